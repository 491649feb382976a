"""One stick-slip cycle of many batch rows at once, coarsely: the simulator behind starts and initial nodes.

Every row has its own parameters, drive speed, normal force and start state. Rests are closed forms; slips take fixed
RK4 steps with the bounded state clamped after every step, and their events are roots of a parabola within a step.
Accurate to a fraction of a percent, which is what a start needs; answers come from `simulate` and the shooting.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.model.model import INPUTS, SPEED, TIME, Model
from identify.simulation.steppers import RK4, step

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LONGEST = 14.0  # half periods: a slip that takes longer counts as sliding
STRIDE = 8  # steps of a slip between two looks at which rows still slide


@dataclass(frozen=True)
class Slips:
    """One slip per row. `h` (n,) step lengths [s]; `states` (s+1, n, n_x) and `rates` (s+1, n, n_x) at the
    steps (constant after the arrest); `wear`, `arrest` (n,) [s] from the onset, NaN where they never
    happen; `at_wear`, `at_arrest` (n, n_x) states there."""

    h: Array
    states: Array
    rates: Array
    wear: Array
    arrest: Array
    at_wear: Array
    at_arrest: Array

    @property
    def rested(self) -> NDArray[np.bool_]:
        """Whether each row came to rest."""
        return np.isfinite(self.arrest)

    def at(self, times: Array) -> Array:
        """States (n, m, n_x) at times (n, m) [s] from the onset of each row, cubic Hermite; level outside."""
        steps, rows = self.states.shape[0] - 1, np.arange(self.h.size)[:, None]
        u = np.clip(times / self.h[:, None], 0.0, steps * (1 - 1e-12))
        i = np.minimum(u.astype(int), steps - 1)
        w, h = (u - i)[..., None], self.h[:, None, None]
        y0, y1, d0, d1 = (of[at, rows] for of in (self.states, self.rates) for at in (i, i + 1))
        value = y0 * (1 + 2 * w) * (1 - w) ** 2 + y1 * w**2 * (3 - 2 * w)
        return np.asarray(value + h * (d0 * w * (1 - w) ** 2 - d1 * w**2 * (1 - w)))


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

    free, _, stages = step(RK4, lambda state, _t: model.slip(clamp(state), p, u), x, h)
    # Called once for each step: that costs much less than to write the step out as often.
    one = ca.Function("row_step", [x, p, u, h], [clamp(free), free, stages[0]])
    steps, state, now = list[Sequence[ca.SX]](), x, u
    for _ in range(STRIDE):
        steps.append(one(state, p, now, h))
        state, now = steps[-1][0], ca.vertcat(now[:TIME], now[TIME] + h)
    columns = [ca.horzcat(*column) for column in zip(*steps, strict=True)]
    return Mapped(ca.Function("row_stride", [x, p, u, h], columns))


def slip(model: Model, x: Array, p: Array, u: Array, per_half_period: int) -> Slips:
    """Slide every row from x (n, n_x) until it rests, with steps of half a natural period / per_half_period.

    Args:
        p: (n, n_p); u: (n, 4) drive speed, normal force, direction +1, time at the start.
    """
    n, n_x, names, rows = *x.shape, model.parameter_names, np.arange(x.shape[0])
    half = np.pi * np.sqrt(p[:, names.index("mass")] / p[:, names.index("stiffness")])
    h, now, last, active, chunks = half / per_half_period, u.copy(), x, rows, list[Array]()
    for _ in range(0, int(LONGEST * per_half_period), STRIDE):
        chunk = np.full((3, STRIDE, n, n_x), np.nan)
        for place, value in zip(chunk, _stride(model)([q[active] for q in (last, p, now, h)]), strict=True):
            place[:, active] = value.reshape(active.size, STRIDE, n_x).transpose(1, 0, 2)
        chunks.append(chunk)
        last = chunk[0, -1]
        now[:, TIME] += STRIDE * h
        active = active[np.all(chunk[0][:, active, SPEED] > 0.0, axis=0)]  # what is not finite is over, too
        if active.size == 0:
            break
    after, free, rates = np.concatenate(chunks, axis=1)
    over = _first(~(after[..., SPEED] > 0.0))
    rests = (over >= 0) & np.all(np.isfinite(after[over, rows]), axis=1)
    length = int(over.max(initial=0)) + 1 if active.size == 0 else len(after)
    before = np.concatenate([x[None], after])
    renewed = np.full(n, -1)
    if model.clamped is not None:
        wears = (free[..., model.clamped] <= _lowest(model)) & (before[:-1, :, model.clamped] > _lowest(model))
        renewed = _first(wears & (np.arange(len(after))[:, None] < np.where(over < 0, len(after), over)))
    # After its arrest a row keeps its state; one that is lost keeps that before.
    stop = np.where(over < 0, length, over + rests)
    kept = np.minimum(np.arange(length + 1)[:, None], stop)
    states, rates = before[kept, rows], rates[np.minimum(kept, np.where(over < 0, length - 1, over)), rows]
    rates[(kept == stop) & (over >= 0) & ~rests] = 0.0
    ends = []
    for component, at in ((model.clamped, renewed), (SPEED, np.where(rests, over, -1))):
        ends.append(_crossing(model, component, at, states, rates, free[at, rows], h))
    (wear, at_wear), (arrest, at_arrest) = ends
    return Slips(h, states, rates, wear, arrest, at_wear, at_arrest)


def _first(true: NDArray[np.bool_]) -> Indices:
    """The first step (s, n) in which something is true for each row (n,), -1 where it never is."""
    return np.where(true.any(axis=0), true.argmax(axis=0), -1)


def _lowest(model: Model) -> float:
    """The bound of the bounded state."""
    return 0.0 if model.clamped is None else model.states[model.clamped].lower or 0.0


def _crossing(
    model: Model, component: int | None, step: Indices, states: Array, rates: Array, free: Array, h: Array
) -> tuple[Array, Array]:
    """When a component comes to its level in a step (n,) of each row (-1: never), (n,) [s], and the states there."""
    time, state, rows = np.full(step.shape, np.nan), np.full(free.shape, np.nan), np.flatnonzero(step >= 0)
    if component is None or not rows.size:
        return time, state
    level, s = 0.0 if component == SPEED else _lowest(model), step[rows]
    old, slope = states[s, rows], rates[s, rows] * h[rows, None]
    curvature = free[rows] - old - slope
    # The first root in (0, 1] of a parabola that is not negative at 0 and not positive at 1.
    a, b, c = curvature[:, component], slope[:, component], old[:, component] - level
    root = np.sqrt(np.maximum(b**2 - 4 * a * c, 0.0))
    with np.errstate(all="ignore"):
        w = np.where(b < 0, 2 * c / (root - b), -(b + root) / (2 * a))
    w = np.clip(np.where(np.isfinite(w), w, 1.0), 1e-9, 1.0)
    at = old + slope * w[:, None] + curvature * (w**2)[:, None]
    at[:, component] = level
    if model.clamped is not None:
        at[:, model.clamped] = np.maximum(at[:, model.clamped], _lowest(model))
    time[rows], state[rows] = (s + w) * h[rows], at
    return time, state


# Rests, and what the load cell shows.


@lru_cache(maxsize=16)
def _functions(model: Model) -> tuple[Mapped, Mapped]:
    """(x, p, u) -> force of the sensor at rest and while sliding; (force, p, u) -> state settled there."""
    x, p, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters)), ca.SX.sym("u", len(INPUTS))
    force = ca.SX.sym("force")
    cells = dict.fromkeys((model.load_cell, model.sliding_cell))  # one where the sensor is at the drive
    return (
        Mapped(ca.Function("row_force", [x, p, u], [cell(x, p, u) for cell in cells])),
        Mapped(ca.Function("row_at_force", [force, p, u], [model.at_force(force, p, u)])),
    )


def load_cell(model: Model, x: Array, p: Array, u: Array) -> Array:
    """What the force sensor shows at rest [N] (n,); x (n, n_x), p (n, n_p), u (n, 4)."""
    return _functions(model)[0]([x, p, u])[0][:, 0]


def at_force(model: Model, force: Array, p: Array, u: Array) -> Array:
    """States (n, n_x) in which resting rows settle at these load cell forces (n,) [N]."""
    return _functions(model)[1]([force, p, u])[0]


# The force of one simulated cycle as a function of time: stick line, slip, stick line.


def middle_of_fall(force: Array, h: Array, duration: Array) -> Array:
    """Time of the mid-fall crossing of each row's simulated force (n, steps) [s]."""
    steps, rows = np.arange(force.shape[1])[None, :], np.arange(force.shape[0])
    inside = steps * h[:, None] <= duration[:, None] + h[:, None]
    highest, lowest = (np.where(inside & np.isfinite(force), force, end) for end in (-np.inf, np.inf))
    with np.errstate(all="ignore"):
        level = 0.5 * (np.max(highest, axis=1) + np.min(lowest, axis=1))
    below = (force <= level[:, None]) & (steps > np.argmax(highest, axis=1)[:, None]) & inside
    after = np.maximum(np.argmax(below, axis=1), 1)
    f0, f1 = force[rows, after - 1], force[rows, after]
    w = np.clip(np.where(f0 > f1, (f0 - level) / np.where(f0 > f1, f0 - f1, 1.0), 0.5), 0.0, 1.0)
    return np.asarray((after - 1 + w) * h)


