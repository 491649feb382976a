"""What an uneven pair does next: static peak, drop and period of cycles drawn from the fitted model.

The rule, frozen before any comparison with records that were held out:
every draw takes its parameters from their joint normal distribution (of logarithms), and starts at the level and at the
force after a slip of a cycle of the record picked at random. Then CYCLES cycles follow each other, of which the first
SETTLING do not count. Each: the stick ends when level + strength is reached, the strength regained(T) times a
lognormal factor drawn per stick; the slip starts as the estimator's does, at SEEN of sliding, and is followed in
steps of STEP/sqrt(k/m) with the level's wander and fine roughness drawn on the way, until the mass stands; a slip is
odd with the estimator's probability. Static peak: force at the onset; drop: from there to the force at the arrest;
period: from onset to onset. A slip that falls by less than half the smallest drop of the record is none that a
segmentation would count: its time goes to the next cycle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.uneven.events import RigConstants
from identify.uneven.likelihood import ODD_WANDER
from identify.uneven.slip_functions import MET, ODD, PARAMETERS, ROUGHNESS_LENGTH, slip_functions

Array = NDArray[np.float64]

CYCLES, SETTLING = 6, 2
SETS, CHAINS = 40, 30  # sets of parameters, and chains of cycles for each
SEEN = 0.5e-6  # [m] of sliding from which a slip is followed in steps
STEP = 0.1
LONGEST = 12.0  # half periods after which a slip that has not ended is given up
RECORDS = 10  # of each set of parameters, whose medians tell how far one is off by chance
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

    def median_of(self, cycles: int, seed: int) -> tuple[float, float]:
        """95 % interval of the median over so many cycles of a record: by the parameters' errors, and by chance."""
        random, chains = np.random.default_rng(seed), self.draws.reshape(SETS, CHAINS, -1)
        picked = random.integers(CHAINS, size=(RECORDS, SETS, -(-cycles // chains.shape[2])))
        made = chains[np.arange(SETS)[None, :, None], picked].reshape(RECORDS * SETS, -1)[:, :cycles]
        made = made[np.isfinite(made).any(axis=1)]  # with some parameters no slip is one that would be counted
        low, high = np.quantile(np.nanmedian(made, axis=1), (0.025, 0.975)).tolist() if len(made) else (np.nan, np.nan)
        return low, high

    def to_dict(self) -> dict[str, object]:
        """As in `distributions` of result.json."""
        quantiles = {
            f"{100 * q:.0f}": {"value": float(value), "interval": [float(end) for end in ends]}
            for q, value, ends in zip(QUANTILES, self.values, self.intervals, strict=True)
        }
        return {"unit": self.unit, "quantiles": quantiles}


@dataclass(frozen=True)
class Begin:
    """Where chains may begin: level and force over the load after slips of a record, each (c,), and its smallest drop;
    usual rest [s] after which the strength is told."""

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
    spread = vectors * np.sqrt(np.minimum(np.maximum(values, 0.0), 1.0))
    sets = theta[:, None] + spread @ np.clip(random.standard_normal((theta.size, SETS)), -2.5, 2.5)
    chains = _Chains(rig, begin, np.repeat(sets, CHAINS, axis=1), random)
    peak, drop, period, counted = chains.run()
    out = []
    for name, unit, table in (("static_peak", "", peak), ("drop", "", drop), ("period", "s", period)):
        each = np.where(counted, table, np.nan).reshape(SETS, -1)
        quantiles = np.nanquantile(each, QUANTILES, axis=1)
        out.append(
            Distribution(
                name,
                unit,
                np.nanquantile(each, QUANTILES),
                np.nanquantile(quantiles, (0.025, 0.975), axis=1).T,
                each,
            )
        )
    return out[0], out[1], out[2]


class _Chains:
    """Cycles after one another, in many chains side by side; every array (n,)."""

    def __init__(self, rig: RigConstants, begin: Begin, theta: Array, random: np.random.Generator) -> None:
        self.rig, self.begin, self.random = rig, begin, random
        size = theta.shape[1]
        self.theta, self.functions = np.ascontiguousarray(theta.T), slip_functions()
        self.mass, self.wander, self.scatter, self.rough = np.exp(theta[3 : len(PARAMETERS)])
        self.over_load = np.tile(rig.over_load(0.0), (size, 1))
        picked = random.integers(begin.level.size, size=size)
        self.level, self.force, self.left = begin.level[picked], begin.force[picked], np.zeros(size)

    def run(self) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Peak, drop, period and whether it counts, each (chains, cycles - settling)."""
        rows, waited = [], np.zeros(self.level.size)
        for _ in range(CYCLES):
            rest, strength, usual = self._stick()
            onset = self.force
            took = self._slip(rest, strength, usual)
            drop = onset + self.rig.rate * took - self.force
            seen = drop > 0.5 * self.begin.smallest
            period = waited + rest + took
            rows.append((onset, drop, period, seen))
            waited = np.where(seen, 0.0, period)
        peak, drop, period, seen = (np.array(column)[SETTLING:].T for column in zip(*rows, strict=True))
        return peak, drop, period, seen.astype(bool)

    def _stick(self) -> tuple[Array, Array, Array]:
        """Rest [s] until the spring reaches level and strength, the strength met, and the usual one after that rest."""
        factor = np.exp(self.scatter * self.random.standard_normal(self.level.size))
        low = np.zeros(self.level.size)
        full = self._usual(low)[:, 1]
        high = (self.level + factor * np.maximum(full, self.left) - self.force) / self.rig.rate + 1e-9
        high = np.maximum(high, 1e-9)
        for _ in range(40):
            middle = 0.5 * (low + high)
            short = self.force + self.rig.rate * middle < self.level + factor * self._usual(middle)[:, 0]
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        usual = np.maximum(self._usual(high)[:, 0], 1e-9)
        self.force = self.force + self.rig.rate * high
        return high, factor * usual, usual

    def _usual(self, rest: Array) -> Array:
        """Strength after a rest [s] without scatter, and after a long one (n, 2)."""
        contact = np.column_stack([rest, np.full(rest.size, self.begin.usual_rest), self.left])
        return self.functions.aged([self.theta, contact])[0]

    def _slip(self, rest: Array, strength: Array, usual: Array) -> Array:
        """How long every mass slides [s]; force, level and strength left are what they are after it."""
        rig, f, size = self.rig, self.functions, self.level.size
        odd = np.where(self.random.random(size) < ODD, ODD_WANDER, 1.0)
        same, drive = np.ones(size), rig.drive_speed
        seen = SEEN * rig.stiffness * same  # in units of the force
        stick = np.column_stack([seen, self.force, rest, self.begin.usual_rest * same, same])
        met = f.met([self.theta, self.over_load, stick])[0]
        met[:, len(MET) + f.own.index("gamma")] += (usual - met[:, MET.index("regained")]) / met[:, MET.index("full")]
        met[:, MET.index("onset")], met[:, MET.index("regained")] = self.force, usual
        place = np.column_stack([np.log(strength), odd**2, seen])
        begun = f.begin([self.theta, met, self.over_load, place])[0]
        x, kept = begun[:, : len(f.states)].copy(), begun[:, f.state_size :].copy()
        speed, worn, change, fine = (f.states.index(n) for n in ("sliding_speed", "gamma", "level_change", "fine"))
        t, start = met[:, MET.index("earlier")].copy(), x[:, 0] - drive * met[:, MET.index("earlier")] + SEEN
        h = STEP * np.sqrt(self.mass / rig.load / rig.stiffness)
        moving = np.ones(size, bool)
        for _ in range(int(LONGEST * np.pi / STEP)):
            rows = np.flatnonzero(moving)
            now, dt = x[rows], h[rows]
            pace = np.maximum(now[:, speed], 0.1 * drive)
            q = np.minimum(pace * dt / ROUGHNESS_LENGTH, 50.0)
            draws = self.random.standard_normal((2, rows.size))
            now[:, fine] = np.exp(-q) * now[:, fine] + self.rough[rows] * np.sqrt(-np.expm1(-2.0 * q)) * draws[0]
            now[:, change] += odd[rows] * self.wander[rows] * np.sqrt(pace * dt) * draws[1]
            given = [kept[rows], self.over_load[rows]]
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
        self.left = strength * np.maximum(x[:, worn], 0.0) * met[:, MET.index("full")] / usual
        return t
