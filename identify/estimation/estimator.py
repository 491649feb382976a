"""What an estimator is: prepared logs and unknowns go in; values, covariance, curves and a verdict come out.

`fit` has one of its own (multiple shooting) and takes any other that keeps to this protocol. The
time it may take is ambient: `base.budget.seconds_left` tells, and every solve of this package keeps to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.estimation.covariance import Estimate
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.scene import Scene

Array = NDArray[np.float64]


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
