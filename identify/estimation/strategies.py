"""The trace of a fit: what was tried, in order, and what the time did not suffice for (`search` in result.json)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from identify.base.budget import now, time_is_up

if TYPE_CHECKING:
    from identify.estimation.attempt import Attempt

FINER_STEPS = "finer steps"


@dataclass(frozen=True)
class Trial:
    """One try: strategy; logs it took part with (numbers from 1); how it ended; 2 x cost per sample, None where there
    is none; seconds it took, with what it tried inside."""

    strategy: str
    logs: tuple[int, ...]
    status: str
    cost: float | None
    seconds: float


@dataclass
class Trace:
    """What a fit tried, in order; what was due when the time was up."""

    trials: list[Trial] = field(default_factory=list)
    not_tried: list[str] = field(default_factory=list)


_trace: ContextVar[Trace | None] = ContextVar("trace", default=None)


@contextmanager
def tracing(*, apart: bool = False) -> Iterator[Trace]:
    """Collect what is tried inside; a trace within a trace is part of the outer one, unless it stands apart."""
    outer = _trace.get()
    trace = outer if outer is not None and not apart else Trace()
    token = _trace.set(trace)
    try:
        yield trace
    finally:
        _trace.reset(token)


def in_time(part: str) -> bool:
    """Whether there is time for a part of a fit; else the part is noted as not tried."""
    if time_is_up():
        no_time_for(part)
        return False
    return True


def no_time_for(part: str) -> None:
    """Note that the time did not suffice for a part of a fit."""
    trace = _trace.get()
    if trace is not None and part not in trace.not_tried:
        trace.not_tried.append(part)


def tried(
    strategy: str, make: Callable[[], Attempt | None], since: Attempt | None = None, logs: Sequence[int] = ()
) -> Attempt | None:
    """What one strategy comes to, as an entry of the trace; None where it comes to nothing or the time is up.

    Args:
        since: the attempt it goes on from. logs: numbers (from 0) it was tried with, where it comes to nothing.
    """
    if not in_time(strategy):
        return None
    began, status, cost = now(), "no answer", None
    found = make()
    found = None if found is since else found
    if found is not None:
        logs, status, cost = found.log_numbers, found.gate.status.value, found.cost_per_sample
    note(Trial(strategy, tuple(i + 1 for i in logs), status, cost, now() - began))
    return found


def note(trial: Trial) -> None:
    """Add an entry to the trace."""
    trace = _trace.get()
    if trace is not None:
        trace.trials.append(trial)
