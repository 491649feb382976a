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

from identify.uneven.events import Rig
from identify.uneven.likelihood import ODD, ODD_WANDER, ROUGHNESS_LENGTH, onset_motion, weakened

Array = NDArray[np.float64]

CYCLES, SETTLING = 6, 2
SETS, CHAINS = 40, 60  # sets of parameters, and chains of cycles for each
SEEN = 0.5e-6  # [m] of sliding from which a slip is followed in steps
STEP = 0.06
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
            f"{100 * q:.0f}": {"value": float(value), "interval": [float(end) for end in ends]}
            for q, value, ends in zip(QUANTILES, self.values, self.intervals, strict=True)
        }
        return {"unit": self.unit, "quantiles": quantiles}


@dataclass(frozen=True)
class Begin:
    """Where chains may begin: level and force over the load after slips of a record, each (c,), and its smallest drop;
    typical rest [s]."""

    level: Array
    force: Array
    smallest: float
    typical_rest: float


def drawn_distributions(
    rig: Rig, begin: Begin, theta: Array, covariance: Array, seed: int
) -> tuple[Distribution, Distribution, Distribution]:
    """Static peak [1], drop [1] and period [s] of the fitted pair on a rig.

    Args:
        theta: logarithms of the estimator's parameters (7,), and their covariance (7, 7).
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

    def __init__(self, rig: Rig, begin: Begin, theta: Array, random: np.random.Generator) -> None:
        self.rig, self.begin, self.random = rig, begin, random
        strength, self.weakening, self.creep, self.mass, self.wander, self.scatter, self.rough = np.exp(theta)
        self.full = strength / -np.expm1(-begin.typical_rest / self.creep)
        size = theta.shape[1]
        picked = random.integers(begin.level.size, size=size)
        self.level, self.force, self.left = begin.level[picked], begin.force[picked], np.zeros(size)

    def run(self) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Peak, drop, period and whether it counts, each (chains, cycles - settling)."""
        rows, waited = [], np.zeros(self.level.size)
        for _ in range(CYCLES):
            rest, strength, regained = self._stick()
            onset = self.force
            took, slid = self._slip(strength, regained)
            drop = onset + self.rig.rate * took - self.force
            seen = drop > 0.5 * self.begin.smallest
            period = waited + rest + took
            rows.append((onset, drop, period, seen))
            waited = np.where(seen, 0.0, period)
            self.left = np.maximum(strength - self.weakening * strength / regained * slid, 0.0)
        peak, drop, period, seen = (np.array(column)[SETTLING:].T for column in zip(*rows, strict=True))
        return peak, drop, period, seen.astype(bool)

    def _stick(self) -> tuple[Array, Array, Array]:
        """Rest [s] until the spring reaches level and strength, the strength met, and the usual one after that rest."""
        factor = np.exp(self.scatter * self.random.standard_normal(self.level.size))
        low = np.zeros(self.level.size)
        high = (self.level + factor * np.maximum(self.full, self.left) - self.force) / self.rig.rate + 1e-9
        high = np.maximum(high, 1e-9)
        for _ in range(40):
            middle = 0.5 * (low + high)
            usual = self.full - (self.full - self.left) * np.exp(-middle / self.creep)
            short = self.force + self.rig.rate * middle < self.level + factor * usual
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        usual = np.maximum(self.full - (self.full - self.left) * np.exp(-high / self.creep), 1e-9)
        self.force = self.force + self.rig.rate * high
        return high, factor * usual, usual

    def _slip(self, strength: Array, regained: Array) -> tuple[Array, Array]:
        """How long every mass slides [s], and how far [m]; force and level are what they are after it."""
        rig, size = self.rig, self.level.size
        t, v = onset_motion(np.full(1, SEEN), rig, self.weakening, self.mass)
        t, v, u = t[0], v[0], np.full(size, SEEN)
        base = np.sqrt(self.mass / rig.stiffness)
        h, x, b = STEP * base, np.zeros(size), np.zeros(size)
        odd = np.where(self.random.random(size) < ODD, ODD_WANDER, 1.0)
        moving, end = np.ones(size, bool), np.zeros(size)
        for _ in range(int(LONGEST * np.pi / STEP)):
            speed = np.maximum(v, 0.1 * rig.drive_speed)
            q = np.minimum(speed * h / ROUGHNESS_LENGTH, 50.0)
            draws = self.random.standard_normal((2, size))
            x = np.exp(-q) * x + self.rough * np.sqrt(-np.expm1(-2.0 * q)) * draws[0]
            b = b + odd * self.wander * np.sqrt(speed * h) * draws[1]
            friction = self.level + b + x + strength * weakened(self.weakening / regained * (u + 0.5 * h * v))[0]
            pull = self.force + rig.rate * (t + 0.5 * h) - rig.stiffness * (u + 0.5 * h * v) - rig.damping * v
            faster = v + h * (pull - friction) / self.mass
            stops = moving & (faster <= 0.0)
            share = np.where(stops, v / np.maximum(v - faster, 1e-30), 1.0)
            u = np.where(moving, u + share * h * 0.5 * (v + np.maximum(faster, 0.0)), u)
            t = np.where(moving, t + share * h, t)
            end = np.where(stops, self.level + b, end)
            moving &= ~stops
            v = np.where(moving, faster, 0.0)
            if not moving.any():
                break
        self.level = np.where(moving, self.level + b, end)
        self.force = self.force + rig.rate * t - rig.stiffness * u
        return t, u
