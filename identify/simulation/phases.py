"""One phase of motion at a time: rest until the drive overcomes the static limit, slide until a guard falls to zero.

Switch times are located on the step function itself (the last step is repeated with the length at
which its guard is zero), so they are as accurate as the integration, not as its interpolation.
Time is local to the phase: after 800 s of sticking a slip of microseconds loses no digits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.base.errors import SimulationError
from identify.model.model import ELONGATION, SPEED, Model
from identify.model.modes import GUARDS, GuardName, ModeName, sliding_modes
from identify.simulation import resting
from identify.simulation.bursts import MODES, N_GUARDS, SHORTEST, Stop
from identify.simulation.plan import Plan, Scales, growth
from identify.simulation.resting import Resting
from identify.simulation.stepper import Situated, Stepper, borrowed, give_back
from identify.simulation.steppers import Method

# ----------------------------------------------------------------------------------------------------------------------
# Where a simulation starts: what the scene says of its states, the others in keeping with it.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


def initial_states(model: Model, p: Array, u: Array, given: Mapping[str, float]) -> dict[str, float]:
    """States by name at the start of a simulation, SI.

    A series element and the lags of a load cell start settled at the force that the elongation means at rest, so
    that nothing moves of itself.

    Args:
        p: parameters (n_p,). u: inputs (4,) at the start. given: states by name; "elongation" is the whole one, of
            rig and series element together.

    Raises:
        SimulationError: a sliding speed for a model without inertia, where it is no state.
    """
    if model.balance is not None and given.get("sliding_speed", 0.0) != 0.0:
        raise SimulationError(
            f"the motion is to start at {given['sliding_speed']:g} m/s, but without inertia the speed follows from the "
            "balance of forces; drop sliding_speed from [initial], or add the effect inertia"
        )
    names = [s.name for s in model.states]
    told = {name: value for name, value in given.items() if name in names}
    named = {s.name: s.start for s in model.states} | told
    if model.decays.numel_out(0) == 0:
        return named
    unloaded, loaded = (np.array(model.at_force(force, p, u)).ravel() for force in (0.0, 1.0))
    share = (named["elongation"] - unloaded[ELONGATION]) / (loaded[ELONGATION] - unloaded[ELONGATION])
    settled = unloaded + share * (loaded - unloaded)
    return dict(zip(names, settled.tolist(), strict=True)) | told


MAX_STEPS = 200_000  # of one sliding phase: a bound, so that no scene runs for ever
RUNAWAY = 1e9  # times the speed at which one normal force stops the mass: no bounded friction gets there
FREEING = 8  # doublings of the last digit of the elongation that set a mass free which only rounding holds
CREPT = 3  # nodes in a row that are that slow: a mass that is braked to rest passes within one step
LEAST = 1e-9  # friction coefficients within this of zero are rounding


@dataclass(frozen=True)
class Phase:
    """A stretch of one mode, with its nodes (a stick has its two ends only): local times (s,) [s], states (s, n_x).

    `ended_by` is the guard that ended it, None when its time was up.
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


STEPS_PER_PHASE = 2000  # earned by every phase; together they spend MAX_STEPS more at most, so that time is bounded
PATIENCE = 3000  # trials of one slide after which the next method takes over, where there is one
CRAWLING = 300, 1e-3  # trials after which it does so if their mean length is less than that, in natural times
FIRST = 1e-3  # of the natural time: the very first step
BEGINNING = 0.1  # of the time in which a slip that has just begun grows e-fold: no first step is longer
FLOOR = 1e-6  # absolute over relative tolerance, of typical states
ROUNDING = 1e-12  # what the rounding of the forces makes of the speed within a thousandth of the natural time
CREEP = 1e-13  # of the typical speed: a mass that creeps to rest under a drive at rest does not get slower


