"""Other ways to simulate stick-slip, to compare with: events by solve_ivp, and friction smoothed by a tanh.

Both are written from the equations alone and share no line with the package. The event-driven one is written for
speed within that way: sticks in closed form by Newton's method, slips by solve_ivp with events, nothing sampled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from experiments.event_driven import _stick as stick

Array = NDArray[np.float64]

FLOORS = 1e-2  # absolute over relative tolerance, of a typical state
MOST_CALLS = 3_000_000  # evaluations of the motion; a run beyond is given up


@dataclass(frozen=True)
class Law:
    """The equations in SI: parameters by name, drive speed [m/s], normal force [N]."""

    p: Mapping[str, float]
    drive_speed: float
    normal_force: float

    @property
    def c(self) -> float:
        """Damper [N s/m]."""
        return self.p["damping"] * math.sqrt(self.p["mass"] / self.p["stiffness"])

    @property
    def typical(self) -> Array:
        """Sizes of elongation [m], speed [m/s] and gamma."""
        k, m = self.p["stiffness"], self.p["mass"]
        return np.array([self.normal_force / k, self.normal_force / math.sqrt(k * m), 1.0])


def onsets_by_events(law: Law, duration: float, rtol: float, method: str = "DOP853") -> Array:
    """Times at which slips start within `duration` [s], from rest, unloaded, fresh contact."""
    p, v0, load, c = law.p, law.drive_speed, law.normal_force, law.c
    k, m, mu_k0, step = p["stiffness"], p["mass"], p["mu_k0"], p["mu_s"] - p["mu_k0"]
    weakening, a, per_length, per_time = p["delta_mu_k"], p["a"], 1.0 / p["D"], 1.0 / p["t_cr"]
    expm1, atol = math.expm1, rtol * FLOORS * law.typical
    critical = p["D"] / p["t_cr"]

    def free(_t: float, y: Array) -> tuple[float, float, float]:
        x, v, g = y
        kinetic = mu_k0 - weakening * expm1(-a * (v if v > 0.0 else 0.0))
        friction = load * (kinetic + (mu_k0 + step - kinetic) * g)
        return v0 - v, (k * x + c * (v0 - v) - friction) / m, (1.0 - g) * per_time - v * per_length

    def worn(_t: float, y: Array) -> tuple[float, float]:
        x, v = y
        kinetic = mu_k0 - weakening * expm1(-a * (v if v > 0.0 else 0.0))
        return v0 - v, (k * x + c * (v0 - v) - load * kinetic) / m

    def rests(_t: float, y: Array) -> float:
        return float(y[1])

    def clean(_t: float, y: Array) -> float:
        return float(y[2])

    def released(_t: float, y: Array) -> float:
        return float(y[1]) - critical

    for event in (rests, clean, released):
        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    options: dict[str, Any] = {"method": method, "rtol": rtol}
    onsets: list[float] = []
    now, x, gamma = 0.0, 0.0, 0.0
    while True:
        length = stick(p, k * x + c * v0, gamma, k * v0, load)
        now += length
        if now > duration:
            return np.array(onsets)
        onsets.append(now)
        y = np.array([x + v0 * length, 0.0, 1.0 - (1.0 - gamma) * math.exp(-length * per_time)])
        first = 1e-2 * math.sqrt(m / k)
        run = solve_ivp(free, (0.0, 10.0), y, events=[rests, clean], atol=atol, first_step=first, **options)
        now, y = now + float(run.t[-1]), run.y[:, -1]
        if run.t_events[1].size:
            run = solve_ivp(worn, (0.0, 10.0), y[:2], events=[released], atol=atol[:2], **options)
            now += float(run.t[-1])
            start = np.append(run.y[:, -1], 0.0)
            run = solve_ivp(free, (0.0, 10.0), start, events=[rests], atol=atol, **options)
            now, y = now + float(run.t[-1]), run.y[:, -1]
        x, gamma = float(y[0]), float(y[2])


class GivenUpError(RuntimeError):
    """A run that took too many evaluations."""


def passages_by_smoothing(law: Law, duration: float, width: float, rtol: float, method: str, speed: float) -> Array:
    """Times at which the sliding speed rises through `speed` [m/s], with friction times tanh(v/width [m/s]).

    gamma is kept within 0 and 1 by holding its rate there, the way such programs do it.

    Raises:
        GivenUpError: more than MOST_CALLS evaluations.
    """
    p, v0, load, c = law.p, law.drive_speed, law.normal_force, law.c
    k, m, mu_k0, step = p["stiffness"], p["mass"], p["mu_k0"], p["mu_s"] - p["mu_k0"]
    weakening, a, per_length, per_time = p["delta_mu_k"], p["a"], 1.0 / p["D"], 1.0 / p["t_cr"]
    calls = 0

    def motion(_t: float, y: Array) -> tuple[float, float, float]:
        nonlocal calls
        calls += 1
        if calls > MOST_CALLS:
            raise GivenUpError(f"more than {MOST_CALLS} evaluations")
        x, v, g = y
        g = min(max(g, 0.0), 1.0)
        kinetic = mu_k0 - weakening * math.expm1(-a * abs(v))
        friction = load * (kinetic + (mu_k0 + step - kinetic) * g) * math.tanh(v / width)
        change = (1.0 - g) * per_time - abs(v) * per_length
        return v0 - v, (k * x + c * (v0 - v) - friction) / m, max(change, 0.0) if y[2] <= 0.0 else change

    def passes(_t: float, y: Array) -> float:
        return float(y[1]) - speed

    passes.direction = 1.0  # type: ignore[attr-defined]
    atol = rtol * FLOORS * law.typical
    run = solve_ivp(motion, (0.0, duration), np.zeros(3), method=method, rtol=rtol, atol=atol, events=[passes])
    if not run.success:
        raise GivenUpError(run.message)
    return np.asarray(run.t_events[0])
