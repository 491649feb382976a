"""What a fit found, as the result document takes it; and the rig as it was stated, against the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identify.base.result import CauseResult, HeldResult, Status
from identify.diagnosis.quantities import held_quantities
from identify.diagnosis.score_test import ScoreTable, score_table
from identify.estimation.attempt import Attempt
from identify.estimation.certainty import Certainty
from identify.estimation.covariance import Estimate, Information
from identify.estimation.estimator import Estimated, Trace
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS
from identify.scene import Scene

Array = NDArray[np.float64]

VAGUE = 1.0  # standard error of a logarithm beyond which the data say nothing of it


def held_scores(attempt: Attempt, unknowns: Unknowns) -> ScoreTable:
    """The scores of all that an attempt took as stated."""
    return score_table(attempt.solved, held_quantities(attempt, unknowns), attempt.inflation)


def against_data(table: ScoreTable, unknowns: Unknowns, rig: Mapping[str, float]) -> dict[str, HeldResult]:
    """Mass, stiffness and damping as stated (rig, by name [SI]) against what the data say of them to first order, with
    all that was free set free."""
    out, scores = {}, {score.column.name: score for score in table.scores}
    for name in (name for name in RIG_PARAMETERS if name in scores):
        score = scores[name]
        prior = unknowns.prior_sd[unknowns.names.index(name)] if score.column.prior else 0.0  # its error is in the step
        error = float(np.sqrt(max(score.error**2 - prior**2, 0.0)))
        if error < VAGUE:
            value = rig[name] * float(np.exp(score.step))
            out[name] = HeldResult(rig[name], value, value * error, unknowns.model.parameter(name).unit, score.score)
    return out


@dataclass(frozen=True)
class Findings:
    """What a fit found: status and sentence, the attempt that was accepted or came closest (None without one), why
    logs took no part, what is known of its parameters (None where nothing is); held: the rig as it was stated,
    against the data; scores: of all that was stated; causes: those a misfit may come of; trace: what was tried;
    estimator: its name; estimated: what an estimator found that is not the plain one; scene: that of the answer
    where it is not the one that was given; explained: whether a cause was confirmed, or the data are refused;
    scatter: relative standard deviation of friction from log to log where the answer is one of logs that differ,
    else 0; restart: (n_p,) theta of a better fit with all as stated, from which the search starts again, or None."""

    status: Status
    message: str
    unknowns: Unknowns
    attempt: Attempt | None = None
    left_out: Mapping[int, str] = field(default_factory=dict)
    sure: Certainty | None = None
    held: Mapping[str, HeldResult] = field(default_factory=dict)
    scores: ScoreTable | None = None
    causes: tuple[CauseResult, ...] = ()
    trace: Trace = field(default_factory=Trace)
    estimator: str = "plain"
    estimated: Estimated | None = None
    scene: Scene | None = None
    explained: bool = False
    scatter: float = 0.0
    restart: Array | None = None

    @property
    def estimates(self) -> Sequence[Estimate]:
        """Of all parameters; none where nothing is known of them."""
        if self.estimated is not None:
            return self.estimated.estimates
        return [] if self.sure is None else self.sure.estimates

    @property
    def information(self) -> Information | None:
        """Of the data on all parameters, at the answer."""
        return None if self.sure is None else self.sure.information

    @property
    def covariance(self) -> Array | None:
        """Of theta of the free parameters (f, f)."""
        return None if self.sure is None else self.sure.covariance
