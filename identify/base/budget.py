"""The time a fit may take and where it goes: a deadline and stages that every solve sees, however deep it runs.

Both are ambient, like a signal: handed down as arguments they would have to pass through every function between `fit`
and IPOPT, and none of them does anything with them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar

DEFAULT_TIME_LIMIT = 60.0
"""Of a fit [s], where neither the scene nor the command states another."""

_deadline: ContextVar[float] = ContextVar("deadline", default=math.inf)
_seconds: ContextVar[dict[str, float] | None] = ContextVar("seconds", default=None)
_stage: ContextVar[str | None] = ContextVar("stage", default=None)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """What runs inside sees at most so many seconds [s] from now; infinite: no limit, whatever holds outside."""
    token = _deadline.set(min(_deadline.get(), now() + seconds) if math.isfinite(seconds) else math.inf)
    try:
        yield
    finally:
        _deadline.reset(token)


def no_time_limit() -> AbstractContextManager[None]:
    """What runs inside was requested by itself (a bootstrap, a profile of every parameter) and takes what it takes."""
    return time_limit(math.inf)


def now() -> float:
    """The clock of all limits [s]."""
    return time.perf_counter()


def seconds_left() -> float:
    """Until the deadline [s], not below 0; infinite where there is none."""
    return max(_deadline.get() - now(), 0.0)


def time_is_up() -> bool:
    """Whether the deadline has passed."""
    return now() >= _deadline.get()


@contextmanager
def timing_stages() -> Iterator[dict[str, float]]:
    """Seconds by stage (reading, starts, solving …) of what runs inside, by the clock."""
    seconds: dict[str, float] = {}
    token = _seconds.set(seconds)
    try:
        yield seconds
    finally:
        _seconds.reset(token)


@contextmanager
def stage(name: str) -> Iterator[None]:
    """What runs inside counts to this stage, and not to the one it is within."""
    seconds, outer = _seconds.get(), _stage.get()
    token, began = _stage.set(name), now()
    try:
        yield
    finally:
        _stage.reset(token)
        spent = now() - began
        if seconds is not None:
            seconds[name] = seconds.get(name, 0.0) + spent
            if outer is not None:  # which counts all of it when it ends
                seconds[outer] = seconds.get(outer, 0.0) - spent
