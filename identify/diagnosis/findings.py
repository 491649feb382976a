"""What the search and the uncertainty found: the stuff the result document is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.result import CauseResult, HeldResult
from identify.estimation.attempt import Attempt
from identify.estimation.certainty import Certainty
from identify.estimation.covariance import Estimate, Information
from identify.estimation.estimator import Estimated
from identify.estimation.strategies import Trace
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS

# ----------------------------------------------------------------------------------------------------------------------
# What was taken as exact, held against the data: the score test.
#
# At an answer the cost is level along every free parameter. Along a rig quantity that was held it need not be: its
# slope, over the information that is left on it with all else free, says where the data would put it, and how surely.
# The misfit of thousands of samples does not see what a few parameters absorb; this does, and costs no fit.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

TOLD = 1e-6  # of the information on a quantity that must be left with all else free
VAGUE = 1.0  # standard error of a logarithm beyond which the data say nothing of it
CLEAR = 25.0  # squared distance that noise does not reach


@dataclass(frozen=True)
class Held:
    """A rig quantity against the data, SI: stated, and its tolerance (one standard deviation, relative; 0 as exact);
    said: where the data would put it, to first order, and the relative standard error of that; squared: distance."""

    name: str
    unit: str
    stated: float
    tolerance: float
    said: float
    error: float
    squared: float

    @property
    def contradicted(self) -> bool:
        """Whether noise cannot be why the data would put it elsewhere."""
        return self.squared > CLEAR


def against_data(
    known: Information, theta: Array, rig: Mapping[str, float], memory: float, *, tolerances: Mapping[str, float]
) -> list[Held]:
    """Mass, stiffness and damping as stated, against what the data say of them with all that was free set free.

    Args:
        known: at the answer theta (n_p,); rig: stated values [SI] by name; tolerances: of those that were not taken as
            exact; memory: by how much the memory of the noise widens a variance.
    """
    unknowns, free = known.unknowns, known.free
    out = []
    for name in (n for n in RIG_PARAMETERS if n in unknowns.names and rig[n] > 0.0):
        i, tolerance = unknowns.names.index(name), tolerances.get(name, 0.0)
        if i not in free:
            left = float(known.total[i, i] + known.total[i, free] @ known.shift(i))
            if not left > TOLD * known.total[i, i]:
                continue
            move, error = -float(known.gradient[i]) / left, float(np.sqrt(memory / left))
        elif tolerance > 0.0 and np.isfinite(unknowns.prior_sd[i]):
            place = int(np.flatnonzero(free == i)[0])
            left = 1.0 / float(known.covariance()[place, place]) - 1.0 / tolerance**2
            if not left > TOLD / tolerance**2:
                continue
            move = float(theta[i]) + float(theta[i]) / (left * tolerance**2)
            error = float(np.sqrt(memory / left))
        else:
            continue
        if error < VAGUE:
            said, squared = rig[name] * float(np.exp(move)), move**2 / (error**2 + tolerance**2)
            out.append(Held(name, unknowns.model.parameters[i].unit, rig[name], tolerance, said, error, squared))
    return out


def held_results(held: list[Held]) -> dict[str, HeldResult]:
    """As the result gives it, by name."""
    return {h.name: HeldResult(h.stated, h.said, h.said * h.error, h.unit, h.squared) for h in held}


@dataclass(frozen=True)
class Findings:
    """What the search and the uncertainty found: status and sentence, the attempt that was accepted or came
    closest (None without one), why logs took no part, what is known of its parameters (None where nothing is); held:
    the rig as it was stated, against the data; causes: the scores of what a misfit may come of; trace: what was tried;
    estimator: its name; estimated: what an estimator found that is not the plain one."""

    status: Status
    message: str
    unknowns: Unknowns
    attempt: Attempt | None = None
    left_out: Mapping[int, str] = field(default_factory=dict)
    sure: Certainty | None = None
    held: list[Held] = field(default_factory=list)
    causes: tuple[CauseResult, ...] = ()
    trace: Trace = field(default_factory=Trace)
    estimator: str = "plain"
    estimated: Estimated | None = None

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
