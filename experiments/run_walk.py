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
from pathlib import Path
from types import FrameType

sys.path.insert(0, str(Path(__file__).parents[1]))

import identify
from experiments.machine import describe
from identify import Scene, examples, fit

HOUSE = Path(identify.__file__).parent
ROOMS = re.findall(
    r"^\|[^|]*\| `([\w.]+?)/?` \|", (HOUSE.parent / "docs" / "rooms.md").read_text("utf-8"), re.MULTILINE
)


def _file(frame: FrameType) -> str | None:
    path = Path(frame.f_code.co_filename)
    return path.relative_to(HOUSE).as_posix() if path.is_relative_to(HOUSE) else None


def walked(work: Callable[[Scene], object]) -> tuple[set[str], set[tuple[str, str]]]:
    """Files (relative to identify/) that ran, and (caller, called) pairs of files, of work with the example pair."""
    files, calls = set[str](), set[tuple[str, str]]()

    def note(frame: FrameType, event: str, _argument: object) -> None:
        called, caller = _file(frame), frame.f_back
        if event != "call" or called is None:
            return
        files.add(called)
        while caller is not None and _file(caller) is None:
            caller = caller.f_back
        if caller is not None and _file(caller) != called:
            calls.add((str(_file(caller)), called))

    scene = Scene.from_toml(examples.SCENE)
    sys.setprofile(note)
    try:
        work(scene)
    finally:
        sys.setprofile(None)
    return files, calls


def main(fast: bool = False) -> None:
    """Print what was counted; fast: of reading a scene alone."""
    files, calls = walked((lambda _: Scene.from_toml(examples.SCENE)) if fast else fit)
    floor = {file: ROOMS.index(file.split("/")[0]) for file in files | {file for call in calls for file in call}}
    climbs = sorted(call for call in calls if floor[call[1]] > floor[call[0]])
    print(f"{describe()}\n{len(files)} files, {len(calls)} calls from file to file, {len(climbs)} into a higher room:")
    print("\n".join(f"  {caller} -> {called}" for caller, called in climbs))
    print(", ".join(f"{room} {count}" for room, count in Counter(file.split("/")[0] for file in files).most_common()))


if __name__ == "__main__":
    main()
