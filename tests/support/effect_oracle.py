"""A second, slow and tight integrator of the oscillator with all its effects: the answer tests compare with.

Written from the equations of the effects in plain numpy; it shares no line with the package. Rests and slips alike
are DOP853 with events, also where the package has a closed form; what a sensor averages is a state of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Programme = float | Sequence[tuple[float, float]]
Drive = float | Callable[[float], float]  # speed [m/s], or that at a time [s]

RTOL = 1e-12
NAMES = ("elongation", "sliding_speed", "gamma", "skin_deformation", "lagged_force", "second_lagged_force", "track")
X, V, GAMMA, SKIN, LAG1, LAG2, TRACK, IMPULSE = range(8)
ATOL = np.array([1e-17, 1e-15, 1e-14, 1e-17, 1e-13, 1e-13, 1e-17, 1e-14])
KNOWN = frozenset(
    "inertia hysteresis_damping driven_damping contact_ageing velocity_weakening linear_weakening power_law "
    "direct_effect load_dependence pressure_dependence varying_normal_force occlusion friction_heterogeneity "
    "excitation finger_motion skin_compliance force_sensor sensor_lag sensor_second_lag".split()
)
RHYTHMS = ("breathing", "pulse", "tremor")


def uniform(seed: float, number: float) -> float:
    """The fraction of a large sine."""
    wild = 43758.5453 * math.sin(12.9898 * number + 78.233 * seed + 0.5)
    return 1e-6 + (1 - 2e-6) * (wild - math.floor(wild))


def normal(seed: float, number: float) -> float:
    """Box and Muller."""
    return math.sqrt(-2 * math.log(uniform(seed, number))) * math.cos(2 * math.pi * uniform(seed + 0.37, number + 0.71))


class Track:
    """The level along the track: 48 harmonics, one per equal share of the Cauchy distribution of wave numbers."""

    def __init__(self, seed: float, sd: float, length: float) -> None:
        top = math.atan(2 * math.pi / 0.02)
        self.numbers = np.tan(top * (np.arange(48) + 0.5) / 48) / length
        self.phases = 2 * np.pi * np.array([uniform(seed, i + 0.5) for i in range(48)])
        self.size = sd * math.sqrt(2 / 48)

    def at(self, position: float) -> float:
        """Level at a position [m]."""
        return float(self.size * np.sum(np.cos(self.numbers * position + self.phases)))


class Equations:
    """Forces and rates of one rig and pair; `on`: the effects that are there. p: parameters by name, SI."""

    def __init__(self, on: Collection[str], p: Mapping[str, float]) -> None:
        unknown = sorted(set(on) - KNOWN)
        if unknown:
            raise ValueError(f"the independent integrator knows no {unknown[0]}; write its equation here")
        self.on, self.p = frozenset(on), SimpleNamespace(**p)
        q = self.p
        self.c = 0.0
        if "hysteresis_damping" in on:
            self.c = q.damping * math.sqrt(q.mass / q.stiffness)
        if "driven_damping" in on:
            self.c = q.damping / (2 * math.pi * q.damping_frequency)
        self.waves: list[tuple[float, float, float]] = []
        if "excitation" in on:
            self.waves.append((q.excitation_amplitude, 2 * math.pi * q.excitation_frequency, q.excitation_phase))
        if "finger_motion" in on:
            for r in RHYTHMS:
                self.waves.append((p[f"{r}_amplitude"], 2 * math.pi * p[f"{r}_frequency"], p[f"{r}_phase"]))
        self.stick = 0
        self.fast = False  # beyond the kink of the power law
        if "friction_heterogeneity" in on:
            self.track = Track(q.field_seed, q.field_sd, q.field_length)

    # -- drive

    def drive(self, v0: Drive, t: float) -> float:
        """Speed of the drive with its motions [m/s]."""
        speed = (v0(t) if callable(v0) else v0) + sum(a * w * math.cos(w * t + phi) for a, w, phi in self.waves)
        return speed + (self.p.finger_drift if "finger_motion" in self.on else 0.0)

    def loading(self) -> float:
        """Relative change of the rate at which the spring is stretched in this stick."""
        if "friction_heterogeneity" not in self.on:
            return 0.0
        return self.p.loading_sd * normal(self.p.field_seed, self.stick + 1e4)

    # -- rig

    def rig(self, s: Sequence[float], v: float, speed: float) -> tuple[float, float]:
        """Force of the rig [N], and rate of the skin's deformation [m/s]."""
        q = self.p
        if "skin_compliance" not in self.on:
            return q.stiffness * s[X] + self.c * (speed - v), 0.0
        damper = q.skin_stiffness * q.skin_retardation
        rig = q.stiffness * (s[X] - s[SKIN]) + self.c * (speed - v)
        give = (rig - q.skin_stiffness * s[SKIN]) / (self.c + damper)
        return q.skin_stiffness * s[SKIN] + damper * give, give

    def shown(self, s: Sequence[float], force: float) -> float:
        """What the load cell shows of a force, not averaged [N]."""
        if "sensor_second_lag" in self.on:
            force = s[LAG2]
        elif "sensor_lag" in self.on:
            force = s[LAG1]
        return self.p.sensor_gain * force + self.p.sensor_offset if "force_sensor" in self.on else force

    def quickest(self) -> float:
        """Shortest time constant of lags and skin [s]."""
        q, times = self.p, [math.inf]
        if "skin_compliance" in self.on:
            times.append((self.c + q.skin_stiffness * q.skin_retardation) / (q.stiffness + q.skin_stiffness))
        times += [getattr(q, name) for name in ("lag_time", "second_lag_time") if hasattr(q, name)]
        return min(times)

    # -- contact

    def kinetic(self, v: float) -> float:
        """Kinetic coefficient at sliding speed v >= 0."""
        q = self.p
        if "velocity_weakening" in self.on:
            return q.mu_k0 + q.delta_mu_k * (1 - math.exp(-q.a * max(v, 0.0)))
        if "linear_weakening" in self.on:
            return q.mu_k0 + q.slope * v
        if "power_law" in self.on and self.fast:
            return q.mu_k0 * (v / q.lowest_speed) ** -q.speed_exponent
        return q.mu_k0

    def moistened(self, t: float) -> float:
        """Share of the occlusion that has come about."""
        return 1 - math.exp(-t / self.p.occlusion_time) if "occlusion" in self.on else 0.0

    def friction(self, s: Sequence[float], v: float, load: float, t: float, gamma: float) -> float:
        """Friction force at sliding speed v [N]."""
        q = self.p
        kinetic, share = self.kinetic(v), gamma
        if "friction_heterogeneity" in self.on:
            share *= math.exp(q.strength_sd * normal(q.field_seed, self.stick))
        coefficient = kinetic + (q.mu_s - kinetic) * share
        if "direct_effect" in self.on:
            coefficient += q.direct_strength * math.log(1 + max(v, 0.0) / q.direct_speed)
        if "friction_heterogeneity" in self.on:
            coefficient += self.track.at(s[TRACK])
        if "load_dependence" in self.on:
            coefficient *= (load / q.reference_force) ** -q.load_exponent
        if "pressure_dependence" in self.on:
            area = q.contact_area * (load / q.area_force) ** q.area_exponent
            coefficient *= (load / area / q.reference_pressure) ** -q.pressure_exponent
        if "occlusion" in self.on:
            coefficient *= math.exp(q.occlusion_level * self.moistened(t))
        return load * coefficient

    def ageing(self, gamma: float, v: float, t: float) -> float:
        """Rate of gamma [1/s], unclamped."""
        if "contact_ageing" not in self.on:
            return 0.0
        pace = 1 + (self.p.occlusion_hastening * self.moistened(t) if "occlusion" in self.on else 0.0)
        return pace * (1 - gamma) / self.p.t_cr - v / self.p.D

    def share(self, gamma: float, resting: bool) -> float:
        """Strengthening: gamma; without ageing all of it at rest and nothing in sliding."""
        return gamma if "contact_ageing" in self.on else float(resting)

    # -- motion

    def rates(self, s: Sequence[float], mode: str, way: int, v0: Drive, load: float, t: float) -> list[float]:
        """Time derivatives of the eight states."""
        resting = mode == "stick"
        v = 0.0 if resting else s[V]
        speed = self.drive(v0, t)
        force, give = self.rig(s, v, speed)
        stretching = speed - v
        if resting and not callable(v0):
            stretching += v0 * self.loading()
        gamma = 0.0 if mode == "renewed" else s[GAMMA]
        acceleration = 0.0
        if not resting:
            braking = self.friction(s, way * v, load, t, self.share(gamma, False))
            acceleration = (force - way * braking) / self.p.mass
        first = (force - s[LAG1]) / self.p.lag_time if "sensor_lag" in self.on else 0.0
        second = (s[LAG1] - s[LAG2]) / self.p.second_lag_time if "sensor_second_lag" in self.on else 0.0
        aged = 0.0 if mode == "renewed" else self.ageing(gamma, way * v, t)
        return [stretching, acceleration, aged, give, first, second, v, self.shown(s, force)]

    def spare(self, s: Sequence[float], way: int, v0: Drive, load: float, t: float) -> float:
        """Grip less the pull in one direction, at rest [N]."""
        force = self.rig(s, 0.0, self.drive(v0, t))[0]
        return self.friction(s, 0.0, load, t, self.share(s[GAMMA], True)) - way * force


