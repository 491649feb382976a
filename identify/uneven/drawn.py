"""What an uneven pair does next: static peak, drop and period of cycles drawn from the fitted model.

The rule, frozen before any comparison with records that were held out:
every draw takes its parameters from their joint normal distribution (of logarithms), and starts at the level and at the
force after a slip of a cycle of the record picked at random. Then CYCLES cycles follow each other, of which the first
SETTLING do not count. Each: the stick ends when level + strength is reached, the strength regained(T) times a
lognormal factor drawn per stick; the slip starts as the estimator's does, at SEEN of sliding, and is followed in
steps of STEP sqrt(m/k) with the level's wander and fine roughness drawn on the way, until the mass stands. Static
peak: force at the onset; drop: from there to the force at the arrest; period: from onset to onset. A slip that falls by
less than half the smallest drop of the record is none that a segmentation would count: its time goes to the next cycle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.uneven.events import RigConstants
from identify.uneven.slip_functions import ONSET, PARAMETERS, ROUGHNESS_LENGTH, STATES, N, slip_functions

Array = NDArray[np.float64]

CYCLES, SETTLING = 6, 2
SETS, CHAINS = 40, 30  # sets of parameters, and chains of cycles for each
SEEN = 0.5e-6  # [m] of sliding from which a slip is followed in steps
STEP = 0.1
LONGEST = 12.0  # half periods after which a slip that has not ended is given up
QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Distribution:
    """Quantiles of one quantity at 5, 50 and 95 %, with the interval (2,) of each that the parameters' errors make;
    draws (sets, cycles): themselves."""

    name: str
    unit: str
    values: Array
    intervals: Array
    draws: Array

    def to_dict(self) -> dict[str, object]:
        """As in `distributions` of result.json."""
        quantiles = {
            f"{100 * q:.0f}": {"value": float(value), "interval": ends.tolist()}
            for q, value, ends in zip(QUANTILES, self.values, self.intervals, strict=True)
        }
        return {"unit": self.unit, "quantiles": quantiles}


@dataclass(frozen=True)
class Begin:
    """Where chains may begin: level and force over the load after slips of a record, each (c,), and its smallest drop;
    usual rest [s] to which the strength refers."""

    level: Array
    force: Array
    smallest: float
    usual_rest: float


def drawn_distributions(
    rig: RigConstants, begin: Begin, theta: Array, covariance: Array, seed: int
) -> tuple[Distribution, Distribution, Distribution]:
    """Static peak [1], drop [1] and period [s] of the fitted pair on a rig.

    Args:
        theta: the estimator's parameters (10,), and their covariance (10, 10).
    """
    random = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(covariance)
    spread = vectors * np.sqrt(np.clip(values, 0.0, 1.0))
    sets = theta[:, None] + spread @ np.clip(random.standard_normal((theta.size, SETS)), -2.5, 2.5)
    peak, drop, period, counted = _Chains(rig, begin, np.repeat(sets, CHAINS, axis=1), random).run()
    out = []
    for name, unit, table in (("static_peak", "", peak), ("drop", "", drop), ("period", "s", period)):
        each = np.where(counted, table, np.nan).reshape(SETS, -1)
        ends = np.nanquantile(np.nanquantile(each, QUANTILES, axis=1), (0.025, 0.975), axis=1).T
        out.append(Distribution(name, unit, np.nanquantile(each, QUANTILES), ends, each))
    return out[0], out[1], out[2]


class _Chains:
    """Cycles after one another, in many chains side by side; every array (n,)."""

    def __init__(self, rig: RigConstants, begin: Begin, theta: Array, random: np.random.Generator) -> None:
        self.rig, self.begin, self.random = rig, begin, random
        self.theta, self.functions, self.size = np.ascontiguousarray(theta.T), slip_functions(), theta.shape[1]
        self.mass, self.wander, self.scatter, self.rough = np.exp(theta[3 : len(PARAMETERS)])
        self.over_load = np.tile(rig.over_load(0.0), (self.size, 1))
        picked = random.integers(begin.level.size, size=self.size)
        self.level, self.force, self.left = begin.level[picked], begin.force[picked], np.zeros(self.size)

    def run(self) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Peak, drop, period and whether it counts, each (chains, cycles - settling)."""
        rows, waited = [], np.zeros(self.size)
        for _ in range(CYCLES):
            rest, strength, usual = self._stick()
            onset = self.force
            duration = self._slip(rest, strength, usual)
            drop = onset + self.rig.rate * duration - self.force
            counts, period = drop > 0.5 * self.begin.smallest, waited + rest + duration
            rows.append((onset, drop, period, counts))
            waited = np.where(counts, 0.0, period)
        peak, drop, period, counted = (np.array(column)[SETTLING:].T for column in zip(*rows, strict=True))
        return peak, drop, period, counted.astype(bool)

    def _stick(self) -> tuple[Array, Array, Array]:
        """Rest [s] until the spring reaches level and strength, the strength met, and the usual one after that rest."""
        factor, rate = np.exp(self.scatter * self.random.standard_normal(self.size)), self.rig.rate
        low = np.zeros(self.size)
        full = self._usual(low)[:, 1]
        high = np.maximum((self.level + factor * np.maximum(full, self.left) - self.force) / rate, 0.0) + 1e-9
        for _ in range(40):
            middle = 0.5 * (low + high)
            short = self.force + rate * middle < self.level + factor * self._usual(middle)[:, 0]
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        usual = np.maximum(self._usual(high)[:, 0], 1e-9)
        self.force = self.force + rate * high
        return high, factor * usual, usual

    def _usual(self, rest: Array) -> Array:
        """Strength after a rest [s] without scatter, and after a long one (n, 2)."""
        contact = np.column_stack([rest, np.full(self.size, self.begin.usual_rest), self.left])
        return self.functions.aged([self.theta, contact])[0]

    def _slip(self, rest: Array, strength: Array, usual: Array) -> Array:
        """How long every mass slides [s]; force, level and strength left are what they are after it."""
        rig, f, drive, same = self.rig, self.functions, self.rig.drive_speed, np.ones(self.size)
        slid = SEEN * rig.stiffness * same  # in units of the force
        stick = np.column_stack([slid, self.force, rest, self.begin.usual_rest * same, same])
        onset = f.onset([self.theta, self.over_load, stick])[0]
        column = {name: i for i, name in enumerate(ONSET)}
        full, earlier = onset[:, column["full"]], onset[:, column["earlier"]]
        onset[:, column["left"]] += (usual - onset[:, column["regained"]]) / full
        onset[:, column["onset"]], onset[:, column["regained"]] = self.force, usual
        begun = f.begin([self.theta, onset, self.over_load, np.column_stack([np.log(strength), slid])])[0]
        x, kept = begun[:, :N].copy(), begun[:, f.state_size :].copy()
        speed, left, change, fine = (STATES.index(name) for name in ("speed", "left", "level_change", "fine"))
        t, start = earlier.copy(), x[:, 0] - drive * earlier + SEEN
        h = STEP * np.sqrt(self.mass / rig.load / rig.stiffness)
        moving = np.ones(self.size, bool)
        for _ in range(int(LONGEST * np.pi / STEP)):
            rows = np.flatnonzero(moving)
            now, dt, given = x[rows], h[rows], [kept[rows], self.over_load[rows]]
            way = np.maximum(now[:, speed], 0.1 * drive) * dt
            q = np.minimum(way / ROUGHNESS_LENGTH, 50.0)
            draws = self.random.standard_normal((2, rows.size))
            now[:, fine] = np.exp(-q) * now[:, fine] + self.rough[rows] * np.sqrt(-np.expm1(-2.0 * q)) * draws[0]
            now[:, change] += self.wander[rows] * np.sqrt(way) * draws[1]
            middle = now + 0.5 * dt[:, None] * f.motion([now, *given])[0]
            after = now + dt[:, None] * f.motion([middle, *given])[0]
            stops = after[:, speed] <= 0.0
            share = np.where(stops, now[:, speed] / np.maximum(now[:, speed] - after[:, speed], 1e-30), 1.0)
            x[rows] = now + share[:, None] * (after - now)
            t[rows] += share * dt
            moving[rows[stops]] = False
            if not moving.any():
                break
        self.level = self.level + x[:, change]
        self.force = self.force + rig.stiffness * (x[:, 0] - start)
        self.left = strength * np.maximum(x[:, left], 0.0) * full / usual
        return t
