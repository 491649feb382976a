"""Records of an uneven track by chance, from the equations alone: nothing of the estimator is used to draw them.

The friction level is a Brownian path along the track with fine roughness (Ornstein-Uhlenbeck) on it, both fields of
position; every stick has a strength of its own. Sticks are advanced in closed form, slips in steps far shorter than
the samples, many records side by side. Forces are over the load until the record is made.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.effects import MAIN
from identify.logs.prepare import Prepared, prepare
from identify.logs.unknowns import from_scene
from identify.scene import Scene

Array = NDArray[np.float64]

STEP = 2e-5  # [s] of a slip
DRAWN = 400  # steps for which fields are drawn at once
KEPT = 5  # steps between two points of a slip that are kept
LONGEST = 40_000  # steps
DIRECT_SPEED = 1e-4  # [m/s] of sliding, at which a direct effect sets in


@dataclass(frozen=True)
class Pair:
    """A pair and its rig. strength [1] after a long rest, scatter of its logarithm, creep_time [s], weakening_rate
    [1/m], level [1], level_wander [1/sqrt(m)], roughness [1] and its length [m]; mass [kg], stiffness [N/m], damping
    [N s/m], drive_speed [m/s], load [N], noise of a sample [N], rate [Hz]; renewal: "linear" with sliding, "state"
    (in proportion to what is left); direct: friction per e-fold of the sliding
    speed beyond 0.1 mm/s [1]; speed_slope: friction per sliding speed [s/m]."""

    strength: float = 0.03
    scatter: float = 0.25
    creep_time: float = 1.0
    weakening_rate: float = 2000.0
    level: float = 0.3
    level_wander: float = 1.4
    roughness: float = 0.0
    roughness_length: float = 6e-6
    mass: float = 0.018
    stiffness: float = 168.0
    damping: float = 0.06
    drive_speed: float = 42e-6
    load: float = 0.301
    noise: float = 3e-4
    rate: float = 2000.0
    renewal: str = "linear"
    direct: float = 0.0
    speed_slope: float = 0.0


SOFT = Pair()
STIFF = Pair(0.06, 0.2, 0.3, 7000.0, level_wander=2.5, stiffness=1002.0, damping=0.15, noise=1.2e-3)
CASES = {
    "soft": SOFT,
    "soft, rough": replace(SOFT, roughness=0.011),
    "stiff": STIFF,
    "stiff, rough": replace(STIFF, roughness=0.015),
}
UNLIKE_SEED = 6400


@dataclass(frozen=True)
class Simulated:
    """A record, and what is true of it: onsets and arrests [s]; onset force above the slow level (c,) [1]; strength
    (c,): that of every stick without the roughness; rests (c,) [s]."""

    record: Record
    onset: Array
    arrest: Array
    effective: Array
    strength: Array
    rest: Array


def simulated(pair: Pair, cycles: int, seeds: list[int]) -> list[Simulated]:
    """Records of so many cycles, one per seed."""
    return _Tracks(pair, seeds).records(cycles)


class _Tracks:
    """Many tracks of one pair, advanced slip by slip side by side; the state of each is an array (n,)."""

    def __init__(self, pair: Pair, seeds: list[int]) -> None:
        self.pair, self.random = pair, [np.random.default_rng(seed) for seed in seeds]
        count = len(seeds)
        self.stiffness, self.mass = pair.stiffness / pair.load, pair.mass / pair.load
        self.damping = pair.damping / pair.load
        self.rate = self.stiffness * pair.drive_speed
        self.time, self.slid = np.zeros(count), np.zeros(count)
        self.slow = pair.level + np.zeros(count)
        self.fine = pair.roughness * self.normal()
        self.force = self.slow - 0.5 * pair.strength
        self.left = np.zeros(count)
        self.points: list[list[tuple[Array, Array]]] = [[] for _ in seeds]
        self.seen: dict[str, list[Array]] = {name: [] for name in ("onset", "arrest", "effective", "strength", "rest")}

    def normal(self) -> Array:
        return np.array([random.standard_normal() for random in self.random])

    def records(self, cycles: int) -> list[Simulated]:
        for _ in range(cycles + 1):
            self._slip(*self._stick())
        return [self._record(i) for i in range(self.time.size)]

    def _stick(self) -> tuple[Array, Array]:
        """Rests until the spring reaches level, roughness and strength; strength met, and regained without scatter."""
        pair, factor = self.pair, np.exp(self.pair.scatter * self.normal())

        def regained(rest: Array) -> Array:
            return pair.strength - (pair.strength - self.left) * np.exp(-rest / pair.creep_time)

        # A contact that cannot stick at all yet regains for a microsecond.
        low, high = np.full(self.time.size, 1e-6), np.full(self.time.size, 1e3 * pair.strength / self.rate)
        for _ in range(80):
            middle = 0.5 * (low + high)
            short = self.force + self.rate * middle < self.slow + self.fine + factor * regained(middle)
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        self.time, self.force = self.time + high, self.force + self.rate * high
        strength = factor * regained(high)
        values = (self.time, self.force - self.slow, strength, high)
        for name, value in zip(("onset", "effective", "strength", "rest"), values, strict=True):
            self.seen[name].append(value)
        return strength, regained(high)

    def _slip(self, strength: Array, regained: Array) -> None:
        """Slides until every mass stands again."""
        pair, count = self.pair, self.time.size
        u, v, t = np.zeros(count), np.zeros(count), np.zeros(count)
        fine, slow, moving = self.fine.copy(), self.slow.copy(), np.ones(count, bool)
        kept = [(t, self.force.copy())]
        started = np.zeros(count, bool)
        measured = self.force
        draws = np.empty((DRAWN, 2, count))
        for i in range(LONGEST):
            if i % DRAWN == 0:
                for n in np.flatnonzero(moving).tolist():
                    draws[..., n] = self.random[n].standard_normal((DRAWN, 2))
            fine_draw, slow_draw = draws[i % DRAWN]
            left = strength * self._law(u / regained * pair.weakening_rate)
            left = left + pair.direct * np.log1p(v / DIRECT_SPEED) + pair.speed_slope * v
            force = self.force + self.rate * t - self.stiffness * u - self.damping * v
            v_next = v + STEP * (force - slow - fine - left) / self.mass
            started |= v_next > 2.0 * pair.drive_speed
            moving &= ~(started & (v_next <= 0.0))
            if not moving.any():
                break
            v = np.where(moving, np.maximum(v_next, 0.0), 0.0)
            moved = STEP * v
            u = u + moved
            fade = np.exp(-moved / pair.roughness_length)
            fine = fade * fine + pair.roughness * np.sqrt(-np.expm1(-2.0 * moved / pair.roughness_length)) * fine_draw
            slow = slow + pair.level_wander * np.sqrt(moved) * slow_draw
            t = np.where(moving, t + STEP, t)
            if i % KEPT == 0:
                measured = self.force + self.rate * t - self.stiffness * u - self.damping * v
                kept.append((t.copy(), measured))
        self.left = strength * self._law(u / regained * pair.weakening_rate)
        times, forces = (np.array(values) for values in zip(*kept, strict=True))
        self.force = self.force + self.rate * t - self.stiffness * u
        for n, points in enumerate(self.points):
            whole = np.append(True, np.diff(times[:, n]) > 0.0)
            points.append((self.time[n] + np.append(times[whole, n], t[n]), np.append(forces[whole, n], self.force[n])))
        self.time, self.slow, self.fine, self.slid = self.time + t, slow, fine, self.slid + u
        self.seen["arrest"].append(self.time)

    def _law(self, reach: Array) -> Array:
        """Share of the strength that is left."""
        if self.pair.renewal == "state":
            return np.exp(-reach)
        return np.maximum(1.0 - reach, 0.0)

    def _record(self, n: int) -> Simulated:
        pair = self.pair
        time, force = (np.concatenate([points[i] for points in self.points[n]]) for i in range(2))
        seen = {name: np.array([values[n] for values in lists]) for name, lists in self.seen.items()}
        until = float(seen["onset"][-1])  # the last slip is not whole
        start = float(seen["arrest"][0]) - 2.0 / pair.rate
        grid = np.arange(start, until, 1.0 / pair.rate)
        measured = pair.load * np.interp(grid, time, force) + pair.noise * self.random[n].standard_normal(grid.size)
        record = Record(
            time=grid - start,
            normal_force=np.full(grid.size, pair.load),
            friction_force=measured,
            drive_speed=pair.drive_speed,
        )
        cut = {name: values[1:] - (start if name in ("onset", "arrest") else 0.0) for name, values in seen.items()}
        return Simulated(record, **{name: values[:-1] for name, values in cut.items()})


def scene_of(pair: Pair) -> Scene:
    """The rig of a pair as a user states it; friction is searched."""
    rig = {
        "mass": pair.mass,
        "stiffness": pair.stiffness,
        "damping": pair.damping * float(np.sqrt(pair.stiffness / pair.mass)),
        "drive_speed": pair.drive_speed,
    }
    return Scene.from_document(
        {"effects": [*MAIN, "varying_normal_force"], "rig": rig, "logs": [{"path": "track.csv"}]}
    )


def unlike(number: int) -> tuple[Simulated, Scene]:
    """A record of 50 cycles, and a scene unlike it: damping ratios of 0.01 to 0.2, each drawn by itself, a mass off by
    up to a half, a linear speed term where there is none, or none where there is one (as a damping ratio of -0.1 to
    0.25), by turns; every second pair of those weakens in proportion to what is left."""
    random, base = np.random.default_rng([UNLIKE_SEED, number]), (SOFT, STIFF)[number % 2]
    zeta, stated_zeta = np.exp(random.uniform(*np.log((0.01, 0.2)), 2))
    critical, sloped = 2.0 * float(np.sqrt(base.stiffness * base.mass)), number // 2 % 2 == 1
    pair = replace(
        base,
        strength=base.strength * float(np.exp(random.uniform(-0.4, 0.4))),
        damping=zeta * critical,
        speed_slope=float(random.uniform(-0.1, 0.25)) * critical / base.load if sloped else 0.0,
        renewal=("linear", "state")[number // 4 % 2],
        roughness=(0.0, 0.25 * base.strength)[number // 8 % 2],
    )
    stated = replace(pair, mass=base.mass * float(np.exp(random.uniform(-0.4, 0.4))))
    stated = replace(stated, damping=2.0 * stated_zeta * float(np.sqrt(stated.stiffness * stated.mass)))
    (track,) = simulated(pair, 50, [UNLIKE_SEED + number])
    effects = [*(e for e in MAIN if sloped or e != "velocity_weakening"), *(() if sloped else ("linear_weakening",))]
    return track, scene_of(stated).with_effects([*effects, "varying_normal_force"])


def prepared(pair: Pair, record: Record) -> Prepared:
    """A record of a pair as the estimators take it."""
    scene = scene_of(pair)
    return prepare(scene, scene.logs[0], record, from_scene(scene))


def truth_of(pair: Pair, rest: float) -> Array:
    """Logarithms of PARAMETERS (7,); strength after a rest [s]."""
    strength = pair.strength * -np.expm1(-rest / pair.creep_time)
    scales = (pair.level_wander, max(pair.scatter, 1e-6), max(pair.roughness, 1e-6))
    return np.log([strength, pair.weakening_rate, pair.creep_time, pair.mass, *scales])