class Machine:
    """All that moves one scene: its rests, and the stepper of the method that is at work.

    Holds buffers, so one per thread. It remembers between phases which method that is and how long a first step may
    be: one slip is like the next.

    Args:
        p: parameters (n_p,).
        locate: False takes the step at whose end a guard is negative as it is (a control for tests: accuracy is lost).
        stops: False slides on where the mass comes to rest, by the motion forwards.
    """

    def __init__(
        self, model: Model, p: Array, scale: Scales, plan: Plan, *, locate: bool = True, stops: bool = True
    ) -> None:
        self.model, self.locate, self.scale, self.p, self.stops = model, locate, scale, p, stops
        self.moment, self._steps = scale.time, MAX_STEPS
        floor = FLOOR * self.scale.state
        # The speed of a slip that starts from balance grows from nothing: relative down to the rounding of the forces.
        floor[SPEED] *= min(ROUNDING / plan.rtol, 1.0)
        self.tolerances = np.concatenate([[plan.rtol], plan.rtol * floor])
        self._left, self._borrowed = list(plan.methods), list[Stepper]()
        self.stepper = self._next()
        self.rests = resting.borrowed(model)
        fastest = growth(model, p, scale)
        self.longest_first = BEGINNING / fastest if fastest > 0.0 else np.inf
        self.modes = sliding_modes(model.clamped is not None)
        self.first = dict.fromkeys(self.modes, min(FIRST * self.scale.time, self.longest_first))
        self.creep = CREEP * scale.state[SPEED]
        self.following = {name: dict(mode.exits) for name, mode in self.modes.items()}
        self.exits = {
            name: tuple(GUARDS.index(guard) for guard, _ in mode.exits if stops or guard != "speed")
            for name, mode in self.modes.items()
        }

    def _next(self) -> Stepper:
        """The stepper of the first method that is left."""
        method, scale = self._left[0], self.scale
        stepper = borrowed(self.model, method, self.stops)
        self._borrowed.append(stepper)
        longest = min(method.reach * scale.time, scale.longest)
        stepper.tune(self.p, self.tolerances, (longest, SHORTEST * scale.time, scale.farthest, self.locate))
        return stepper

    def close(self) -> None:
        """Give back what others can use: the run is over."""
        resting.give_back(self.rests)
        while self._borrowed:
            give_back(self._borrowed.pop())

    def begins(self, situated: Situated, x: Array) -> ModeName:
        """The mode in which a mass that moves begins: a fresh contact that would age below nothing is clamped."""
        clamped = self.model.clamped
        if clamped is None or x[clamped] > (self.model.states[clamped].lower or 0.0):
            return "slip"
        falls = float(self.model.slip(x, self.p, situated.at(0.0, situated.direction))[clamped]) < 0.0
        return "worn" if falls else "slip"

    def creeps(self, situated: Situated, x: Array) -> bool:
        """Whether a mass can creep to rest for ever: nothing that drives it moves or changes with time."""
        if situated.drive_speed != 0.0 or situated.force_slope != 0.0 or self.model.clocked:
            return False
        still = x.copy()
        still[SPEED] = 0.0
        return float(self.model.slip(still, self.p, situated.at(0.0))[ELONGATION]) == 0.0

    def held_back(self, tried: int, reached: float) -> bool:
        """Whether so many trials that have reached so far [s] are too many, and there is a method to take over."""
        crawls = tried > CRAWLING[0] and reached < tried * CRAWLING[1] * self.scale.time
        return len(self._left) > 1 and (crawls or tried > PATIENCE)

    def give_over(self) -> bool:
        """Let the next method take over for good; False where there is none."""
        if len(self._left) == 1:
            return False
        del self._left[0]
        self.stepper = self._next()
        return True

    def rest(self, x: Array, situated: Situated, limit: float) -> Stick:
        """As the function `rest`, from the time of `situated` on."""
        return rest(self.rests, x, situated, situated.time, limit)

    def slide(self, mode: ModeName, x: Array, situated: Situated, limit: float) -> list[Slide]:
        """As the function `slide`, from the time of `situated` on; all slides of a motion share their steps.

        Raises:
            SimulationError: as there; friction pushes.
        """
        made = slide(self, mode, x, situated, situated.time, limit, most=self._steps)
        check_braking(self, made)
        self._steps = min(MAX_STEPS, self._steps - sum(len(phase.times) for phase in made) + STEPS_PER_PHASE)
        return made

    def counts(self, phase: Phase) -> bool:
        """Whether a phase belongs to the motion."""
        return phase.duration > 0.0

    def chatter(self, t: float, longest: float) -> str:
        """Why time does not pass at t [s], where no phase is longer than that [s], and what to do."""
        if longest > 0.0 and t + longest == t:
            return (
                f"at {t:.6g} s slips of {longest:.3g} s are less than the last digit of the time: the rest before them "
                "is too long for their forces to be told; start shortly before the onset, with the elongation it has "
                "there"
            )
        return (
            f"the contact sticks and slips without time passing at {t:.6g} s (chatter): "
            "the static coefficient hardly exceeds the kinetic one; simulate sliding instead"
        )


