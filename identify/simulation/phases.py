"""One phase of motion at a time: rest until the drive overcomes the static limit, slide until an event ends the mode.

Time is local to the phase: after 800 s of sticking a slip of microseconds loses no digits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
import scipy
from numpy.typing import NDArray

from identify.base.compiled import Compiled, Mapped
from identify.base.errors import SimulationError
from identify.base.roots import first_zero
from identify.model.model import ELONGATION, INPUTS, SPEED, TIME, Model
from identify.simulation.drive import Drive, NormalForce, breaks
from identify.simulation.plan import Scales, Stepping, swing
from identify.simulation.stepper import (
    GUARDS,
    N_GUARDS,
    SHORTEST,
    GuardName,
    ModeName,
    Situated,
    Stepper,
    Stop,
    numbers_of,
    rested,
    sliding_modes,
    symbols,
)
from identify.simulation.steppers import Method

Array = NDArray[np.float64]

# A phase of motion as it stands in a trajectory.


@dataclass(frozen=True)
class Phase:
    """A stretch of one mode, with its nodes (a stick has its two ends only): times from its start t (s,) [s], states x
    (s, n_x). `ended_by` is the event that ended it, None when its time was up."""

    mode: ModeName
    start: float
    situated: Situated
    t: Array
    x: Array
    ended_by: GuardName | None

    @property
    def duration(self) -> float:
        """Length of the phase [s]."""
        return float(self.t[-1])

    @property
    def end(self) -> Array:
        """State at its end (n_x,)."""
        return self.x[-1]


@dataclass(frozen=True)
class Stick(Phase):
    """A rest; `drive_force` is the force of the drive on the mass at its end [N]."""

    drive_force: float


@dataclass(frozen=True)
class Slide(Phase):
    """A stretch of sliding, taken by steps of `method` with `tolerances` (rtol, then atol (n_x,))."""

    method: Method
    tolerances: Array


# How long a resting mass stays at rest: the first time at which the drive overcomes the static limit.
#
# Where the breakaway margin (static limit minus force of the drive) is concave in time, as it is for a steady drive and
# a contact that saturates, it has one zero at most; anything else is scanned (`first_zero`).

_SHARES = np.geomspace(1e-9, 1.0, 24)  # of the longest rest: where its curvature is looked at


@lru_cache(maxsize=32)
def _rest_functions(model: Model) -> tuple[ca.Function, ca.Function, Mapped, Mapped]:
    """By (x at the start, constants, t): the row (breakaway margin [N], its slope, force of the drive [N], state); the
    largest second derivative of the margin at some times; for many at once the margin, and what it is without what
    oscillates."""
    x, c, t, p, u = symbols(model)
    after, pull = rested(model, x, p, c[p.numel() :], t)
    force, limit = model.driving_force(after, p, u), model.grip(after, p, u)
    margin = limit - ca.fabs(force)
    shown = ca.vertcat(margin, ca.jacobian(margin, t), force, after)
    row = ca.Function("row", [x, c, t], [ca.cse(ca.densify(shown))])
    curvature = ca.Function("curvature", [x, c, t], [ca.densify(ca.jacobian(ca.jacobian(margin, t), t))])
    times = ca.SX.sym("times", _SHARES.size)
    largest = ca.mmax(ca.vertcat(*(curvature(x, c, at) for at in ca.vertsplit(times))))
    calm = limit - ca.fabs(pull)
    many = [Mapped(ca.Function("margins", [x, c, t], [ca.cse(ca.densify(q))])) for q in (margin, calm)]
    return row, ca.Function("curvatures", [x, c, times], [ca.cse(largest)]), *many


class Resting:
    """Rests of one model; holds buffers, so one per thread."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self._x, self._c = np.zeros(len(model.states)), np.zeros(len(model.parameters) + numbers_of(model))
        self._t, self._at_shares = np.zeros(1), np.zeros(_SHARES.size)
        row, curvatures, self._margins, self._calm = _rest_functions(model)
        self._row, self._curvature = Compiled(row), Compiled(curvatures)
        self._row.bind([self._x, self._c, self._t])
        self._curvature.bind([self._x, self._c, self._at_shares])

    def rest(self, x: Array, situated: Situated, limit: float) -> Stick:
        """Rest from x (n_x,), its speed taken as zero, until the static limit is overcome, or for `limit` [s].

        Raises:
            SimulationError: too fast a vibration to be looked at.
        """
        x = x.copy()
        x[SPEED] = 0.0
        margin, force = self.margin(x, situated)
        if margin <= 0.0:
            return Stick("stick", situated.time, situated, np.zeros(1), x[None], "speed", force)
        onset = None
        if limit > 0.0:
            np.multiply(_SHARES, limit, out=self._at_shares)
            if self.model.vibrates or self._curvature()[0] > 0.0:
                # Looked at finely only where what oscillates may take the margin to zero.
                period, swung = swing(self.model, situated.p)

                def margins(times: Array) -> Array:
                    return self._at(float(times[0]))[:1] if times.size == 1 else self._at_times(self._margins, times)

                def least(times: Array) -> Array:
                    return self._at_times(self._calm, times) - (1.0 + 1e-12) * swung  # force of what oscillates

                onset = first_zero(margins, limit, period, least)
            elif self._at(limit)[0] <= 0.0:
                precision = {"xtol": 1e-16 * limit, "rtol": 1e-15}
                onset = float(scipy.optimize.brentq(lambda t: float(self._at(t)[0]), 0.0, limit, **precision))
        until, ended_by = (limit, None) if onset is None else (onset, GUARDS[0])
        row, nodes = self._at(until), 2 if until > 0.0 else 1
        t, states = np.array([0.0, until][:nodes]), np.array([x, row[3:]][:nodes])
        return Stick("stick", situated.time, situated, t, states, ended_by, float(row[2]))

    def margin(self, x: Array, situated: Situated) -> tuple[float, float]:
        """By how much a mass at rest in x (n_x,) withstands the drive [N], and the force of the drive [N]."""
        self._x[:] = x
        self._c[: situated.p.size], self._c[situated.p.size :] = situated.p, situated.numbers(self.model)
        row = self._at(0.0)
        return float(row[0]), float(row[2])

    def _at(self, t: float) -> Array:
        self._t[0] = t
        return self._row()

    def _at_times(self, function: Mapped, times: Array) -> Array:
        """A margin [N] at times (n,) [s]."""
        return function([*(np.repeat(given[None], times.size, axis=0) for given in (self._x, self._c)), times])[0][:, 0]


