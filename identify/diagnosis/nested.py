"""One model and smaller ones inside it, fitted to the same logs: what each effect gains on the data.

A smaller model starts from the motion of the larger one, and where that fails from the data alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.diagnosis.fitted import Fitted, fits, taken_over, values_of
from identify.estimation.attempt import Attempt, solve_from, usable
from identify.estimation.search import SearchProblem, alike, search
from identify.estimation.starts import Sources
from identify.logs.prepare import Prepared
from identify.logs.prepared_scene import prepare_scene
from identify.logs.unknowns import Unknowns
from identify.scene import Scene
from identify.shooting.passes import solve_in_passes
from identify.shooting.shooting import shooting_problem
from identify.shooting.solve import solve

Array = NDArray[np.float64]

FAR = 0.5  # sum of squares per sample (in noise variances) above that of the larger model: look for a better start
DOUBT = 5.0  # sum of squares above that of the larger model: under a vibrating drive it may be another course of slips
COST_CUTOFF = 1000.0  # half statistic beyond which a smaller model is not followed further
GLANCE = 8  # iterations that show whether an effect is worth a fit
CLOSED = 1e-2  # largest row of a trajectory that hangs together well enough for that


def fit_model(scene: Scene, records: Sequence[Record], *, thorough: bool = True, sources: Sources = "data") -> Fitted:
    """Fit one scene to its records.

    Args:
        thorough: where the first start fails, try many.
        sources: starts from the data, from the values of the scene, or both.
    """
    prepared, unknowns = _prepared(scene, records)
    attempt, _ = search(SearchProblem(prepared, unknowns, sources, thorough=False))
    failed = attempt is not None and not attempt.solved.solution.success
    # Unlike cycles leave no other start to try.
    more = attempt is None or (failed and alike([prepared[i] for i in usable(prepared)]))
    if thorough and more:
        attempt, _ = search(SearchProblem(prepared, unknowns, sources))
    return Fitted(scene, unknowns, tuple(prepared), attempt, _excess(attempt))


def fit_larger(smaller: Fitted, scene: Scene, records: Sequence[Record]) -> Fitted:
    """Fit a model with one effect more, or another one in its place, from the motion of the smaller one; where that
    misfits, also from its parameters alone: the motion of a misfit can hold back what would describe the data."""
    prepared, unknowns = _prepared(scene, records)
    cost_cutoff = np.inf if smaller.attempt is None else smaller.attempt.solved.solution.cost + COST_CUTOFF
    warm = _warm(smaller, prepared, unknowns, cost_cutoff)
    best = Fitted(scene, unknowns, tuple(prepared), warm, _excess(warm))
    if smaller.attempt is None or fits(smaller) or fits(best):
        return best
    return _better(best, _placed_anew(smaller, scene, prepared, unknowns), smaller)


def _prepared(scene: Scene, records: Sequence[Record]) -> tuple[list[Prepared], Unknowns]:
    made = prepare_scene(scene, records)
    return made.logs, made.unknowns


def _excess(attempt: Attempt | None) -> float:
    return np.inf if attempt is None else attempt.excess


def fit_smaller(larger: Fitted, scene: Scene, records: Sequence[Record], *, thorough: bool = True) -> Fitted:
    """Fit a model that lacks an effect of a larger one: from the larger one's motion, else from the data.

    Args:
        thorough: where its motion leads far off, the data are tried as well.
    """
    prepared, unknowns = _prepared(scene, records)
    cost_cutoff = np.inf if larger.attempt is None else larger.attempt.solved.solution.cost + COST_CUTOFF
    warm = _warm(larger, prepared, unknowns, cost_cutoff)
    best = Fitted(scene, unknowns, tuple(prepared), warm, _excess(warm))
    if larger.attempt is not None and unknowns.model.vibrates and best.excess > larger.excess + DOUBT:
        best = _better(best, _placed_anew(larger, scene, prepared, unknowns), larger)
    samples = larger.attempt.solved.problem.samples if larger.attempt is not None else 1
    if best.excess - larger.excess < FAR * samples or (warm is not None and not thorough):
        return best
    attempt, _ = search(SearchProblem(prepared, unknowns, thorough=False))
    return _better(best, Fitted(scene, unknowns, tuple(prepared), attempt, _excess(attempt)), larger)


def _better(best: Fitted, other: Fitted, beside: Fitted) -> Fitted:
    """The other fit where its misfit is smaller and it has all the logs of the model it is compared with."""
    complete = other.attempt is not None and (
        beside.attempt is None or other.attempt.log_numbers == beside.attempt.log_numbers
    )
    return other if complete and other.excess < best.excess else best


def _warm(other: Fitted, prepared: list[Prepared], unknowns: Unknowns, cost_cutoff: float = np.inf) -> Attempt | None:
    """A model solved from the motion of another one; None where its states do not allow that."""
    known, small, large = other.attempt, unknowns.model, other.model
    if known is None or (small.clamped is None and large.clamped is not None):
        return None
    logs, trajectories, unknowns = taken_over(other, prepared, unknowns)
    try:
        solved = solve_in_passes(
            [log.data for log in logs], trajectories, unknowns.with_weak_priors(), cost_cutoff=cost_cutoff
        )
    except (ValueError, FloatingPointError):
        return None
    return replace(known, fitted_logs=tuple(logs), solved=solved)


def fit_from_values(other: Fitted, scene: Scene, records: Sequence[Record]) -> Fitted:
    """Fit a model from the parameters of another one, its motion placed anew on the data."""
    return _placed_anew(other, scene, *_prepared(scene, records))


def _placed_anew(other: Fitted, scene: Scene, prepared: list[Prepared], unknowns: Unknowns) -> Fitted:
    attempt = solve_from(prepared, usable(prepared), replace(unknowns, start=values_of(other, unknowns)))
    return Fitted(scene, unknowns, tuple(prepared), attempt, _excess(attempt))


def promise(smaller: Fitted, scene: Scene, records: Sequence[Record]) -> float:
    """About the statistic that one more effect would gain on the data: a few iterations, on the solution's grid."""
    if smaller.attempt is None:
        return np.inf
    prepared, unknowns = _prepared(scene, records)
    solved = smaller.attempt.solved
    logs, trajectories, unknowns = taken_over(smaller, prepared, unknowns)
    problem = shooting_problem([log.data for log in logs], trajectories, unknowns.with_weak_priors(), solved.grid)
    tried = solve(problem, tolerance=1e-3, mu_init=1e-6, iterations=GLANCE)
    return 2.0 * (solved.solution.cost - tried.cost) if tried.constraint_violation < CLOSED else np.inf