def rest(rests: Resting, x: Array, situated: Situated, start: float, limit: float) -> Stick:
    """Rest from state x until the static limit is overcome, or for `limit` [s]."""
    x = x.copy()
    x[SPEED] = 0.0
    onset, after, force = rests.until(x, situated, limit)
    end = limit if onset is None else onset
    times, states = ([0.0, end], [x, after]) if end > 0.0 else ([0.0], [x])
    return Stick("stick", start, situated, times, states, None if onset is None else "speed", force)


def slide(
    machine: Machine, mode: ModeName, x: Array, situated: Situated, start: float, limit: float, most: int = MAX_STEPS
) -> list[Slide]:
    """Slide from state x, beginning in one mode, until the mass rests, another method is needed, or for `limit` [s].

    Args:
        most: bound of the steps.

    Returns:
        one phase per mode, in order: one at least.

    Raises:
        SimulationError: the integration needs more than `most` steps or meets a state that is not finite; the motion
            runs away.
    """
    stepper = machine.stepper
    stepper.start(mode, x, situated, limit, machine.first[mode])
    if x[SPEED] == 0.0 and stepper.speeding < 0.0:
        x = _freed(machine, stepper, mode, x, situated, limit)
    track = _Track(machine, stepper, mode, start, situated, x.tolist())
    tried, creeps = 0, machine.creeps(situated, x)
    while tried < most:
        rows = stepper.go_on()
        tried += len(rows)
        track.add(rows)
        if creeps and track.crept():
            return track.finish("speed")
        stop = rows[-1][stepper.places.stop]
        if stop == Stop.NOT_YET and not machine.held_back(tried, rows[-1][stepper.places.t]):
            continue
        if stop in (Stop.NOT_YET, Stop.STUCK):
            break
        ended_by = None if stop == Stop.TIME_IS_UP else _end(machine, stepper, track, rows[-1])
        return track.finish(ended_by)
    if machine.give_over():
        return slide(machine, mode, x, situated, start, limit, most)
    raise SimulationError(_unfinished(machine, mode, start, track.times[-1], abs(track.states[-1][SPEED]), most))


def check_braking(machine: Machine, slides: Sequence[Slide]) -> None:
    """Refuse a slide in which friction does not brake where the mass is fastest.

    Raises:
        SimulationError: where, and what to do.
    """
    fastest, slide, i = 0.0, slides[0], 0
    for phase in slides:
        speeds = [phase.situated.direction * state[SPEED] for state in phase.states]
        if max(speeds) > fastest:
            fastest, slide = max(speeds), phase
            i = speeds.index(fastest)
    coefficient = machine.stepper.coefficient(slide.mode, slide.states[i], slide.situated, slide.times[i])
    if coefficient < -LEAST:
        raise SimulationError(
            f"friction pushes at {slide.start + slide.times[i]:.6g} s (coefficient {coefficient:.3g} at "
            f"{fastest:.3g} m/s): a law has left its range; let friction fall less with speed and along the track"
        )


