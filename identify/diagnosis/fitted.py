"""One model on the data: what a fit of it came to, and another model fitted from where that one ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.estimation.attempt import Attempt, solve_from, usable
from identify.estimation.search import SearchProblem, search
from identify.logs.prepare import Prepared
from identify.logs.scene_records import prepare_scene
from identify.logs.unknowns import Unknowns
from identify.scene import Scene

Array = NDArray[np.float64]

MISFIT = 3.0  # standard deviations of the sum of squares that are still noise
COST_CUTOFF = 1000.0  # half chi^2 above that of a model beyond which another one is not followed further


@dataclass(frozen=True)
class Fitted:
    """One model on the data: its scene, search space and prepared logs; the attempt (None where nothing could be
    tried)."""

    scene: Scene
    unknowns: Unknowns
    prepared: tuple[Prepared, ...]
    attempt: Attempt | None

    @property
    def excess(self) -> float:
        """Sum of squares in noise variances less the number of samples; infinite without a motion of the model."""
        return np.inf if self.attempt is None else self.attempt.excess

    @property
    def samples(self) -> int:
        """Number of samples that count in the attempt; 0 without one."""
        return 0 if self.attempt is None else self.attempt.solved.problem.samples

    @property
    def logs(self) -> tuple[int, ...]:
        """Which logs took part."""
        return () if self.attempt is None else self.attempt.log_numbers

    @property
    def searched(self) -> int:
        """Number of free parameters, with those every log has for itself."""
        logs = len(self.logs) if self.attempt is not None else len(self.prepared)
        return int(np.count_nonzero(self.unknowns.free)) + (logs - 1) * int(np.count_nonzero(self.unknowns.own))

    @property
    def fits(self) -> bool:
        """Whether the misfit is about noise."""
        return self.excess < MISFIT * np.sqrt(2.0 * max(self.samples, 1))


def fit_model(scene: Scene, records: Sequence[Record], *, thorough: bool = False) -> Fitted:
    """Fit one scene to its records, from the first start of the data, or as many as it takes."""
    preparation = prepare_scene(scene, records)
    attempt, _ = search(SearchProblem(preparation.logs, preparation.unknowns, thorough=thorough))
    return Fitted(scene, preparation.unknowns, tuple(preparation.logs), attempt)


def fit_beside(other: Fitted, scene: Scene, records: Sequence[Record]) -> Fitted:
    """Fit a model from where another one ended; where that misfits, from the data as well."""
    preparation, known = prepare_scene(scene, records), other.attempt
    if known is None:
        return fit_model(scene, records)
    at = replace(preparation.unknowns, start=values_of(other, preparation.unknowns))
    attempt = solve_from(preparation.logs, usable(preparation.logs), at, known.solved.solution.cost + COST_CUTOFF)
    best = Fitted(scene, preparation.unknowns, tuple(preparation.logs), attempt)
    if best.logs == other.logs and best.fits:
        return best
    searched = fit_model(scene, records)
    return min(best, searched, key=lambda each: (each.logs != other.logs, each.excess))


def values_of(other: Fitted, unknowns: Unknowns) -> Array:
    """The start of a model (n_p,) with what another one searched where that ended."""
    assert other.attempt is not None
    names = other.unknowns.names
    theta = dict(zip(names, other.attempt.solved.theta.tolist(), strict=True))
    searched = dict(zip(names, other.unknowns.free.tolist(), strict=True))
    start = np.array([theta[n] if searched.get(n) else unknowns.start[i] for i, n in enumerate(unknowns.names)])
    return np.clip(np.where(unknowns.free, start, unknowns.start), unknowns.lower, unknowns.upper)