# Rests side by side, from a state, parameters and inputs of each row; no drive may vibrate.

DOUBLINGS = 60  # of the longest rest that the spring alone allows for
NEWTON_STEPS = 60  # towards the end of a rest
SCAN = np.geomspace(1e-6, 1.0, 33)  # of a rest: where the margin is looked at if it need not be concave


@lru_cache(maxsize=16)
def rest_row(model: Model, forward: bool = False) -> Mapped:
    """Of a rest, by (x, p, u at its start, t): breakaway margin [N], its slope, force of the drive [N], the state.
    forward: as if the mass could not be pulled back, so that what slips backwards now and then still has cycles."""
    x, p, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters)), ca.SX.sym("u", len(INPUTS))
    t = ca.SX.sym("t")
    then = ca.vertcat(u[:TIME], u[TIME] + t)
    rested = model.rest(x, p, then, t)
    force = model.driving_force(rested, p, then)
    margin = model.grip(rested, p, then) - (force if forward else ca.fabs(force))
    row = ca.vertcat(margin, ca.jacobian(margin, t), force, rested)
    return Mapped(ca.Function("rest_row", [x, p, u, t], [ca.cse(ca.densify(row))]))


def sticks(model: Model, x: Array, p: Array, u: Array, forward: bool = False) -> tuple[Array, Array, Array]:
    """Durations (n,) [s] of rests from states x (n, n_x) until the static limit is overcome (0: at once; NaN: never),
    the states there (n, n_x), the forces of the drive (n,) [N]; p (n, n_p), u (n, 4) at the start; see `rest_row`."""
    # The first zero of the breakaway margin is bracketed, by a scan where transients may bring several.
    x, low, stiffness = x.copy(), np.zeros(len(x)), p[:, model.parameter_names.index("stiffness")]
    x[:, SPEED] = 0.0

    def look(t: Array) -> Array:
        return rest_row(model, forward)([x, p, u, t])[0]

    with np.errstate(all="ignore"):
        high = 2.0 * (np.max(p[:, :2], axis=1) * u[:, 1] / stiffness + np.abs(x[:, ELONGATION])) / u[:, 0]
        at_once = look(low)[:, 0] <= 0.0
        for _ in range(DOUBLINGS):
            held = look(high)[:, 0] > 0.0
            if not np.any(held):
                break
            high = np.where(held, 2.0 * high, high)
        if model.decays.numel_out(0):
            times, rows = SCAN[:, None] * high, np.arange(high.size)
            first = np.argmax([look(each)[:, 0] < 0.0 for each in times], axis=0)
            low, high = np.where(first > 0, times[first - 1, rows], 0.0), times[first, rows]
        t = high = np.where(at_once, 0.0, high)
        for _ in range(NEWTON_STEPS):
            row = look(t)
            low, high = np.where(row[:, 0] > 0.0, t, low), np.where(row[:, 0] > 0.0, high, t)
            newton = t - row[:, 0] / row[:, 1]
            after = np.where((low <= newton) & (newton <= high), newton, 0.5 * (low + high))
            # The forces have so many digits: a margin of the last one is none.
            if np.all(
                (np.abs(after - t) <= 1e-14 * t) | (np.abs(row[:, 0]) <= np.finfo(float).eps * np.abs(row[:, 2]))
            ):
                break
            t = after
    return np.where(held, np.nan, t), row[:, 3:], row[:, 2]


