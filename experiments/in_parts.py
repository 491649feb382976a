"""Studies that are run in parts: a line of JSON per case, appended to a file as it comes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def append(file: Path | None, line: Mapping[str, Any]) -> None:
    """Add one case to the file, where there is one."""
    if file is not None:
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(line) + "\n")


def read(paths: Sequence[str | Path]) -> list[dict[str, Any]]:
    """The cases of all files."""
    return [json.loads(line) for path in paths for line in Path(path).read_text(encoding="utf-8").splitlines()]
