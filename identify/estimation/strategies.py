"""The table of strategies: every way by which a fit may find its answer, and the trace of what was tried.

Rows that start are tried from top to bottom until an answer fits (`search.STARTS`); the others where they belong: they
repair an attempt, look about an answer, or explain a misfit. Each try is one entry of the trace (`search` in
result.json), and an answer carries the names of the strategies that led to it (`Attempt.found_by`).
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
    """One row: name; when it applies; what it does."""

    # From a start to an answer of some logs.
    PIECES_FIRST = "pieces first", "a log repeats itself within a programme", "solves what repeats, then the whole log"
    FEATURE_START = "feature start", "always", "solves from the start whose settled cycle is that of the data"
    FURTHER_STARTS = "further feature starts", "the first start did not fit", "solves from up to three more of these"
    HELD_NEAR = "held near a start", "nothing fitted", "solves under firm priors about a start, then without them"
    STEADY_PARTS = "steady parts", "logs end in steady sliding and nothing fitted", "fits the level of their last part"
    GROUP_BY_GROUP = "group by group", "parameters differ between groups", "solves each group, then all together"
    # From an attempt that does not fit to one that does.
    STICK_STRENGTHS = "strength per stick", "cycles misfit, or only their loads explain them", "lets sticks differ"
    JOINED = "logs joined", "some logs took no part", "solves again with them, from the answer"
    # From an answer that fits to a better one, or to one whose motion is sure.
    VIBRATION_STARTS = "starts about the answer", "the drive vibrates", "solves from starts drawn about the answer"
    FINER_STEPS = "finer steps", "integration errors are no small part of a standard error", "halves the steps"
    OTHER_OPTIMA = "other optima", "the data hardly tell some parameter", "solves from starts about the answer"
    PROFILE_OPTIMUM = "optimum of a profile", "a profile meets a better place", "solves from there"
    # What the model as stated cannot be.
    CAUSES = "refit of a cause", "nothing fitted, or an answer is doubtful", "frees what the score test names first"

    def __init__(self, title: str, when: str, does: str) -> None:
        self.title, self.when, self.does = title, when, does


STRATEGIES: tuple[Strategy, ...] = tuple(Strategy)


@dataclass(frozen=True)
class Trial:
    """One try: strategy; logs it took part with (numbers from 1); how it ended; 2 x cost per sample, None where there
    is none; seconds it took, with what it tried inside."""

    strategy: str
    logs: tuple[int, ...]
    status: str
    cost: float | None
    seconds: float

    def to_dict(self) -> dict[str, object]:
        """As in `search` of result.json."""
        return {
            "strategy": self.strategy,
            "logs": list(self.logs),
            "status": self.status,
            "cost": self.cost,
            "seconds": round(self.seconds, 4),
        }


@dataclass
class Trace:
    """What a fit tried, in order; strategies that were due when the time was up; those switched off, for an ablation;
    those that led to the answer."""

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
            seconds = now() - began
            outer.trials.append(Trial(f"{strategy.title}: {detail}", (), "examined", None, seconds))


def may_run(strategy: Strategy) -> bool:
    """Whether a strategy may still be tried: it is not switched off, and there is time; else noted as not tried."""
    trace = _trace.get()
    if trace is not None and strategy in trace.switched_off:
        return False
    return in_time(strategy.title)


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


def cut_short() -> bool:
    """Whether something was due that the time did not suffice for."""
    trace = _trace.get()
    return trace is not None and bool(trace.not_tried)


def run_strategy(
    strategy: Strategy, make: Callable[[], Attempt | None], since: Attempt | None = None, logs: Sequence[int] = ()
) -> Attempt | None:
    """What one strategy comes to, as an entry of the trace; None where it comes to nothing or is not due.

    Args:
        make: does it. since: the attempt it goes on from. logs: numbers (from 0) it was tried with, where it comes to
            nothing.
    """
    if not may_run(strategy):
        return None
    began = now()
    found = make()
    seconds = now() - began
    if found is since:
        found = None
    if found is not None:
        before = () if since is None else since.found_by
        after = found.found_by[len(before) :] if found.found_by[: len(before)] == before else found.found_by
        found = replace(found, found_by=(*before, strategy.title, *after))
    trace = _trace.get()
    if trace is not None:
        taken = logs if found is None else found.log_numbers
        status, cost = ("no answer", None) if found is None else (found.gate.status.value, found.cost_per_sample)
        trace.trials.append(Trial(strategy.title, tuple(i + 1 for i in taken), status, cost, seconds))
    return found
