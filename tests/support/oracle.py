"""An independent, slow and tight integrator of the stick-slip oscillator: the answer tests compare with.

Written from the equations alone (m v' = k x_b + c (v_0 - v) - s F_n [mu_k(v) + (mu_s - mu_k(v)) gamma],
x_b' = v_0 - v, gamma' = (1 - gamma)/t_cr - |v|/D within [0, 1], c = h sqrt(m/k)); it shares no line with the
package. Sticks are closed form with a bracketed root; slips are DOP853 with events, in a local time that starts
at zero with every piece and in increments from the state at its start, so that nothing cancels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Array = NDArray[np.float64]
Programme = float | Sequence[tuple[float, float]]
State = tuple[float, float, float]  # elongation [m], sliding speed [m/s], gamma [1]

RTOL = 1e-12
ATOL = (1e-19, 1e-17, 1e-15)


@dataclass(frozen=True)
class Law:
    """The constants of one pair and rig, SI."""

    mu_s: float
    mu_k0: float
    delta_mu_k: float
    a: float
    D: float
    t_cr: float
    mass: float
    stiffness: float
    damping: float

    @property
    def c(self) -> float:
        """Damper [N s/m]."""
        return self.damping * math.sqrt(self.mass / self.stiffness)

    def rested(self, gamma: float, t: Array | float) -> Array | float:
        """Gamma after resting for t [s]."""
        return gamma - (1.0 - gamma) * np.expm1(-np.asarray(t) / self.t_cr)


@dataclass(frozen=True)
class Piece:
    """One stretch of one mode: drive constant, normal force linear, local time from 0 to length [s]."""

    start: float
    length: float
    mode: str  # "stick", "slip" or "renewed"
    direction: int
    drive: float
    load: tuple[float, float]  # normal force [N] at the start, its rate [N/s]
    state: State
    motion: Callable[[Array], Array] | None  # increments (2 or 3, n) at local times (n,)


@dataclass(frozen=True)
class Oracle:
    """A finished run. Event times [s] and the states there, (elongation, speed, gamma) per row."""

    law: Law
    pieces: tuple[Piece, ...]
    onsets: Array
    onset_states: Array
    arrests: Array
    arrest_states: Array
    wear_times: Array
    directions: Array  # of sliding, per onset

    def state(self, times: Array) -> Array:
        """Elongation [m], sliding speed [m/s] and gamma at times (n,): shape (3, n)."""
        return self._at(times)[:3]

    def force(self, times: Array) -> Array:
        """What the load cell sees [N] at times (n,): k x_b + c (v_0 - v)."""
        x, v, _, drive = self._at(times)
        return self.law.stiffness * x + self.law.c * (drive - v)

    def _at(self, times: Array) -> Array:
        times = np.asarray(times, dtype=float)
        starts = np.array([p.start for p in self.pieces])
        which = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        order = np.argsort(which, kind="stable")
        edges = np.searchsorted(which[order], np.arange(len(self.pieces) + 1))
        out = np.empty((4, times.size))
        for i in np.unique(which):
            rows, piece = order[edges[i] : edges[i + 1]], self.pieces[i]
            out[:3, rows] = _inside(self.law, piece, times[rows] - piece.start)
            out[3, rows] = piece.drive
        return out


def _inside(law: Law, piece: Piece, t: Array) -> Array:
    x, v, gamma = piece.state
    if piece.motion is None:
        return np.array([x + piece.drive * t, np.zeros_like(t), law.rested(gamma, t)])
    inc = piece.motion(t)
    rest = gamma + inc[2] if len(inc) == 3 else np.zeros_like(t)
    return np.array([x + inc[0], v + inc[1], rest])


def _stick(law: Law, state: State, drive: float, load: tuple[float, float], room: float) -> tuple[float, int]:
    """How long the mass rests (at most room [s]) and which way it then goes (0: still at rest)."""

    def excess(t: Array | float, s: int) -> Array:
        grip = law.mu_k0 + (law.mu_s - law.mu_k0) * law.rested(state[2], t)
        pull = s * (law.stiffness * (state[0] + drive * np.asarray(t)) + law.c * drive)
        return np.asarray(pull - (load[0] + load[1] * np.asarray(t)) * grip)

    grid = np.linspace(0.0, room, 129)
    best, way = math.inf, 0
    for s in (1, -1):
        above = excess(grid, s) > 0
        if not above.any():
            continue
        i = int(np.argmax(above))
        root = 0.0 if i == 0 else float(brentq(lambda t, s=s: float(excess(t, s)), grid[i - 1], grid[i], xtol=1e-16))
        if root < best:
            best, way = root, s
    return (room, 0) if way == 0 else (best, way)


def _slip(
    law: Law,
    mode: str,
    s: int,
    state: State,
    drive: float,
    load: tuple[float, float],
    room: float,
    broke_loose: bool,
    rtol: float,
    method: str,
) -> tuple[float, Array, Callable[[Array], Array], str]:
    """Integrate one piece of sliding: length, end increments, dense output, what ended it."""
    x0, v0, gamma0 = state
    step, c, k, m = law.mu_s - law.mu_k0, law.c, law.stiffness, law.mass
    free = mode == "slip"

    def weakening(v: float) -> float:
        return -law.delta_mu_k * math.expm1(min(-law.a * s * v, 50.0))  # a trial step backwards stays finite

    mu_start = law.mu_k0 + step * gamma0 + (1.0 - gamma0) * weakening(v0)
    net_start = 0.0 if broke_loose else k * x0 + c * (drive - v0) - s * load[0] * mu_start

    def rates(t: float, y: Array) -> list[float]:
        dx, dv = float(y[0]), float(y[1])
        dg = float(y[2]) if free else 0.0
        v = v0 + dv
        change = step * dg + (1.0 - gamma0 - dg) * weakening(v) - (1.0 - gamma0) * weakening(v0)
        friction = load[1] * t * (mu_start + change) + load[0] * change
        out = [drive - v, (net_start + k * dx - c * dv - s * friction) / m]
        return [*out, (1.0 - gamma0 - dg) / law.t_cr - s * v / law.D] if free else out

    def arrest(t: float, y: Array) -> float:
        return s * (v0 + float(y[1]))

    def switch(t: float, y: Array) -> float:
        return gamma0 + float(y[2]) if free else s * (v0 + float(y[1])) - law.D / law.t_cr

    def turn(t: float, y: Array) -> float:
        return s * rates(t, y)[1]

    for event in (arrest, switch):
        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    turn.direction = 1.0  # type: ignore[attr-defined]
    run = solve_ivp(
        rates,
        (0.0, room),
        np.zeros(3 if free else 2),
        method=method,
        rtol=rtol,
        atol=np.array(ATOL[: 3 if free else 2]),
        first_step=min(room, 1e-3 * math.sqrt(m / k)),
        dense_output=True,
        events=(arrest, switch, turn),
    )
    if not run.success:
        raise RuntimeError(run.message)
    for lowest in run.t_events[2]:
        # An event is a change of sign from step to step: a touch of rest within one step is none, but a lowest speed.
        if arrest(lowest, run.sol(lowest)) < 0.0:
            before = max(t for t in (*run.t, *run.t_events[2]) if t < lowest and arrest(t, run.sol(t)) > 0.0)
            at = float(brentq(lambda t: arrest(t, run.sol(t)), before, lowest, xtol=1e-16))
            return at, run.sol(at), run.sol, "arrest"
    ended = "arrest" if run.t_events[0].size else "switch" if run.t_events[1].size else "room"
    return float(run.t[-1]), run.y[:, -1], run.sol, ended


def _breaks(duration: float, *programmes: Sequence[tuple[float, float]]) -> list[float]:
    inner = {t for programme in programmes for t, _ in programme if 0.0 < t < duration}
    return [0.0, *sorted(inner), duration]


def _programme(value: Programme) -> Sequence[tuple[float, float]]:
    return [(0.0, float(value))] if isinstance(value, (int, float)) else value


def simulate(
    parameters: Mapping[str, float],
    drive: Programme,
    normal_force: Programme,
    duration: float,
    initial: State = (0.0, 0.0, 0.0),
    rtol: float = RTOL,
    method: str = "DOP853",
    strengths: Iterator[float] | None = None,
) -> Oracle:
    """Run the oscillator.

    Args:
        parameters: mu_s, mu_k0, delta_mu_k, a, D, t_cr, mass, stiffness, damping (SI, by name).
        drive: speed [m/s], or ((start [s], speed), ...), piecewise constant.
        normal_force: force [N], or ((time [s], force), ...), piecewise linear, constant beyond its ends.
        duration: [s].
        initial: elongation [m], sliding speed [m/s], gamma.
        rtol: relative tolerance of the slips.
        method: of scipy's solve_ivp; "Radau" for stiff slips (at a looser rtol).
        strengths: by what mu_s - mu_k0 is multiplied in every stick and the sliding after it; None: by nothing.
    """
    alike = Law(**{name: float(parameters[name]) for name in Law.__annotations__})
    law = _of_strength(alike, strengths)
    speeds, loads = _programme(drive), _programme(normal_force)
    load_t, load_f = np.array(loads, dtype=float).T
    events: dict[str, list[tuple[float, State]]] = {"onset": [], "arrest": [], "wear": []}
    pieces: list[Piece] = []
    directions: list[int] = []
    state, mode, s = initial, "stick" if initial[1] == 0.0 else "slip", 1 if initial[1] >= 0.0 else -1
    if state[2] <= 0.0 and s * state[1] > law.D / law.t_cr:
        mode = "renewed"
    breaks = _breaks(duration, speeds, loads)
    for begin, end in pairwise(breaks):
        speed = [v for t, v in speeds if t <= begin][-1]
        ends = np.interp([begin, end], load_t, load_f)
        slope, now, broke_loose = float(ends[1] - ends[0]) / (end - begin), begin, False
        while now < end:
            load, room = (float(ends[0]) + slope * (now - begin), slope), end - now
            if mode == "stick":
                length, way = _stick(law, state, speed, load, room)
                pieces.append(Piece(now, length, mode, s, speed, load, state, None))
                state = (state[0] + speed * length, 0.0, float(law.rested(state[2], length)))
                now = now + length if way else end
                if way:
                    mode, s, broke_loose = "slip", way, length > 0.0
                    events["onset"].append((now, state))
                    directions.append(way)
                continue
            length, inc, sol, ended = _slip(law, mode, s, state, speed, load, room, broke_loose, rtol, method)
            pieces.append(Piece(now, length, mode, s, speed, load, state, sol))
            gamma = state[2] + float(inc[2]) if mode == "slip" else 0.0
            state, broke_loose = (state[0] + float(inc[0]), state[1] + float(inc[1]), gamma), False
            now = end if ended == "room" else now + length
            if ended == "arrest":
                mode, state, law = "stick", (state[0], 0.0, max(state[2], 0.0)), _of_strength(alike, strengths)
                events["arrest"].append((now, state))
            elif ended == "switch":
                if mode == "slip":
                    events["wear"].append((now, (state[0], state[1], 0.0)))
                mode, state = "renewed" if mode == "slip" else "slip", (state[0], state[1], 0.0)
    return Oracle(
        alike,
        tuple(pieces),
        onsets=_times(events["onset"]),
        onset_states=_states(events["onset"]),
        arrests=_times(events["arrest"]),
        arrest_states=_states(events["arrest"]),
        wear_times=_times(events["wear"]),
        directions=np.array(directions, dtype=float),
    )


def _of_strength(law: Law, strengths: Iterator[float] | None) -> Law:
    return law if strengths is None else replace(law, mu_s=law.mu_k0 + next(strengths) * (law.mu_s - law.mu_k0))


def _times(events: list[tuple[float, State]]) -> Array:
    return np.array([t for t, _ in events], dtype=float)


def _states(events: list[tuple[float, State]]) -> Array:
    return np.array([y for _, y in events], dtype=float).reshape(-1, 3)


def noisy_log(oracle: Oracle, duration: float, rate: float, noise: float, seed: int) -> tuple[Array, Array]:
    """Times [s] and load cell force [N] sampled at rate [Hz] with white noise of sd noise [N]."""
    times = np.arange(round(duration * rate) + 1) / rate
    return times, oracle.force(times) + noise * np.random.default_rng(seed).standard_normal(times.size)
