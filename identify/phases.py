"""One phase of motion at a time: rest until the drive overcomes the grip, slide until a guard falls to zero.

Switch times are located on the step function itself (the last step is repeated with the length at
which its guard is zero), so they are as accurate as the integration, not as its interpolation.
Time is local to the phase: after 800 s of sticking a slip of microseconds loses no digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.crossing import first_zero
from identify.errors import SimulationError
from identify.model import SPEED, Model
from identify.modes import GuardName, ModeName, sliding_modes
from identify.stepping import Situated, Stepper

Array = NDArray[np.float64]

MAX_STEPS = 200_000  # of one sliding phase: a bound, so that no scene runs for ever
RUNAWAY = 1e9  # times the speed at which one normal force stops the mass: no bounded friction gets there
LEAST = 1e-9  # friction coefficients within this of zero are rounding
CLOSE = 0.25  # of the guards around it: a minimum of the speed as low as this is looked at


@dataclass(frozen=True)
class Phase:
    """A stretch of one mode. `t` (s,) are the node times from its start [s], `x` (s, n_x) the states there
    (a stick has its two ends only); `ended_by` is the guard that ended it, None when its time was up."""

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


@dataclass(frozen=True)
class Scales:
    """Typical time [s] and state sizes (n_x,) of a scene: they set first steps and absolute tolerances.

    No step is longer than `longest` [s] or goes farther than `farthest` [m]: an error estimate sees no vibration
    and no track that it steps over.
    """

    time: float
    state: Array
    longest: float = np.inf
    farthest: float = np.inf


def scales(model: Model, p: Array, normal_force: float) -> Scales:
    """Natural time scale sqrt(m/k), and the states a load of one normal force gives."""
    values = dict(zip(model.parameter_names, p.tolist(), strict=True))
    k, m = values["stiffness"], values["mass"]
    state = np.ones(len(model.states))
    state[0], state[1] = normal_force / k, normal_force / np.sqrt(k * m)
    lengths = np.array(model.finest(p)).ravel()
    farthest = float(np.min(lengths)) if lengths.size else np.inf
    return Scales(float(np.sqrt(m / k)), state, swing(model, p)[0] / 4.0, farthest / 4.0)


def stepper(model: Model, p: Array, normal_force: float, rtol: float) -> Stepper:
    """A stepper with tolerances fit for this scene: nearly relative, so that slips may start from nothing.

    The speed of a slip that starts from balance grows from nothing by the exponential; what the rounding of the
    forces makes of it within a thousandth of the natural time bounds its tolerance from below.
    """
    atol = rtol * 1e-6 * scales(model, p, normal_force).state
    atol[SPEED] *= max(1e-3, 1e-12 / rtol)
    return Stepper(model, rtol, atol)


def _spare_grip(model: Model, x: Array, situated: Situated, times: Array) -> Array:
    """Grip minus driving force while resting, shape of times [N]; negative: the mass is moved."""
    n = times.size
    p = situated.p[:, None]
    u = situated.at(times)
    state = np.array(model.rest(x, p, u, times[None, :])) if n > 1 else np.array(model.rest(x, p, u, times))
    driving = np.array(model.driving_force(state, p, u)).ravel()
    return np.asarray(np.array(model.grip(state, p, u)).ravel() - np.abs(driving))


def swing(model: Model, p: Array) -> tuple[float, float]:
    """Shortest period [s] of what oscillates in the drive (infinite without), bound of its force on the contact [N]."""
    if model.waves.numel_out(0) == 0:
        return np.inf, 0.0
    forces, omegas = np.array(model.swings(p)).ravel(), np.array(model.waves(p)).ravel()
    moving = forces > 0.0
    return (2.0 * np.pi / float(np.max(omegas[moving])), float(np.sum(forces))) if moving.any() else (np.inf, 0.0)


def stick(model: Model, x: Array, situated: Situated, start: float, limit: float) -> Phase:
    """Rest from state x until the grip is overcome, or for `limit` [s]."""
    x = x.copy()
    x[SPEED] = 0.0
    if _spare_grip(model, x, situated, np.zeros(1))[0] <= 0.0:
        return Phase("stick", start, situated, np.zeros(1), x[None, :], "speed")
    period, force = swing(model, situated.p)
    onset = first_zero(lambda t: _spare_grip(model, x, situated, t), limit, period, force) if limit > 0.0 else None
    end = limit if onset is None else onset
    after = np.array(model.rest(x, situated.p, situated.at(end), end)).ravel()
    ended_by: GuardName | None = None if onset is None else "speed"
    return Phase("stick", start, situated, np.array([0.0, end]), np.stack([x, after]), ended_by)


def slide(
    machine: Stepper,
    mode: ModeName,
    x: Array,
    situated: Situated,
    start: float,
    limit: float,
    scale: Scales,
    *,
    locate: bool = True,
    most: int = MAX_STEPS,
) -> Phase:
    """Slide in one mode from state x until one of its guards falls to zero, or for `limit` [s].

    Args:
        locate: False takes the step at whose end a guard is negative as it is (a control for tests:
            accuracy is lost).
        most: bound of the steps.

    Raises:
        SimulationError: the integration needs more than `most` steps or meets a state that is not finite.
    """
    exits = dict(sliding_modes(machine.model.clamped is not None)[mode].exits)
    machine.situate(situated)
    power = -1.0 / machine.tableau.order
    t, h = 0.0, min(1e-3 * scale.time, limit)
    times, states = [0.0], [x]
    before: tuple[dict[GuardName, float], Array] | None = None
    for _ in range(most):
        h = min(h, limit - t, scale.longest)
        if h * abs(x[SPEED]) > scale.farthest:
            h = scale.farthest / float(abs(x[SPEED]))
        after, norm, guards, rate = machine.advance(mode, x, t, h)
        if not norm <= 1.0:
            h *= 0.2 if not np.isfinite(norm) else max(0.2, 0.9 * norm**power)
            if h < 1e-14 * scale.time:
                break
            continue
        if locate and before is not None and all(guards[guard] > 0.0 for guard in exits):
            h, guards = _dip(machine, mode, x, t, h, (*before, guards, rate))
        fallen: list[tuple[float, GuardName]] = []
        for guard in exits:
            if guards[guard] < 0.0 or (guards[guard] == 0.0 and t > 0.0):
                fallen.append((_locate(machine, mode, x, t, h, guard) if locate else h, guard))
        if fallen:
            length, guard = min(fallen)
            after = machine.advance(mode, x, t, length)[0]
            if guard == "speed":
                after[SPEED] = 0.0
            elif guard == "clearance" and machine.model.clamped is not None:
                after[machine.model.clamped] = machine.model.states[machine.model.clamped].lower
            times.append(t + length)
            states.append(after)
            return Phase(mode, start, situated, np.array(times), np.array(states), guard)
        t, x, before = t + h, after, (guards, rate)
        times.append(t)
        states.append(x)
        if t >= limit * (1.0 - 1e-15):
            return Phase(mode, start, situated, np.array(times), np.array(states), None)
        h *= min(5.0, max(0.2, 0.9 * max(norm, 1e-10) ** power))
    if not abs(x[SPEED]) < RUNAWAY * scale.state[SPEED]:
        raise SimulationError(
            f"the {mode} phase at {start:.6g} s runs away (it reached {abs(x[SPEED]):.3g} m/s): friction falls with "
            "speed without a floor; make the slope smaller, or take the law velocity_weakening"
        )
    raise SimulationError(
        f"the {mode} phase at {start:.6g} s did not end within {most} steps (it reached {t:.3g} s): "
        "the motion is too stiff for explicit steps; check mass, a and normal force"
    )


def refuse_push(model: Model, phase: Phase) -> None:
    """Where the mass slides fastest friction must still brake.

    Raises:
        SimulationError: the friction coefficient is negative there.
    """
    i = int(np.argmax(np.abs(phase.x[:, SPEED])))
    s, x = phase.situated, phase.x[i]
    u = s.at(phase.t[i], s.direction)
    field = model.slip if phase.mode == "slip" else model.saturated
    mass = float(s.p[model.parameter_names.index("mass")])
    net = mass * np.array(field(x, s.p, u)).ravel()[SPEED]
    coefficient = s.direction * (float(model.load(x, s.p, u)) - net) / float(u[1])
    if coefficient < -LEAST:
        raise SimulationError(
            f"friction pushes at {phase.start + phase.t[i]:.6g} s (coefficient {coefficient:.3g} at "
            f"{abs(x[SPEED]):.3g} m/s): a law has left its range; let friction fall less with speed and along the track"
        )


def _dip(
    machine: Stepper,
    mode: ModeName,
    x: Array,
    t: float,
    h: float,
    ends: tuple[dict[GuardName, float], Array, dict[GuardName, float], Array],
) -> tuple[float, dict[GuardName, float]]:
    """A step at whose ends all guards are positive, cut short where one of them is not in between.

    Args:
        ends: guards and dx/dt before and after the step.

    Returns:
        length of the step to take [s] and the guards at its end.
    """
    first, falling, last, rising = ends
    direction = float(machine.inputs[1])
    for i, sign in ((SPEED, direction), (machine.model.clamped, 1.0)):
        if i is None or not sign * falling[i] < 0.0 < sign * rising[i]:
            continue

        def slope(length: float, i: int = i) -> float:
            return float(machine.advance(mode, x, t, length)[3][i])

        length = h * falling[i] / (falling[i] - rising[i])
        guards = machine.advance(mode, x, t, length)[2]
        exits = dict(sliding_modes(machine.model.clamped is not None)[mode].exits)
        if all(guards[g] > CLOSE * min(first[g], last[g]) for g in exits):
            continue
        if slope(0.0) * slope(h) < 0.0:
            length = float(brentq(slope, 0.0, h, xtol=1e-15 * h, rtol=1e-12))
            guards = machine.advance(mode, x, t, length)[2]
        if any(guards[g] <= 0.0 for g in exits):
            return length, guards
    return h, last


def _locate(machine: Stepper, mode: ModeName, x: Array, t: float, h: float, guard: GuardName) -> float:
    """The step length within (0, h] at which the guard is zero."""

    def value(length: float) -> float:
        return machine.advance(mode, x, t, length)[2][guard]

    low = 0.0
    if t == 0.0 and value(0.0) <= 0.0:
        # A slip starts with the guard at zero: find where it is positive first, if anywhere.
        low = next((f * h for f in np.geomspace(0.5, 1e-12, 20).tolist() if value(f * h) > 0.0), 0.0)
        if low == 0.0:
            return 0.0
    if value(h) == 0.0:
        return h
    if value(low) <= 0.0:
        return low
    return float(brentq(value, low, h, xtol=1e-15 * max(h, 1e-300), rtol=1e-14))
