"""How the orbit and the end of stick-slip move with the parameters: implicit differentiation of the closed cycle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identify.branch import Branch, reach
from identify.cycle import SLIDES_AFTER, Cycle, CycleMap, loads, rest_state
from identify.orbit import Orbit, jacobian
from identify.sliding import sliding

Array = NDArray[np.float64]

QUANTITIES = {
    "drop": "N",
    "period": "s",
    "stick_duration": "s",
    "slip_duration": "s",
    "slip_distance": "m",
    "peak_speed": "m/s",
    "onset_force": "N",
    "arrest_force": "N",
}  # what is said of an orbit, and its unit
STEP = 1e-5  # relative, of a parameter
LEAST = 1e-3  # a parameter that is zero is moved by STEP times this
BEFORE_END = 2e-3  # relative distance to the end of the branch at which its motion is read off


def quantities(map_: CycleMap, cycle: Cycle, drive_speed: float, p: Array | None = None) -> Array:
    """QUANTITIES of a cycle, shape (8,), SI."""
    onset, arrest = loads(map_, cycle, drive_speed, p)
    distance = drive_speed * cycle.slip - float(cycle.end[0] - cycle.onset[0])
    return np.array(
        [
            onset - arrest,
            cycle.stick + cycle.slip,
            cycle.stick,
            cycle.slip,
            distance,
            cycle.peak_speed,
            onset,
            arrest,
        ]
    )


def _moved(map_: CycleMap, y: Array, speed: float, p: Array) -> tuple[Array, Array] | None:
    cycle = map_.run(y, speed, p, patience=2 * SLIDES_AFTER)
    if cycle is None:
        return None
    return rest_state(cycle.end) / map_.scale, quantities(map_, cycle, speed, p)


def orbit_slopes(map_: CycleMap, orbit: Orbit, names: Sequence[str]) -> Array:
    """Derivatives of QUANTITIES along the orbit by parameters, or "drive_speed": shape (8, len(names)).

    Each entry is q_p + q_y (1 - J)^-1 F_p with central differences of one cycle (no orbit is solved again);
    NaN in a column whose differences leave the orbit's domain.
    """
    y, speed, p = orbit.y, orbit.drive_speed, map_.p
    slope = jacobian(map_, y, speed, orbit.cycle, 2 * SLIDES_AFTER)
    by_y = np.zeros((len(QUANTITIES), y.size))
    here = quantities(map_, orbit.cycle, speed)
    for i in range(y.size):
        moved = y.copy()
        moved[i] += STEP * map_.scale[i]
        other = _moved(map_, moved, speed, p)
        by_y[:, i] = np.nan if other is None else (other[1] - here) / STEP
    out = np.full((len(QUANTITIES), len(names)), np.nan)
    for j, name in enumerate(names):
        ends = []
        at = speed if name == "drive_speed" else p[map_.model.parameter_names.index(name)]
        step = STEP * (abs(at) or LEAST)
        for sign in (1.0, -1.0):
            changed, v = p.copy(), speed
            if name == "drive_speed":
                v = speed + sign * step
            else:
                changed[map_.model.parameter_names.index(name)] += sign * step
            ends.append(_moved(map_, y, v, changed))
        up, down = ends
        if up is None or down is None:
            continue
        closing = np.linalg.solve(np.eye(y.size) - slope, (up[0] - down[0]) / (2 * step))
        out[:, j] = (up[1] - down[1]) / (2 * step) + by_y @ closing
    return out


def end_slopes(map_: CycleMap, branch: Branch, names: Sequence[str]) -> Array:
    """Derivatives of the end of a branch [m/s] by parameters: shape (len(names),), NaN where not to be had.

    Just before the end the orbit's drop goes like the square root of what is left, so the speed at which
    it has a given value moves as the end does: d end/dp = -(d drop/dp)/(d drop/dv).
    """
    none = np.full(len(names), np.nan)
    if branch.end is None:
        return none
    target = branch.end * (1 - BEFORE_END)
    below = [o for o in branch.orbits if o.drive_speed < target]
    orbit = reach(map_, below[-1], target, lambda _: 2 * SLIDES_AFTER) if below else branch.orbits[-1]
    if orbit is None:
        return none
    slopes = orbit_slopes(map_, orbit, [*names, "drive_speed"])[0]
    return np.asarray(-slopes[:-1] / slopes[-1])


def growth_slopes(map_: CycleMap, drive_speed: float, names: Sequence[str]) -> Array:
    """Derivatives of the growth rate of steady sliding [1/s] by parameters, by central differences."""
    out = np.empty(len(names))
    for j, name in enumerate(names):
        i = map_.model.parameter_names.index(name)
        step = STEP * (abs(map_.p[i]) or LEAST)
        rates = []
        for sign in (1.0, -1.0):
            p = map_.p.copy()
            p[i] += sign * step
            rates.append(sliding(map_.model, p, drive_speed, map_.normal_force).growth)
        out[j] = (rates[0] - rates[1]) / (2 * step)
    return out


def deviation(slopes: Array, covariance: Array) -> Array:
    """Standard deviations of quantities with `slopes` (..., n) under a covariance (n, n); NaN where unknown."""
    variance = np.einsum("...i,ij,...j->...", slopes, covariance, slopes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
