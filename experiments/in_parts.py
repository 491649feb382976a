"""Studies that are run in parts: a line of JSON per case, and time limits that count processor time."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from identify.base import budget


def by_processor_time() -> None:
    """Time limits of fits count processor time from here on: cases of one study get the same on a busy machine."""
    budget.time = SimpleNamespace(perf_counter=time.process_time)  # type: ignore[assignment]
    if abs(budget.now() - time.process_time()) > 1.0:
        raise RuntimeError("the clock of the limits is another one than the one that was set")


def read(paths: Sequence[str | Path]) -> list[dict[str, Any]]:
    """The cases of all files."""
    return [json.loads(line) for path in paths for line in Path(path).read_text(encoding="utf-8").splitlines()]
