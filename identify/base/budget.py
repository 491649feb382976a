"""The time a fit may take: a deadline that every solve and every loop of the search sees, however deep it runs.

It is ambient, like a signal: a deadline handed down as an argument would have to pass through every function between
`fit` and IPOPT, and none of them does anything with it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

DEFAULT_TIME_LIMIT = 60.0
"""Of a fit [s], where neither the scene nor the command says another."""

_deadline: ContextVar[float] = ContextVar("deadline", default=math.inf)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """What runs inside sees at most so many seconds [s] from now; a limit inside another one cannot extend it."""
    token = _deadline.set(min(_deadline.get(), now() + seconds))
    try:
        yield
    finally:
        _deadline.reset(token)


@contextmanager
def no_time_limit() -> Iterator[None]:
    """What runs inside was asked for by itself (a bootstrap, a profile of every parameter) and takes what it takes."""
    token = _deadline.set(math.inf)
    try:
        yield
    finally:
        _deadline.reset(token)


def now() -> float:
    """The clock of all limits [s]."""
    return time.perf_counter()


def seconds_left() -> float:
    """Until the deadline [s], not below 0; infinite where there is none."""
    return max(_deadline.get() - now(), 0.0)


def time_is_up() -> bool:
    """Whether the deadline has passed."""
    return now() >= _deadline.get()
