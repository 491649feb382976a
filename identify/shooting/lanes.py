"""Many stick-slip cycles at once, coarsely: the simulator behind starts and initial nodes.

Every lane has its own parameters, drive speed, normal force and start state. Here they rest until they break away, as
`sliding_lanes` has it from there. Accurate to a fraction of a percent, which is what a start needs; answers come from
`simulate` and the shooting.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.mapped import Mapped
from identify.model.model import ELONGATION, INPUTS, SPEED, TIME, Model
from identify.shooting.sliding_lanes import Slips, slip
from identify.simulation.phases import stick as rest
from identify.simulation.resting import swing
from identify.simulation.situated import Situated

Array = NDArray[np.float64]

NEWTON_STEPS = 40
TREMBLING = 3.0  # times the swing of the drive: a shorter slip is a tremble of the contact, and the stick goes on
MOST_TREMBLES = 30  # before one slip


@lru_cache(maxsize=16)
def _functions(model: Model) -> dict[str, Mapped]:
    x, p, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters)), ca.SX.sym("u", len(INPUTS))
    t = ca.SX.sym("t")
    then = ca.vertcat(u[:TIME], u[TIME] + t)
    rested = model.rest(x, p, then, t)
    spare = model.grip(rested, p, then) - model.driving_force(rested, p, then)
    slope = ca.jacobian(spare, t)
    made = (
        ca.Function("lane_spare", [x, p, u, t], [spare, slope, rested]),
        ca.Function("lane_force", [x, p, u], [model.load_cell(x, p, u)]),
        ca.Function("lane_at_force", [t, p, u], [model.at_force(t, p, u)]),
    )
    return {f.name().removeprefix("lane_"): Mapped(f) for f in made}


def load_cell(model: Model, x: Array, p: Array, u: Array) -> Array:
    """What the load cell sees [N], shape (n,); x (n, n_x), p (n, n_p), u (n, 4)."""
    return _functions(model)["force"]([x, p, u])[0][:, 0]


def stick(model: Model, x: Array, p: Array, u: Array) -> tuple[Array, Array]:
    """Rest each lane until the drive overcomes its grip.

    The spare grip falls convexly at late times, so Newton from a late time converges monotonically. Where the drive
    vibrates it does not: the first onset is searched lane by lane.

    Args:
        u: (n, 4), time at the start of the rest.

    Returns:
        stick time (n,) [s] (0 where the lane is moved at once, NaN where nothing ever moves it), state at
        the onset (n, n_x).
    """
    functions = _functions(model)
    k = p[:, model.parameter_names.index("stiffness")]
    x = x.copy()
    x[:, SPEED] = 0.0
    saturated = functions["spare"]([x, p, u, np.full(x.shape[0], 1e12)])[0][:, 0]
    with np.errstate(all="ignore"):
        t = (saturated + k * u[:, 0] * 1e12) / (k * u[:, 0])  # the grip of a contact saturated for ever
        t = np.where(np.isfinite(t), np.maximum(t, 0.0), 0.0)
        swings = _swings(model, p)
        if np.any(swings > 0.0):
            longest = t + 2 * swings / np.maximum(k * u[:, 0], 1e-300) + 1e-9
            rests = [
                rest(model, x[i], Situated(p[i], u[i, 0], 1.0, u[i, 1], 0.0, u[i, TIME]), u[i, TIME], longest[i])
                for i in range(t.size)
            ]
            return np.array([r.duration for r in rests]), np.stack([r.x[-1] for r in rests])
        for _ in range(NEWTON_STEPS):
            spare, slope, _state = functions["spare"]([x, p, u, t])
            move = -spare[:, 0] / slope[:, 0]
            t_new = np.maximum(np.where(np.isfinite(move), t + move, t), 0.0)
            done = np.all(np.abs(t_new - t) <= 1e-12 * np.maximum(t, 1e-9))
            t = t_new
            if done:
                break
    state = functions["spare"]([x, p, u, t])[2]
    return t, state


def break_away(model: Model, x: Array, p: Array, u: Array, per_half_period: int) -> tuple[Array, Slips]:
    """Rest each lane and let it slip; where the drive vibrates, the trembles before the slip count as rest.

    Near the end of a stick a vibration lets the contact slip by no more than it moves itself, some times over, before
    it slides away: such slips are below the noise of a log, and no falls that are seen.

    Returns:
        time from x to the slip (n,) [s], as that of `stick`; the slips.
    """
    time, at_onset = stick(model, x, p, u)
    slips = slip(model, at_onset, p, _later(u, time), per_half_period)
    swings = _swings(model, p)
    shortest = TREMBLING * swings / p[:, model.parameter_names.index("stiffness")]
    for _ in range(MOST_TREMBLES):
        moved = at_onset[:, ELONGATION] - slips.at_arrest[:, ELONGATION]
        again = np.flatnonzero(slips.rested & (swings > 0.0) & (moved < shortest))
        if again.size == 0:
            break
        since = time[again] + slips.arrest[again]
        more, at_onset[again] = stick(model, slips.at_arrest[again], p[again], _later(u[again], since))
        time[again] = since + more
        later = slip(model, at_onset[again], p[again], _later(u[again], time[again]), per_half_period)
        slips = slips.replaced(again, later)
    return time, slips


def _swings(model: Model, p: Array) -> Array:
    """Force of what oscillates in the drive on the contact of each lane (n,) [N]."""
    if not model.vibrates:
        return np.zeros(p.shape[0])
    return np.array([swing(model, lane)[1] for lane in p])


def _later(u: Array, t: Array) -> Array:
    """The inputs t (n,) [s] later."""
    return np.column_stack([u[:, :TIME], u[:, TIME] + np.nan_to_num(t)])


def at_force(model: Model, force: Array, p: Array, u: Array) -> Array:
    """States (n, n_x) in which resting lanes settle at these load cell forces (n,) [N]."""
    return _functions(model)["at_force"]([force, p, u])[0]