class _Track:
    """The nodes of a slide as they come, and its phases as they end."""

    def __init__(
        self, machine: Machine, stepper: Stepper, mode: ModeName, start: float, situated: Situated, x: list[float]
    ) -> None:
        self.machine, self.stepper, self.mode, self.start, self.situated = machine, stepper, mode, start, situated
        self.times, self.states, self._begun, self._since = [0.0], [x], situated, 0.0
        self.phases: list[Slide] = []

    def add(self, rows: list[list[float]]) -> None:
        """The nodes in the rows of a burst; a phase ends where the mode changes."""
        n, number, times, states = self.stepper.places.n, MODES.index(self.mode), self.times, self.states
        mode, stop, h = n + 1, n + 2, n + 3
        if rows[0][n] > 0.0 and rows[0][stop] == Stop.NOT_YET and len(times) == 1 and not self.phases:
            self.machine.first[self.mode] = min(rows[0][h], self.machine.longest_first)
        last = times[-1]
        for row in rows:
            t = row[n]
            if t > last:
                last = t
                times.append(t)
                states.append(row[:n])
            if row[mode] != number:
                self._close("clearance" if self.mode == "slip" else "release")
                self._begin_other()
                number, times, states = 1 - number, self.times, self.states

    def crept(self) -> bool:
        """Whether the mass has crept to where its speed has no digits left; then the nodes end where it fell so low.

        Under a drive at rest a damped mass only nears its rest, faster than any power of time, and rounding would
        decide whether and when it is at rest.
        """
        limit, last = self.machine.creep, len(self.states) - 1
        if abs(self.states[-1][SPEED]) >= limit:
            return False
        fast = next((i for i in range(last, -1, -1) if abs(self.states[i][SPEED]) >= limit), last)
        if last - fast < CREPT:
            return False
        x, t, direction = self.states[fast], self.times[fast], self.situated.direction

        def above(length: float) -> float:
            return direction * self.stepper.trial(self.mode, x, t, length)[SPEED] - limit

        whole = self.times[fast + 1] - t
        length = low = 1e-12 * whole
        if above(low) > 0.0:
            length = brentq(above, low, whole, xtol=1e-15 * whole, rtol=1e-14)
        after = self.stepper.trial(self.mode, x, t, length)[: len(x)]
        after[SPEED] = 0.0
        self.times[fast + 1 :], self.states[fast + 1 :] = [t + length], [after]
        return True

    def finish(self, ended_by: GuardName | None) -> list[Slide]:
        """All phases, the last one ended so."""
        self._close(ended_by)
        return self.phases

    def _begin_other(self) -> None:
        """The next phase starts at the last node."""
        t, s = self.times[-1], self.situated
        self._since, self.times, self.states = t, [t], [self.states[-1]]
        self.mode = MODES[1 - MODES.index(self.mode)]
        force = s.normal_force + s.force_slope * t
        self._begun = Situated(s.p, s.drive_speed, s.direction, force, s.force_slope, s.time + t)

    def _close(self, ended_by: GuardName | None) -> None:
        times, states, since = self.times, self.states, self._since
        if since:
            times = [t - since for t in times]
        method, tolerances = self.stepper.method, self.machine.tolerances
        begin = self.start + since
        self.phases.append(Slide(self.mode, begin, self._begun, times, states, ended_by, method, tolerances))


def _freed(machine: Machine, stepper: Stepper, mode: ModeName, x: Array, situated: Situated, limit: float) -> Array:
    """The state from which a slip starts that the last digits of the forces would hold back; x where it is more."""
    first = machine.first[mode]
    for moves in range(FREEING):
        near = x.copy()
        near[ELONGATION] += situated.direction * 2.0**moves * np.spacing(abs(x[ELONGATION]))
        stepper.start(mode, near, situated, limit, first)
        if stepper.speeding >= 0.0:
            return near
    stepper.start(mode, x, situated, limit, first)
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


def _end(machine: Machine, stepper: Stepper, track: _Track, last: list[float]) -> GuardName:
    """The guard that ends a slide; its last node lies there, with the guard exactly zero."""
    mode, at = track.mode, stepper.places
    if last[at.stop] == Stop.LOCATED:
        ends = stepper.ends
        guard = min(machine.exits[mode], key=lambda i: abs(ends[i] / (ends[N_GUARDS + i] or 1e-300)))
    else:
        x, t, h = last[: at.n], last[at.t], last[at.h]
        row = stepper.trial(mode, x, t, h)[at.n + 1 :]
        fallen = [i for i in machine.exits[mode] if row[i] < 0.0 or (row[i] == 0.0 and t > 0.0)]
        length, guard = h, fallen[0]
        if machine.locate:
            length, guard = min(
                (from_zero(lambda part, i=i: stepper.trial(mode, x, t, part)[at.n + 1 + i], h), i)  # type: ignore[misc]
                for i in fallen
            )
        track.times.append(t + length)
        track.states.append(stepper.trial(mode, x, t, length)[: at.n] if length > 0.0 else x)
    after, clamped = track.states[-1], machine.model.clamped
    if GUARDS[guard] == "speed":
        after[SPEED] = 0.0
    elif GUARDS[guard] == "clearance" and clamped is not None:
        after[clamped] = machine.model.states[clamped].lower or 0.0
    return GUARDS[guard]


def from_zero(value: Callable[[float], float], h: float) -> float:
    """The length within (0, h] of a step at which a guard that may start at zero falls to zero."""
    low = next((f * h for f in (0.0, *np.geomspace(0.5, 1e-12, 20).tolist()) if value(f * h) > 0.0), None)
    return 0.0 if low is None else float(brentq(value, low, h, xtol=1e-15 * h, rtol=1e-14))