# What moves a scene: its rests, and the steps of the method that is at work.

MAX_STEPS = 200_000  # of one sliding phase: a bound, so that no scene runs for ever
FIRST = 1e-3  # of the natural time: the very first step
FLOOR = 1e-6  # absolute over relative tolerance, of typical states
ROUNDING = 1e-12  # what the rounding of the forces makes of the speed within a thousandth of the natural time


class Machine:
    """All that moves one scene: its rests, and the stepper of the method that is at work.

    Holds buffers, so one per thread. It remembers between phases which method that is and how long a first step may
    be: one slip is like the next.

    Args:
        p: parameters (n_p,).
        stepping: where it does not locate switches, the step at whose end an event function is negative is taken as it
            is (a control for tests: accuracy is lost).
    """

    def __init__(self, model: Model, p: Array, scale: Scales, stepping: Stepping) -> None:
        self.model, self.locate, self.scale, self.p = model, stepping.locate, scale, p
        self._steps, self._pace = MAX_STEPS, 0.0  # the last: of a motion that goes on [s]
        floor = FLOOR * scale.state
        # The speed of a slip that starts from balance grows from nothing: relative down to the rounding of the forces.
        floor[SPEED] *= min(ROUNDING / stepping.rtol, 1.0)
        self.tolerances = np.concatenate([[stepping.rtol], stepping.rtol * floor])
        self._left = list(stepping.methods(scale.stiff))
        self.stepper = self._next()
        self.rests = Resting(model)
        self.following = sliding_modes(model.clamped is not None)
        self.first = dict.fromkeys(self.following, min(FIRST * scale.time, scale.first))

    def _next(self) -> Stepper:
        """The stepper of the first method that is left."""
        method, scale = self._left[0], self.scale
        stepper = Stepper(self.model, method)
        longest = min(method.reach * scale.time, scale.longest)
        stepper.tune(self.p, self.tolerances, (longest, SHORTEST * scale.time, scale.farthest, self.locate))
        return stepper

    def slide(self, mode: ModeName, x: Array, situated: Situated, limit: float) -> Slide:
        """Slide from state x in one mode until that ends, or for `limit` [s].

        Raises:
            SimulationError: too many steps or a state that is not finite; the motion runs away.
        """
        begin = self._begin(mode, x, situated, limit)
        times, states, at, tried = [0.0], [begin.tolist()], self.stepper.places, 0
        while tried < self._steps:
            rows = self.stepper.go_on()
            if len(times) == 1 and rows[0][at.t] > 0.0 and rows[0][at.stop] == Stop.NOT_YET:
                self.first[mode] = min(rows[0][at.h], self.scale.first)
            for row in rows:
                tried += 1
                if row[at.t] > times[-1]:
                    times.append(row[at.t])
                    states.append(row[: at.n])
                if row[at.stop]:
                    break
            stop = row[at.stop]
            if stop == Stop.NOT_YET and not (len(self._left) > 1 and tried > 3000):  # then the next method takes over
                continue
            if stop in (Stop.NOT_YET, Stop.STUCK):
                break
            by = None if stop == Stop.TIME_IS_UP else self._end(mode, row, times, states)
            self._pace = self.stepper.pace if by in ("clearance", "release") else 0.0
            self._steps = min(MAX_STEPS, self._steps - len(times) + 2000)  # earned by every phase
            nodes = np.array(times), np.array(states)
            return Slide(mode, situated.time, situated, *nodes, by, self.stepper.method, self.tolerances)
        if len(self._left) > 1:  # for good
            del self._left[0]
            self.stepper = self._next()
            return self.slide(mode, x, situated, limit)
        phase, speed = f"the {mode} phase at {situated.time:.6g} s", abs(states[-1][SPEED])
        if not speed < 1e9 * self.scale.state[SPEED]:  # no bounded friction gets there
            raise SimulationError(
                f"{phase} runs away (it reached {speed:.3g} m/s): friction falls with speed without a floor; make the "
                "slope smaller, or take the law velocity_weakening"
            )
        raise SimulationError(
            f"{phase} did not end within {self._steps} steps (it reached {times[-1]:.3g} s): the motion is too "
            "stiff to follow; check mass, a and normal force"
        )

    def _begin(self, mode: ModeName, x: Array, situated: Situated, limit: float) -> Array:
        """The state from which a slide goes on: the last digits of the forces may hold back a slip that begins."""
        for doublings in range(-1, 8):  # of the last digit of the elongation
            near = x.copy()
            if doublings >= 0:
                near[ELONGATION] += situated.direction * 2.0**doublings * np.spacing(abs(x[ELONGATION]))
            self.stepper.start(mode, near, situated, limit, max(self.first[mode], self._pace))
            if x[SPEED] != 0.0 or self.stepper.speeding >= 0.0:
                return near
        self.stepper.start(mode, x, situated, limit, self.first[mode])
        return x

    def _end(self, mode: ModeName, last: list[float], times: list[float], states: list[list[float]]) -> GuardName:
        """The event that ends a slide; its last node lies there, with the event function exactly zero."""
        stepper, at, exits = self.stepper, self.stepper.places, [GUARDS.index(g) for g in self.following[mode]]
        if last[at.stop] == Stop.LOCATED:
            ends = stepper.ends
            guard = min(exits, key=lambda i: abs(ends[i] / (ends[N_GUARDS + i] or 1e-300)))
        else:
            x, t, h = last[: at.n], last[at.t], last[at.h]
            row = stepper.trial(mode, x, t, h)[at.n + 1 :]
            fallen = [i for i in exits if row[i] < 0.0 or (row[i] == 0.0 and t > 0.0)]
            length, guard = h, fallen[0]
            if self.locate:
                lengths = []
                for i in fallen:  # where within the step an event function that may start at zero falls to zero

                    def value(part: float, i: int = i) -> float:
                        return stepper.trial(mode, x, t, part)[at.n + 1 + i]

                    starts = (part * h for part in (0.0, *np.geomspace(0.5, 1e-12, 20).tolist()))
                    low = next((part for part in starts if value(part) > 0.0), None)
                    found = low if low is None else scipy.optimize.brentq(value, low, h, xtol=1e-15 * h, rtol=1e-14)
                    lengths.append((found or 0.0, i))
                length, guard = min(lengths)
            times.append(t + length)
            states.append(stepper.trial(mode, x, t, length)[: at.n] if length > 0.0 else x)
        after, clamped = states[-1], self.model.clamped
        if GUARDS[guard] == "speed":
            after[SPEED] = 0.0
        elif GUARDS[guard] == "clearance" and clamped is not None:
            after[clamped] = self.model.states[clamped].lower or 0.0
        return GUARDS[guard]

    def check_braking(self, slide: Slide) -> None:
        """Refuse a slide in which friction does not brake where the mass is fastest.

        Raises:
            SimulationError: where, and what to do.
        """
        i = int(np.argmax(np.abs(slide.x[:, SPEED])))
        if i == slide.t.size - 1 and slide.ended_by not in (None, "speed"):
            return  # it gets faster in the next mode
        coefficient = self.stepper.coefficient(slide.mode, slide.x[i], slide.t[i])
        if coefficient < -1e-9:  # friction coefficients within this of zero are rounding
            raise SimulationError(
                f"friction pushes at {slide.start + slide.t[i]:.6g} s (coefficient {coefficient:.3g} at "
                f"{abs(slide.x[i, SPEED]):.3g} m/s): a law has left its range; let friction fall less with speed "
                "and along the track"
            )