@dataclass(frozen=True)
class Piece:
    """One stretch of one mode in local time [s]: its states (8, n) at local times by `motion`."""

    start: float
    length: float
    mode: str
    stick: int
    motion: Callable[[Array], Array]


@dataclass
class Run:
    """A finished run: pieces, times of onsets and arrests [s]."""

    equations: Equations
    v0: Drive
    load: Programme
    pieces: list[Piece] = field(default_factory=list)
    onsets: list[float] = field(default_factory=list)
    arrests: list[float] = field(default_factory=list)

    def states(self, times: Array) -> Array:
        """The eight states (8, n) at times (n,)."""
        which = np.searchsorted([p.start for p in self.pieces], times, side="right") - 1
        return np.stack(
            [
                self.pieces[i].motion(np.array([t - self.pieces[i].start]))[:, 0]
                for i, t in zip(which, times, strict=True)
            ],
            axis=1,
        )

    def force(self, times: Array) -> Array:
        """What the load cell shows at times (n,) [N]."""
        equations, span = self.equations, 0.0
        if "force_sensor" in equations.on:
            span = equations.p.averaging_time
        if span > 0.0:
            since = np.maximum(times - span, 0.0)
            impulse = self.states(times)[IMPULSE] - self.states(since)[IMPULSE]
            still = times <= 0.0
            moment = self._moment(times[still])
            mean = impulse / np.where(still, 1.0, times - since)
            mean[still] = moment
            return mean
        return self._moment(times)

    def _moment(self, times: Array) -> Array:
        out = []
        for t, s in zip(times, self.states(times).T, strict=True):
            out.append(self.equations.shown(s, self.equations.rig(s, s[V], self.equations.drive(self.v0, float(t)))[0]))
        return np.array(out)


