"""How long a batch will still take, from what it took so far."""

from __future__ import annotations

import time


class Pace:
    """Counts the work done, in bytes of logs; what is left is expected to go as fast."""

    def __init__(self, total: int) -> None:
        self._began = time.monotonic()
        self._total, self._done = total, 0

    def add(self, size: int) -> None:
        """So much more is done."""
        self._done += size

    def remaining(self) -> float | None:
        """Expected seconds to the end; None while nothing is done yet."""
        if not self._done:
            return None
        return (time.monotonic() - self._began) * max(self._total - self._done, 0) / self._done


def in_words(seconds: float) -> str:
    """ "40 s", "5 min", "3 h 20 min"."""
    minutes = round(seconds / 60)
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
