"""Studies that are run in parts: a line of JSON per case, appended to a file as it comes."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from identify.base import budget


def by_processor_time() -> None:
    """Time limits of fits count processor time from here on: cases of one study get the same on a busy machine."""
    budget.time = SimpleNamespace(perf_counter=time.process_time)  # type: ignore[assignment]


def append(file: Path | None, line: Mapping[str, Any]) -> None:
    """Add one case to the file, where there is one."""
    if file is not None:
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(line) + "\n")


def read(paths: Sequence[str | Path]) -> list[dict[str, Any]]:
    """The cases of all files."""
    return [json.loads(line) for path in paths for line in Path(path).read_text(encoding="utf-8").splitlines()]


def cases(study: Callable[[int, int, Path], object]) -> Callable[[Sequence[str]], None]:
    """The part of a study that a command line names: FIRST LAST FILE."""

    def part(said: Sequence[str]) -> None:
        study(int(said[0]), int(said[1]), Path(said[2]))

    return part


def kind_and_cases(study: Callable[[str, int, int, Path], object]) -> Callable[[Sequence[str]], None]:
    """The part of a study of several kinds that a command line names: KIND FIRST LAST FILE."""

    def part(said: Sequence[str]) -> None:
        study(said[0], int(said[1]), int(said[2]), Path(said[3]))

    return part


def started(
    main: Callable[[], object],
    table: Callable[[list[dict[str, Any]]], None],
    part: Callable[[list[str]], object],
) -> None:
    """Do what the command line says: nothing: the whole study; "table FILE...": the table of finished cases; else
    the part that its words name."""
    said = sys.argv[1:]
    if not said:
        main()
    elif said[0] == "table":
        table(read(said[1:]))
    else:
        part(said)
