"""One slip, fast: compiled steps with exact ends, and how its states move with start, parameters and rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Compiled, Mapped, compiled
from identify.base.errors import SimulationError
from identify.base.tableaus import DORMAND_PRINCE, step
from identify.model.model import SPEED, Model
from identify.model.modes import GUARDS, ModeName, sliding_modes

# ----------------------------------------------------------------------------------------------------------------------
# One step of a slip, its tangent and its guards as compiled functions of one setting w.
#
# w (n_w,) = parameters, normal force [N], drive speed [m/s]: everything that holds during a stick and its slip.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Symbols:
    """What steps are functions of: state and length of a step, setting, direction; parameters and inputs in these."""

    xh: ca.SX
    w: ca.SX
    direction: ca.SX
    p: ca.SX
    u: ca.SX

    @staticmethod
    def of(model: Model) -> _Symbols:
        """Those of a model."""
        n_p = len(model.parameters)
        xh, w, direction = ca.SX.sym("xh", len(model.states) + 1), ca.SX.sym("w", n_p + 2), ca.SX.sym("direction")
        return _Symbols(xh, w, direction, w[:n_p], ca.vertcat(w[n_p + 1], w[n_p], direction, 0))

    def motion(self, model: Model, mode: ModeName) -> Callable[[ca.SX, object], ca.SX]:
        """dx/dt while it slides in a mode."""
        field = model.saturated if mode == "saturated" else model.slip
        return lambda state, _at: field(state, self.p, self.u)


@lru_cache(maxsize=16)
def slip_tangents(model: Model) -> Mapping[ModeName, Mapped]:
    """Compiled by model, per sliding mode: steps (x and length, w, direction) -> d after/d (x, w)."""
    s, n_x, out = _Symbols.of(model), len(model.states), dict[ModeName, Mapped]()
    for name in sliding_modes(model.clamped is not None):
        after, _, _ = step(DORMAND_PRINCE, s.motion(model, name), s.xh[:n_x], s.xh[n_x])
        slope = ca.densify(ca.jacobian(after, ca.vertcat(s.xh[:n_x], s.w)).T)
        out[name] = Mapped(ca.Function(f"tangent_{name}", [s.xh, s.w, s.direction], [slope]))
    return out


@lru_cache(maxsize=16)
def slip_functions(model: Model) -> Mapping[str, ca.Function]:
    """Compiled by model: per sliding mode `step_`, the `rate_`; what rest needs.

    step: (x and length, w, direction, tolerances) -> x after, error norm, guards and their slopes in time, as one
    vector; the tolerances are rtol and atol (n_x,). rate: (x, w, direction) -> dx/dt. hold: (x, w) -> force that tries
    to move a resting mass, force it withstands.
    """
    n_x, s = len(model.states), _Symbols.of(model)
    xh, w, direction, p, u = s.xh, s.w, s.direction, s.p, s.u
    tolerances = ca.SX.sym("tolerances", n_x + 1)
    x, h = xh[:n_x], xh[n_x]
    out: dict[str, ca.Function] = {}
    for name in sliding_modes(model.clamped is not None):
        motion = s.motion(model, name)
        after, error, _ = step(DORMAND_PRINCE, motion, x, h)
        norm = ca.mmax(ca.fabs(error) / (tolerances[1:] + tolerances[0] * ca.fmax(ca.fabs(x), ca.fabs(after))))
        there = ca.SX.sym("there", n_x)
        guards = [direction * there[SPEED], ca.SX(1), ca.SX(1)]
        if model.clamped is not None:
            guards[1] = there[model.clamped] - (model.states[model.clamped].lower or 0.0)
            guards[2] = -model.slip(there, p, u)[model.clamped]
        guard = ca.vertcat(*guards)
        slopes = ca.jtimes(guard, there, motion(there, 0))
        ends = ca.Function("ends", [there, w, direction], [ca.vertcat(guard, slopes)])
        row = ca.vertcat(after, norm, ends(after, w, direction))
        out[f"step_{name}"] = ca.Function(f"step_{name}", [xh, w, direction, tolerances], [row])
        out[f"rate_{name}"] = ca.Function(f"rate_{name}", [xh, w, direction], [motion(x, 0)])
    forward = ca.vertcat(u[:2], 1, 0)
    hold = ca.vertcat(model.driving_force(x, p, forward), model.grip(x, p, forward))
    out["hold"] = ca.Function("hold", [x, w], [hold])
    return out


# ----------------------------------------------------------------------------------------------------------------------
# One slip, fast: adaptive steps with exact ends, and how its states move with start, parameters and rig.
#
# The same equations, guards and tableau as `phases`, for callers that need thousands of slips: everything that holds
# during a slip is one setting w (n_w,) = parameters, drive speed [m/s], normal force [N], and every step is one
# compiled call. Tangents are the exact derivatives of the steps taken, not difference quotients.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

MAX_STEPS = 200_000  # of one slip: a bound, so that no scene runs for ever
MAX_SEGMENTS = 200  # of one slip; more is chatter
NEWTON_STEPS = 60
SPEED_GUARD = GUARDS.index("speed")
SPEED_SLOPE = 1 + len(GUARDS) + SPEED_GUARD  # place of its slope in the result of a step, behind the state
CLOSE = 0.25  # of the speed before it: a minimum of the speed as low as this is looked at


@dataclass(frozen=True)
class SlipSegment:
    """A stretch of one mode and direction (+1 or -1), between the nodes `first` and `last` of its slip."""

    mode: ModeName
    direction: float
    first: int
    last: int


@dataclass(frozen=True)
class SlipMotion:
    """A slip. t (s+1,) [s] from its onset, x (s+1, n_x); `rests`: its end is an arrest, not the time limit."""

    t: Array
    x: Array
    segments: tuple[SlipSegment, ...]
    rests: bool

    @property
    def turns(self) -> bool:
        """Whether the mass slid backwards on the way."""
        return any(segment.direction < 0 for segment in self.segments)


class SlipIntegrator:
    """Slides one model with fixed tolerances; holds the buffers, so one per thread.

    Args:
        rtol, atol (n_x,): relative and absolute tolerance of a step. first: length of the first step of a segment [s].
    """

    def __init__(self, model: Model, rtol: float, atol: Array, first: float) -> None:
        self.model, self.first = model, first
        self._n = len(model.states)
        self._calls: dict[str, Compiled] = {name: compiled(f) for name, f in slip_functions(model).items()}
        modes = sliding_modes(model.clamped is not None)
        self._exits = {name: [(GUARDS.index(g), then) for g, then in m.exits] for name, m in modes.items()}
        self._direction = np.ones(1)
        self._xh, self._w = np.empty(self._n + 1), np.empty(len(model.parameters) + 2)
        tolerances = np.concatenate([[rtol], atol])
        for name, call in self._calls.items():
            given = [self._xh, self._w, self._direction, tolerances]
            call.bind([self._xh[:-1], self._w] if name == "hold" else given[: len(call.given)])

    def slide(self, x: Array, w: Array, limit: float, *, stops: bool = True) -> SlipMotion:
        """Slide from x (n_x,) until the mass rests, or for `limit` [s].

        Args:
            stops: False slides on for the whole `limit`, through speeds below zero by the same forward motion.

        Raises:
            SimulationError: the integration needs more than MAX_STEPS steps or meets a state that is not finite.
        """
        self.set(w)
        times, states, segments = [0.0], [x.tolist()], list[SlipSegment]()
        mode: ModeName = "slip"
        direction = 1.0
        for _ in range(MAX_SEGMENTS):
            first, self._direction[0] = len(times) - 1, direction
            ended_by = self._segment(mode, times, states, limit, stops)
            segments.append(SlipSegment(mode, direction, first, len(times) - 1))
            if ended_by is None:
                return SlipMotion(np.array(times), np.array(states), tuple(segments), rests=False)
            if ended_by != SPEED_GUARD:
                mode = dict(self._exits[mode])[ended_by]
                continue
            pull, grip = self.hold(np.array(states[-1]), w)
            if abs(pull) < grip:
                return SlipMotion(np.array(times), np.array(states), tuple(segments), rests=True)
            mode, direction = "slip", float(np.sign(pull))
        return SlipMotion(np.array(times), np.array(states), tuple(segments), rests=False)

    def _segment(
        self, mode: ModeName, times: list[float], states: list[list[float]], limit: float, stops: bool
    ) -> int | None:
        """Append one segment; the guard that ended it, by its place in GUARDS, None when the time was up."""
        call, n, xh = self._calls[f"step_{mode}"], self._n, self._xh
        exits = [i for i, _ in self._exits[mode] if stops or i != SPEED_GUARD]
        x, t = states[-1], times[-1]
        h, fresh, dipped = min(self.first, limit - t), True, not stops
        direction = float(self._direction[0])
        falling = direction * float(self.rate(mode, np.array(x), direction)[SPEED])
        for _ in range(MAX_STEPS):
            h = min(h, limit - t)
            xh[:n], xh[n] = x, h
            row = call().tolist()
            norm = row[n]
            if not norm <= 1.0:
                h *= max(0.2, 0.9 * norm**-0.2) if np.isfinite(norm) else 0.2
                if h < 1e-11 * self.first:
                    break
                continue
            rising = row[n + SPEED_SLOPE]
            if not dipped and falling < 0.0 < rising:
                # The speed has a minimum within the step: end the step there if it comes close to rest.
                length, speed = h * falling / (falling - rising), direction * x[SPEED]
                if speed > 0.0 and speed + 0.5 * falling * length < CLOSE * speed:
                    h, dipped = length, True
                    continue
            fallen = [i for i in exits if row[n + 1 + i] < 0.0 or (row[n + 1 + i] == 0.0 and not fresh)]
            if fallen:
                length, guard = min((self._locate(call, x, h, i, fresh), i) for i in fallen)
                times.append(t + length)
                states.append(self._stopped(call, x, length, guard))
                return guard
            t, x, fresh, falling, dipped = t + h, row[:n], False, rising, not stops
            times.append(t)
            states.append(x)
            if t >= limit * (1.0 - 1e-15):
                return None
            h *= min(5.0, max(0.2, 0.9 * max(norm, 1e-10) ** -0.2))
        raise SimulationError(
            f"a slip did not end within {MAX_STEPS} steps (it reached {t:.3g} s): "
            "the motion is too stiff for explicit steps; check mass, a and normal force"
        )

    def _stopped(self, call: Compiled, x: list[float], length: float, guard: int) -> list[float]:
        """The state after a step that ends where a guard is zero, exactly so."""
        self._xh[: self._n], self._xh[self._n] = x, length
        after = call().tolist()[: self._n]
        if guard == SPEED_GUARD:
            after[SPEED] = 0.0
        elif GUARDS[guard] == "clearance" and self.model.clamped is not None:
            after[self.model.clamped] = self.model.states[self.model.clamped].lower or 0.0
        return after

    def _locate(self, call: Compiled, x: list[float], h: float, guard: int, fresh: bool) -> float:
        """The step length within (0, h] at which the guard is zero: Newton's method within a bracket."""
        n, xh = self._n, self._xh
        value_at, slope_at = n + 1 + guard, n + 1 + len(GUARDS) + guard

        def evaluate(length: float) -> tuple[float, float]:
            xh[:n], xh[n] = x, length
            row = call()
            return float(row[value_at]), float(row[slope_at])

        low, high, at = 0.0, h, h
        if fresh:
            # A segment may start with the guard at zero: find where it is positive first, if anywhere.
            low = next((f * h for f in (0.5, 0.25, 0.1, 1e-2, 1e-4) if evaluate(f * h)[0] > 0.0), 0.0)
            if low == 0.0:
                return 0.0
        for _ in range(NEWTON_STEPS):
            value, slope = evaluate(at)
            if value > 0.0:
                low = at
            else:
                high = at
            new = at - value / slope if slope < 0.0 else low
            if value == 0.0 or abs(new - at) <= 1e-14 * h:
                break
            at = new if low < new < high else 0.5 * (low + high)
        return at

    def tangents(self, slip_motion: SlipMotion, w: Array, onset: Array, sums: Array) -> tuple[Array, Array]:
        """Derivatives, at fixed times, of the last state (n_x, m) and of sums over the states at the nodes (q, m).

        Args:
            onset: derivatives (n_x, m) at the onset; the last of the m directions are w.
            sums: what each state counts in each sum, (q, s+1, n_x).

        Taken from the end backwards: a few numbers per node instead of all m directions.
        """
        self.set(w)
        n, columns, lengths = self._n, w.size, np.diff(slip_motion.t)
        back = np.vstack([np.eye(n), sums[:, -1]])
        direct = np.zeros((back.shape[0], columns))
        for number in reversed(range(len(slip_motion.segments))):
            segment = slip_motion.segments[number]
            steps = np.column_stack(
                [slip_motion.x[segment.first : segment.last], lengths[segment.first : segment.last]]
            )
            slopes = self.step_tangents(segment, steps, columns)
            by_state = np.ascontiguousarray(slopes[:, :, :n])
            behind = np.empty((back.shape[0], len(steps), n))
            for i in reversed(range(len(steps))):
                behind[:, i] = back
                back = back.dot(by_state[i])
                back[n:] += sums[:, segment.first + i]
            direct += behind.reshape(back.shape[0], -1) @ slopes[:, :, n:].reshape(-1, columns)
            if number:
                back = back @ self._switch(slip_motion, number)
        out = back @ onset
        out[:, -columns:] += direct
        return out[:n], out[n:]

    def step_tangents(self, segment: SlipSegment, steps: Array, columns: int) -> Array:
        """d after/d (x, w) of every step (s, n_x + 1) of a segment: shape (s, n_x, n_x + columns)."""
        settings = np.broadcast_to(self._w, (steps.shape[0], self._w.size))
        direction = np.full(steps.shape[0], segment.direction)
        (out,) = slip_tangents(self.model)[segment.mode]([steps, settings, direction])
        return out.reshape(-1, self._n, self._n + columns)

    def _switch(self, slip_motion: SlipMotion, number: int) -> Array:
        """What the switch to a segment does to tangents (n_x, n_x): 1 + (rate before - rate after) d(switch time)."""
        before, after = slip_motion.segments[number - 1], slip_motion.segments[number]
        x, out = slip_motion.x[after.first], np.eye(self._n)
        rates = [self.rate(segment.mode, x, segment.direction) for segment in (before, after)]
        if before.direction != after.direction:
            moved = SPEED
        elif after.mode == "saturated" and self.model.clamped is not None:
            moved = self.model.clamped
        else:
            return out  # released: both motions agree here
        out[:, moved] -= (rates[0] - rates[1]) / rates[0][moved]
        return out

    def hold(self, x: Array, w: Array) -> tuple[float, float]:
        """Force that tries to move the mass if it rests in x, signed, and the force it withstands [N]."""
        self._xh[:-1], self._w[:] = x, w
        pull, grip = self._calls["hold"]().tolist()
        return pull, grip

    def set(self, w: Array) -> None:
        """Take a setting (n_w,) for the calls of `step` and `rate` that follow."""
        self._w[:] = w

    def step(self, mode: ModeName, x: Array, length: float, direction: float = 1.0) -> Array:
        """The state (n_x,) after one step of `length` [s] from x, with the setting of the last `slide` or `set`."""
        self._xh[:-1], self._xh[-1], self._direction[0] = x, length, direction
        return self._calls[f"step_{mode}"]()[: self._n].copy()

    def rate(self, mode: ModeName, x: Array, direction: float = 1.0) -> Array:
        """dx/dt (n_x,) with the setting of the last `slide` or `set`."""
        self._xh[:-1], self._direction[0] = x, direction
        return self._calls[f"rate_{mode}"]().copy()
