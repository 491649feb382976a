"""What an estimator is: prepared logs and unknowns go in; values, covariance, curves and a verdict come out; and the
trace of what was tried, in order, and what the time did not suffice for (`search` in result.json).

`fit` has one of its own (multiple shooting) and takes any other that keeps to this protocol. The
time it may take is ambient: `base.budget.seconds_left` tells, and every solve of this package keeps to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import now, time_is_up
from identify.base.progress import Progress
from identify.base.result import SearchTrial, Status
from identify.estimation.covariance import Estimate
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.scene import Scene

if TYPE_CHECKING:
    from identify.estimation.attempt import Attempt

Array = NDArray[np.float64]

FINER_STEPS = "finer steps"


@dataclass(frozen=True)
class EstimationTask:
    """What is to be estimated: the scene; its logs as they were prepared, those left out among them; the unknowns; the
    seed of all that is drawn; progress(stage, share of the whole or None)."""

    scene: Scene
    logs: Sequence[Prepared]
    unknowns: Unknowns
    seed: int
    progress: Progress


@dataclass(frozen=True)
class Estimated:
    """What an estimator found.

    status and message: how it ended, in one sentence that says what to do where it did not converge; it names the part
    of each record the answer rests on, where that is not all of it.
    estimates: of the parameters of the model and of those of the estimator's own, SI, each with verdict and reason.
    names, covariance: (f,) names and (f, f) covariance [SI] of those estimates that have a standard error.
    curves: per log the fitted friction force (n,) [N] at the samples of its record, NaN where nothing was fitted; None
    for a log without one. left_out: by number of a log (from 0) why it took no part.
    more: further keys of result.json, JSON-able. notes: what a reader has to know beside the message, in sentences.
    """

    status: Status
    message: str
    estimates: Sequence[Estimate]
    names: Sequence[str] = ()
    covariance: Array = field(default_factory=lambda: np.empty((0, 0)))
    curves: Sequence[Array | None] = ()
    left_out: Mapping[int, str] = field(default_factory=dict)
    more: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()


class Estimator(Protocol):
    """An estimator; `name` stands in result.json ("estimator")."""

    @property
    def name(self) -> str:
        """One word, lower case."""

    def estimate(self, task: EstimationTask) -> Estimated:
        """Estimate; a failure is a status with a sentence, never an exception.

        Raises:
            FitError: what cannot be set up, one sentence.
        """


# The trace of a fit.


@dataclass
class Trace:
    """What a fit tried, in order; what was due when the time was up."""

    trials: list[SearchTrial] = field(default_factory=list)
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
        solved, logs, status = found.solved, found.log_numbers, found.gate.status.value
        squares = 2.0 * solved.solution.cost / max(solved.problem.samples, 1)
        cost = squares if np.isfinite(squares) else None
    note(SearchTrial(strategy, tuple(i + 1 for i in logs), status, cost, round(now() - began, 4)))
    return found


def note(trial: SearchTrial) -> None:
    """Add an entry to the trace."""
    trace = _trace.get()
    if trace is not None:
        trace.trials.append(trial)