@dataclass(frozen=True)
class Waves:
    """The force of simulated cycles as a function of time from their onset: stick line, slip, stick line.

    h (n,) step lengths [s]; duration (n,) of the slips [s]; start, end (n,) force at their ends [N]; slope (n,) of the
    sticks [N/s]; cubics (4, n * s): coefficients of the powers of the share of every step that has passed.
    """

    h: Array
    duration: Array
    start: Array
    end: Array
    slope: Array
    cubics: Array

    @staticmethod
    def of(force: Array, h: Array, duration: Array, end: Array, slope: Array) -> Waves:
        """From the force at the steps (n, s + 1); cubic through the neighbours' slopes: the steps are coarse."""
        around = np.pad(force, ((0, 0), (1, 1)), mode="edge")
        tilt = 0.5 * (around[:, 2:] - around[:, :-2])
        rise, first, last = np.diff(force, axis=1), tilt[:, :-1], tilt[:, 1:]
        cubics = [force[:, :-1], first, 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise]
        return Waves(h, duration, force[:, 0], end, slope, np.stack(cubics).reshape(4, -1))

    @staticmethod
    def of_slips(model: Model, slips: Slips, p: Array, u: Array, rested: NDArray[np.bool_]) -> tuple[Waves, Array]:
        """Of slips with parameters p (n, n_p) and inputs u (n, 4), those that have not rested a step long; and the time
        of the middle of their falls (n,) [s]."""
        n, steps = slips.h.size, slips.states.shape[0]
        flat = slips.states.transpose(1, 0, 2).reshape(n * steps, -1)
        inputs = [flat, np.repeat(p, steps, axis=0), np.repeat(u, steps, axis=0)]
        pull, force = (_functions(model)[0](inputs)[which][:, 0].reshape(n, steps) for which in (0, -1))
        duration = np.where(rested, slips.arrest, slips.h)
        end = load_cell(model, np.nan_to_num(slips.at_arrest), p, u)
        slope = p[:, model.parameter_names.index("stiffness")] * u[:, 0]
        # Falls are seen in the force of the drive: under the counterface they have no middle, but a plateau.
        return Waves.of(force, slips.h, duration, end, slope), middle_of_fall(pull, slips.h, duration)

    def values(self, t: Array) -> Array:
        """Force (n, b) at times t (n, b) from the onset of each cycle."""
        return self._at(t)[0]

    def with_rates(self, t: Array) -> tuple[Array, Array]:
        """Force (n, b) at times t (n, b) from the onset of each cycle, and its rates [N/s]."""
        value, c, w = self._at(t)
        rate = ((3.0 * c[3] * w + 2.0 * c[2]) * w + c[1]) / self.h[:, None]
        return value, np.where((t < 0.0) | (t > self.duration[:, None]), self.slope[:, None], rate)

    def _at(self, t: Array) -> tuple[Array, Array, Array]:
        """The force (n, b), the coefficients (4, n, b) of the step each time is in, and the share of it that passed."""
        rows, s = self.h.size, self.slope[:, None]
        steps = self.cubics.shape[1] // rows
        u = np.clip(t / self.h[:, None], 0.0, steps - 1e-6)
        i = u.astype(np.int64)
        c, w = np.take(self.cubics, i + steps * np.arange(rows)[:, None], axis=1), u - i
        late = t - self.duration[:, None]
        value = np.where(late > 0.0, self.end[:, None] + s * late, ((c[3] * w + c[2]) * w + c[1]) * w + c[0])
        return np.where(t < 0.0, self.start[:, None] + s * t, value), c, w
