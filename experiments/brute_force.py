"""Settled stick-slip by plain simulation, no line of the package in it: what orbits, maps and windows are held against.

One motion: by the integrator of the tests (`tests/support/oracle.py`: scipy's DOP853, sticks in closed form). Thousands
side by side in numpy: from the equations alone (m v' = k x_b + c (v_0 - v) - s F_n [mu_k(v) + (mu_s - mu_k(v)) gamma],
x_b' = v_0 - v, gamma' = (1 - gamma)/t_cr - |v|/D within [0, 1], c = h sqrt(m/k)) by Runge and Kutta's fourth order
with a step of its own per motion; a step over a switch is cut at the root of the cubic through both of its ends. Sticks
are in closed form, their ends by bisection.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from tests.support import oracle

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

NAMES = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr", "mass", "stiffness", "damping", "normal_force")
FINEST = 120.0  # steps of a natural period, at least
SHARE = 0.1  # of the relaxation length, of the creep time and of the growth time of a slip that one step may cover
SLIDES_AFTER = 60.0  # natural periods without rest
RTOL = 1e-9
SETTLED = 1e-6  # relative change of drop and period from cycle to cycle
LONGEST, DRIFTING = 2000, 10  # cycles of a motion that still drifts one way
SOON = 3.0  # natural periods in which a slip usually ends
SAMPLES = 1000  # of a slip, for its largest speed
State = tuple[float, float]  # at rest: elongation [m], gamma


@dataclass(frozen=True)
class Lanes:
    """Pairs, rigs and drive speeds side by side: values (n,) by NAMES, SI, and drive speeds (n,) [m/s]."""

    values: Mapping[str, Array]
    drive: Array

    @staticmethod
    def of(pairs: Sequence[Mapping[str, float]], drive: Array) -> Lanes:
        """One lane per pair and drive speed."""
        return Lanes(
            {name: np.array([pair[name] for pair in pairs], float) for name in NAMES}, np.asarray(drive, float)
        )

    def take(self, which: NDArray[np.int_] | Bools) -> Lanes:
        """Some of the lanes."""
        return Lanes({name: value[which] for name, value in self.values.items()}, self.drive[which])

    def at(self, drive: Array) -> Lanes:
        """The same pairs at other drive speeds [m/s]."""
        return Lanes(self.values, np.asarray(drive, float))

    @property
    def period(self) -> Array:
        """Natural periods (n,) [s]."""
        return np.asarray(2.0 * np.pi * np.sqrt(self.values["mass"] / self.values["stiffness"]))

    @property
    def damper(self) -> Array:
        """Damping constants (n,) [N s/m]."""
        return np.asarray(self.values["damping"] * np.sqrt(self.values["mass"] / self.values["stiffness"]))

    def grip(self, gamma: Array) -> Array:
        """Force (n,) [N] that a contact at rest withstands."""
        v = self.values
        return np.asarray(v["normal_force"] * (v["mu_k0"] + (v["mu_s"] - v["mu_k0"]) * gamma))

    def rates(self, state: Array, sign: Array, renewed: Bools) -> Array:
        """d/dt of (elongation, speed, gamma) (3, n) while sliding."""
        v, (x, speed, gamma) = self.values, state
        fast = np.maximum(sign * speed, 0.0)
        kinetic = v["mu_k0"] + v["delta_mu_k"] * (1.0 - np.exp(-v["a"] * fast))
        friction = sign * v["normal_force"] * (kinetic + (v["mu_s"] - kinetic) * gamma)
        force = v["stiffness"] * x + self.damper * (self.drive - speed) - friction
        ageing = np.where(renewed, 0.0, (1.0 - gamma) / v["t_cr"] - sign * speed / v["D"])
        return np.stack([self.drive - speed, force / v["mass"], ageing])

    def step(self, state: Array, sign: Array, renewed: Bools, h: Array) -> Array:
        """The states after steps h (n,) [s]."""
        k1 = self.rates(state, sign, renewed)
        k2 = self.rates(state + 0.5 * h * k1, sign, renewed)
        k3 = self.rates(state + 0.5 * h * k2, sign, renewed)
        k4 = self.rates(state + h * k3, sign, renewed)
        return np.asarray(state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))

    def margin(self, state: Array, sign: Array, renewed: Bools) -> Array:
        """Positive inside the mode: speed and gamma, or the speed above that at which a renewed contact ages again."""
        v_cr = self.values["D"] / self.values["t_cr"]
        speed = sign * state[1]
        return np.where(renewed, speed / v_cr - 1.0, np.minimum(speed / self.drive, state[2]))


@dataclass
class Course:
    """What became of each lane: cycles made, whether it slides on, drop [N] and period [s] of the last cycle, rest
    states (2, n) (elongation, gamma) at the last arrest."""

    cycles: NDArray[np.int_]
    slides: Bools
    drop: Array
    period: Array
    rest: Array


def stick(lanes: Lanes, rest: Array) -> tuple[Array, Array]:
    """(durations (n,) [s], onset states (3, n)) of sticks from rest states (2, n)."""
    v, (x, gamma) = lanes.values, rest

    def spare(t: Array) -> Array:
        aged = 1.0 - (1.0 - gamma) * np.exp(-t / v["t_cr"])
        return lanes.grip(aged) - v["stiffness"] * (x + lanes.drive * t) - lanes.damper * lanes.drive

    high = (lanes.grip(np.ones_like(x)) - lanes.damper * lanes.drive - v["stiffness"] * x) / (
        v["stiffness"] * lanes.drive
    )
    low, high = np.zeros_like(x), np.maximum(high, 0.0) * (1.0 + 1e-12) + 1e-300
    for _ in range(60):
        middle = 0.5 * (low + high)
        holds = spare(middle) > 0.0
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    t = np.where(spare(np.zeros_like(x)) > 0.0, 0.5 * (low + high), 0.0)
    return t, np.stack([x + lanes.drive * t, np.zeros_like(x), 1.0 - (1.0 - gamma) * np.exp(-t / v["t_cr"])])


def onsets(lanes: Lanes, gamma: Array) -> Array:
    """Rest states (2, n) that break loose at once with a given gamma (n,)."""
    x = (lanes.grip(gamma) - lanes.damper * lanes.drive) / lanes.values["stiffness"]
    return np.stack([x * (1.0 + 1e-9), gamma])


def simulate(lanes: Lanes, rest: Array, cycles: int) -> Course:
    """So many cycles of every lane from rest states (2, n), or until it slides on."""
    n = lanes.drive.size
    course = Course(np.zeros(n, int), np.zeros(n, bool), np.full(n, np.nan), np.full(n, np.nan), rest.copy())
    length, state = stick(lanes, rest)
    onset, sign, renewed = state[0].copy(), np.ones(n), np.zeros(n, bool)
    slid, live = np.zeros(n), np.arange(n)
    while live.size:
        here = lanes.take(live)
        after, h, rests, now_worn, now_sign = _advance(here, state[:, live], sign[live], renewed[live])
        state[:, live], renewed[live], sign[live] = after, now_worn, now_sign
        slid[live] += h
        course.slides[live[(slid[live] > SLIDES_AFTER * here.period) & ~rests]] = True
        i = live[rests]
        if i.size:
            course.drop[i] = lanes.values["stiffness"][i] * (onset[i] - state[0, i])
            course.period[i] = length[i] + slid[i]
            course.rest[:, i] = state[0, i], state[2, i]
            course.cycles[i] += 1
            length[i], state[:, i] = stick(lanes.take(i), course.rest[:, i])
            onset[i], slid[i], sign[i], renewed[i] = state[0, i], 0.0, 1.0, False
        live = live[~course.slides[live] & (course.cycles[live] < cycles)]
    return course


def begun(lanes: Lanes, cycles: int, fresh: Sequence[float] = (0.5, 0.15)) -> tuple[Bools, Course]:
    """Which lanes stick from a rested contact, else from one that breaks loose with these gammas, and what they do."""
    n = lanes.drive.size
    whole = simulate(lanes, np.stack([np.zeros(n), np.ones(n)]), cycles)
    for gamma in fresh:
        left = np.flatnonzero(whole.slides)
        if left.size:
            again = simulate(lanes.take(left), onsets(lanes.take(left), np.full(left.size, gamma)), cycles)
            kept = left[~again.slides]
            for name in ("drop", "period"):
                getattr(whole, name)[kept] = getattr(again, name)[~again.slides]
            whole.rest[:, kept] = again.rest[:, ~again.slides]
            whole.slides[kept] = False
    return ~whole.slides, whole


def _advance(lanes: Lanes, state: Array, sign: Array, renewed: Bools) -> tuple[Array, Array, Bools, Bools, Array]:
    """One step of every lane, cut where its mode ends: states, lengths, which rest, and the modes that follow."""
    v = lanes.values
    speed, pull = np.abs(state[1]), np.abs(lanes.rates(state, sign, renewed)[1])
    h = lanes.period / FINEST
    with np.errstate(all="ignore"):
        renewal = np.minimum(SHARE * v["D"] / speed, np.sqrt(2.0 * SHARE * v["D"] / pull))
        growth = np.sqrt(v["mass"] * v["D"] / ((v["mu_s"] - v["mu_k0"]) * v["normal_force"]))
        h = np.minimum(h, np.where(renewed, np.inf, np.minimum(renewal, SHARE * np.minimum(v["t_cr"], growth))))
    after = lanes.step(state, sign, renewed, h)
    ends = lanes.margin(after, sign, renewed) < 0.0
    rests = np.zeros(h.size, bool)
    i = np.flatnonzero(ends)
    if i.size:
        few = lanes.take(i)
        at_rest = ~renewed[i] & (sign[i] * after[1, i] / few.drive <= after[2, i])
        share = _root(few, state[:, i], after[:, i], sign[i], renewed[i], h[i], at_rest)
        h[i] *= share
        cut = few.step(state[:, i], sign[i], renewed[i], h[i])
        cut[1, at_rest] = 0.0
        wears = ~at_rest & ~renewed[i]
        cut[2, wears] = 0.0
        after[:, i] = cut
        renewed = renewed.copy()
        renewed[i] = wears
        pulls = few.values["stiffness"] * cut[0] + few.damper * few.drive
        held = at_rest & (np.abs(pulls) <= few.grip(np.maximum(cut[2], 0.0)))
        rests[i] = held
        sign = sign.copy()
        sign[i] = np.where(at_rest & ~held, np.sign(pulls), sign[i])
    after[2] = np.clip(after[2], 0.0, 1.0)
    return after, h, rests, renewed, sign


def _root(
    lanes: Lanes, before: Array, after: Array, sign: Array, renewed: Bools, h: Array, at_rest: Bools
) -> Array:  # fmt: skip
    """Share of a step (n,) at which what ends the mode is zero, by the cubic through both ends."""
    level = np.where(renewed, lanes.values["D"] / lanes.values["t_cr"], 0.0)
    row = np.where(renewed | at_rest, 1, 2)
    pick = np.arange(h.size)
    factor = np.where(row == 1, sign, 1.0)
    y0, y1 = (factor * s[row, pick] - level for s in (before, after))
    d0, d1 = (factor * lanes.rates(s, sign, renewed)[row, pick] * h for s in (before, after))
    low, high = np.zeros_like(h), np.ones_like(h)
    # Where a slip begins the value is zero and rises: the root asked for is the later one.
    low = np.where(y0 <= 0.0, 1e-3, low)
    for _ in range(45):
        s = 0.5 * (low + high)
        value = (
            (1 + 2 * s) * (1 - s) ** 2 * y0 + s * (1 - s) ** 2 * d0 + s * s * (3 - 2 * s) * y1 + s * s * (s - 1) * d1
        )
        low, high = np.where(value > 0.0, s, low), np.where(value > 0.0, high, s)
    return np.asarray(0.5 * (low + high))


def swings_die(lanes: Lanes, share: float = 0.02, periods: int = 80) -> Bools:
    """Whether steady sliding, its speed disturbed by `share`, neither comes to rest nor grows within so many natural
    periods."""
    v = lanes.values
    gamma = np.maximum(0.0, 1.0 - lanes.drive * v["t_cr"] / v["D"])
    mu = v["mu_k0"] + v["delta_mu_k"] * (1.0 - np.exp(-v["a"] * lanes.drive))
    level = v["normal_force"] * (mu + (v["mu_s"] - mu) * gamma)
    state = np.stack([level / v["stiffness"], (1.0 + share) * lanes.drive, gamma])
    n = lanes.drive.size
    sign, renewed, time = np.ones(n), lanes.drive * v["t_cr"] >= v["D"], np.zeros(n)
    early, late, stopped, live = np.zeros(n), np.zeros(n), np.zeros(n, bool), np.arange(n)
    while live.size:
        here = lanes.take(live)
        after, h, _, now_worn, _ = _advance(here, state[:, live], sign[live], renewed[live])
        state[:, live], renewed[live] = after, now_worn
        time[live] += h
        clock, swing = time[live] / here.period, np.abs(after[1] / here.drive - 1.0)
        early[live] = np.where(
            (clock > 0.125 * periods) & (clock < 0.25 * periods), np.maximum(early[live], swing), early[live]
        )
        late[live] = np.where(clock > 0.875 * periods, np.maximum(late[live], swing), late[live])
        stopped[live] = after[1] <= 0.0
        live = live[~stopped[live] & (clock < periods)]
    return np.asarray(~stopped & ((late < early) | (late < 1e-6 * share)))


@dataclass(frozen=True)
class Pair:
    """Friction and rig by name, SI, and the load [N]."""

    values: Mapping[str, float]
    load: float = 1.0

    @property
    def natural_period(self) -> float:
        """2 pi sqrt(m/k) [s]."""
        return 2.0 * math.pi * math.sqrt(self.values["mass"] / self.values["stiffness"])

    def run(self, drive: float, duration: float, state: oracle.State) -> oracle.Oracle:
        """The motion from (elongation, speed, gamma)."""
        return oracle.simulate(self.values, drive, self.load, duration, state, rtol=RTOL)


@dataclass(frozen=True)
class Jump:
    """One cycle: drop [N], period [s], peak sliding speed [m/s], rest state at its arrest."""

    drop: float
    period: float
    peak: float
    end: State


def cycles_from(pair: Pair, drive: float, state: State) -> Iterator[Jump]:
    """Cycle after cycle from a rest state, until the mass slides for SLIDES_AFTER natural periods."""
    k = pair.values["stiffness"]
    while True:
        stick = max(pair.values["mu_s"] * pair.load / k - state[0], 0.0) / drive
        for periods in (SOON, SLIDES_AFTER):
            motion = pair.run(drive, stick + periods * pair.natural_period, (state[0], 0.0, state[1]))
            if motion.arrests.size:
                break
        # A mass that stops and is not held slides back: no arrest, and no onset after it.
        first, rests = ~np.isin(motion.onsets, motion.arrests), ~np.isin(motion.arrests, motion.onsets)
        begun, before = motion.onset_states[first], 0.0
        onsets, arrests = motion.onsets[first], motion.arrests[rests]
        for onset, arrest, start, end in zip(onsets, arrests, begun, motion.arrest_states[rests], strict=False):
            speed = float(np.max(motion.state(np.linspace(onset, arrest, SAMPLES))[1]))
            state = float(end[0]), float(end[2])
            yield Jump(k * float(start[0] - end[0]), float(arrest) - before, speed, state)
            before = float(arrest)
        if not arrests.size:
            return


def settled(pair: Pair, drive: float, start: State = (0.0, 1.0), cycles: int = 60) -> Jump | None:
    """The cycle on which the motion from a rest state settles (the last of `cycles`); None when it ends in sliding.

    More cycles are given to a drop that still falls or still grows: just beyond its end stick-slip lingers.
    """
    before: Jump | None = None
    drift, lasted = 0.0, 0
    for i, now in enumerate(islice(cycles_from(pair, drive, start), LONGEST)):
        if before is not None:
            if max(abs(now.drop / before.drop - 1), abs(now.period / before.period - 1)) < SETTLED:
                return now
            sign = math.copysign(1.0, now.drop - before.drop)
            drift, lasted = sign, lasted + 1 if sign == drift else 0
        if i + 1 >= cycles and lasted < DRIFTING:
            return now
        before = now
    return None
