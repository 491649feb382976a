"""Stick-slip whose strength differs from stick to stick, from the equations alone: nothing of the estimator is used.

m v' = k x_b + c (v_0 - v) - F_n [mu_k(v) + (mu_s' - mu_k(v)) gamma], x_b' = v_0 - v,
gamma' = (1 - gamma)/t_cr - v/D within [0, 1], c = h sqrt(m/k); every stick, and the slip after it, has its own
mu_s' = mu_k0 + e^s (mu_s - mu_k0), s normal with standard deviation `scatter`. Sticks in closed form with a bracketed
root, slips by scipy's DOP853 with located switches. The load cell shows spring and damper.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from data_io import Record
from experiments.brute_force import Pair, stick
from experiments.study_problem import Case

Array = NDArray[np.float64]

PRECISION = {"rtol": 1e-9, "atol": 1e-15, "method": "DOP853"}
LONGEST = 40.0  # natural periods of a slip
PUSH = 1e-9  # [s] beyond the onset, where pull and grip balance, that a slip begins


def with_scatter(case: Case, speeds: Sequence[tuple[float, float, float]], scatter: float, seed: int) -> list[Record]:
    """The logs of a case, each of speed [m/s], duration [s] and sampling rate [Hz], with strength that scatters.

    Raises:
        ValueError: a mass that does not come to rest again.
    """
    random, noise = np.random.default_rng(seed), 5e-3
    pair = Pair.of(case.truth | case.rig)
    records = []
    for speed, duration, rate in speeds:
        times = np.arange(round(duration * rate) + 1) / rate
        force = forces(pair, speed, times, scatter, random) + noise * random.standard_normal(times.size)
        records.append(Record(times, np.full(times.size, pair.load), force))
    return records


def forces(pair: Pair, drive: float, times: Array, scatter: float, random: np.random.Generator) -> Array:
    """What the load cell shows at times (n,) [s] from rest, unloaded, with a fresh contact [N]."""
    shown, t, x, gamma = np.empty(times.size), 0.0, 0.0, 0.0
    while t < times[-1]:
        factor = float(np.exp(scatter * random.standard_normal()))
        strong = Pair(**{**vars(pair), "mu_s": pair.mu_k0 + factor * (pair.mu_s - pair.mu_k0)})
        rest = stick(strong, (x, gamma), drive) + PUSH
        rows = (times >= t) & (times <= t + rest)
        shown[rows] = pair.stiffness * (x + drive * (times[rows] - t)) + pair.c * drive
        x, gamma, t = x + drive * rest, gamma - (1.0 - gamma) * np.expm1(-rest / pair.t_cr), t + rest
        state, mode = np.array([x, 0.0, gamma]), "ageing"
        end = t + LONGEST * 2.0 * np.pi * pair.time
        while mode != "rest":
            if t >= min(end, times[-1]):
                if t >= times[-1]:
                    break
                raise ValueError("the mass slides on")
            state, t, mode = _part(strong, drive, state, (t, end), mode, times, shown)
        x, gamma = float(state[0]), float(state[2])
    return shown


def _part(
    pair: Pair,
    drive: float,
    state: Array,
    span: tuple[float, float],
    mode: str,
    times: Array,
    shown: Array,
) -> tuple[Array, float, str]:
    """A part of a slip, "ageing" or "worn", until it rests, wears or ages again: state, time and what follows."""
    motion, worn, v_cr = _motion(pair, drive, mode), mode == "worn", pair.D / pair.t_cr

    def rests(_t: float, y: Any) -> float:
        return float(y[1])

    def changes(_t: float, y: Any) -> float:
        return float(y[1] - v_cr if worn else y[2])

    for event in (rests, changes):
        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    found = solve_ivp(
        motion,
        span,
        state,
        events=[rests, changes],
        dense_output=True,
        max_step=2.0 * np.pi * pair.time / 50,
        **PRECISION,
    )
    until = float(found.t[-1])
    rows = (times > span[0]) & (times <= until)
    if np.any(rows):
        x, v, _ = found.sol(times[rows])
        shown[rows] = pair.stiffness * x + pair.c * (drive - v)
    end, rested = np.array(found.y[:, -1]), found.t_events[0].size > 0
    if rested:
        end[1] = 0.0
        return end, until, "rest"
    end[2] = 0.0
    return end, until, "ageing" if worn else "worn"


def _motion(pair: Pair, drive: float, mode: str) -> Callable[[float, Any], list[float]]:
    """The equations of a slip; worn: gamma rests at 0."""

    def rates(_t: float, y: Any) -> list[float]:
        x, v, gamma = y
        mu = pair.mu_k0 - pair.delta_mu_k * np.expm1(-pair.a * max(v, 0.0))
        force = pair.stiffness * x + pair.c * (drive - v) - pair.load * (mu + (pair.mu_s - mu) * gamma)
        ageing = 0.0 if mode == "worn" else (1.0 - gamma) / pair.t_cr - v / pair.D
        return [drive - v, force / pair.mass, ageing]

    return rates
