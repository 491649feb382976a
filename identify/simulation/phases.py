"""One phase of motion at a time: rest until the drive overcomes the static limit, slide until an event ends the mode.

Time is local to the phase: after 800 s of sticking a slip of microseconds loses no digits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.model.model import ELONGATION, SPEED, Model
from identify.model.modes import GUARDS, GuardName, ModeName, sliding_modes
from identify.simulation.drive import Drive, NormalForce, breaks
from identify.simulation.plan import Plan, Scales
from identify.simulation.resting import Resting
from identify.simulation.stepper import N_GUARDS, SHORTEST, Situated, Stepper, Stop, borrowed, give_back
from identify.simulation.steppers import Method

Array = NDArray[np.float64]

# ----------------------------------------------------------------------------------------------------------------------
# A phase of motion as it stands in a trajectory.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Phase:
    """A stretch of one mode, with its nodes (a stick has its two ends only): local times (s,) [s], states (s, n_x).

    `ended_by` is the event that ended it, None when its time was up.
    """

    mode: ModeName
    start: float
    situated: Situated
    times: Sequence[float] | Array
    states: Sequence[Sequence[float]] | Sequence[Array] | Array
    ended_by: GuardName | None

    @cached_property
    def t(self) -> Array:
        """Node times from its start [s], shape (s,)."""
        return np.asarray(self.times, float)

    @cached_property
    def x(self) -> Array:
        """States at the nodes, shape (s, n_x)."""
        return np.asarray(self.states, float)

    @property
    def duration(self) -> float:
        """Length of the phase [s]."""
        return float(self.times[-1])

    @property
    def end(self) -> Array:
        """State at its end (n_x,)."""
        return np.asarray(self.states[-1], float)


@dataclass(frozen=True)
class Stick(Phase):
    """A rest; `drive_force` is the force of the drive on the mass at its end [N]."""

    drive_force: float


@dataclass(frozen=True)
class Slide(Phase):
    """A stretch of sliding, taken by steps of `method` with `tolerances` (rtol, then atol (n_x,))."""

    method: Method
    tolerances: Array


def rest(rests: Resting, x: Array, situated: Situated, start: float, limit: float) -> Stick:
    """Rest from state x until the static limit is overcome, or for `limit` [s]."""
    x = x.copy()
    x[SPEED] = 0.0
    onset, after, force = rests.until(x, situated, limit)
    until = limit if onset is None else onset
    times, states = ([0.0, until], [x, after]) if until > 0.0 else ([0.0], [x])
    return Stick("stick", start, situated, times, states, None if onset is None else "speed", force)


# ----------------------------------------------------------------------------------------------------------------------
# What moves a scene: its rests, and the steps of the method that is at work.
# ----------------------------------------------------------------------------------------------------------------------

MAX_STEPS = 200_000  # of one sliding phase: a bound, so that no scene runs for ever
PATIENCE = 3000  # trials of one slide after which the next method takes over, where there is one
FIRST = 1e-3  # of the natural time: the very first step
FLOOR = 1e-6  # absolute over relative tolerance, of typical states
ROUNDING = 1e-12  # what the rounding of the forces makes of the speed within a thousandth of the natural time


class Machine:
    """All that moves one scene: its rests, and the stepper of the method that is at work.

    Holds buffers, so one per thread. It remembers between phases which method that is and how long a first step may
    be: one slip is like the next.

    Args:
        p: parameters (n_p,).
        locate: False takes the step at whose end an event function is negative as it is (a control for tests:
            accuracy is lost).
    """

    def __init__(self, model: Model, p: Array, scale: Scales, plan: Plan, *, locate: bool = True) -> None:
        self.model, self.locate, self.scale, self.p = model, locate, scale, p
        self._steps, self._pace = MAX_STEPS, 0.0  # the last: of a motion that goes on [s]
        floor = FLOOR * scale.state
        # The speed of a slip that starts from balance grows from nothing: relative down to the rounding of the forces.
        floor[SPEED] *= min(ROUNDING / plan.rtol, 1.0)
        self.tolerances = np.concatenate([[plan.rtol], plan.rtol * floor])
        self._left, self._borrowed = list(plan.methods), list[Stepper]()
        self.stepper = self._next()
        self.rests = Resting(model)
        modes = sliding_modes(model.clamped is not None)
        self.first = dict.fromkeys(modes, min(FIRST * scale.time, scale.first))
        self.following: dict[ModeName, dict[GuardName, ModeName]] = {n: dict(mode.exits) for n, mode in modes.items()}

    def _next(self) -> Stepper:
        """The stepper of the first method that is left."""
        method, scale = self._left[0], self.scale
        stepper = borrowed(self.model, method)
        self._borrowed.append(stepper)
        longest = min(method.reach * scale.time, scale.longest)
        stepper.tune(self.p, self.tolerances, (longest, SHORTEST * scale.time, scale.farthest, self.locate))
        return stepper

    def close(self) -> None:
        """Give back what others can use: the run is over."""
        while self._borrowed:
            give_back(self._borrowed.pop())

    def begins(self, situated: Situated, x: Array) -> ModeName:
        """The mode in which a mass that moves begins: a fresh contact that would age below nothing is clamped."""
        clamped = self.model.clamped
        if clamped is None or x[clamped] > (self.model.states[clamped].lower or 0.0):
            return "slip"
        falls = float(self.model.slip(x, self.p, situated.at(0.0, situated.direction))[clamped]) < 0.0
        return "worn" if falls else "slip"

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
            if stop == Stop.NOT_YET and not (len(self._left) > 1 and tried > PATIENCE):
                continue
            if stop in (Stop.NOT_YET, Stop.STUCK):
                break
            by = None if stop == Stop.TIME_IS_UP else self._end(mode, row, times, states)
            self._pace = self.stepper.pace if by in ("clearance", "release") else 0.0
            self._steps = min(MAX_STEPS, self._steps - len(times) + 2000)  # earned by every phase
            return Slide(mode, situated.time, situated, times, states, by, self.stepper.method, self.tolerances)
        if len(self._left) > 1:  # the next method takes over for good
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
                length, guard = min(
                    (from_zero(lambda part, i=i: stepper.trial(mode, x, t, part)[at.n + 1 + i], h), i)  # type: ignore[misc]
                    for i in fallen
                )
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
        if i == len(slide.times) - 1 and slide.ended_by not in (None, "speed"):
            return  # it gets faster in the next mode
        coefficient = self.stepper.coefficient(slide.mode, slide.states[i], slide.times[i])
        if coefficient < -1e-9:  # friction coefficients within this of zero are rounding
            raise SimulationError(
                f"friction pushes at {slide.start + slide.times[i]:.6g} s (coefficient {coefficient:.3g} at "
                f"{abs(slide.states[i][SPEED]):.3g} m/s): a law has left its range; let friction fall less with speed "
                "and along the track"
            )


def from_zero(value: Callable[[float], float], h: float) -> float:
    """The length within (0, h] of a step at which a value that may start at zero falls to zero."""
    low = next((f * h for f in (0.0, *np.geomspace(0.5, 1e-12, 20).tolist()) if value(f * h) > 0.0), None)
    return 0.0 if low is None else float(scipy.optimize.brentq(value, low, h, xtol=1e-15 * h, rtol=1e-14))


# ----------------------------------------------------------------------------------------------------------------------
# Phase after phase.
# ----------------------------------------------------------------------------------------------------------------------

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
        mode = machine.begins(Situated(p, drive.at(0.0), direction, *normal_force.line(0.0)), x)
    phase: Phase
    for number in range(MAX_PHASES):
        situated = Situated(p, drive.at(t), direction, *normal_force.line(t), t)
        limit = max(float(ends[segment]) - t, 0.0)
        if mode == "stick":
            phase = stick = rest(machine.rests, x, situated, t, limit)
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