def simulate(
    on: Collection[str],
    p: Mapping[str, float],
    v0: Drive,
    load: Programme,
    duration: float,
    *,
    start: Mapping[str, float] | None = None,
    rtol: float = RTOL,
) -> Run:
    """Run from rest (or the states `start` by name) for `duration` [s]; drive v0 [m/s], also over time, normal force
    [N] constant or ((time, force), ...), piecewise linear."""
    equations = Equations(on, p)
    run = Run(equations, v0, load)
    s = np.array([(start or {}).get(name, 0.0) for name in NAMES] + [0.0])
    knots = [(0.0, float(load))] if isinstance(load, (int, float)) else list(load)
    ends = [t for t, _ in knots if 0.0 < t < duration] + [duration]
    mode, way, now = "stick", 1, 0.0
    while now < duration:
        end = next(t for t in ends if t > now)
        length, s, cause, motion = _piece(equations, mode, way, s, v0, knots, now, end - now, rtol)
        if length > 0.0:
            run.pieces.append(Piece(now, length, mode, equations.stick, motion))
        now = end if cause == "time" else now + length
        if cause == "onset":
            force = equations.rig(s, 0.0, equations.drive(v0, now))[0]
            mode, way, equations.fast = "slip", 1 if force >= 0 else -1, False
            run.onsets.append(now)
        elif cause == "arrest":
            s[V] = 0.0
            run.arrests.append(now)
            mode = "stick"
            equations.stick += 1
        elif cause == "empty":
            s[GAMMA] = 0.0
            mode = "renewed"
        elif cause == "kink":
            equations.fast = not equations.fast
        elif cause == "refill":
            mode = "slip"
    return run


