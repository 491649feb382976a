"""What is said of an orbit: drop, period, speeds and forces of its cycle, and how they move with the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.prediction.cycle import Cycle, CycleMap, loads
from identify.prediction.orbit import Orbit
from identify.prediction.path import along
from identify.prediction.slip import SlipSegment
from identify.prediction.windows import StickSlipLimit
from identify.simulation.sliding import slidings

# ----------------------------------------------------------------------------------------------------------------------
# Where the force that the load cell sees is highest and lowest in a cycle: what a lab calls the size of a jump.
#
# Neither lies at a switch. The mass starts from rest, so the drive loads the spring for a while after the onset of
# slip; before the arrest the mass is slower than the drive, which loads it again. At low speed the force from peak to
# valley is that from onset to arrest; near the end of stick-slip it is many times as large.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

SHARP = 1e-12  # of a step of the integration: how well the place of an extreme is found


@dataclass(frozen=True)
class Extreme:
    """A highest or lowest force [N]: `length` [s] into the step from node `node` of the slip, which belongs to
    `segment`. Without a segment the force is extreme at the node itself, where the motion switches."""

    force: float
    node: int
    segment: SlipSegment | None = None
    length: float = 0.0


def extremes(map_: CycleMap, cycle: Cycle) -> tuple[Extreme, Extreme]:
    """The highest and the lowest force of a cycle: between the nodes of the integration, by its own steps."""
    forces = np.array([map_.load(x, cycle.setting) for x in cycle.slip_motion.x])
    map_.slip_integrator.set(cycle.setting)
    return _extreme(map_, cycle, forces, 1.0), _extreme(map_, cycle, forces, -1.0)


def peak_to_valley(map_: CycleMap, cycle: Cycle) -> float:
    """The force from its highest to its lowest in a cycle [N]."""
    highest, lowest = extremes(map_, cycle)
    return highest.force - lowest.force


def peak_to_valley_slope(map_: CycleMap, cycle: Cycle) -> Array:
    """Its derivatives (m,) by the rest state before the cycle and by the setting; NaN where an extreme lies at a switch
    in the middle of a slip."""
    w, slip_motion, onset = cycle.setting, cycle.slip_motion, map_.onset_slopes(cycle)
    found = extremes(map_, cycle)
    sums = np.zeros((2, *slip_motion.x.shape))
    direct = np.zeros((2, w.size))
    for i, extreme in enumerate(found):
        # The force stands still there, so that the time of it does not matter.
        if extreme.segment is None:
            sums[i, extreme.node], direct[i] = map_.load_slopes(slip_motion.x[extreme.node], w)
            continue
        x = slip_motion.x[extreme.node]
        after = map_.slip_integrator.step(extreme.segment.mode, x, extreme.length, extreme.segment.direction)
        by_state, by_setting = map_.load_slopes(after, w)
        step = map_.slip_integrator.step_tangents(extreme.segment, np.append(x, extreme.length)[None], w.size)[0]
        sums[i, extreme.node] = by_state @ step[:, : x.size]
        direct[i] = by_setting + by_state @ step[:, x.size :]
    _, slopes = map_.slip_integrator.tangents(slip_motion, w, onset, sums)
    slopes[:, -w.size :] += direct
    for i, extreme in enumerate(found):
        if extreme.segment is None and extreme.node > 0:
            slopes[i] = np.nan
    return np.asarray(slopes[0] - slopes[1])


def _extreme(map_: CycleMap, cycle: Cycle, forces: Array, sign: float) -> Extreme:
    """Of the forces at the nodes (s+1,) the highest (sign 1) or lowest (-1), with the steps beside it looked into."""
    top = int(np.argmax(sign * forces))
    best = Extreme(float(forces[top]), top)
    for segment in cycle.slip_motion.segments:
        for node in range(max(segment.first, top - 1), min(segment.last, top + 1)):
            length = _turn(map_, cycle, segment, node, sign)
            if length is not None:
                after = map_.slip_integrator.step(segment.mode, cycle.slip_motion.x[node], length, segment.direction)
                force = map_.load(after, cycle.setting)
                if best.segment is None or sign * force > sign * best.force:
                    best = Extreme(force, node, segment, length)
    return best


def _turn(map_: CycleMap, cycle: Cycle, segment: SlipSegment, node: int, sign: float) -> float | None:
    """How far into the step from a node the force turns, from rising to falling (sign 1) or the other way; None where
    it does not."""
    x, slip_integrator = cycle.slip_motion.x[node], map_.slip_integrator
    step = float(cycle.slip_motion.t[node + 1] - cycle.slip_motion.t[node])

    def rising(length: float) -> float:
        after = slip_integrator.step(segment.mode, x, length, segment.direction) if length else x
        by_state, _ = map_.load_slopes(after, cycle.setting)
        return sign * float(by_state @ slip_integrator.rate(segment.mode, after, segment.direction))

    if not (step > 0.0 and rising(0.0) > 0.0 > rising(step)):
        return None
    return float(brentq(rising, 0.0, step, xtol=SHARP * step))


# ----------------------------------------------------------------------------------------------------------------------
# How the orbit and steady sliding move with the parameters: implicit differentiation of the closed cycle.
# ----------------------------------------------------------------------------------------------------------------------

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


def end_slopes(map_: CycleMap, limit: StickSlipLimit, names: Sequence[str]) -> Array:
    """Derivatives of a limit of stick-slip [m/s] by parameters: shape (len(names),), NaN where not to be had."""
    return np.asarray(limit.slopes[_columns(map_, names)])


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