# Phase after phase.

MAX_PHASES = 2_000_000


def phases(machine: Machine, drive: Drive, normal_force: NormalForce, duration: float, x: Array) -> Iterator[Phase]:
    """The phases of the motion from state x (n_x,), one by one, until `duration` [s].

    Raises:
        SimulationError: chatter (stick and slip without time passing), a slip that cannot be integrated, or in which
            friction pushes.
    """
    model, p = machine.model, machine.p
    ends = breaks(drive, normal_force, duration)
    t, segment, marked, direction = 0.0, 0, -np.inf, 1.0
    mode: ModeName = "stick"
    if x[SPEED] != 0.0:
        direction = float(np.sign(x[SPEED]))
        mode, u = "slip", np.array([drive.at(0.0), normal_force.line(0.0)[0], direction, 0.0])
        if model.clamped is not None and x[model.clamped] <= (model.states[model.clamped].lower or 0.0):
            # A fresh contact that would age below nothing is clamped.
            mode = "renewed" if float(model.slip(x, p, u)[model.clamped]) < 0.0 else "slip"
    phase: Phase
    for number in range(MAX_PHASES):
        speed, acceleration = drive.line(t)
        situated = Situated(p, speed, direction, *normal_force.line(t), t, acceleration)
        limit = max(float(ends[segment]) - t, 0.0)
        if mode == "stick":
            phase = stick = machine.rests.rest(x, situated, limit)
            direction = -1.0 if stick.drive_force < 0.0 else 1.0
        else:
            phase = slide = machine.slide(mode, x, situated, limit)
            machine.check_braking(slide)
        if number % 1000 == 999:
            if t - marked < machine.scale.time:
                raise SimulationError(
                    f"the contact sticks and slips without time passing at {t:.6g} s (chatter): simulate sliding where "
                    "the static coefficient is close to the kinetic one; after a long rest start shortly before its "
                    "end, with the elongation it has there"
                )
            marked = t
        if phase.duration > 0.0:
            yield phase
        t, x = phase.start + phase.duration, phase.end
        if phase.ended_by is None:
            t, segment = float(ends[segment]), segment + 1
            if segment == ends.size:
                return
        elif mode == "stick":
            mode = "slip"
        else:
            mode = machine.following[mode][phase.ended_by]
            if mode == "stick" and model.jumps:
                x = np.array(model.at_stick(x, p, situated.at(phase.duration))).ravel()
    raise SimulationError(f"the simulation reached {t:.6g} s of {duration:.6g} s in {MAX_PHASES} phases; shorten it")
