"""Seconds of a fit by stage (reading, starts, solving …): ambient, as its time limit is.

A stage counts by the clock, whatever runs in it: a stage within another one is part of that.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field


@dataclass
class _Stages:
    """Seconds by stage; the one under way."""

    seconds: dict[str, float] = field(default_factory=dict)
    current: str | None = None

    def add(self, name: str, seconds: float) -> None:
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds


_stages: ContextVar[_Stages | None] = ContextVar("stages", default=None)


@contextmanager
def timing_stages() -> Iterator[dict[str, float]]:
    """Seconds by stage of what runs inside."""
    stages = _Stages()
    token = _stages.set(stages)
    try:
        yield stages.seconds
    finally:
        _stages.reset(token)


@contextmanager
def stage(name: str) -> Iterator[None]:
    """What runs inside counts to this stage."""
    stages = _stages.get()
    if stages is None or stages.current is not None:
        yield
        return
    stages.current, began = name, time.perf_counter()
    try:
        yield
    finally:
        stages.current = None
        stages.add(name, time.perf_counter() - began)


def of_which(part: str, seconds: float, of: str) -> None:
    """So many seconds of a stage, where it is the one under way, count to a stage of their own."""
    stages = _stages.get()
    if stages is not None and stages.current == of:
        stages.add(part, seconds)
        stages.add(of, -seconds)