def _piece(
    equations: Equations,
    mode: str,
    way: int,
    s: Array,
    v0: Drive,
    knots: Sequence[tuple[float, float]],
    now: float,
    room: float,
    rtol: float,
) -> tuple[float, Array, str, Callable[[Array], Array]]:
    """One piece: its length, the state at its end, what ended it, its motion."""
    times, forces = zip(*knots, strict=True)

    def load(t: float) -> float:
        return float(np.interp(now + t, times, forces))

    def rates(t: float, y: Array) -> list[float]:
        return equations.rates((s + y).tolist(), mode, way, v0, load(t), now + t)

    def spare(w: int) -> Callable[[float, Array], float]:
        return lambda t, y: equations.spare((s + y).tolist(), w, v0, load(t), now + t)

    def stopped(t: float, y: Array) -> float:
        return way * float(s[V] + y[V])

    def emptied(t: float, y: Array) -> float:
        return float(s[GAMMA] + y[GAMMA])

    def refilled(t: float, y: Array) -> float:
        return -equations.ageing(0.0, way * float(s[V] + y[V]), now + t)

    def kink(t: float, y: Array) -> float:
        beyond = way * float(s[V] + y[V]) - equations.p.lowest_speed
        return beyond if equations.fast else -beyond

    ages = "contact_ageing" in equations.on
    bent = [("kink", kink)] if "power_law" in equations.on else []
    table: dict[str, list[tuple[str, Callable[[float, Array], float]]]] = {
        "stick": [("onset", spare(1)), ("onset", spare(-1))],
        "slip": [("arrest", stopped), *([("empty", emptied)] if ages else []), *bent],
        "renewed": [("arrest", stopped), ("refill", refilled), *bent],
    }
    events = []
    for _, event in table[mode]:
        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        events.append(event)
    zero = np.zeros(8)
    if mode == "stick" and min(event(0.0, zero) for event in events) <= 0.0:
        return 0.0, s, "onset", lambda t: s[:, None] + 0.0 * t
    fastest = max((w for a, w, _ in equations.waves if a), default=0.0)
    longest = min(room / 40 if mode == "stick" else np.inf, 2 * math.pi / (16 * fastest) if fastest else np.inf)
    longest = min(longest, 0.5 * equations.quickest())  # stable it is with longer steps, accurate within them it is not
    done = solve_ivp(
        rates,
        (0.0, room),
        zero,
        method="DOP853",
        rtol=rtol,
        atol=ATOL,
        first_step=min(room, 1e-3 * math.sqrt(equations.p.mass / equations.p.stiffness), longest),
        max_step=longest,
        dense_output=True,
        events=events,
    )
    if not done.success:
        raise RuntimeError(done.message)
    hit = [name for (name, _), found in zip(table[mode], done.t_events, strict=True) if found.size]
    cause = hit[0] if hit else "time"
    return float(done.t[-1]), s + done.y[:, -1], cause, lambda t: s[:, None] + done.sol(t)
