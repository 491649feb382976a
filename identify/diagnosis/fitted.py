"""One model on the data: what a fit of it came to, comparable with fits of other models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.estimation.attempt import Attempt, usable
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.model.model import Model
from identify.scene import Scene
from identify.shooting.shooting_trajectory import ShootingTrajectory

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
        return () if self.attempt is None else self.attempt.log_numbers

    @property
    def complete(self) -> bool:
        """Whether all logs that can be used took part."""
        return set(self.logs) >= set(usable(list(self.prepared)))

    @property
    def searched(self) -> int:
        """Number of free parameters, with those every log has for itself."""
        logs = len(self.attempt.log_numbers) if self.attempt is not None else len(self.prepared)
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


# ----------------------------------------------------------------------------------------------------------------------
# Logs, motion and start of a model as another model left them.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


def values_of(other: Fitted, unknowns: Unknowns) -> Array:
    """The start of a model (n_p,) with what another one searched where that ended."""
    assert other.attempt is not None
    names = other.model.parameter_names
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
    known, small, large = other.attempt, unknowns.model, other.model
    assert known is not None
    start = values_of(other, unknowns)
    logs = [
        replace(
            prepared[i], fit_mode=cut.fit_mode, data=replace(prepared[i].data, begin=cut.data.begin, end=cut.data.end)
        )
        for i, cut in zip(known.log_numbers, known.fitted_logs, strict=True)
    ]
    trajectories = [
        _translated(g, large, small, large_p)
        for g, large_p in zip(
            known.solved.trajectories,
            (
                other.unknowns.values(g.theta(known.solved.theta), log.data.base)
                for g, log in zip(known.solved.trajectories, known.fitted_logs, strict=True)
            ),
            strict=True,
        )
    ]
    return logs, trajectories, replace(unknowns, start=start)


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
            shown = np.array(large.load(flat.T, np.repeat(p[:, None], flat.shape[0], axis=1), u.T)).reshape(
                x.shape[:-1]
            )
            out[..., lags] = shown[..., None]
        for name in set(names) - {s.name for s in small.states}:
            if name == large.series_state:
                out[..., 0] -= x[..., names.index(name)]
        return out

    own = trajectory.own
    if own.size:
        at = [large.parameter_names.index(n) if n in large.parameter_names else -1 for n in small.parameter_names]
        own = np.where(np.array(at) >= 0, own[at], np.nan)
    return replace(
        trajectory,
        start=states(trajectory.start),
        nodes=states(trajectory.nodes),
        own=own,
    )
