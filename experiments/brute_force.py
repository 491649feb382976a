"""Stick-slip by plain simulation with scipy's Fortran integrator: the answer that orbits and maps are held against.

Written from the equations alone (m v' = k x_b + c (v_0 - v) - s F_n [mu_k(v) + (mu_s - mu_k(v)) gamma],
x_b' = v_0 - v, gamma' = (1 - gamma)/t_cr - |v|/D within [0, 1], c = h sqrt(m/k)); it shares no line with the package.
Sticks are closed form with a bracketed root, slips are Dormand and Prince's eighth order with steps no longer than a
hundredth of a natural period, every switch found by integrating again from the last step to a bracketed root.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import ode
from scipy.optimize import brentq

RTOL = 1e-9
FINEST = 100  # steps of a natural period, at least
SETTLED = 1e-6  # relative change of drop and period from cycle to cycle
LONGEST, DRIFTING = 2000, 10  # cycles of a motion that still drifts one way
SLIDES_AFTER = 60.0  # natural periods without rest
State = tuple[float, float]  # at rest: elongation [m], gamma


@dataclass(frozen=True)
class Pair:
    """Friction, rig and load, SI."""

    mu_s: float
    mu_k0: float
    delta_mu_k: float
    a: float
    D: float
    t_cr: float
    mass: float
    stiffness: float
    damping: float
    load: float = 1.0

    @staticmethod
    def of(values: Mapping[str, float], load: float = 1.0) -> Pair:
        """From named values."""
        names = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr", "mass", "stiffness", "damping")
        return Pair(**{name: values[name] for name in names}, load=load)

    @property
    def c(self) -> float:
        """Damper [N s/m]."""
        return self.damping * math.sqrt(self.mass / self.stiffness)

    @property
    def time(self) -> float:
        """sqrt(m/k) [s]."""
        return math.sqrt(self.mass / self.stiffness)

    def grip(self, gamma: float) -> float:
        """Force the contact withstands at rest [N]."""
        return self.load * (self.mu_k0 + (self.mu_s - self.mu_k0) * gamma)


@dataclass(frozen=True)
class Jump:
    """One cycle: drop [N], period [s], slip duration [s], peak sliding speed [m/s], rest state at its arrest."""

    drop: float
    period: float
    slip: float
    peak: float
    end: State


def _motion(pair: Pair, drive: float, sign: float, ageing: bool) -> Callable[[float, Any], list[float]]:
    k, c, m, load, a = pair.stiffness, pair.c, pair.mass, pair.load, pair.a
    mu_0, change, mu_s, wear, rate = pair.mu_k0, pair.delta_mu_k, pair.mu_s, 1.0 / pair.D, 1.0 / pair.t_cr
    exp = math.exp

    def aged(_: float, y: Any) -> list[float]:
        x, v, gamma = y
        speed = v * sign
        mu = mu_0 + change * (1.0 - exp(-a * max(speed, 0.0)))
        force = k * x + c * (drive - v) - sign * load * (mu + (mu_s - mu) * gamma)
        return [drive - v, force / m, (1.0 - gamma) * rate - speed * wear]

    def worn(_: float, y: Any) -> list[float]:
        x, v, _g = y
        mu = mu_0 + change * (1.0 - exp(-a * max(v * sign, 0.0)))
        return [drive - v, (k * x + c * (drive - v) - sign * load * mu) / m, 0.0]

    return aged if ageing else worn


def _leg(pair: Pair, y: Any, drive: float, sign: float, ageing: bool, room: float) -> tuple[Any, float, str, float]:
    """One mode of sliding: (state, duration, how it ended, largest speed); ends "rest", "worn", "ages" or "time"."""
    motion, v_cr = _motion(pair, drive, sign, ageing), pair.D / pair.t_cr
    step = 2.0 * math.pi * pair.time / FINEST
    nodes: list[tuple[float, Any]] = [(0.0, np.array(y, float))]

    def ended(state: Any) -> str:
        if sign * state[1] < 0.0:
            return "rest"
        if ageing and state[2] < 0.0:
            return "worn"
        return "ages" if not ageing and sign * state[1] < v_cr else ""

    def watch(t: float, state: Any) -> int:
        if t > nodes[-1][0]:
            nodes.append((t, np.array(state)))
            return -1 if ended(state) else 0
        return 0

    run = ode(motion).set_integrator("dop853", rtol=RTOL, atol=1e-15, max_step=step, nsteps=10**7)
    run.set_solout(watch)
    run.set_initial_value(y, 0.0)
    run.integrate(room)
    how = ended(nodes[-1][1]) or "time"
    if how != "time":
        nodes[-1] = _located(motion, nodes[-2], nodes[-1], how, sign, v_cr)
    return nodes[-1][1], nodes[-1][0], how, _crest(nodes)


def _located(
    motion: Any, before: tuple[float, Any], after: tuple[float, Any], how: str, sign: float, v_cr: float
) -> tuple[float, Any]:
    """Time and state within a step at which its guard is zero."""
    guard = {
        "rest": lambda s: sign * s[1],
        "worn": lambda s: s[2],
        "ages": lambda s: sign * s[1] - v_cr,
    }[how]

    def there(t: float) -> Any:
        if t <= before[0]:
            return before[1]
        again = ode(motion).set_integrator("dop853", rtol=RTOL, atol=1e-15)
        return again.set_initial_value(before[1], before[0]).integrate(t)

    if guard(before[1]) <= 0.0:
        return before if before[0] > 0.0 else after
    t = brentq(lambda t: guard(there(t)), before[0], after[0], xtol=1e-15, rtol=1e-13)
    state = np.array(there(t))
    if how != "ages":
        state[1 if how == "rest" else 2] = 0.0
    return t, state


def _crest(nodes: list[tuple[float, Any]]) -> float:
    """Largest speed, by the parabola through the fastest node and its neighbours."""
    times, speeds = np.array([t for t, _ in nodes]), np.array([s[1] for _, s in nodes])
    i = int(np.argmax(speeds))
    if not 0 < i < times.size - 1:
        return float(speeds[i])
    fit = np.polyfit(times[i - 1 : i + 2] - times[i], speeds[i - 1 : i + 2], 2)
    return float(fit[2] - fit[1] ** 2 / (4.0 * fit[0])) if fit[0] < 0.0 else float(speeds[i])


def stick(pair: Pair, state: State, drive: float) -> float:
    """How long a mass at rest stays so [s]: the pull is linear in time, the grip saturates."""
    x, gamma = state

    def excess(t: float) -> float:
        aged = gamma - (1.0 - gamma) * math.expm1(-t / pair.t_cr)
        return pair.stiffness * (x + drive * t) + pair.c * drive - pair.grip(aged)

    if excess(0.0) >= 0.0:
        return 0.0
    longest = (pair.grip(1.0) - pair.c * drive - pair.stiffness * x) / (pair.stiffness * drive)
    return float(brentq(excess, 0.0, 1.0000001 * longest + 1e-12, xtol=1e-16, rtol=1e-13))


def _slide(pair: Pair, y: Any, drive: float, room: float) -> tuple[Any, float, float, bool]:
    """(state, duration [s], largest speed [m/s], whether it rests) of a motion of at most `room` [s].

    A mass that stops but is not held slides back.
    """
    t, peak, sign = 0.0, 0.0, 1.0
    ageing = not (y[2] <= 0.0 and y[1] * pair.t_cr >= pair.D)
    while True:
        y, length, how, top = _leg(pair, y, drive, sign, ageing, room - t)
        t, peak = t + length, max(peak, top)
        if how == "time" or t >= room:
            return y, t, peak, False
        if how == "rest":
            pull = pair.stiffness * y[0] + pair.c * drive
            if abs(pull) <= pair.grip(y[2]):
                return y, t, peak, True
            sign = math.copysign(1.0, pull)
        ageing = how != "worn"


def slide(pair: Pair, y: Any, drive: float, patience: float = SLIDES_AFTER) -> tuple[State, float, float] | None:
    """(rest state, duration [s], largest speed [m/s]) of a motion from (elongation, speed, gamma); None: it slides on
    for `patience` natural periods."""
    y, t, peak, rests = _slide(pair, y, drive, patience * 2.0 * math.pi * pair.time)
    return ((float(y[0]), float(y[2])), t, peak) if rests else None


def jump(pair: Pair, state: State, drive: float, patience: float = SLIDES_AFTER) -> Jump | None:
    """The stick from a rest state and the slip after it; None when the mass does not come to rest again."""
    length = stick(pair, state, drive)
    x, gamma = state[0] + drive * length, state[1] - (1.0 - state[1]) * math.expm1(-length / pair.t_cr)
    found = slide(pair, (x, 0.0, gamma), drive, patience)
    if found is None:
        return None
    end, slip, peak = found
    return Jump(pair.stiffness * (x - end[0]), length + slip, slip, peak, end)


def settled(
    pair: Pair, drive: float, start: State = (0.0, 1.0), cycles: int = 60, patience: float = SLIDES_AFTER
) -> Jump | None:
    """The cycle on which the motion from a rest state settles (the last of `cycles`); None when it ends in sliding.

    More cycles are given to a drop that still falls or still grows: just beyond its end stick-slip lingers.
    """
    before: Jump | None = None
    drift, lasted = 0.0, 0
    for i in range(LONGEST):
        if i >= cycles and lasted < DRIFTING:
            break
        now = jump(pair, start if before is None else before.end, drive, patience)
        if now is None or now.period <= 0.0:
            return None
        if before is not None and max(abs(now.drop / before.drop - 1), abs(now.period / before.period - 1)) < SETTLED:
            return now
        if before is not None:
            sign = math.copysign(1.0, now.drop - before.drop)
            drift, lasted = sign, lasted + 1 if sign == drift else 0
        before = now
    return before


def bracket(pair: Pair, drive: float, width: float = 2e-3, fastest: float = math.inf) -> tuple[float, float] | None:
    """Drive speeds [m/s] at which stick-slip that has begun still goes on, and no longer does.

    Raised from `drive` by half each time, every run from the last rest state of the one before, then halved; None
    without stick-slip at `drive`. An end above `fastest` is infinite.
    """
    first = settled(pair, drive)
    if first is None:
        return None
    low, high, state = drive, math.inf, first.end
    while not high / low <= 1.0 + width:
        trial = 1.5 * low if math.isinf(high) else math.sqrt(low * high)
        if trial > fastest:
            return low, math.inf
        found = settled(pair, trial, state)
        if found is None:
            high = trial
        else:
            low, state = trial, found.end
    return low, high


def slides_on(pair: Pair, drive: float, share: float = 0.02, periods: int = 10, rounds: int = 8) -> bool:
    """Whether steady sliding, its speed disturbed by `share`, does not come to rest and its swing dies down.

    A swing that grows by a millionth in each natural period comes to rest too, but only after more than anybody
    simulates: so the first and the last of `rounds` stretches of so many natural periods are compared.
    """
    gamma = max(0.0, 1.0 - drive * pair.t_cr / pair.D)
    mu = pair.mu_k0 - pair.delta_mu_k * math.expm1(-pair.a * drive)
    y: Any = (pair.load * (mu + (pair.mu_s - mu) * gamma) / pair.stiffness, (1.0 + share) * drive, gamma)
    swings = []
    for _ in range(rounds):
        y, _, peak, rests = _slide(pair, y, drive, periods * 2.0 * math.pi * pair.time)
        if rests:
            return False
        swings.append(peak / drive - 1.0)
    return swings[-1] < swings[1] or swings[-1] < 1e-6 * share
