"""Where the force that the load cell sees is highest and lowest in a cycle: what a lab calls the size of a jump.

Neither lies at a switch. The mass starts from rest, so the drive loads the spring for a while after the onset of slip;
before the arrest the mass is slower than the drive, which loads it again. At low speed the force from peak to valley is
that from onset to arrest; near the end of stick-slip it is many times as large.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.prediction.cycle import Cycle, CycleMap
from identify.prediction.glide import Leg

Array = NDArray[np.float64]

SHARP = 1e-12  # of a step of the integration: how well the place of an extreme is found


@dataclass(frozen=True)
class Extreme:
    """A highest or lowest force [N]: `length` [s] into the step from node `node` of the slip, which belongs to `leg`.
    Without a leg the force is extreme at the node itself, where the motion switches."""

    force: float
    node: int
    leg: Leg | None = None
    length: float = 0.0


def extremes(map_: CycleMap, cycle: Cycle) -> tuple[Extreme, Extreme]:
    """The highest and the lowest force of a cycle: between the nodes of the integration, by its own steps."""
    forces = np.array([map_.load(x, cycle.setting) for x in cycle.glide.x])
    map_.glider.set(cycle.setting)
    return _extreme(map_, cycle, forces, 1.0), _extreme(map_, cycle, forces, -1.0)


def peak_to_valley(map_: CycleMap, cycle: Cycle) -> float:
    """The force from its highest to its lowest in a cycle [N]."""
    highest, lowest = extremes(map_, cycle)
    return highest.force - lowest.force


def peak_to_valley_slope(map_: CycleMap, cycle: Cycle) -> Array:
    """Its derivatives (m,) by the rest state before the cycle and by the setting; NaN where an extreme lies at a switch
    in the middle of a slip."""
    w, glide, onset = cycle.setting, cycle.glide, map_.onset_slopes(cycle)
    found = extremes(map_, cycle)
    sums = np.zeros((2, *glide.x.shape))
    direct = np.zeros((2, w.size))
    for i, extreme in enumerate(found):
        # The force stands still there, so that the time of it does not matter.
        if extreme.leg is None:
            sums[i, extreme.node], direct[i] = map_.load_slopes(glide.x[extreme.node], w)
            continue
        x = glide.x[extreme.node]
        after = map_.glider.step(extreme.leg.mode, x, extreme.length, extreme.leg.direction)
        by_state, by_setting = map_.load_slopes(after, w)
        step = map_.glider.step_tangents(extreme.leg, np.append(x, extreme.length)[None], w.size)[0]
        sums[i, extreme.node] = by_state @ step[:, : x.size]
        direct[i] = by_setting + by_state @ step[:, x.size :]
    _, slopes = map_.glider.tangents(glide, w, onset, sums)
    slopes[:, -w.size :] += direct
    for i, extreme in enumerate(found):
        if extreme.leg is None and extreme.node > 0:
            slopes[i] = np.nan
    return np.asarray(slopes[0] - slopes[1])


def _extreme(map_: CycleMap, cycle: Cycle, forces: Array, sign: float) -> Extreme:
    """Of the forces at the nodes (s+1,) the highest (sign 1) or lowest (-1), with the steps beside it looked into."""
    top = int(np.argmax(sign * forces))
    best = Extreme(float(forces[top]), top)
    for leg in cycle.glide.legs:
        for node in range(max(leg.first, top - 1), min(leg.last, top + 1)):
            length = _turn(map_, cycle, leg, node, sign)
            if length is not None:
                after = map_.glider.step(leg.mode, cycle.glide.x[node], length, leg.direction)
                force = map_.load(after, cycle.setting)
                if best.leg is None or sign * force > sign * best.force:
                    best = Extreme(force, node, leg, length)
    return best


def _turn(map_: CycleMap, cycle: Cycle, leg: Leg, node: int, sign: float) -> float | None:
    """How far into the step from a node the force turns, from rising to falling (sign 1) or the other way; None where
    it does not."""
    x, glider = cycle.glide.x[node], map_.glider
    step = float(cycle.glide.t[node + 1] - cycle.glide.t[node])

    def rising(length: float) -> float:
        after = glider.step(leg.mode, x, length, leg.direction) if length else x
        by_state, _ = map_.load_slopes(after, cycle.setting)
        return sign * float(by_state @ glider.rate(leg.mode, after, leg.direction))

    if not (step > 0.0 and rising(0.0) > 0.0 > rising(step)):
        return None
    return float(brentq(rising, 0.0, step, xtol=SHARP * step))
