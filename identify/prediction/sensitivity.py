"""How the orbit and steady sliding move with the parameters: implicit differentiation of the closed cycle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identify.prediction.branch import along
from identify.prediction.cycle import Cycle, CycleMap, loads
from identify.prediction.extremes import peak_to_valley, peak_to_valley_slope
from identify.prediction.orbit import Orbit
from identify.prediction.sliding import slidings
from identify.prediction.windows import Limit

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
    "peak_to_valley": "N",
}  # what is said of an orbit, and its unit
STEP = 1e-5  # relative, of a parameter
LEAST = 1e-3  # a parameter that is zero is moved by STEP times this


def quantities(map_: CycleMap, cycle: Cycle, drive_speed: float) -> Array:
    """QUANTITIES of a cycle, shape (9,), SI."""
    onset, arrest = loads(map_, cycle)
    distance = drive_speed * cycle.slip - float(cycle.end[0] - cycle.onset[0])
    period = cycle.stick + cycle.slip
    jump = [onset - arrest, period, cycle.stick, cycle.slip, distance, cycle.peak_speed, onset, arrest]
    return np.array([*jump, peak_to_valley(map_, cycle)])


def _columns(map_: CycleMap, names: Sequence[str]) -> list[int]:
    return [map_.names.index(name) for name in names]


def orbit_slopes(map_: CycleMap, orbit: Orbit, names: Sequence[str]) -> Array:
    """Derivatives of QUANTITIES along the orbit by parameters, "drive_speed" or "normal_force": (9, len(names)).

    Each is q_w + q_y (1 - J)^-1 F_w: the cycle moves with the setting, and with the rest state that closes it.
    """
    n, t = map_.scale.size, orbit.tangent
    rows = np.stack(
        [
            t.onset_load - t.arrest_load,
            t.stick + t.slip,
            t.stick,
            t.slip,
            t.distance,
            t.peak_speed,
            t.onset_load,
            t.arrest_load,
            peak_to_valley_slope(map_, orbit.cycle),
        ]
    )
    closing = along(map_.scale, t, orbit.jacobian)
    return np.asarray((rows[:, n:] + rows[:, :n] @ closing)[:, _columns(map_, names)])


def end_slopes(map_: CycleMap, limit: Limit, names: Sequence[str]) -> Array:
    """Derivatives of a limit of stick-slip [m/s] by parameters: shape (len(names),), NaN where not to be had."""
    return np.asarray(limit.slopes[_columns(map_, names)])


def growth_slopes(map_: CycleMap, drive_speed: float, names: Sequence[str]) -> Array:
    """Derivatives of the growth rate of steady sliding [1/s] by parameters, "drive_speed" or "normal_force"."""
    return sliding_slopes(map_, drive_speed, names)[0]


def sliding_slopes(map_: CycleMap, drive_speed: float, names: Sequence[str]) -> tuple[Array, Array]:
    """Derivatives of the growth rate [1/s] and of the force [N] of steady sliding, (len(names),) each, by parameters,
    "drive_speed" or "normal_force"; by central differences."""
    if not names:
        return np.zeros(0), np.zeros(0)
    columns, w = _columns(map_, names), map_.setting(drive_speed)
    steps = STEP * np.where(w == 0.0, LEAST, np.abs(w))[columns]
    moved = np.zeros((len(columns), w.size))
    moved[np.arange(len(columns)), columns] = steps
    each = np.concatenate([w + moved, w - moved])
    found = slidings(map_.model, np.ascontiguousarray(each[:, :-2]), each[:, -1], each[:, -2])
    table = np.array([[state.growth, state.force] for state in found])
    slopes = (table[: len(columns)] - table[len(columns) :]) / (2.0 * steps[:, None])
    return slopes[:, 0], slopes[:, 1]
