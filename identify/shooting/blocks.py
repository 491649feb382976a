"""The shooting blocks: their equations from the composed model, and as functions of numbers over many instances.

A block takes its slots (local unknowns) and constants; what it returns is said there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.base.tableaus import RK4, step
from identify.model.model import ELONGATION, INPUTS, SPEED, Model

# ----------------------------------------------------------------------------------------------------------------------
# The last moment of a worn slip, in which the contact ages again before the mass rests.
# ----------------------------------------------------------------------------------------------------------------------

Inputs = Callable[[ca.SX], ca.SX]

STEPS: Final = 2
"""RK4 steps over the speed."""
SLOWEST: Final = 1e-9
"""Deceleration [m/s^2] of a mass that comes to rest."""
LEAST_BRAKED: Final = 0.1
"""Of that deceleration while the contact ages, and"""
FASTEST: Final = 0.5
"""of the speed of a free swing that is braked so: what lies beyond is no moment, nor an answer."""


def reaged_at_rest(model: Model, start: ca.SX, p: ca.SX, inputs: Inputs) -> ca.SX:
    """Return the state (n_x,) of a mass at rest after a worn slip, from where it would rest still worn.

    In truth the bounded state leaves its bound at the speed where its rate (eqs. 2-3) changes sign, friction grows, and
    the mass rests a little earlier and elsewhere. Both ways are followed over the speed, of which that moment has a
    fixed span: back from rest along the one, forth along the other; then the mass rests until the moment at which the
    slip is said to end.

    start: (n_x,), speed 0. p: parameters of the model. inputs: u at a time [s] after the slip is said to end.
    """
    if model.clamped is None:
        return start
    creeping, v = ca.SX(start), ca.SX.sym("v")
    creeping[SPEED] = v
    pace = model.slip(creeping, p, inputs(ca.SX(0)))[model.clamped]
    at_rest, slope = (ca.substitute(q, v, 0.0) for q in (pace, ca.gradient(pace, v)))
    braked = ca.fmax(-model.worn(start, p, inputs(ca.SX(0)))[SPEED], SLOWEST)
    k, m = (p[model.parameter_names.index(name)] for name in ("stiffness", "mass"))
    release = ca.fmin(-at_rest / slope, FASTEST * braked * ca.sqrt(m / k))

    def by_speed(field: ca.Function, state: ca.SX, t: ca.SX, first: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX]:
        """State and time [s] after a change of the speed."""
        both, h = ca.vertcat(state, t), (last - first) / STEPS
        for j in range(STEPS):

            def motion(at: ca.SX, offset: ca.SX, begin: ca.SX = first + j * h) -> ca.SX:
                moving = ca.SX(at[:-1])
                moving[SPEED] = begin + offset
                rates = field(moving, p, inputs(at[-1]))
                return ca.vertcat(rates, 1.0) / ca.fmin(rates[SPEED], -LEAST_BRAKED * braked)

            both = step(RK4, motion, both, h)[0]
        return both[:-1], both[-1]

    freed, before = by_speed(model.worn, start, ca.SX(0), ca.SX(0), release)
    arrested, after = by_speed(model.slip, freed, before, release, ca.SX(0))
    arrested[SPEED] = 0
    return ca.SX(model.rest(arrested, p, inputs(after), -after))


# ----------------------------------------------------------------------------------------------------------------------
# The equations of the shooting blocks, from the composed model: a rest, a moment of re-ageing, an interval of a slip.
#
# Each gives rows (defects and guards, scaled) and curve coefficients: what the load cell sees as a polynomial of
# reference time u within each cell, where u = 0 and 1 are the cell's ends for the event times at which the samples were
# assigned. Event times are unknowns, so the true cell is shifted and stretched against the reference one; the
# polynomial is composed with that affine map and the residuals stay exact functions of the unknowns.
#
# A rest that is no straight line takes many blocks; the moment in which the contact re-ages before it is a block then.
# ----------------------------------------------------------------------------------------------------------------------

BlockKind = Literal[
    "stick",
    "stick_reaged",
    "hold",
    "hold_reaged",
    "reageing",
    "slip",
    "slip_trembling",
    "worn",
    "released",
    "rest",
    "rest_reaged",
    "steady",
    "steady_worn",
]


REST_CELLS = 6  # cubics per block of a rest that is no straight line
SLIDES: tuple[BlockKind, ...] = ("slip", "slip_trembling", "worn", "released")
TREMBLING: tuple[BlockKind, ...] = ("slip_trembling",)  # the deviation of the normal force goes over to another one


@dataclass(frozen=True)
class Symbols:
    """The symbols every block is written in."""

    start: ca.SX
    end: ca.SX
    offset_start: ca.SX
    offset_end: ca.SX
    deviation: ca.SX
    deviation_end: ca.SX
    theta: ca.SX
    base: ca.SX
    row_scale: ca.SX
    drive_speed: ca.SX
    force_start: ca.SX
    force_end: ca.SX
    force_slope: ca.SX
    since: ca.SX
    reference: ca.SX
    first: ca.SX
    last: ca.SX

    @staticmethod
    def of(model: Model) -> Symbols:
        """Those of the blocks of a model."""
        n_x, n_p = len(model.states), len(model.parameters)
        sizes = {"start": n_x, "end": n_x, "theta": n_p, "base": n_p, "row_scale": n_x}
        return Symbols(**{name: ca.SX.sym(name, sizes.get(name, 1)) for name in Symbols.__annotations__})

    def slots(self, kind: BlockKind) -> ca.SX:
        """The local unknowns of a kind in their order (n_slots,); see `blocks.Block`."""
        end = [] if kind.startswith("rest") else [self.end]
        deviations = [self.deviation, *([self.deviation_end] if kind in TREMBLING else [])]
        return ca.vertcat(self.start, *end, self.offset_start, self.offset_end, *deviations, self.theta)

    @property
    def constants(self) -> ca.SX:
        """The constants in their order (n_constants,)."""
        return ca.vertcat(
            self.base,
            self.row_scale,
            self.drive_speed,
            self.force_start,
            self.force_end,
            self.force_slope,
            self.since,
            self.reference,
            self.first,
            self.last,
        )

    @property
    def duration(self) -> ca.SX:
        """Duration of the phase at the current event times [s]."""
        return self.reference + self.offset_end - self.offset_start

    def parameters(self, model: Model) -> ca.SX:
        """p of the model: base + theta for a linear scale, base exp(theta) for a logarithmic one."""
        return ca.vertcat(
            *(
                self.base[i] * ca.exp(self.theta[i]) if q.scale == "log" else self.base[i] + self.theta[i]
                for i, q in enumerate(model.parameters)
            )
        )


def _resting_start(model: Model, s: Symbols, p: ca.SX, reaged: bool) -> ca.SX:
    """State at the start of a stick: at rest, and after a worn slip re-aged in its last moment."""
    start = ca.SX(s.start)
    start[SPEED] = 0
    if not reaged:
        return start
    since = s.since + s.offset_start
    return reaged_at_rest(model, start, p, lambda t: ca.vertcat(s.drive_speed, s.force_start, 1, since + t))


def _rest(model: Model, reaged: bool, with_end: bool, guarded: bool = True) -> tuple[Symbols, ca.SX, ca.SX]:
    """A stick that ends with the onset guard, one that goes on (not guarded), or (without end) the last of a log."""
    s = Symbols.of(model)
    p = s.parameters(model)
    start = _resting_start(model, s, p, reaged)
    ended = s.since + s.reference + s.offset_end
    u = ca.vertcat(s.drive_speed, s.force_end + s.force_slope * s.offset_end + s.deviation, 1, ended)
    after = model.rest(start, p, u, s.duration)
    if model.straight:
        before_force, after_force = model.load_cell(start, p, u), model.load_cell(after, p, u)
        slope = (after_force - before_force) / s.duration
        curve = ca.vertcat(before_force - slope * s.offset_start, slope * s.reference)
    else:
        curve = _bent_rest(model, s, p, start)
    if not with_end:
        return s, ca.SX(0, 1), curve
    free = [i for i in range(len(model.states)) if i != SPEED]
    end = ca.SX(s.end)
    end[SPEED] = 0
    rows = [(end[i] - after[i]) / s.row_scale[i] for i in free]
    if not guarded:
        return s, ca.vertcat(*rows), curve
    guard = (model.driving_force(end, p, u) - model.grip(end, p, u)) / s.row_scale[SPEED]
    return s, ca.vertcat(*rows, guard), curve


def _reageing(model: Model) -> tuple[Symbols, ca.SX, ca.SX]:
    """The moment before a rest of many blocks: its end is the state that they all start from; no samples are in it."""
    s = Symbols.of(model)
    start = _resting_start(model, s, s.parameters(model), True)
    rows = [(s.end[i] - start[i]) / s.row_scale[i] for i in range(len(model.states)) if i != SPEED]
    return s, ca.vertcat(*rows), ca.SX.zeros(2)


def _bent_rest(model: Model, s: Symbols, p: ca.SX, start: ca.SX) -> ca.SX:
    """What the load cell shows between two fractions of a rest that is no straight line: REST_CELLS cubics."""
    t = ca.SX.sym("t")
    u = ca.vertcat(s.drive_speed, s.force_start, 1, s.since + s.offset_start + t)
    force = model.load_cell(model.rest(start, p, u, t), p, u)
    rate = ca.jacobian(force, t)
    fractions = [s.first + (s.last - s.first) * j / REST_CELLS for j in range(REST_CELLS + 1)]
    points = [(ca.substitute(force, t, s.duration * f), ca.substitute(rate, t, s.duration * f)) for f in fractions]
    return _cells(s, points, fractions[:-1], s.duration * (s.last - s.first) / REST_CELLS)


def _cells(s: Symbols, points: list[tuple[ca.SX, ca.SX]], fractions: list[ca.SX], h: ca.SX) -> ca.SX:
    """Coefficients in reference time of the cubics between points (value, rate) that lie h [s] apart; the cells begin
    at these fractions of the phase."""
    stretch = s.reference / s.duration
    curves = []
    for j, fraction in enumerate(fractions):
        shift = -(s.offset_start + fraction * (s.duration - s.reference)) / h
        curves.append(_composed(_hermite(points[j], points[j + 1], h), stretch, shift))
    return ca.vertcat(*curves)


@lru_cache(maxsize=32)
def _step(model: Model, worn: bool) -> ca.Function:
    """One RK4 step of a slip: (x, time since the slip began, length, p, course of the inputs as `_inputs` has it) ->
    x after it, and what the load cell sees before it, and the rate of that. Called once for each step, which costs much
    less than to write the step out as often."""
    n_x = len(model.states)
    x, t, h = ca.SX.sym("x", n_x), ca.SX.sym("t"), ca.SX.sym("h")
    p, course, u = ca.SX.sym("p", len(model.parameters)), ca.SX.sym("course", 8), ca.SX.sym("u", len(INPUTS))
    field, seed = model.worn if worn else model.slip, ca.SX.sym("rate", n_x)
    sensor_rate = ca.Function("sensor_rate", [x, p, u, seed], [ca.jtimes(model.load_cell(x, p, u), x, seed)])

    def motion(at: ca.SX, offset: ca.SX) -> ca.SX:
        return field(at, p, _inputs(course, t + offset))

    after, _, stages = step(RK4, motion, x, h)
    now = _inputs(course, t)
    return ca.Function(
        "step", [x, t, h, p, course], [after, model.load_cell(x, p, now), sensor_rate(x, p, now, stages[0])]
    )


def _inputs(course: ca.SX, t: ca.SX) -> ca.SX:
    """u of the model at a time since a slip began. course (8,): drive speed, normal force, its slope, its deviation and
    the swing of that until the end of the phase, its duration, offset and time of its start."""
    drive_speed, force, slope, deviation, swing, duration, offset, since = ca.vertsplit(course)
    force = force + slope * (offset + t) + deviation + swing * (t / duration) ** 2
    return ca.vertcat(drive_speed, force, 1, since + offset + t)


def _slip(model: Model, kind: BlockKind, steps: int) -> tuple[Symbols, ca.SX, ca.SX]:
    """One shooting interval of a slip: RK4 steps, their defect at the end, a cubic Hermite curve per step.

    Released: at its end the bounded state is about to leave its bound, one more row. Trembling: the deviation of the
    normal force is one at the onset and another in the end; its rate is none at the onset, where the pull would fall
    behind the grip otherwise.
    """
    s = Symbols.of(model)
    p = s.parameters(model)
    worn = kind in ("worn", "released")
    swing = s.deviation_end - s.deviation if kind in TREMBLING else ca.SX(0)
    loads = s.force_start, s.force_slope, s.deviation, swing
    course = ca.vertcat(s.drive_speed, *loads, s.duration, s.offset_start, s.since)
    held = [i for i, q in enumerate(model.states) if q.lower is not None] if worn else []
    one, x = _step(model, worn), ca.SX(s.start)
    for i in held:
        x[i] = model.states[i].lower
    h = s.duration * (s.last - s.first) / steps
    points: list[tuple[ca.SX, ca.SX]] = []
    for j in range(steps):
        x, force, rate = one(x, s.duration * s.first + j * h, h, p, course)
        points.append((force, rate))
    t = s.duration * s.last
    points.append(one(x, t, h, p, course)[1:])

    fractions = [s.first + (s.last - s.first) * j / steps for j in range(steps)]
    rows = [(s.end[i] - x[i]) / s.row_scale[i] for i in range(len(model.states)) if i not in held]
    if kind == "released":
        freed = held[0]  # held rows are not used: the place of its scale holds that of its rate
        rows.append(model.slip(x, p, _inputs(course, t))[freed] / s.row_scale[freed])
    return s, ca.vertcat(*rows), _cells(s, points, fractions, h)


def _steady(model: Model, worn: bool) -> tuple[Symbols, ca.SX, ca.SX]:
    """Sliding as fast as the drive: at both ends nothing changes, and between them the force is a straight line.

    Exact where the normal force is level; where it drifts, the motion lags behind by less than a natural period.
    """
    s = Symbols.of(model)
    p = s.parameters(model)
    field = model.worn if worn else model.slip
    held = [i for i, q in enumerate(model.states) if q.lower is not None] if worn else []
    rows, shown = [], []
    ends = ((s.start, s.force_start, s.since), (s.end, s.force_end, s.since + s.reference))
    for state, force, t in ends:
        x = ca.SX(state)
        x[SPEED] = s.drive_speed
        for i in held:
            x[i] = model.states[i].lower
        u = ca.vertcat(s.drive_speed, force + s.deviation, 1, t)
        rates = field(x, p, u)
        rows += [rates[i] / s.row_scale[i] for i in range(len(model.states)) if i not in (ELONGATION, *held)]
        shown.append(model.load_cell(x, p, u))
    return s, ca.vertcat(*rows), ca.vertcat(shown[0], shown[1] - shown[0])


def _hermite(left: tuple[ca.SX, ca.SX], right: tuple[ca.SX, ca.SX], h: ca.SX) -> list[ca.SX]:
    """Coefficients in u of the cubic through two values and two rates at u = 0 and 1."""
    (y0, d0), (y1, d1) = left, right
    return [y0, h * d0, 3 * (y1 - y0) - h * (2 * d0 + d1), -2 * (y1 - y0) + h * (d0 + d1)]


def _composed(c: list[ca.SX], stretch: ca.SX, shift: ca.SX) -> ca.SX:
    """Coefficients of the cubic c(stretch * u + shift)."""
    return ca.vertcat(
        c[0] + shift * (c[1] + shift * (c[2] + shift * c[3])),
        stretch * (c[1] + shift * (2 * c[2] + shift * 3 * c[3])),
        stretch**2 * (c[2] + 3 * c[3] * shift),
        stretch**3 * c[3],
    )


def equations(model: Model, kind: BlockKind, steps: int) -> tuple[Symbols, ca.SX, ca.SX]:
    """Symbols, rows and curve of a block; `steps` RK4 steps per interval (slips only)."""
    if kind in SLIDES:
        return _slip(model, kind, steps)
    if kind.startswith("steady"):
        return _steady(model, kind.endswith("worn"))
    if kind == "reageing":
        return _reageing(model)
    return _rest(model, kind.endswith("reaged"), not kind.startswith("rest"), guarded=kind.startswith("stick"))


Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Block:
    """One kind of block, mapped over many instances.

    Slots, in order: state at the start (n_x,), state at the end (n_x,; absent in a rest), offset of the
    start time [s], offset of the end time [s], deviation of the normal force in this cycle from its measured
    course [N] (of a trembling slip two: at its onset, in its end), then the search variables (n_p,). Constants, in
    order: base values of the parameters (n_p,), row scales (n_x,), drive speed, normal force at the start and at the
    end of the phase and its slope, time of its start, reference duration of it, first and last fraction of it.
    """

    kind: BlockKind
    n_slots: int
    n_rows: int
    n_cells: int
    order: int  # coefficients per cell: 2 linear, 4 cubic
    values: Mapped
    derivatives: Mapped
    expressions: tuple[ca.SX, ca.SX, ca.SX, ca.SX]  # slots, constants, rows, curve
    drive_speed: int  # its place among the constants

    def evaluate(self, slots: Array, constants: Array, *, derivatives: bool) -> tuple[Array, ...]:
        """Rows (B, n_rows) and curves (B, n_cells, order); with derivatives also their Jacobians
        (B, n_rows, n_slots) and (B, n_cells, order, n_slots). slots (B, n_slots), constants (B, n_constants)."""
        count = slots.shape[0]
        out = (self.derivatives if derivatives else self.values)([slots, constants])
        rows, curve = out[0], out[1].reshape(count, self.n_cells, self.order)
        if not derivatives:
            return rows, curve
        by_slot = out[2].reshape(count, self.n_slots, -1)  # CasADi stores matrices by columns
        d_rows = by_slot[:, :, : self.n_rows].transpose(0, 2, 1)
        d_curve = by_slot[:, :, self.n_rows :].reshape(count, self.n_slots, self.n_cells, self.order)
        return rows, curve, d_rows, d_curve.transpose(0, 2, 3, 1)

    def bend(self, slots: Array, constants: Array, on_rows: Array, on_curve: Array, used: tuple[int, ...]) -> Array:
        """Second derivatives (B, n_slots, n_slots) of on_rows . rows + on_curve . curve; weights (B, n_rows) and
        (B, n_cells * order). Built on first use: only creeping solves need it.

        Args:
            used: the slots that are asked for; all others count as constants.
        """
        out = np.zeros((slots.shape[0], self.n_slots, self.n_slots))
        asked = np.array(used)
        some = _second(self, used)([slots, constants, on_rows, on_curve])[0]
        out[:, asked[:, None], asked] = some.reshape(-1, asked.size, asked.size)
        return out


@lru_cache(maxsize=64)
def _second(made: Block, used: tuple[int, ...]) -> Mapped:
    """The mapped function behind `Block.bend`."""
    slots, constants, rows, curve = made.expressions
    on_rows, on_curve = ca.SX.sym("on_rows", made.n_rows), ca.SX.sym("on_curve", curve.numel())
    weighted = ca.dot(on_rows, rows) + ca.dot(on_curve, curve)
    moving = ca.vertcat(*(slots[i] for i in used))
    second, _ = ca.hessian(weighted, moving)
    function = ca.Function(f"{made.kind}_second", [slots, constants, on_rows, on_curve], [ca.densify(second)])
    return Mapped(function)


@lru_cache(maxsize=64)
def block(model: Model, kind: BlockKind, steps: int = 1) -> Block:
    """The block functions of one kind; `steps` RK4 steps per interval (slips only)."""
    s, rows, curve = equations(model, kind, steps)
    slots = s.slots(kind)
    values = ca.Function(f"{kind}_values", [slots, s.constants], [rows, curve])
    # Together they take a fifth less than the two one by one.
    jacobian = ca.densify(ca.jacobian(ca.vertcat(rows, curve), slots))
    derivatives = ca.Function(f"{kind}_derivatives", [slots, s.constants], [rows, curve, jacobian])
    line = model.straight or kind.startswith("steady") or kind == "reageing"
    cells, order = (steps, 4) if kind in SLIDES else (1, 2) if line else (REST_CELLS, 4)
    return Block(
        kind,
        slots.numel(),
        rows.numel(),
        cells,
        order,
        Mapped(values),
        Mapped(derivatives),
        (slots, s.constants, rows, curve),
        len(model.parameters) + len(model.states),
    )
