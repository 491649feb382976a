"""One model on the data: what a fit of it came to, and another model fitted from where that one ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.estimation.attempt import Attempt, retested, solve_from, usable
from identify.estimation.search import SearchProblem, alike, search
from identify.logs.prepare import Prepared
from identify.logs.prepared_scene import prepare_scene
from identify.logs.unknowns import Unknowns
from identify.model.model import Model
from identify.scene import Scene
from identify.shooting.passes import solve_in_passes
from identify.shooting.shooting_trajectory import ShootingTrajectory

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


def fit_model(scene: Scene, records: Sequence[Record], *, thorough: bool = True) -> Fitted:
    """Fit one scene to its records; where the first start fails, from more of them if it is to be thorough."""
    made = prepare_scene(scene, records)
    attempt, _ = search(SearchProblem(made.logs, made.unknowns, thorough=False))
    failed = attempt is not None and not attempt.solved.solution.success
    # Unlike cycles leave no other start to try.
    more = attempt is None or (failed and alike([made.logs[i] for i in usable(made.logs)]))
    if thorough and more:
        attempt, _ = search(SearchProblem(made.logs, made.unknowns))
    return Fitted(scene, made.unknowns, tuple(made.logs), attempt)


def fit_beside(other: Fitted, scene: Scene, records: Sequence[Record]) -> Fitted:
    """Fit a model from the motion of another one; where that misfits, where its states allow none, or the drive
    vibrates, also from its parameters alone, and in the end from the data: the motion of a misfit can hold back what
    would describe them."""
    made = prepare_scene(scene, records)
    prepared, unknowns, known = made.logs, made.unknowns, other.attempt
    if known is None:
        return fit_model(scene, records, thorough=False)
    cutoff = known.solved.solution.cost + COST_CUTOFF
    best = Fitted(scene, unknowns, tuple(prepared), _from_motion(other, prepared, unknowns, cutoff))
    if best.fits or (best.attempt is not None and other.fits and not unknowns.model.vibrates):
        return best
    at = replace(unknowns, start=values_of(other, unknowns))
    placed = replace(best, attempt=solve_from(prepared, usable(prepared), at, cost_cutoff=cutoff))
    best = placed if placed.logs == other.logs and placed.excess < best.excess else best
    if np.isfinite(best.excess) or other.fits:
        return best
    searched = fit_model(scene, records, thorough=False)
    return searched if searched.logs == other.logs else best


def _from_motion(other: Fitted, prepared: list[Prepared], unknowns: Unknowns, cost_cutoff: float) -> Attempt | None:
    """A model solved from the motion of another one; None where its states do not allow that."""
    known = other.attempt
    if known is None or (unknowns.model.clamped is None and other.unknowns.model.clamped is not None):
        return None
    logs, trajectories, unknowns = taken_over(other, prepared, unknowns)
    try:
        data, soft = [log.data for log in logs], unknowns.with_weak_priors()
        solved = solve_in_passes(data, trajectories, soft, cost_cutoff=cost_cutoff)
    except (ValueError, FloatingPointError):
        return None
    return retested(replace(known, fitted_logs=tuple(logs), solved=solved))


# ----------------------------------------------------------------------------------------------------------------------
# Logs, motion and start of a model as another model left them.
# ----------------------------------------------------------------------------------------------------------------------


def values_of(other: Fitted, unknowns: Unknowns) -> Array:
    """The start of a model (n_p,) with what another one searched where that ended."""
    assert other.attempt is not None
    names = other.unknowns.names
    theta = dict(zip(names, other.attempt.solved.theta.tolist(), strict=True))
    searched = dict(zip(names, other.unknowns.free.tolist(), strict=True))
    for index, to, base in other.unknowns.ties:  # what followed another parameter goes on from there
        theta[names[index]] = theta[names[to]] + (np.log(base) if other.unknowns.logarithmic[index] else base)
        searched[names[index]] = True
    start = np.array([theta[n] if searched.get(n) else unknowns.start[i] for i, n in enumerate(unknowns.names)])
    return np.clip(np.where(unknowns.free, start, unknowns.start), unknowns.lower, unknowns.upper)


def taken_over(
    other: Fitted, prepared: Sequence[Prepared], unknowns: Unknowns
) -> tuple[list[Prepared], list[ShootingTrajectory], Unknowns]:
    """Logs, motion and start of a model as another one left them."""
    known = other.attempt
    assert known is not None
    logs, trajectories = list[Prepared](), list[ShootingTrajectory]()
    for i, cut, motion in zip(known.log_numbers, known.fitted_logs, known.solved.trajectories, strict=True):
        data = replace(prepared[i].data, begin=cut.data.begin, end=cut.data.end)
        logs.append(replace(prepared[i], fit_mode=cut.fit_mode, data=data))
        p = other.unknowns.values(motion.theta(known.solved.theta), cut.data.base)
        trajectories.append(_translated(motion, other.unknowns.model, unknowns.model, p))
    return logs, trajectories, replace(unknowns, start=values_of(other, unknowns))


def _translated(trajectory: ShootingTrajectory, large: Model, small: Model, p: Array) -> ShootingTrajectory:
    """The motion in the states of another model; a load cell that did not lag shows what its lag would.

    Args:
        p: parameters (n_p,) of the model the motion is from.
    """
    names = [s.name for s in large.states]
    lags = [i for i, s in enumerate(small.states) if s.unit == "N" and s.name not in names]

    def states(x: Array) -> Array:
        out = np.stack(
            [x[..., names.index(s.name)] if s.name in names else 0.0 * x[..., 0] + s.start for s in small.states],
            axis=-1,
        )
        if lags and x.size:
            flat = x.reshape(-1, x.shape[-1])
            u = np.tile([0.0, 1.0, 1.0, 0.0], (flat.shape[0], 1))
            shown = large.load(flat.T, np.repeat(p[:, None], flat.shape[0], axis=1), u.T)
            out[..., lags] = np.array(shown).reshape(x.shape[:-1])[..., None]
        for name in set(names) - {s.name for s in small.states}:
            if name == large.series_state:
                out[..., 0] -= x[..., names.index(name)]
        return out

    own = trajectory.own
    if own.size:
        at = [large.parameter_names.index(n) if n in large.parameter_names else -1 for n in small.parameter_names]
        own = np.where(np.array(at) >= 0, own[at], np.nan)
    return replace(trajectory, start=states(trajectory.start), nodes=states(trajectory.nodes), own=own)
