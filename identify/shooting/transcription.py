"""From motions to the layout of the problem: along every log, stick by stick and slip by slip."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION, SPEED
from identify.shooting.blocks import BlockKind
from identify.shooting.grid import Grid
from identify.shooting.layout import KNOWN, Indices, Layout, NlpBuilder, Places
from identify.shooting.parts import after_reageing, cut, parts_of_rest
from identify.shooting.shooting_trajectory import ShootingTrajectory, Stretch
from identify.simulation.sliding import rate_slopes

Array = NDArray[np.float64]
NO_OFFSET = np.array([KNOWN])
ZERO = np.zeros(1)
BOUNDED_START, BOUNDED_START_SD = 0.5, 0.5  # of a state with bounds, such as a saturation, where a record begins


class _LogTranscriber:
    """Walks along one log, stick by stick and slip by slip, and notes its blocks and where its events, loads and nodes
    stand among the unknowns.

    It stands at a node: with its values, the offset of its time, since when, the normal force, and whether the contact
    re-aged there. Every block that is put ends in the next node.
    """

    def __init__(
        self, builder: NlpBuilder, number: int, log: LogData, trajectory: ShootingTrajectory, grid: Grid
    ) -> None:
        self.c, self.number, self.log, self.trajectory, self.grid = builder, number, log, trajectory, grid
        model = builder.model
        self.n_x = len(model.states)
        p = builder.unknowns.values(trajectory.theta(builder.unknowns.start), log.base)
        k, m = (p[model.parameter_names.index(n)] for n in ("stiffness", "mass"))
        force = 0.1 * log.mean_normal_force
        by_unit = {"m": force / k, "m/s": force / np.sqrt(k * m), "N": force}
        self.size = np.array([by_unit.get(s.unit, 1.0) for s in model.states])
        # of what makes a rest no straight line
        self.rates, self.frequencies = (np.array(f(p)).ravel() for f in (model.decays, model.waves))
        self.rest_rows = self.size.copy()
        self.rest_rows[SPEED] = force  # the onset guard is a force
        self.tick = 0.1 * float(np.sqrt(m / k))
        self.held = () if model.clamped is None else (model.clamped,)
        self.own = np.full(len(model.parameters), KNOWN)
        self.strength_at = model.parameter_names.index("mu_s")
        self.node, self.value, self.offset = np.full(self.n_x, KNOWN), trajectory.start, NO_OFFSET
        self.load, self.load_value = NO_OFFSET, ZERO
        self.since, self.reaged = log.begin, False
        parts = trajectory.loaded_at.size
        self.loads = np.full(parts, KNOWN)
        self.loads_in_slips: list[int] = []
        self.strengths = np.full(parts if log.strength_sd > 0.0 else 0, KNOWN)
        self.sliding_deviation = trajectory.sliding_deviation

    def walk(self) -> Places:
        """Note everything of this log."""
        self._own()
        self.shared = self.own  # where sticks have a strength of their own, `own` is that of the stick
        start, trajectory = self._begin(), self.trajectory
        until, nodes = np.full(trajectory.until.shape, KNOWN), np.full(trajectory.nodes.shape, KNOWN)
        slips, swings = trajectory.slip_parts, trajectory.own_slips if self.log.tremor_sd > 0.0 else []
        ends = [*trajectory.until.tolist(), self.log.end]
        for i, (part, stretch) in enumerate(zip(trajectory.part, trajectory.stretches, strict=True)):
            mine = slice(*trajectory.first[i : i + 2].tolist())
            if i == 0 or part != trajectory.part[i - 1]:
                self._load(part, self.log.expected[0] if part in slips else 0.0)
            if stretch.steady:
                nodes[mine] = self._steady(part, stretch)
                continue
            if stretch.ended_by != "time":
                until[i] = self.c.event(self.tick, stretch.until - self.since, ends[i + 1] - stretch.until)
            if stretch.kind == "rest":
                nodes[mine] = self._rest_until(part, stretch.until, int(until[i]), stretch.nodes[-1])
                self.reaged = False
            else:
                nodes[mine] = self._sliding(part, stretch, int(until[i]), trembling=i in swings)
            self.since = stretch.until
        if trajectory.rests_at_end and self.since < self.log.end:
            self._last_rest(trajectory.parts)
        loads_in_slips = np.array(self.loads_in_slips, dtype=np.int64)
        return Places(start, until, nodes, self.loads, self.shared, loads_in_slips, self.strengths)

    def _begin(self) -> Indices:
        """The state the record starts from: elongation free, the other states with a weak prior."""
        start = np.full(self.n_x, KNOWN)
        first = next(iter(self.trajectory.stretches), None)
        begins_steady = first is not None and first.steady
        if not begins_steady:
            start[[0]] = self.c.add(self.trajectory.start[[0]], self.size[[0]])
        if first is not None and first.kind in ("slip", "worn"):
            start[[SPEED]] = self.c.add(self.trajectory.start[[SPEED]], self.size[[SPEED]])
        known = self.held if first is not None and first.kind == "worn" else ()
        extra = [] if begins_steady else [i for i in range(2, self.n_x) if i not in known]
        if extra:
            bounded = np.array([self.c.model.states[i].lower is not None for i in extra])
            mean = np.where(bounded, BOUNDED_START, self.trajectory.start[extra])
            sd = np.where(bounded, BOUNDED_START_SD, self.size[extra])
            start[extra] = self.c.add(self.trajectory.start[extra], self.size[extra], mean=mean, sd=sd)
        self.node, self.value, self.offset = start, self.trajectory.start, NO_OFFSET
        return start

    def _load(self, cycle: int, expected: float) -> None:
        """The normal force of this cycle: known to within the error of its measurement, or exactly.

        A slow log tells its periods to a millisecond, which is a millionth of the load: no measured load is
        that good, and a fit that took it as exact would answer with wrong friction.
        """
        sd, mean = self.log.onset_load_sd_at(self.trajectory.loaded_at[[cycle]]), np.array([expected])
        if sd[0] > 0.0:
            self.loads[cycle] = self.c.add(self.trajectory.deviation[[cycle]], sd, mean=mean, sd=sd)[0]
        self.load = np.array([self.loads[cycle]])
        self.load_value = self.trajectory.deviation[[cycle]] if sd[0] > 0.0 else ZERO
        if self.strengths.size:
            self._strength(cycle)

    def _strength(self, part: int) -> None:
        """The static friction of this stick, and of the slip after it: about that of all, scattered."""
        at, unknowns, sd = self.strength_at, self.c.unknowns, np.array([self.log.strength_sd])
        shared = int(np.where(self.shared >= 0, self.shared, self.c.theta)[self.c.source[at]])
        mean = self.trajectory.theta(unknowns.start)[[self.c.source[at]]]
        value = self.trajectory.strength[[part]] if self.trajectory.strength.size else mean
        self.strengths[part] = self.c.add(value, sd, mean=mean if shared < 0 else ZERO, sd=sd, about=shared)[0]
        self.own = self.shared.copy()
        self.own[at] = self.strengths[part]

    def _swing(self, part: int, at: float) -> None:
        """The deviation of the normal force to which that at the onset goes over in a slip, as it is at a time [s]."""
        sd, mean = self.log.load_sd_at([at]), np.array([self.log.expected[1]])
        value = self.sliding_deviation[[part]]
        index = self.c.add(value, sd, mean=mean, sd=sd)
        self.loads_in_slips.append(int(index[0]))
        self.load, self.load_value = np.append(self.load, index), np.append(self.load_value, value)

    def _sliding(self, part: int, stretch: Stretch, index: int, *, trembling: bool) -> Indices:
        """A part of a slide in one mode, whatever ends it.

        Args:
            trembling: where the measured normal force misses fast rhythms, its deviation becomes another one on the
                way: a tremor goes through half a period while a slip lasts.
        """
        worn = stretch.kind == "worn"
        inside = self.held if worn else ()
        arrests = (SPEED,) if stretch.ended_by == "arrest" else ()
        at_end = (*self.held, *arrests) if worn or stretch.ended_by == "wear" else arrests
        kind: BlockKind = "worn" if worn else "slip"
        rows = self.size.copy()
        if stretch.ended_by == "release":
            kind = "released"
            rows[list(self.held)] = self._pace_of_bound(stretch.nodes[-1], stretch.until)
        if trembling:
            kind = "slip_trembling"
            self._swing(part, stretch.until)
        span = (self.since, stretch.until)
        local = self._line_by_line(rows, span, len(stretch.nodes))
        self.reaged = worn
        places = self._intervals(kind, part, stretch.nodes, span, index, (inside, at_end), local)
        self.load, self.load_value = self.load[-1:], self.load_value[-1:]
        return places

    def _steady(self, part: int, stretch: Stretch) -> Indices:
        """Pieces of steady sliding, each with the states at its ends; what came before has faded."""
        worn = stretch.kind == "steady_worn"
        known = (SPEED, *(self.held if worn else ()))
        pieces = stretch.nodes.reshape(-1, 2, self.n_x)
        edges = np.linspace(self.since, stretch.until, pieces.shape[0] + 1)
        places = np.full(pieces.shape, KNOWN)
        kind: BlockKind = "steady_worn" if worn else "steady"
        rows = np.maximum(np.max(np.abs(self._rates(pieces[0, 0], self.since)) * self.size, axis=1), 1e-300)
        rows[ELONGATION] = 1.0
        for i, (span, ends) in enumerate(zip(pairwise(edges.tolist()), pieces, strict=True)):
            for j in range(2):
                places[i, j] = self.c.state(ends[j], self.size, known)
            self.c.put(
                (kind, 1),
                (self.number, part),
                [places[i, 0], places[i, 1], NO_OFFSET, NO_OFFSET, self.load],
                [ends[0], ends[1], ZERO, ZERO, self.load_value],
                self._constants(rows, *span, span[1]),
                np.array([span]),
                self.own,
            )
        self.node, self.value, self.offset = places[-1, 1], pieces[-1, 1].copy(), NO_OFFSET
        self.value[SPEED] = self.log.speed_at(0.5 * (edges[-2] + edges[-1]))
        self.since, self.reaged = stretch.until, worn
        return places.reshape(stretch.nodes.shape)

    def _own(self) -> None:
        """The parameters this log has for itself or with its group; those of the first log are the shared ones."""
        u, known = self.c.unknowns, self.c.groups
        for i in np.flatnonzero(u.own).tolist():
            group = self.log.groups[i] if self.log.groups else ""
            key = (i, group or f"log {self.number}")
            if key not in known:
                known[key] = int(self.c.theta[i]) if self.number == 0 else self._own_unknown(i)
            if self.number > 0:
                self.own[i] = known[key]

    def _own_unknown(self, i: int) -> int:
        """A new unknown for parameter i."""
        u, one = self.c.unknowns, np.array([i])
        start = self.trajectory.theta(u.start)[one]
        mean, sd = (np.array([x]) for x in u.own_prior(i, float(start[0])))
        return int(self.c.add(start, u.spread[one], u.lower[one], u.upper[one], mean=mean, sd=sd)[0])

    def _constants(self, rows: Array, start: float, end: float, slope_at: float) -> Array:
        force_start, force_end = self.log.normal_force.at([start, end])
        slope = self.log.normal_force.line(slope_at)[1]
        drive = self.log.speed_at(0.5 * (start + end))
        ends = [drive, force_start, force_end, slope, start, end - start, 0.0, 1.0]
        return np.concatenate([self.log.base, rows, ends])

    def _last_rest(self, cycle: int) -> None:
        """The rest that the end of the window cuts."""
        constants = self._constants(self.rest_rows, self.since, self.log.end, self.log.end)
        parts = self._parts(self.since, self.log.end)
        self._reaging(cycle, constants, len(parts), NO_OFFSET, ZERO)
        for part in parts:
            self._rest_part(cycle, NO_OFFSET, NO_OFFSET, ZERO, constants, part)

    def _rest_until(self, cycle: int, on: float, index: int, state: Array) -> Indices:
        """A rest that ends in a node: with the onset guard at an event, without it (index KNOWN) at a given time."""
        value = state.copy()
        value[SPEED] = 0.0
        node = self.c.state(value, self.size, (SPEED,))
        constants = self._constants(self.rest_rows, self.since, on, on)
        *before, last = self._parts(self.since, on)
        self._reaging(cycle, constants, len(before) + 1, self.load, self.load_value)
        for part in before:
            self._rest_part(cycle, np.array([index]), self.load, self.load_value, constants, part)
        self.c.put(
            (_kind("hold" if index == KNOWN else "stick", self.reaged), 1),
            (self.number, cycle),
            [self.node, node, self.offset, np.array([index]), self.load],
            [self.value, value, ZERO, ZERO, self.load_value],
            *self._cut(constants, last),
            self.own,
        )
        self.node, self.value, self.offset = node, value, np.array([index])
        return node

    def _reaging(self, cycle: int, constants: Array, parts: int, load: Indices, load_value: Array) -> None:
        """A node after the contact re-aged, where more than one block would each go through that moment again."""
        if not self.reaged or parts == 1:
            return
        moment = self._cut(constants, (0.0, 0.0))[0]
        theta = self.trajectory.theta(self.c.unknowns.start)[self.c.source]
        value = after_reageing(self.c.model, self.value, theta, moment, self.rest_rows)
        node = self.c.state(value, self.size, (SPEED,))
        self.c.put(
            ("reageing", 1),
            (self.number, cycle),
            [self.node, node, self.offset, self.offset, load],
            [self.value, value, ZERO, ZERO, load_value],
            moment,
            np.full((1, 2), self.since),
            self.own,
        )
        self.node, self.value, self.reaged = node, value, False

    def _rest_part(
        self, cycle: int, end: Indices, load: Indices, load_value: Array, constants: Array, part: tuple[float, float]
    ) -> None:
        """A part of a rest without the guard that ends it."""
        self.c.put(
            (_kind("rest", self.reaged), 1),
            (self.number, cycle),
            [self.node, self.offset, end, load],
            [self.value, ZERO, ZERO, load_value],
            *self._cut(constants, part),
            self.own,
        )

    def _cut(self, constants: Array, part: tuple[float, float]) -> tuple[Array, Array]:
        return cut(constants, part, self.c.model.straight)

    def _parts(self, since: float, until: float) -> list[tuple[float, float]]:
        return [(0.0, 1.0)] if self.c.model.straight else parts_of_rest(self.rates, self.frequencies, until - since)

    def _line_by_line(self, rows: Array, span: tuple[float, float], intervals: int) -> Array:
        """The constants of the intervals of a slide, with the normal force as a straight line over each: the tremor of
        a finger goes through half a period while a slip lasts. Written as lines from the start of the slide.

        A trajectory whose events coincide has a slide of no length: its normal force is level, not undefined."""
        since = (span[1] - span[0]) * shares(intervals)
        forces = self.log.normal_force.at(span[0] + since)
        width = since[1:] - since[:-1]
        slope = np.divide(forces[1:] - forces[:-1], width, out=np.zeros(intervals), where=width > 0.0)
        local = np.tile(self._constants(rows, *span, span[0]), (intervals, 1))
        local[:, -7], local[:, -5] = forces[:-1] - slope * since[:-1], slope
        return local

    def _intervals(
        self,
        kind: BlockKind,
        cycle: int,
        nodes: Array,
        span: tuple[float, float],
        end: int,
        known: tuple[tuple[int, ...], tuple[int, ...]],
        local: Array | None = None,
    ) -> Indices:
        """The shooting intervals of one part of a slide: indices of the nodes at their ends (n, n_x).

        Args:
            known: states that are at their bounds inside, and at the end; end: index of the event that ends it, KNOWN
                at a given time; local: constants of each interval in place of those of the whole span.
        """
        intervals, steps, n_x = nodes.shape[0], self.grid.steps, self.n_x
        values, index = nodes.copy(), np.full((intervals, n_x), KNOWN)
        for row, bound in zip((slice(None, -1), slice(-1, None)), known, strict=True):
            for component in bound:
                values[row, component] = self.c.model.states[component].lower or 0.0
        unknown = _unknown(intervals, n_x, *known)
        index[unknown] = self.c.add(values[unknown], np.broadcast_to(self.size, unknown.shape)[unknown])
        d_end, fractions = np.array([end]), shares(intervals)
        slots = np.empty((intervals, 2 * n_x + 2 + self.load.size), dtype=np.int64)
        fixed = np.zeros(slots.shape)
        for table, before, nodes_at, load in (
            (slots, self.node, index, self.load),
            (fixed, self.value, values, self.load_value),
        ):
            table[0, :n_x], table[1:, :n_x], table[:, n_x : 2 * n_x] = before, nodes_at[:-1], nodes_at
            table[:, 2 * n_x + 2 :] = load
        slots[:, 2 * n_x], slots[:, 2 * n_x + 1] = self.offset[0], end
        constants = np.tile(self._constants(self.size, *span, span[0]), (intervals, 1)) if local is None else local
        constants[:, -2], constants[:, -1] = fractions[:-1], fractions[1:]
        cells = span[0] + (span[1] - span[0]) * shares(intervals * steps)
        edges = np.empty((intervals, steps, 2))
        edges[..., 0], edges[..., 1] = cells[:-1].reshape(intervals, steps), cells[1:].reshape(intervals, steps)
        last = intervals - 1 if kind == "released" else intervals  # the guard is in the last interval
        for name, part in (("worn" if kind == "released" else kind, slice(0, last)), (kind, slice(last, None))):
            if slots[part].size:
                self.c.put_all(
                    (name, steps),
                    (self.number, cycle),
                    slots[part],
                    fixed[part],
                    constants[part],
                    edges[part],
                    self.own,
                )
        self.node, self.value = index[-1], values[-1]
        self.offset = d_end
        return index

    def _rates(self, state: Array, at: float) -> Array:
        """Derivatives of the rates of all states with respect to the states (n_x, n_x) [1/s per unit]."""
        unknowns, model = self.c.unknowns, self.c.model
        p = unknowns.values(self.trajectory.theta(unknowns.start), self.log.base)
        return rate_slopes(model, state, p, np.array([self.log.speed_at(at), self.log.normal_force.at(at), 1.0, at]))

    def _pace_of_bound(self, state: Array, at: float) -> float:
        """A typical rate of the bounded state [1/s]."""
        return float(np.max(np.abs(self._rates(state, at)[list(self.held)]) * self.size))


@lru_cache(maxsize=64)
def shares(parts: int) -> Array:
    """The shares at which something is cut into so many equal parts (parts + 1,); not to be written to."""
    out = np.linspace(0.0, 1.0, parts + 1)
    out.setflags(write=False)
    return out


@lru_cache(maxsize=64)
def _unknown(intervals: int, n_x: int, inside: tuple[int, ...], at_end: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which components of the nodes (intervals, n_x) at the ends of intervals are unknown; not to be written to."""
    out = np.ones((intervals, n_x), bool)
    out[:-1, list(inside)] = False
    out[-1, list(at_end)] = False
    out.setflags(write=False)
    return out


def _kind(kind: str, reaged: bool) -> BlockKind:
    """The kind of a rest, by whether the contact re-aged in the last moment of the slide before it."""
    return f"{kind}_reaged" if reaged else kind  # type: ignore[return-value]


def transcribe(logs: list[LogData], trajectories: list[ShootingTrajectory], unknowns: Unknowns, grid: Grid) -> Layout:
    """Lay out the multiple-shooting problem of several logs around their trajectories."""
    free = np.flatnonzero(unknowns.free)
    builder = NlpBuilder(unknowns.model, unknowns, free)
    places = tuple(
        _LogTranscriber(builder, number, log, trajectory, grid).walk()
        for number, (log, trajectory) in enumerate(zip(logs, trajectories, strict=True))
    )
    families = builder.families()
    joined = [
        np.concatenate(part)
        for part in (builder.scale, builder.start, builder.lower, builder.upper, builder.mean, builder.sd)
    ]
    scale, start, lower, upper, mean, sd = joined
    return Layout(
        unknowns,
        free,
        families,
        scale,
        start,
        lower,
        upper,
        mean,
        sd,
        np.concatenate(builder.about),
        builder.rows,
        places,
    )
