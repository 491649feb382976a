"""How much memory a log may take, asked before it is read."""

import contextlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from data_io.errors import LogTooLargeError
from data_io.packing import LEAST_SUSPECT
from data_io.source import Source

_SHARE: Final = 0.5
"""Of the free memory, that the columns of one log may take: whoever looks at them needs as much again."""
FEWEST_COLUMNS: Final = 3
"""A clock and two forces."""
_MOST_PACKED: Final = 1100
"""Times that deflation can pack bytes that are all alike."""
_MOST_UNWRITTEN: Final = 10
"""Times the bytes that were written: a logger asks for room, and may stop before it is used."""
_SMALL: Final = 1 << 26
"""Bytes that are never refused."""


def check_memory(source: Source, rows: int, columns: int, until: Callable[[int], float]) -> None:
    """Refuse so many float64 numbers where they do not fit into memory; until: tells the time [s] of a row.

    Raises `LogTooLargeError`.
    """
    wanted, free = 8 * rows * columns, free_memory()
    if wanted <= _SMALL or free is None or wanted <= _SHARE * free:
        return
    stop = f"{until(int(rows * _SHARE * free / wanted) - 1):.4g} s"
    fewer = ", or fewer columns with --channels none" if columns > FEWEST_COLUMNS else ""
    refused = source.error(
        f"the columns asked for take {wanted / 1e9:.3g} GB where {free / 1e9:.3g} GB of memory are free; read a part "
        f'of the log with --window "0 s,{stop}" (in a scene: window = ["0 s", "{stop}"] in its [[logs]]), one step '
        f"with --step{fewer}"
    )
    raise LogTooLargeError(str(refused))


def check_promise(source: Source, name: str, promised: int, stored: int, packed: bool) -> None:
    """Refuse a column that promises so many bytes and holds next to none: no memory is taken for them.

    packed: whether its bytes are compressed. Raises the source's `LogError`.
    """
    if promised > max(LEAST_SUSPECT, (_MOST_PACKED if packed else _MOST_UNWRITTEN) * stored):
        raise source.error(
            f"the dataset {name!r} promises {promised / 1e6:.4g} MB and holds {stored / 1e6:.3g} MB; was it never "
            "written to its end? Copy or export it again"
        )


def free_memory() -> int | None:
    """Return the bytes that this process may still take, None where the system does not tell."""
    told = [_of_system(), _of_process()]
    return min((size for size in told if size is not None), default=None)


def _of_system() -> int | None:
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return None


def _of_process() -> int | None:
    """Where a limit is set for the process (ulimit -v)."""
    if sys.platform == "win32":
        return None
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return None
    with contextlib.suppress(OSError, ValueError, IndexError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        return max(limit - pages * resource.getpagesize(), 0)
    return limit
