"""One slip of many lanes at once.

Slips take fixed RK4 steps, several in a call, with the bounded state clamped after every step; events are roots of a
parabola within it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.base.tableaus import RK4, step
from identify.model.model import INPUTS, SPEED, TIME, Model

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.int64]

LONGEST = 14.0  # half periods: a slip that takes longer counts as sliding
STRIDE = 8  # steps of a slip between two looks at which lanes still slide


@dataclass(frozen=True)
class Slips:
    """One slip per lane. `h` (n,) step lengths [s]; `states` (s+1, n, n_x) and `rates` (s+1, n, n_x) at the
    steps (constant after the arrest); `wear`, `arrest` (n,) [s] from the onset, NaN where they never
    happen; `at_wear`, `at_arrest` (n, n_x) states there; `rested` (n,) whether the mass came to rest."""

    h: Array
    states: Array
    rates: Array
    wear: Array
    arrest: Array
    at_wear: Array
    at_arrest: Array

    @property
    def rested(self) -> Bools:
        """Whether each lane came to rest."""
        return np.isfinite(self.arrest)

    def at(self, times: Array) -> Array:
        """States (n, m, n_x) at times (n, m) [s] from the onset of each lane, cubic Hermite; held outside."""
        steps, lanes = self.states.shape[0] - 1, np.arange(self.h.size)[:, None]
        u = np.clip(times / self.h[:, None], 0.0, steps * (1 - 1e-12))
        i = np.minimum(u.astype(int), steps - 1)
        w = (u - i)[..., None]
        h = self.h[:, None, None]
        y0, y1, d0, d1 = (
            self.states[i, lanes],
            self.states[i + 1, lanes],
            self.rates[i, lanes],
            self.rates[i + 1, lanes],
        )
        return np.asarray(
            y0 * (1 + 2 * w) * (1 - w) ** 2
            + y1 * w**2 * (3 - 2 * w)
            + h * (d0 * w * (1 - w) ** 2 - d1 * w**2 * (1 - w))
        )


@lru_cache(maxsize=16)
def _stride(model: Model) -> Mapped:
    """STRIDE steps: (x, p, u, step length) -> states after each with the bound kept, without it, rates at its start."""
    x, p, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters)), ca.SX.sym("u", len(INPUTS))
    h = ca.SX.sym("h")

    def clamp(state: ca.SX) -> ca.SX:
        out = ca.SX(state)
        for i, q in enumerate(model.states):
            if q.lower is not None:
                out[i] = ca.fmax(state[i], q.lower)
        return out

    def motion(state: ca.SX, _t: object) -> ca.SX:
        return model.slip(clamp(state), p, u)

    free, _, stages = step(RK4, motion, x, h)
    # Called once for each step: that costs much less than to write the step out as often.
    one = ca.Function("lane_step", [x, p, u, h], [clamp(free), free, stages[0]])
    steps, state, now = list[Sequence[ca.SX]](), x, u
    for _ in range(STRIDE):
        steps.append(one(state, p, now, h))
        state, now = steps[-1][0], ca.vertcat(now[:TIME], now[TIME] + h)
    columns = [ca.horzcat(*column) for column in zip(*steps, strict=True)]
    return Mapped(ca.Function("lane_stride", [x, p, u, h], columns))


def slip(model: Model, x: Array, p: Array, u: Array, per_half_period: int) -> Slips:
    """Slide every lane from x (n, n_x) until it rests, with steps of half a natural period / per_half_period.

    Args:
        p: (n, n_p); u: (n, 4) drive speed, normal force, direction +1, time at the start.
    """
    n, n_x, names = x.shape[0], len(model.states), model.parameter_names
    half = np.pi * np.sqrt(p[:, names.index("mass")] / p[:, names.index("stiffness")])
    h, now, active, blocks = half / per_half_period, u.copy(), np.arange(n), list[Array]()
    last, over, worn = np.stack([x, np.zeros_like(x)]), np.full(n, -1), np.full(n, -1)  # steps in which that happens
    free, free_worn, rests, clamped = np.empty_like(x), np.empty_like(x), np.zeros(n, bool), model.clamped
    for first in range(0, int(LONGEST * per_half_period), STRIDE):
        taken = _stride(model)([q[active] for q in (last[0], p, now, h)])
        after, unbound, rate = (q.reshape(active.size, STRIDE, n_x).transpose(1, 0, 2) for q in taken)
        steps = np.stack([after, rate])
        ended = ~(after[..., SPEED] > 0.0)  # what is not finite is over, too
        stops = np.any(ended, axis=0)
        if clamped is not None:
            before = np.concatenate([last[0, active, clamped][None], after[:-1, :, clamped]])
            falls = (
                (unbound[..., clamped] <= _lowest(model)) & (before > _lowest(model)) & (np.cumsum(ended, axis=0) == 0)
            )
            lanes = np.flatnonzero(np.any(falls, axis=0) & (worn[active] < 0))
            at = np.argmax(falls[:, lanes], axis=0)
            worn[active[lanes]], free_worn[active[lanes]] = first + at, unbound[at, lanes]
        lanes = np.flatnonzero(stops)
        which, at = active[lanes], np.argmax(ended[:, lanes], axis=0)
        rests[which], over[which] = np.all(np.isfinite(after[at, lanes]), axis=1), first + at
        free[which] = unbound[at, lanes]
        lost = ~rests[which]
        if np.any(lost):  # a lane that is lost stays where it was
            i, gone = at[lost], lanes[lost]
            steps[0, i, gone] = np.where((i > 0)[:, None], steps[0, i - 1, gone], last[0, which[lost]])
            steps[1, i, gone] = 0.0
        row, lane = np.nonzero(np.arange(STRIDE)[:, None] > at)
        steps[:, row, lanes[lane]] = steps[:, at[lane], lanes[lane]]
        block = np.repeat(last[:, None], STRIDE, axis=1)
        block[:, :, active] = steps
        blocks.append(block)
        last, active = block[:, -1], active[~stops]
        now[:, TIME] += STRIDE * h
        if active.size == 0:
            break
    longest = STRIDE * len(blocks) if active.size else int(np.max(over, initial=0)) + 1
    states = np.concatenate([x[None], *(block[0] for block in blocks)])[: longest + 1]
    rates = np.concatenate([*(block[1] for block in blocks), last[1][None]])[: longest + 1]
    slips = Slips(h, states, rates, *(np.full(shape, np.nan) for shape in (n, n, (n, n_x), (n, n_x))))
    _mark(model, slips, SPEED, np.where(rests, over, -1), free, slips.arrest, slips.at_arrest)
    if clamped is not None:
        _mark(model, slips, clamped, worn, free_worn, slips.wear, slips.at_wear)
    return slips


def _mark(model: Model, out: Slips, component: int, step: Indices, free: Array, time: Array, state: Array) -> None:
    """Record when a component comes to its level in a step (n,) of each lane (-1: never), time (n,) [s], and the states
    there (n, n_x): on the parabola through both ends of the step, the last one `free` of bounds (n, n_x), with the rate
    at its start."""
    lanes, level = np.flatnonzero(step >= 0), 0.0 if component == SPEED else _lowest(model)
    s = step[lanes]
    old, slope = out.states[s, lanes], out.rates[s, lanes] * out.h[lanes, None]
    bend = free[lanes] - old - slope
    w = _first_root(old[:, component] - level, slope[:, component], bend[:, component])
    time[lanes] = (s + w) * out.h[lanes]
    at = old + slope * w[:, None] + bend * (w**2)[:, None]
    at[:, component] = level
    if model.clamped is not None:
        at[:, model.clamped] = np.maximum(at[:, model.clamped], _lowest(model))
    state[lanes] = at


def _lowest(model: Model) -> float:
    """The bound of the bounded state."""
    return 0.0 if model.clamped is None else model.states[model.clamped].lower or 0.0


def _first_root(y: Array, slope: Array, bend: Array) -> Array:
    """The first root in (0, 1] of y + slope w + bend w^2, which is not negative at 0 and not positive at 1."""
    root = np.sqrt(np.maximum(slope**2 - 4 * bend * y, 0.0))
    with np.errstate(all="ignore"):
        w = np.where(slope < 0, 2 * y / (root - slope), -(slope + root) / (2 * bend))
    return np.asarray(np.clip(np.where(np.isfinite(w), w, 1.0), 1e-9, 1.0))


# ----------------------------------------------------------------------------------------------------------------------
# Many stick-slip cycles at once, coarsely: the simulator behind starts and initial nodes.
#
# Every lane has its own parameters, drive speed, normal force and start state. Here they rest until they
# break away, and slide on as above. Accurate to a fraction of a percent, which is what a start needs; answers come from
# `simulate` and the shooting.
# ----------------------------------------------------------------------------------------------------------------------

NEWTON_STEPS = 40


@lru_cache(maxsize=16)
def _functions(model: Model) -> dict[str, Mapped]:
    x, p, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters)), ca.SX.sym("u", len(INPUTS))
    t = ca.SX.sym("t")
    then = ca.vertcat(u[:TIME], u[TIME] + t)
    rested = model.rest(x, p, then, t)
    spare = model.grip(rested, p, then) - model.driving_force(rested, p, then)
    slope = ca.jacobian(spare, t)
    made = (
        ca.Function("lane_spare", [x, p, u, t], [spare, slope, rested]),
        ca.Function("lane_force", [x, p, u], [model.load_cell(x, p, u)]),
        ca.Function("lane_at_force", [t, p, u], [model.at_force(t, p, u)]),
    )
    return {f.name().removeprefix("lane_"): Mapped(f) for f in made}


def load_cell(model: Model, x: Array, p: Array, u: Array) -> Array:
    """What the load cell sees [N], shape (n,); x (n, n_x), p (n, n_p), u (n, 4)."""
    return _functions(model)["force"]([x, p, u])[0][:, 0]


def stick(model: Model, x: Array, p: Array, u: Array) -> tuple[Array, Array]:
    """Rest each lane until the drive overcomes its static limit.

    The breakaway margin falls convexly at late times, so Newton from a late time converges monotonically. No drive may
    vibrate.

    Args:
        u: (n, 4), time at the start of the rest.

    Returns:
        stick time (n,) [s] (0 where the lane is moved at once, NaN where nothing ever moves it), state at
        the onset (n, n_x).
    """
    functions = _functions(model)
    k = p[:, model.parameter_names.index("stiffness")]
    x = x.copy()
    x[:, SPEED] = 0.0
    rested = functions["spare"]([x, p, u, np.full(x.shape[0], 1e12)])[0][:, 0]
    with np.errstate(all="ignore"):
        t = (rested + k * u[:, 0] * 1e12) / (k * u[:, 0])  # the grip of a contact that rested for ever
        t = np.where(np.isfinite(t), np.maximum(t, 0.0), 0.0)
        for _ in range(NEWTON_STEPS):
            spare, slope, _state = functions["spare"]([x, p, u, t])
            move = -spare[:, 0] / slope[:, 0]
            t_new = np.maximum(np.where(np.isfinite(move), t + move, t), 0.0)
            done = np.all(np.abs(t_new - t) <= 1e-12 * np.maximum(t, 1e-9))
            t = t_new
            if done:
                break
    state = functions["spare"]([x, p, u, t])[2]
    return t, state


def rested(model: Model, x: Array, p: Array, u: Array, t: Array) -> Array:
    """States (n, n_x) of lanes that have rested for t (n,) [s] more, whatever the drive pulls."""
    return _functions(model)["spare"]([x, p, u, t])[2]


def at_force(model: Model, force: Array, p: Array, u: Array) -> Array:
    """States (n, n_x) in which resting lanes settle at these load cell forces (n,) [N]."""
    return _functions(model)["at_force"]([force, p, u])[0]
