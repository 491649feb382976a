"""One model on the data: what a fit of it came to, comparable with fits of other models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identify.base.outcome import Status
from identify.estimation.attempt import Attempt, usable
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.model.model import Model
from identify.scene import Scene

MISFIT = 3.0  # standard deviations of the sum of squares that are still noise


@dataclass(frozen=True)
class Fitted:
    """One model on the data: its scene, search space and prepared logs; the attempt (None where nothing could be
    tried); excess: the sum of squares in noise variances less the number of samples (infinite without an answer)."""

    scene: Scene
    unknowns: Unknowns
    prepared: tuple[Prepared, ...]
    attempt: Attempt | None
    excess: float

    @property
    def model(self) -> Model:
        """The composed model."""
        return self.unknowns.model

    @property
    def samples(self) -> int:
        """Number of samples that count in the attempt; 0 without one."""
        return 0 if self.attempt is None else self.attempt.solved.problem.samples

    @property
    def logs(self) -> tuple[int, ...]:
        """Which logs took part."""
        return () if self.attempt is None else self.attempt.logs

    @property
    def complete(self) -> bool:
        """Whether all logs that can be used took part."""
        return set(self.logs) >= set(usable(list(self.prepared)))

    @property
    def searched(self) -> int:
        """Number of free parameters, with those every log has for itself."""
        logs = len(self.attempt.logs) if self.attempt is not None else len(self.prepared)
        return int(np.count_nonzero(self.unknowns.free)) + (logs - 1) * int(np.count_nonzero(self.unknowns.own))


def as_it_ended(scene: Scene, unknowns: Unknowns, prepared: Sequence[Prepared], attempt: Attempt | None) -> Fitted:
    """A fit as it ended, whether the solver succeeded or not."""
    excess = np.inf if attempt is None else 2.0 * attempt.solved.solution.cost - attempt.solved.problem.samples
    return Fitted(scene, unknowns, tuple(prepared), attempt, float(excess))


def fits(fitted: Fitted) -> bool:
    """Whether the misfit is about noise."""
    if fitted.attempt is None:
        return False
    return bool(fitted.excess < MISFIT * np.sqrt(2.0 * fitted.samples))


def described(fitted: Fitted) -> bool:
    """Whether the misfit is about noise, one with a memory too."""
    accepted = fitted.attempt is not None and fitted.attempt.gate.status is Status.CONVERGED
    return accepted or fits(fitted)
