"""The shooting blocks: their equations from the composed model, and as functions of numbers over many instances.

There are four types of block: a rest, the ageing of a renewed contact just before a mass rests, an interval of a slide,
and steady sliding. Each gives rows (defects and guards, scaled) and curve coefficients: what the load cell sees as a
polynomial of reference time u within each cell, where u = 0 and 1 are the cell's ends for the event times at which the
samples were assigned. Event times are unknowns, so the true cell is shifted and stretched against the reference one;
the polynomial is composed with that affine map and the residuals stay exact functions of the unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.model.model import ELONGATION, SPEED, Model
from identify.simulation.steppers import RK4, step

Array = NDArray[np.float64]
Equations = tuple["Symbols", ca.SX, ca.SX]  # symbols, rows (n_rows,), curve (coefficients, cells)

REST_CELLS = 6  # cubics per block of a rest that is no straight line
COURSE = 5  # constants of a block under a drive on a course
SHORT = 1e-6  # of a rest: within it a course has not changed yet


@dataclass(frozen=True)
class RestBlock:
    """A rest, or a part of one. ended_by: what ends it in a node; None: it has no node at its end."""

    ended_by: Literal["onset", "time"] | None = None

    def equations(self, model: Model) -> Equations:
        """Continuity to the node at the end, the onset guard there, and what the load cell shows meanwhile."""
        s = Symbols.of(model)
        p, start = s.parameters(model), s.at_rest(s.start)
        force = s.force_end + s.force_slope * s.offset_end + s.deviation
        after, u = s.rested(model, start, p, (force, s.reference + s.offset_end, s.duration))
        if model.straight and not model.on_course:
            before_force, after_force = model.load_cell(start, p, u), model.load_cell(after, p, u)
            slope = (after_force - before_force) / s.duration
            curve = ca.vertcat(before_force - slope * s.offset_start, slope * s.reference)
        else:
            t, parts = ca.SX.sym("t"), 1 if model.straight else REST_CELLS
            rested, meanwhile = s.rested(model, start, p, (s.force_start, s.offset_start + t, t))
            force = model.load_cell(rested, p, meanwhile)
            shown = force, ca.jacobian(force, t)
            fractions = [s.first + (s.last - s.first) * j / parts for j in range(parts + 1)]
            points = [tuple(ca.substitute(q, t, s.duration * f) for q in shown) for f in fractions]
            curve = _cells(s, points, fractions[:-1], s.duration * (s.last - s.first) / parts)
        if self.ended_by is None:
            return s, ca.SX(0, 1), curve
        end = s.at_rest(s.end)
        rows = [(end[i] - after[i]) / s.row_scale[i] for i in range(len(model.states)) if i != SPEED]
        if self.ended_by == "onset":
            rows.append((s.way * model.driving_force(end, p, u) - model.grip(end, p, u)) / s.row_scale[SPEED])
        return s, ca.vertcat(*rows), curve


@dataclass(frozen=True)
class AgeingBlock:
    """The last moment of a renewed slide, in which the contact ages again: from where the mass would rest, still
    renewed, to the node in which the rest begins. It holds no samples.

    In truth the bounded state leaves its bound at the speed where its rate (eqs. 2-3) changes sign, friction grows, and
    the mass rests a little earlier and elsewhere. Both ways are followed over the speed, of which that moment has a
    fixed span: back from rest along the one, forth along the other; then the mass rests until the moment at which the
    slip is said to end.
    """

    STEPS: ClassVar[int] = 2  # RK4 steps over the speed
    SLOWEST: ClassVar[float] = 1e-9  # deceleration [m/s^2] of a mass that comes to rest
    LEAST_BRAKED: ClassVar[float] = 0.1  # of that deceleration while the contact ages
    FASTEST: ClassVar[float] = 0.5  # of the speed of a free swing so braked: beyond it this is no moment

    def equations(self, model: Model) -> Equations:
        """Continuity to the node at the end."""
        s = Symbols.of(model)
        aged = self._aged(model, s, s.parameters(model))
        rows = [(s.end[i] - aged[i]) / s.row_scale[i] for i in range(len(model.states)) if i != SPEED]
        return s, ca.vertcat(*rows), ca.SX.zeros(2)

    def _aged(self, model: Model, s: Symbols, p: ca.SX) -> ca.SX:
        start = s.at_rest(s.start)
        if model.clamped is None:
            return start

        def inputs(t: ca.SX) -> ca.SX:
            return s.inputs(s.force_start, s.offset_start + t)

        creeping, v = ca.SX(start), ca.SX.sym("v")
        creeping[SPEED] = s.way * v
        pace = model.slip(creeping, p, inputs(ca.SX(0)))[model.clamped]
        at_rest, slope = (ca.substitute(q, v, 0.0) for q in (pace, ca.gradient(pace, v)))
        braked = ca.fmax(-s.way * model.renewed(start, p, inputs(ca.SX(0)))[SPEED], self.SLOWEST)
        k, m = (p[model.parameter_names.index(name)] for name in ("stiffness", "mass"))
        release = ca.fmin(-at_rest / slope, self.FASTEST * braked * ca.sqrt(m / k))

        def by_speed(field: ca.Function, state: ca.SX, t: ca.SX, first: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX]:
            """State and time [s] after a change of the speed."""
            both, h = ca.vertcat(state, t), (last - first) / self.STEPS
            for j in range(self.STEPS):

                def motion(at: ca.SX, offset: ca.SX, begin: ca.SX = first + j * h) -> ca.SX:
                    moving = ca.SX(at[:-1])
                    moving[SPEED] = s.way * (begin + offset)
                    rates = field(moving, p, inputs(at[-1]))
                    return ca.vertcat(rates, 1.0) / ca.fmin(s.way * rates[SPEED], -self.LEAST_BRAKED * braked)

                both = step(RK4, motion, both, h)[0]
            return both[:-1], both[-1]

        freed, before = by_speed(model.renewed, start, ca.SX(0), ca.SX(0), release)
        arrested, after = by_speed(model.slip, freed, before, release, ca.SX(0))
        rising = [s.course[3]] if model.on_course else []
        return ca.SX(model.rest(s.at_rest(arrested), p, inputs(after), -after, *rising))


@dataclass(frozen=True)
class SlideBlock:
    """One shooting interval of a slide: so many RK4 steps, their defect at the end, a cubic Hermite curve per step.

    renewed: the bounded state stays at its bound; released: at the end it is about to leave it, one more row; jitter:
    the deviation of the normal force is one at the onset and another at the end of the slide; its rate is none at the
    onset, where the spring force would fall behind the static limit otherwise.
    """

    steps: int
    renewed: bool = False
    released: bool = False
    jitter: bool = False

    def equations(self, model: Model) -> Equations:
        """Defects of the states at the end, the release guard there, and a cubic per step."""
        s = Symbols.of(model)
        p = s.parameters(model)
        swing = s.deviation_end - s.deviation if self.jitter else ca.SX(0)
        loads = s.force_start, s.force_slope, s.deviation, swing
        rising = [s.course[2], s.way] if model.on_course else []
        course = ca.vertcat(s.drive_speed, *loads, s.duration, s.offset_start, s.since, *rising)
        one, x, clamped = _step(model, self.renewed), ca.SX(s.start), _clamped(model, self.renewed)
        for i in clamped:
            x[i] = model.states[i].lower
        h = s.duration * (s.last - s.first) / self.steps
        points = []
        for j in range(self.steps):
            x, force, rate = one(x, s.duration * s.first + j * h, h, p, course)
            points.append((force, rate))
        t = s.duration * s.last
        points.append(one(x, t, h, p, course)[1:])
        rows = [(s.end[i] - x[i]) / s.row_scale[i] for i in range(len(model.states)) if i not in clamped]
        if self.released:
            freed = clamped[0]  # its defect is no row: the place of its scale holds that of its rate
            rows.append(model.slip(x, p, _inputs(course, t))[freed] / s.row_scale[freed])
        fractions = [s.first + (s.last - s.first) * j / self.steps for j in range(self.steps)]
        return s, ca.vertcat(*rows), _cells(s, points, fractions, h)


@dataclass(frozen=True)
class SteadyBlock:
    """Sliding as fast as the drive: at both ends nothing changes, and between them the force is a straight line.

    Exact where the normal force is level; where it drifts, the motion lags behind by less than a natural period.
    """

    renewed: bool = False

    def equations(self, model: Model) -> Equations:
        """No rates at both ends, and a line between the forces there."""
        s = Symbols.of(model)
        p, clamped = s.parameters(model), _clamped(model, self.renewed)
        field = model.renewed if self.renewed else model.slip
        rows, shown = [], []
        for state, force, t in ((s.start, s.force_start, ca.SX(0)), (s.end, s.force_end, s.reference)):
            x = ca.SX(state)
            x[SPEED] = s.drive_speed
            for i in clamped:
                x[i] = model.states[i].lower
            u = s.inputs(force + s.deviation, t)
            rates = field(x, p, u)
            rows += [rates[i] / s.row_scale[i] for i in range(len(model.states)) if i not in (ELONGATION, *clamped)]
            shown.append(model.sliding_cell(x, p, u))
        return s, ca.vertcat(*rows), ca.vertcat(shown[0], shown[1] - shown[0])


BlockKind = RestBlock | AgeingBlock | SlideBlock | SteadyBlock


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
    course: ca.SX
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
        sizes["course"] = COURSE if model.on_course else 0
        return Symbols(**{name: ca.SX.sym(name, sizes.get(name, 1)) for name in Symbols.__annotations__})

    def slots(self, kind: BlockKind) -> ca.SX:
        """The local unknowns of a kind in their order (n_slots,); see `Block`."""
        end = [] if kind == RestBlock() else [self.end]
        deviations = [self.deviation, *([self.deviation_end] if isinstance(kind, SlideBlock) and kind.jitter else [])]
        return ca.vertcat(self.start, *end, self.offset_start, self.offset_end, *deviations, self.theta)

    @property
    def constants(self) -> ca.SX:
        """The constants in their order (n_constants,)."""
        names = list(Symbols.__annotations__)
        return ca.vertcat(*(getattr(self, name) for name in names[names.index("base") :]))

    @property
    def way(self) -> ca.SX:
        """Direction of sliding, of a rest of the slide that ends it: +1 unless the drive turns."""
        return self.course[4] if self.course.numel() else ca.SX(1)

    @property
    def duration(self) -> ca.SX:
        """Duration of the phase at the current event times [s]."""
        return self.reference + self.offset_end - self.offset_start

    def inputs(self, force: ca.SX, t: ca.SX) -> ca.SX:
        """u of the model with a normal force [N], at a time after the phase began in the reference [s]."""
        return ca.vertcat(self.drive_speed, force, self.way, self.since + t)

    def rested(self, model: Model, start: ca.SX, p: ca.SX, then: tuple[ca.SX, ca.SX, ca.SX]) -> tuple[ca.SX, ca.SX]:
        """State and u of the model at a moment of a rest from `start`; then: the normal force [N], the time since the
        phase began in the reference [s], and how long the mass has rested [s].

        Along a course the rest takes the acceleration with which the drive, as fast as it is at that moment, has moved
        as far as it has: exact for all that follows the drive at once, and what lags sees the last moments.
        """
        force, t, duration = then
        if not model.on_course:
            u = self.inputs(force, t)
            return model.rest(start, p, u, duration), u
        before, pace, rising, first, way = ca.vertsplit(self.course)
        since, late = t - self.first * self.reference, self.offset_start
        u = ca.vertcat(pace + rising * since, force, way, self.since + t)
        moved = before + pace * since + 0.5 * rising * since**2 - (self.drive_speed * late + 0.5 * first * late**2)
        excess = u[0] * duration - moved - 0.5 * rising * duration**2
        shortest = SHORT * self.reference
        return model.rest(start, p, u, duration, rising + 2 * excess / ca.fmax(duration, shortest) ** 2), u

    def parameters(self, model: Model) -> ca.SX:
        """p of the model: base + theta for a linear scale, base exp(theta) for a logarithmic one."""
        return ca.vertcat(
            *(
                self.base[i] * ca.exp(self.theta[i]) if q.scale == "log" else self.base[i] + self.theta[i]
                for i, q in enumerate(model.parameters)
            )
        )

    @staticmethod
    def at_rest(state: ca.SX) -> ca.SX:
        """A state with speed 0."""
        out = ca.SX(state)
        out[SPEED] = 0
        return out


def _clamped(model: Model, renewed: bool) -> list[int]:
    """The states that stay at their lower bounds."""
    return [i for i, q in enumerate(model.states) if q.lower is not None] if renewed else []


def _cells(s: Symbols, points: list[tuple[ca.SX, ...]], fractions: list[ca.SX], h: ca.SX) -> ca.SX:
    """Coefficients (4, cells) in reference time of cubics between points (value, rate) h [s] apart."""
    stretch = s.reference / s.duration
    curves = []
    for j, fraction in enumerate(fractions):
        (y0, d0), (y1, d1) = points[j], points[j + 1]
        c = [y0, h * d0, 3 * (y1 - y0) - h * (2 * d0 + d1), -2 * (y1 - y0) + h * (d0 + d1)]
        shift = -(s.offset_start + fraction * (s.duration - s.reference)) / h
        curves.append(
            ca.vertcat(  # c(stretch * u + shift)
                c[0] + shift * (c[1] + shift * (c[2] + shift * c[3])),
                stretch * (c[1] + shift * (2 * c[2] + shift * 3 * c[3])),
                stretch**2 * (c[2] + 3 * c[3] * shift),
                stretch**3 * c[3],
            )
        )
    return ca.horzcat(*curves)


@lru_cache(maxsize=32)
def _step(model: Model, renewed: bool) -> ca.Function:
    """One RK4 step of a slip: (x, time since the slip began, length, p, course of the inputs as `_inputs` has it) ->
    x after it, and what the load cell sees before it, and the rate of that. Called once for each step, which costs much
    less than to write the step out as often."""
    n_x = len(model.states)
    x, t, h = ca.SX.sym("x", n_x), ca.SX.sym("t"), ca.SX.sym("h")
    p, course = ca.SX.sym("p", len(model.parameters)), ca.SX.sym("course", 10 if model.on_course else 8)
    field, seed = model.renewed if renewed else model.slip, ca.SX.sym("rate", n_x + 1)
    shown = model.sliding_cell(x, p, _inputs(course, t))
    sensor = ca.Function("sensor", [x, t, p, course, seed], [shown, ca.jtimes(shown, ca.vertcat(x, t), seed)])

    def motion(at: ca.SX, offset: ca.SX) -> ca.SX:
        return field(at, p, _inputs(course, t + offset))

    after, _, stages = step(RK4, motion, x, h)
    return ca.Function("step", [x, t, h, p, course], [after, *sensor(x, t, p, course, ca.vertcat(stages[0], 1))])


def _inputs(course: ca.SX, t: ca.SX) -> ca.SX:
    """u of the model at a time since a slip began. course (8,): drive speed, normal force, its slope, its deviation and
    the swing of that until the end of the phase, its duration, offset and time of its start; along a course of the
    drive (10,) its acceleration and the direction of sliding as well."""
    drive_speed, force, slope, deviation, swing, duration, offset, since, *rising = ca.vertsplit(course)
    drive_speed = drive_speed + rising[0] * (offset + t) if rising else drive_speed
    force = force + slope * (offset + t) + deviation + swing * (t / duration) ** 2
    return ca.vertcat(drive_speed, force, rising[1] if rising else 1, since + offset + t)


@dataclass(frozen=True, eq=False)
class Block:
    """One kind of block, mapped over many instances.

    Slots, in order: state at the start (n_x,), state at the end (n_x,; absent in a rest without a node at its end),
    offset of the start time [s], offset of the end time [s], deviation of the normal force in this cycle from its
    measured course [N] (of a slide with load jitter two: at its onset, at its end), then the search variables (n_p,).
    Constants, in order: base values of the parameters (n_p,), row scales (n_x,), along a course of the drive its way
    from the start of the phase to that of the block, its speed then, its accelerations from then on and at the start
    of the phase, and the direction of sliding (COURSE,), drive speed, normal force at the start and at the end of the
    phase and its slope, time of its start, reference duration of it, first and last fraction of it.
    """

    kind: BlockKind
    n_slots: int
    n_rows: int
    n_cells: int
    order: int  # coefficients per cell: 2 linear, 4 cubic
    values: Mapped
    derivatives: Mapped
    expressions: tuple[ca.SX, ca.SX, ca.SX, ca.SX]  # slots, constants, rows, curve
    model: Model
    one_step: tuple[Block, Block] | None = None  # of a slide in several: a step of it, and the last one

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

    def hessian(self, slots: Array, constants: Array, on_rows: Array, on_curve: Array) -> Array:
        """Second derivatives (B, n_slots, n_slots) of on_rows . rows + on_curve . curve; weights (B, n_rows) and
        (B, n_cells * order). Built on first use: only solves that need the exact Hessian ask for it."""
        if self.one_step is not None:
            return self._hessian_by_steps(slots, constants, on_rows, on_curve)
        out, index = np.zeros((slots.shape[0], self.n_slots, self.n_slots)), np.array(self._curved)
        some = self._second([slots, constants, on_rows, on_curve])[0]
        out[:, index[:, None], index] = some.reshape(-1, index.size, index.size)
        return out

    @property
    def _curved(self) -> list[int]:
        """Slots on which rows and curve depend not only linearly: not the end of a slide."""
        end = range(len(self.model.states), 2 * len(self.model.states)) if isinstance(self.kind, SlideBlock) else ()
        return [i for i in range(self.n_slots) if i not in end]

    @cached_property
    def _second(self) -> Mapped:
        slots, constants, rows, curve = self.expressions
        on_rows, on_curve = ca.SX.sym("on_rows", self.n_rows), ca.SX.sym("on_curve", curve.numel())
        weighted = ca.dot(on_rows, rows) + ca.dot(on_curve, curve)
        second, _ = ca.hessian(weighted, ca.vertcat(*(slots[i] for i in self._curved)))
        return Mapped(ca.Function("block_second", [slots, constants, on_rows, on_curve], [ca.densify(second)]))

    def _hessian_by_steps(self, slots: Array, constants: Array, on_rows: Array, on_curve: Array) -> Array:
        """As `hessian`, from the second derivatives of single steps: sensitivities of the states forwards, adjoints
        backwards (Griewank and Walther, Evaluating Derivatives, 2008, ch. 3). The code of a step is a tenth of that of
        the steps written out, so that it is compiled in a second, and is the same for any number of them."""
        assert self.one_step is not None and isinstance(self.kind, SlideBlock)
        (inner, last), steps, n_x = self.one_step, self.kind.steps, len(self.model.states)
        clamped, n_p = _clamped(self.model, self.kind.renewed), len(self.model.parameters)
        count, moving = slots.shape[0], np.array([i for i in range(n_x) if i not in clamped])
        end, scale = slice(n_x, 2 * n_x), slice(n_p, n_p + n_x)
        at, of = (np.repeat(each[None], steps, axis=0) for each in (slots, constants))
        shares = np.arange(steps + 1)[:, None] / steps
        fractions = constants[:, -2] + (constants[:, -1] - constants[:, -2]) * shares
        of[..., -2], of[..., -1] = fractions[:-1], fractions[1:]
        at[:-1, :, end], of[:-1, :, scale] = 0.0, 1.0  # the rows of a step are then minus the state after it
        states = np.zeros((steps, count, n_x, self.n_slots))  # their derivatives with respect to the slots
        states[0] = np.eye(n_x, self.n_slots)
        by_rows, by_curve = list[Array](), list[Array]()
        for j in range(steps):
            one = inner if j < steps - 1 else last
            rows, _, d_rows, d_curve = one.evaluate(at[j], of[j], derivatives=True)
            by_rows.append(d_rows[:, :, :n_x])
            by_curve.append(d_curve[:, 0, :, :n_x])
            if j < steps - 1:
                at[j + 1][:, moving] = -rows
                d_rows[:, :, end] = 0.0
                moved = np.matmul(d_rows[:, :, :n_x], states[j])
                moved[:, :, n_x:] += d_rows[:, :, n_x:]
                states[j + 1][:, moving] = -moved
        pulls = on_curve.reshape(count, steps, self.order)
        on_steps = np.zeros((steps - 1, count, moving.size))
        weights = on_rows
        for j in range(steps - 1, 0, -1):
            pull = np.einsum("br,bri->bi", weights, by_rows[j]) + np.einsum("bc,bci->bi", pulls[:, j], by_curve[j])
            weights = on_steps[j - 1] = -pull[:, moving]
        at_inner, of_inner = (each[:-1].reshape(-1, each.shape[-1]) for each in (at, of))
        on_inner = pulls[:, :-1].transpose(1, 0, 2).reshape(-1, self.order)
        second = inner.hessian(at_inner, of_inner, on_steps.reshape(-1, moving.size), on_inner)
        final = last.hessian(at[-1], of[-1], on_rows, pulls[:, -1])
        second = np.concatenate([second.reshape(steps - 1, *final.shape), final[None]])
        by_state = np.matmul(second[..., :n_x], states)  # (steps, B, n_slots, n_slots)
        by_state[..., :n_x, n_x:] += second[..., :n_x, n_x:]
        out = np.matmul(states.swapaxes(-1, -2), by_state[..., :n_x, :]).sum(axis=0)
        out[:, n_x:] += by_state[..., n_x:, :].sum(axis=0)
        out[:, n_x:, n_x:] += second[..., n_x:, n_x:].sum(axis=0)
        return np.asarray(out)


@lru_cache(maxsize=64)
def block(model: Model, kind: BlockKind) -> Block:
    """The block functions of one kind."""
    s, rows, cells = kind.equations(model)
    slots, curve, name = s.slots(kind), ca.vec(cells), type(kind).__name__.removesuffix("Block").lower()
    values = ca.Function(f"{name}_values", [slots, s.constants], [rows, curve])
    # Together they take a fifth less than the two one by one.
    jacobian = ca.densify(ca.jacobian(ca.vertcat(rows, curve), slots))
    derivatives = ca.Function(f"{name}_derivatives", [slots, s.constants], [rows, curve, jacobian])
    one_step = None
    if isinstance(kind, SlideBlock) and kind.steps > 1:
        one_step = block(model, replace(kind, steps=1, released=False)), block(model, replace(kind, steps=1))
    sizes = slots.numel(), rows.numel(), cells.shape[1], cells.shape[0]
    expressions = slots, s.constants, rows, curve
    return Block(kind, *sizes, Mapped(values), Mapped(derivatives), expressions, model, one_step)
