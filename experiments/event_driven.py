"""The usual way to the same motion and answer, to compare with: least squares on an event-driven simulation.

Written for speed within that way: sticks in closed form, slips by DOP853 at rtol 1e-8 in local time from onset
to arrest, dense output only at the samples. Shares no line with the package.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import OptimizeResult, least_squares

Array = NDArray[np.float64]
State = tuple[float, float, float]  # elongation [m], sliding speed [m/s], gamma

RTOL, ATOL = 1e-8, (1e-13, 1e-11, 1e-10)
DIFF_STEP = 1e-6  # relative: well above the error of the simulation, well below a sample
NAMES = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")


@dataclass(frozen=True)
class Series:
    """One log: sample times (n,) [s], drive speed [m/s], normal force [N]."""

    time: Array
    drive_speed: float
    normal_force: float


def simulate(p: Mapping[str, float], log: Series, rtol: float = RTOL) -> tuple[Array, Array]:
    """Force at the samples (n,) [N], from rest with an unloaded spring and a fresh contact, and when slips begin [s].

    Args:
        p: the six friction parameters, mass, stiffness and damping by name, SI.
    """
    begun: list[float] = []
    k, v0, load = p["stiffness"], log.drive_speed, log.normal_force
    c = p["damping"] * math.sqrt(p["mass"] / k)
    out = np.empty(log.time.size)
    now, x, gamma, end = 0.0, 0.0, 0.0, float(log.time[-1])
    while now <= end:
        length = _stick(p, k * x + c * v0, gamma, k * v0, load)
        first, last = np.searchsorted(log.time, [now, now + length])
        out[first:last] = k * (x + v0 * (log.time[first:last] - now)) + c * v0
        now, x, gamma = now + length, x + v0 * length, 1.0 - (1.0 - gamma) * math.exp(-length / p["t_cr"])
        if now > end:
            break
        begun.append(now)
        start = (x, 0.0, gamma)
        for worn in (False, True):
            start, length, motion = _slide(p, c, start, v0, load, worn, (end - now + 1.0, rtol), broke_loose=not worn)
            first, last = np.searchsorted(log.time, [now, now + length])
            if last > first:
                state = motion(log.time[first:last] - now)
                out[first:last] = k * state[0] + c * (v0 - state[1])
            now += length
            if start[1] <= 0.0 or now > end:
                break
        x, _, gamma = start
        if gamma == 0.0:  # what the contact regains in the last moment of a worn slip, to first order
            deceleration = (p["mu_k0"] * load - k * x - c * v0) / p["mass"]
            gamma = p["D"] / (2.0 * deceleration * p["t_cr"] ** 2)
    return out, np.array(begun)


def _stick(p: Mapping[str, float], force: float, gamma: float, rate: float, load: float) -> float:
    """How long the mass rests [s]: Newton from the late end, where the spare grip is convex."""
    step, t = (p["mu_s"] - p["mu_k0"]) * load, max((p["mu_s"] * load - force) / rate, 0.0)
    for _ in range(60):
        left = (1.0 - gamma) * math.exp(-t / p["t_cr"])
        spare = p["mu_s"] * load - step * left - force - rate * t
        move = spare / (step * left / p["t_cr"] - rate)
        t = max(t - move, 0.0)
        if abs(move) <= 1e-15 * max(t, 1e-6):
            break
    return t


def _slide(
    p: Mapping[str, float],
    c: float,
    start: State,
    v0: float,
    load: float,
    worn: bool,
    asked: tuple[float, float],
    *,
    broke_loose: bool,
) -> tuple[State, float, Callable[[Array], Array]]:
    """Slide until the contact is clean or the mass rests: the state there, the duration [s], the dense output.

    asked: time at most [s], relative tolerance.
    """
    mu_k0, step0, weakening, a = p["mu_k0"], p["mu_s"] - p["mu_k0"], p["delta_mu_k"], p["a"]
    k, m, per_length, per_time = p["stiffness"], p["mass"], 1.0 / p["D"], 1.0 / p["t_cr"]

    def net(x: float, v: float, g: float) -> float:
        kinetic = mu_k0 - weakening * math.expm1(-a * max(v, 0.0))
        return k * x + c * (v0 - v) - load * (kinetic + (mu_k0 + step0 - kinetic) * g)

    balance = net(*start) if broke_loose else 0.0

    def rates(_t: float, y: Array) -> list[float]:
        x, v, g = float(y[0]), float(y[1]), 0.0 if worn else float(y[2])
        change = 0.0 if worn else (1.0 - g) * per_time - v * per_length
        return [v0 - v, (net(x, v, g) - balance) / m, change]

    def rests(_t: float, y: Array) -> float:
        return float(y[1])

    def clean(_t: float, y: Array) -> float:
        return float(y[2])

    rests.terminal, rests.direction = True, -1.0  # type: ignore[attr-defined]
    clean.terminal, clean.direction = True, -1.0  # type: ignore[attr-defined]
    events = [rests] if worn else [rests, clean]
    run = solve_ivp(rates, (0.0, asked[0]), start, "DOP853", rtol=asked[1], atol=ATOL, dense_output=True, events=events)
    x, v, g = run.y[:, -1].tolist()
    rested = run.t_events[0].size > 0
    return (x, 0.0 if rested else v, 0.0 if worn else max(g, 0.0)), float(run.t[-1]), run.sol


def fit_by_least_squares(
    truth: Mapping[str, float], logs: Sequence[tuple[Series, Array, float]], most: int | None = None
) -> OptimizeResult:
    """Fit the six friction parameters, started at the truth; settings are scipy's but for the difference step.

    Args:
        logs: each with its force (n,) [N] and noise [N].
        most: give up after so many evaluations (None: scipy's own limit).
    """

    def residuals(ratio: Array) -> Array:
        p = dict(truth) | {name: truth[name] * float(r) for name, r in zip(NAMES, ratio, strict=True)}
        return np.concatenate([(simulate(p, log)[0] - force) / noise for log, force, noise in logs])

    return least_squares(residuals, np.ones(6), diff_step=DIFF_STEP, x_scale=1.0, max_nfev=most)
