"""A motion simulated without inertia, and its samples: as `trajectory`, the speed following from the balance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.model.model import Model
from identify.simulation.quasistatic_collocation import CLOSE, NEWTON_STEPS, NODES, local_function, stage_function
from identify.simulation.quasistatic_phases import BalancedPhase
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

METHOD = "radau in balance"  # the name by which its method is reported
BRIEF = 1e-6  # of a step: what is nearer to its start lies on a straight line


@dataclass(frozen=True)
class BalancedTrajectory(Trajectory):
    """A motion without inertia: phases with speeds, and the same samples as with it."""

    phases: Sequence[BalancedPhase]

    @property
    def methods(self) -> tuple[str, ...]:
        """The one method there is, where anything slides."""
        return (METHOD,) if any(phase.mode != "stick" for phase in self.phases) else ()

    def _moments(self, t: Array) -> dict[str, Array]:
        """The samples at rising times t (n,) [s], the force of the moment."""
        names = (*(s.name for s in self.model.states), "sliding_speed")
        out = {name: np.empty(t.size) for name in (*names, "force", "normal_force", "coefficient", "sliding")}
        starts = np.array([p.start for p in self.phases])
        cuts = np.append(np.searchsorted(t, starts[1:], side="left"), t.size)
        first = 0
        for phase, last in zip(self.phases, cuts.tolist(), strict=True):
            if last > first:
                _sample_phase(self.model, phase, t[first:last] - phase.start, out, slice(first, last))
            first = last
        return out


def _sample_phase(model: Model, phase: BalancedPhase, t: Array, out: dict[str, Array], where: slice) -> None:
    """Fill the samples of one phase; t (n,) is local to it."""
    s, n = phase.situated, t.size
    t = np.clip(t, 0.0, phase.duration)
    p, u = np.repeat(s.p[:, None], n, axis=1), s.at(t, s.direction)
    speeds = np.zeros((1, n))
    if phase.mode == "stick":
        x = np.array(model.rest(np.repeat(phase.x[0][:, None], n, axis=1), p, u, t[None, :]))
        load = np.array(model.driving_force(x, p, u)).ravel()
    else:
        x, speeds = _within(model, phase, t)
        load = np.array(model.load(x, p, u, speeds)).ravel()
    for i, state in enumerate(model.states):
        out[state.name][where] = x[i]
    out["sliding_speed"][where] = s.direction * speeds[0]
    out["force"][where] = np.array(model.load_cell(x, p, u, speeds)).ravel()
    out["normal_force"][where] = u[1]
    out["coefficient"][where] = load / u[1]
    out["sliding"][where] = float(phase.mode != "stick")


def _within(model: Model, phase: BalancedPhase, t: Array) -> tuple[Array, Array]:
    """States (n_x, n) and speeds (1, n) at times t (n,) of a slide: a shorter step from the node before each."""
    s, n = phase.situated, t.size
    node = np.clip(np.searchsorted(phase.t, t, side="right") - 1, 0, max(phase.t.size - 2, 0))
    at, x0, v0 = phase.t[node], phase.x[node].T, phase.v[node][None, :]
    whole = phase.t[np.minimum(node + 1, phase.t.size - 1)] - at
    h = t - at
    taken = np.maximum(h, BRIEF * whole)
    share = np.divide(h, taken, out=np.zeros(n), where=taken > 0.0)
    p, drive = np.repeat(s.p[:, None], n, axis=1), np.repeat(s.inputs[:, None], n, axis=1)
    x, v = _step(model, phase, (x0, v0, p, drive), at, taken)
    x = x0 + share * (x - x0)
    local = np.array(local_function(model, phase.mode)(x, v, p, drive, t[None, :]))
    speeds = np.where(share < 1.0, v0[0] + share * (v[0] - v0[0]), local[-2])
    return x, np.where(phase.t[-1] == t, phase.v[-1], speeds)[None, :]


def _step(
    model: Model, phase: BalancedPhase, given: tuple[Array, Array, Array, Array], at: Array, h: Array
) -> tuple[Array, Array]:
    """States and speeds after a step of each lane, by Newton's method on all of them together."""
    x, v, p, drive = given
    n, lanes = x.shape
    slopes = np.array(local_function(model, phase.mode)(x, v, p, drive, at[None, :]))[:n]
    growth = np.concatenate([slopes, np.zeros((1, lanes))])
    first = np.concatenate([x, v])
    stages = np.concatenate([first + c * h * growth for c in NODES])
    function, size = stage_function(model, phase.mode), 3 * (n + 1)
    for _ in range(NEWTON_STEPS):
        result = np.array(function(stages, x, p, drive, at[None, :], h[None, :]))
        matrices = result[size:].T.reshape(lanes, size, size).transpose(0, 2, 1)
        change = np.linalg.solve(matrices, result[:size].T[:, :, None])[:, :, 0].T
        stages = stages - change
        if np.all(
            np.abs(change[-n - 1 : -1]) <= CLOSE * (1e-300 + np.max(np.abs(stages[-n - 1 : -1]), axis=1))[:, None]
        ):
            break
    return stages[-n - 1 : -1], stages[-1:]
