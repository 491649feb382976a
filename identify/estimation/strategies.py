"""The strategies by which a fit may find its answer, and the trace of what was tried.

Each try is one entry of the trace (`search` in result.json), and an answer carries the names of the strategies that led
to it (`Attempt.found_by`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING

from identify.base.budget import now, time_is_up

if TYPE_CHECKING:
    from identify.estimation.attempt import Attempt


class Strategy(Enum):
    """The value is the name in the trace."""

    PIECES_FIRST = "pieces first"  # solves what repeats itself within a programme, then the whole log
    FEATURE_START = "feature start"  # solves from the start whose settled cycle is that of the data
    FURTHER_STARTS = "further feature starts"  # from more of these, where the first does not fit
    HELD_NEAR = "held near a start"  # under firm priors about a start, then without them, where nothing fits
    GROUP_BY_GROUP = "group by group"  # solves groups with parameters of their own each by itself, then together
    STICK_STRENGTHS = "strength per stick"  # lets sticks differ, where alike ones do not fit, or only by their loads
    JOINED = "logs joined"  # solves again with the logs that took no part
    FINER_STEPS = "finer steps"  # halves steps whose error is no small part of a standard error
    OTHER_OPTIMA = "other optima"  # solves from starts about an answer that hardly determines some parameter
    PROFILE_OPTIMUM = "optimum of a profile"  # solves from a lower point that a profile met
    LOG_EFFECTS = "scatter between logs"  # lets friction of single logs be off, where no cause in common is named
    CAUSES = "refit of a cause"  # frees what the score test names first


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
    """What a fit tried, in order; what was due when the time was up; strategies switched off; those that led to the
    answer."""

    trials: list[Trial] = field(default_factory=list)
    not_tried: list[str] = field(default_factory=list)
    switched_off: frozenset[Strategy] = frozenset()
    found_by: tuple[str, ...] = ()


_trace: ContextVar[Trace | None] = ContextVar("trace", default=None)


@contextmanager
def tracing(switched_off: Iterable[Strategy] = ()) -> Iterator[Trace]:
    """Collect what is tried inside; a trace within a trace is part of the outer one."""
    outer = _trace.get()
    trace = outer if outer is not None else Trace(switched_off=frozenset(switched_off))
    token = _trace.set(trace)
    try:
        yield trace
    finally:
        _trace.reset(token)


@contextmanager
def as_one_trial(strategy: Strategy, detail: str) -> Iterator[None]:
    """All that is tried inside is one entry of the trace: a hypothesis is a whole fit of its own."""
    outer, began = _trace.get(), now()
    token = _trace.set(Trace(switched_off=frozenset() if outer is None else outer.switched_off))
    try:
        yield
    finally:
        _trace.reset(token)
        if outer is not None:
            outer.trials.append(Trial(f"{strategy.value}: {detail}", (), "examined", None, now() - began))


def may_run(strategy: Strategy) -> bool:
    """Whether a strategy may still be tried: it is not switched off, and there is time; else noted as not tried."""
    trace = _trace.get()
    return not (trace is not None and strategy in trace.switched_off) and in_time(strategy.value)


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


def run_strategy(
    strategy: Strategy, make: Callable[[], Attempt | None], since: Attempt | None = None, logs: Sequence[int] = ()
) -> Attempt | None:
    """What one strategy comes to, as an entry of the trace; None where it comes to nothing or is not due.

    Args:
        since: the attempt it goes on from. logs: numbers (from 0) it was tried with, where it comes to nothing.
    """
    if not may_run(strategy):
        return None
    began = now()
    found = make()
    seconds = now() - began
    found = None if found is since else found
    status, cost = "no answer", None
    if found is not None:
        before = () if since is None else since.found_by
        after = found.found_by[len(before) :] if found.found_by[: len(before)] == before else found.found_by
        found = replace(found, found_by=(*before, strategy.value, *after))
        logs, status, cost = found.log_numbers, found.gate.status.value, found.cost_per_sample
    trace = _trace.get()
    if trace is not None:
        trace.trials.append(Trial(strategy.value, tuple(i + 1 for i in logs), status, cost, seconds))
    return found
