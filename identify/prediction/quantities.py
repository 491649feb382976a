"""What is said of an orbit: drop, period, speeds and forces of its cycle, and how they move with the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.model.model import SPEED, Model
from identify.model.modes import ModeName
from identify.prediction.orbit import Cycle, CycleMap, Orbit, along, loads
from identify.simulation.phases import Slide
from identify.simulation.steppers import Method
from identify.simulation.tangents import StepExpressions, node_slopes, of_steps, onward, step_slopes, stepped

# ----------------------------------------------------------------------------------------------------------------------
# Where the force that the load cell sees is highest and lowest in a cycle: what a lab calls the size of a jump.
#
# Neither lies at a switch. The mass starts from rest, so the drive loads the spring for a while after the onset of
# slip; before the arrest the mass is slower than the drive, which loads it again. At low speed the force from peak to
# valley is that from onset to arrest; near the end of stick-slip it is many times as large.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

ROUNDS, SPLITS = 2, 16  # of narrowing the place of an extreme in a step, and by how much each round narrows it
FORCE, SPEED_SHOWN = 0, 1  # columns of what is looked at


@dataclass(frozen=True)
class Extreme:
    """A highest or lowest value: `length` [s] into the step from node `node` of slide `part`; 0 where it is extreme at
    the node itself, where the motion switches."""

    value: float
    part: int
    node: int
    length: float = 0.0


def extremes(map_: CycleMap, cycle: Cycle) -> tuple[Extreme, Extreme, Extreme]:
    """The highest and the lowest force of a cycle [N] and its largest speed [m/s]: between the nodes of the
    integration, by its own steps."""
    nodes = [_shown(map_, part, part.x, np.zeros(part.t.size)) for part in cycle.slides]
    highest, lowest, fastest = (
        _extreme(map_, cycle, nodes, column, sign) for column, sign in ((FORCE, 1.0), (FORCE, -1.0), (SPEED_SHOWN, 1.0))
    )
    return highest, lowest, fastest


@lru_cache(maxsize=64)
def _functions(model: Model, method: Method, mode: ModeName) -> Mapped:
    """Of a step: force and speed after it, and how fast they change."""
    step = StepExpressions.of(model, method, mode)
    (_, w, direction), x = step.given, ca.SX.sym("x", len(model.states))
    load = model.load_cell(x, w[:-2], ca.vertcat(w[-1], w[-2], direction, 0))
    force = ca.Function("force", [x, w, direction], [load])
    shown = ca.vertcat(force(step.after, w, direction), step.after[SPEED])
    by_state = ca.Function("by_state", [x, w, direction], [ca.jacobian(load, x)])
    loading = by_state(step.after, w, direction) @ step.rate
    return step.function(shown, ca.vertcat(loading, step.rate[SPEED]))


def _shown(map_: CycleMap, part: Slide, x: Array, lengths: Array) -> tuple[Array, Array]:
    """Force and speed (s, 2) after some lengths (s,) [s] of steps from x (s, n_x), and how fast they change."""
    values, rates = of_steps(_functions(map_.model, part.method, part.mode), part, x, lengths)
    return values, rates


def _extreme(map_: CycleMap, cycle: Cycle, nodes: Sequence[tuple[Array, Array]], column: int, sign: float) -> Extreme:
    """The highest (sign 1) or lowest (-1) of what the nodes show, with the steps beside it looked into."""
    tops = [int(np.argmax(sign * values[:, column])) for values, _ in nodes]
    known = [Extreme(float(nodes[i][0][top, column]), i, top) for i, top in enumerate(tops)]
    for i, (part, top) in enumerate(zip(cycle.slides, tops, strict=True)):
        rates = sign * nodes[i][1][:, column]
        for node in range(max(0, top - 1), min(part.t.size - 1, top + 1)):
            if not rates[node] > 0.0 > rates[node + 1]:
                continue
            ends = np.array([0.0, part.t[node + 1] - part.t[node]])
            for _ in range(ROUNDS):
                lengths = np.linspace(ends[0], ends[1], SPLITS + 1)
                turning = sign * _shown(map_, part, np.repeat(part.x[node][None], SPLITS + 1, 0), lengths)[1][:, column]
                last = max(int(np.argmax(turning <= 0.0)), 1)
                ends, (rising, falling) = lengths[last - 1 : last + 1], turning[last - 1 : last + 1]
            length = ends[0] + rising / (rising - falling) * (ends[1] - ends[0])
            value = _shown(map_, part, part.x[node][None], np.array([length]))[0][0, column]
            known.append(Extreme(float(value), i, node, float(length)))
    return max(known, key=lambda extreme: sign * extreme.value)


def peak_to_valley(map_: CycleMap, cycle: Cycle) -> float:
    """The force from its highest to its lowest in a cycle [N]."""
    highest, lowest, _ = extremes(map_, cycle)
    return highest.value - lowest.value


def _extreme_slopes(map_: CycleMap, cycle: Cycle) -> tuple[Array, Array]:
    """Derivatives (m,) of the largest speed and of the force from peak to valley, by the rest state before the cycle
    and by the setting; NaN where an extreme of the force lies at a switch in the middle of a slip.

    What is extreme stands still, so that the time of it does not matter.
    """
    w, nodes = cycle.setting, node_slopes(map_.model, cycle.slides, map_.onset_slopes(cycle))

    def moved(extreme: Extreme) -> tuple[Array, Array]:
        """The state (n_x,) there, and its derivatives (n_x, m)."""
        part, length = cycle.slides[extreme.part], np.array([extreme.length])
        x = part.x[extreme.node][None]
        slope = step_slopes(map_.model, part, x, length)[0]
        return stepped(map_.model, part, x, length)[0][0], onward(slope, nodes[extreme.part][extreme.node])

    def force(extreme: Extreme) -> Array:
        inside = extreme.length > 0.0 or (extreme.part, extreme.node) == (0, 0)
        x, slope = moved(extreme)
        return map_.load_slope(x, w, slope) if inside else np.full(slope.shape[1], np.nan)

    highest, lowest, fastest = extremes(map_, cycle)
    return moved(fastest)[1][SPEED], force(highest) - force(lowest)


# ----------------------------------------------------------------------------------------------------------------------
# How the orbit moves with the parameters: implicit differentiation of the closed cycle.
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


def quantities(map_: CycleMap, cycle: Cycle, drive_speed: float) -> Array:
    """QUANTITIES of a cycle, shape (9,), SI."""
    onset, arrest = loads(map_, cycle)
    distance = drive_speed * cycle.slip - float(cycle.end[0] - cycle.onset[0])
    period = cycle.stick + cycle.slip
    highest, lowest, fastest = extremes(map_, cycle)
    jump = [onset - arrest, period, cycle.stick, cycle.slip, distance, fastest.value, onset, arrest]
    return np.array([*jump, highest.value - lowest.value])


def _columns(map_: CycleMap, names: Sequence[str]) -> list[int]:
    return [map_.names.index(name) for name in names]


def orbit_slopes(map_: CycleMap, orbit: Orbit, names: Sequence[str]) -> Array:
    """Derivatives of QUANTITIES along the orbit by parameters, "drive_speed" or "normal_force": (9, len(names)).

    Each is q_w + q_y (1 - J)^-1 F_w: the cycle moves with the setting, and with the rest state that closes it.
    """
    n, t = map_.scale.size, orbit.tangent
    fastest, from_peak_to_valley = _extreme_slopes(map_, orbit.cycle)
    rows = np.stack(
        [
            t.onset_load - t.arrest_load,
            t.stick + t.slip,
            t.stick,
            t.slip,
            t.distance,
            fastest,
            t.onset_load,
            t.arrest_load,
            from_peak_to_valley,
        ]
    )
    closing = along(map_.scale, t, orbit.jacobian)
    return np.asarray((rows[:, n:] + rows[:, :n] @ closing)[:, _columns(map_, names)])
