"""How much memory a log may take, asked before it is read."""

import contextlib
import sys
from pathlib import Path
from typing import Final

from data_io.errors import LogTooLargeError
from data_io.source import Source

_SHARE: Final = 0.5
"""Of the free memory, that the columns of one log may take: whoever looks at them needs as much again."""
_SMALL: Final = 1 << 26
"""Bytes that are never refused."""


def check_memory(source: Source, numbers: int) -> None:
    """Refuse so many float64 numbers where they do not fit into memory. Raises `LogTooLargeError`."""
    wanted, free = 8 * numbers, free_memory()
    if wanted <= _SMALL or free is None or wanted <= _SHARE * free:
        return
    refused = source.error(
        f"the columns asked for take {wanted / 1e9:.3g} GB where {free / 1e9:.3g} GB of memory are free; read a part "
        'of the log with --window "0 s,100 s" (in a scene: window = ["0 s", "100 s"] in its [[logs]]), one step with '
        "--step, or fewer columns with --channels"
    )
    raise LogTooLargeError(str(refused))


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
