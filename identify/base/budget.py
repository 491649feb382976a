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
    """What runs inside counts to this stage; a stage within another one is part of that."""
    seconds = _seconds.get()
    if seconds is None or _stage.get() is not None:
        yield
        return
    token, began = _stage.set(name), time.perf_counter()
    try:
        yield
    finally:
        _stage.reset(token)
        seconds[name] = max(seconds.get(name, 0.0) + time.perf_counter() - began, 0.0)  # clocks differ by their ticks


def of_which(part: str, seconds: float, of: str) -> None:
    """So many seconds of a stage, where it is the one under way, count to a stage of their own."""
    stages = _seconds.get()
    if stages is not None and _stage.get() == of:
        stages[part] = stages.get(part, 0.0) + seconds
        stages[of] = stages.get(of, 0.0) - seconds
