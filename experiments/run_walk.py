"""How far a fit walks through the house: which files of `identify/` run, and which calls climb to a higher room.

The example pair is fitted under `sys.setprofile`. A file counts when one of its functions runs. A call is counted once
per pair of files, whatever lies between them outside the package; it climbs where the file called stands in a room that
docs/rooms.md lists after the caller's: what is handed down as a function, or taken by name.

    python experiments/run_walk.py
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import identify
from experiments.machine import describe
from identify import Scene, examples, fit

HOUSE = Path(identify.__file__).parent
ROOMS = re.findall(
    r"^\|[^|]*\| `([\w.]+?)/?` \|", (HOUSE.parent / "docs" / "rooms.md").read_text("utf-8"), re.MULTILINE
)


@dataclass
class Walk:
    """Files (relative to identify/) that ran, and (caller, called) pairs of files."""

    files: set[str] = field(default_factory=set)
    calls: set[tuple[str, str]] = field(default_factory=set)

    def __call__(self, frame: FrameType, event: str, argument: Any) -> None:
        """What `sys.setprofile` calls."""
        called = _file(frame)
        if event != "call" or called is None:
            return
        self.files.add(called)
        caller = frame.f_back
        while caller is not None and _file(caller) is None:
            caller = caller.f_back
        if caller is not None and _file(caller) != called:
            self.calls.add((str(_file(caller)), called))

    @property
    def climbs(self) -> list[tuple[str, str]]:
        """The calls into a higher room."""
        return sorted(call for call in self.calls if _floor(call[1]) > _floor(call[0]))


def _file(frame: FrameType) -> str | None:
    path = Path(frame.f_code.co_filename)
    return path.relative_to(HOUSE).as_posix() if path.is_relative_to(HOUSE) else None


def _floor(file: str) -> int:
    return ROOMS.index(file.split("/")[0])


def walked(work: Callable[[Scene], object]) -> Walk:
    """The walk of what is done with the example pair."""
    walk, scene = Walk(), Scene.from_toml(examples.SCENE)
    sys.setprofile(walk)
    try:
        work(scene)
    finally:
        sys.setprofile(None)
    return walk


def main(fast: bool = False) -> None:
    """Print what was counted; fast: of reading a scene alone."""
    walk = walked((lambda _: Scene.from_toml(examples.SCENE)) if fast else fit)
    print(describe())
    print(f"{len(walk.files)} files, {len(walk.calls)} calls from file to file, {len(walk.climbs)} into a higher room:")
    print("\n".join(f"  {caller} -> {called}" for caller, called in walk.climbs))
    rooms = Counter(file.split("/")[0] for file in walk.files)
    print(", ".join(f"{room} {count}" for room, count in rooms.most_common()))


if __name__ == "__main__":
    main()
