"""Memory that is used again: what the C library gives back to the system between two steps has to be asked for anew."""

from __future__ import annotations

from typing import Final

import numpy as np

LARGEST: Final = 4_000_000  # numbers of an array that is still below the 32 MiB up to which glibc learns


def keep_freed_memory() -> None:
    """Let the process keep up to 64 MB that it has freed.

    Steps of a fit of a long log make and free arrays of some megabytes. glibc hands such memory back and then takes a
    page fault for every 4 KB of the next array: an eighth of the time of a fit of a million samples. It stops that for
    blocks as large as one that it has seen come and go (M_MMAP_THRESHOLD in mallopt(3)), so one comes and goes here;
    nothing is written to it. Other C libraries take no notice.
    """
    np.empty(LARGEST)
