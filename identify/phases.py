"""One phase of motion at a time: rest until the drive overcomes the grip, slide until a guard falls to zero.

Switch times are located on the step function itself (the last step is repeated with the length at
which its guard is zero), so they are as accurate as the integration, not as its interpolation.
Time is local to the phase: after 800 s of sticking a slip of microseconds loses no digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.errors import SimulationError
from identify.methods import Method
from identify.model import ELONGATION, SPEED, Model
from identify.modes import GUARDS, GuardName, ModeName, sliding_modes
from identify.plan import Plan, growth
from identify.resting import Resting
from identify.scales import Scales
from identify.situated import Situated
from identify.stepping import N_GUARDS, SHORTEST, Stepper, Stop

Array = NDArray[np.float64]

MAX_STEPS = 200_000  # of one sliding phase: a bound, so that no scene runs for ever
PATIENCE = 3000  # trials of one phase after which the next method takes over, where there is one
RUNAWAY = 1e9  # times the speed at which one normal force stops the mass: no bounded friction gets there
FREEING = 8  # doublings of the last digit of the elongation that set a mass free which only rounding holds
LEAST = 1e-9  # friction coefficients within this of zero are rounding
FIRST = 1e-3  # of the natural time: the very first step
BEGINNING = 0.1  # of the time in which a slip that has just begun grows e-fold: no first step is longer
FLOOR = 1e-6  # absolute over relative tolerance, of typical states
ROUNDING = 1e-12  # what the rounding of the forces makes of the speed within a thousandth of the natural time


@dataclass(frozen=True)
class Phase:
    """A stretch of one mode, with its nodes (a stick has its two ends only): local times (s,) [s], states (s, n_x).

    `ended_by` is the guard that ended it, None when its time was up.
    """

    mode: ModeName
    start: float
    situated: Situated
    times: Sequence[float] | Array
    states: Sequence[Sequence[float]] | Array
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
    """A rest; `pull` is the force of the drive on the mass at its end [N]."""

    pull: float


@dataclass(frozen=True)
class Slide(Phase):
    """A stretch of sliding, taken by steps of `method` with `tolerances` (rtol, then atol (n_x,))."""

    method: Method
    tolerances: Array


class Machine:
    """All that moves one scene: its rests and, per sliding mode, steppers in the order in which they take over.

    Holds buffers, so one per thread. It remembers between phases which method is at work and how long a first step
    may be: one slip is like the next.

    Args:
        p: parameters (n_p,).
        locate: False takes the step at whose end a guard is negative as it is (a control for tests: accuracy is lost).
    """

    def __init__(self, model: Model, p: Array, scale: Scales, plan: Plan, *, locate: bool = True) -> None:
        self.model, self.locate, self.scale, self.p = model, locate, scale, p
        self._floor = FLOOR * self.scale.state
        # The speed of a slip that starts from balance grows from nothing: relative down to the rounding of the forces.
        self._floor[SPEED] *= min(ROUNDING / plan.rtol, 1.0)
        self._rtol, self._left = plan.rtol, {mode: list(methods) for mode, methods in plan.methods.items()}
        self._at_work: dict[ModeName, Stepper] = {}
        self.rests = Resting(model)
        fastest = growth(model, p, scale)
        self.longest_first = BEGINNING / fastest if fastest > 0.0 else np.inf
        self.first = dict.fromkeys(self._left, min(FIRST * self.scale.time, self.longest_first))
        self.modes = sliding_modes(model.clamped is not None)
        self.following = {name: dict(mode.exits) for name, mode in self.modes.items()}
        self.exits = {name: tuple(GUARDS.index(guard) for guard, _ in mode.exits) for name, mode in self.modes.items()}

    def stepper(self, mode: ModeName) -> Stepper:
        """The one that is at work."""
        if mode not in self._at_work:
            method, scale, rtol = self._left[mode][0], self.scale, self._rtol
            self._at_work[mode] = Stepper(
                self.model,
                method,
                mode,
                self.p,
                rtol,
                rtol * self._floor,
                SHORTEST * scale.time,
                min(method.reach * scale.time, scale.longest),
                scale.farthest,
                self.locate,
            )
        return self._at_work[mode]

    def has_more(self, mode: ModeName) -> bool:
        """Whether there is a method that could take over."""
        return len(self._left[mode]) > 1

    def give_over(self, mode: ModeName) -> bool:
        """Let the next method take over for good; False where there is none."""
        if not self.has_more(mode):
            return False
        del self._left[mode][0], self._at_work[mode]
        return True


def stick(model: Model, x: Array, situated: Situated, start: float, limit: float) -> Stick:
    """Rest from state x until the grip is overcome, or for `limit` [s]."""
    return rest(Resting(model), x, situated, start, limit)


def rest(rests: Resting, x: Array, situated: Situated, start: float, limit: float) -> Stick:
    """The same with what is compiled for a model and used again."""
    x = x.copy()
    x[SPEED] = 0.0
    onset, after, pull = rests.until(x, situated, limit)
    end = limit if onset is None else onset
    times, states = ([0.0, end], np.stack([x, after])) if end > 0.0 else ([0.0], x[None, :])
    return Stick("stick", start, situated, times, states, None if onset is None else "speed", pull)


def slide(
    machine: Machine, mode: ModeName, x: Array, situated: Situated, start: float, limit: float, most: int = MAX_STEPS
) -> Slide:
    """Slide in one mode from state x until one of its guards falls to zero, or for `limit` [s].

    Args:
        most: bound of the steps.

    Raises:
        SimulationError: the integration needs more than `most` steps or meets a state that is not finite; friction
            pushes; the motion runs away.
    """
    stepper, n = machine.stepper(mode), len(machine.model.states)
    stepper.start(x, situated, limit, machine.first[mode])
    if x[SPEED] == 0.0 and stepper.speeding < 0.0:
        x = _freed(machine, stepper, x, situated, limit)
    times, states, tried = [0.0], [x.tolist()], 0
    ended_by: GuardName | None = None
    while tried < most:
        rows = stepper.go_on()
        tried += len(rows)
        for row in rows:
            if row[n] > times[-1]:
                if len(times) == 1 and row[-1] == Stop.NOT_YET:
                    machine.first[mode] = min(row[stepper.places.h], machine.longest_first)
                times.append(row[n])
                states.append(row[:n])
        stop = rows[-1][-1]
        if stop == Stop.NOT_YET and (tried <= PATIENCE or not machine.has_more(mode)):
            continue
        if stop in (Stop.NOT_YET, Stop.STUCK):
            break
        if stop != Stop.TIME_IS_UP:
            ended_by = _end(machine, stepper, stop == Stop.LOCATED, rows[-1], times, states)
        _refuse_push(stepper, start, times, states)
        return Slide(mode, start, situated, times, states, ended_by, stepper.method, stepper.tolerances)
    if machine.give_over(mode):
        return slide(machine, mode, x, situated, start, limit, most)
    raise SimulationError(_unfinished(machine, mode, start, times[-1], abs(states[-1][SPEED]), most))


def _freed(machine: Machine, stepper: Stepper, x: Array, situated: Situated, limit: float) -> Array:
    """The state from which a slip starts that the last digits of the forces would hold back; x where it is more."""
    for moves in range(FREEING):
        near = x.copy()
        near[ELONGATION] += situated.direction * 2.0**moves * np.spacing(abs(x[ELONGATION]))
        stepper.start(near, situated, limit, machine.first[stepper.mode])
        if stepper.speeding >= 0.0:
            return near
    stepper.start(x, situated, limit, machine.first[stepper.mode])
    return x


def _unfinished(machine: Machine, mode: ModeName, start: float, reached: float, speed: float, most: int) -> str:
    """Why a slide did not end, and what to do."""
    if not speed < RUNAWAY * machine.scale.state[SPEED]:
        return (
            f"the {mode} phase at {start:.6g} s runs away (it reached {speed:.3g} m/s): friction falls with "
            "speed without a floor; make the slope smaller, or take the law velocity_weakening"
        )
    return (
        f"the {mode} phase at {start:.6g} s did not end within {most} steps (it reached {reached:.3g} s): "
        "the motion is too stiff to follow; check mass, a and normal force"
    )


def _refuse_push(stepper: Stepper, start: float, times: list[float], states: list[list[float]]) -> None:
    """Where the mass slides fastest friction must still brake.

    Raises:
        SimulationError: the friction coefficient is negative there.
    """
    speeds = [abs(state[SPEED]) for state in states]
    i = speeds.index(max(speeds))
    coefficient = stepper.coefficient(states[i], times[i])
    if coefficient < -LEAST:
        raise SimulationError(
            f"friction pushes at {start + times[i]:.6g} s (coefficient {coefficient:.3g} at "
            f"{abs(states[i][SPEED]):.3g} m/s): a law has left its range; let friction fall less with speed and along "
            "the track"
        )


def _end(
    machine: Machine, stepper: Stepper, located: bool, last: list[float], times: list[float], states: list[list[float]]
) -> GuardName:
    """The guard that ends a phase; the last node lies there, with the guard exactly zero."""
    mode, at = stepper.mode, stepper.places
    if located:
        ends = last[at.ends]
        guard = min(machine.exits[mode], key=lambda i: abs(ends[i] / (ends[N_GUARDS + i] or 1e-300)))
    else:
        x, t, h = last[: at.n], last[at.t], last[at.h]
        row = stepper.trial(x, t, h)[at.n + 1 :]
        fallen = [i for i in machine.exits[mode] if row[i] < 0.0 or (row[i] == 0.0 and t > 0.0)]
        length, guard = min((_from_rest(stepper, x, h, i), i) for i in fallen) if machine.locate else (h, fallen[0])
        times.append(t + length)
        states.append(stepper.trial(x, t, length)[: at.n] if length > 0.0 else x)
    after, clamped = states[-1], machine.model.clamped
    if GUARDS[guard] == "speed":
        after[SPEED] = 0.0
    elif GUARDS[guard] == "clearance" and clamped is not None:
        after[clamped] = machine.model.states[clamped].lower or 0.0
    return GUARDS[guard]


def _from_rest(stepper: Stepper, x: list[float], h: float, guard: int) -> float:
    """The length within (0, h] of a first step at which a guard that may start at zero falls to zero."""
    at = stepper.places.n + 1 + guard

    def value(length: float) -> float:
        return stepper.trial(x, 0.0, length)[at]

    low = next((f * h for f in np.geomspace(0.5, 1e-12, 20).tolist() if value(f * h) > 0.0), 0.0)
    return float(brentq(value, low, h, xtol=1e-15 * h, rtol=1e-14)) if low > 0.0 else 0.0
