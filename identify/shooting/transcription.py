"""From motions to the layout of the problem: along every log, phase by phase."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION, SPEED, Model
from identify.shooting.blocks import (
    REST_CELLS,
    AgeingBlock,
    BlockKind,
    RestBlock,
    SlideBlock,
    SteadyBlock,
    block,
)
from identify.shooting.grid import Grid
from identify.shooting.layout import KNOWN, Family, Indices, Layout, Places
from identify.shooting.shooting_trajectory import ShootingTrajectory, Stretch
from identify.simulation.sliding import linearised

Array = NDArray[np.float64]

BOUNDED_START, BOUNDED_START_SD = 0.5, 0.5  # of a state with bounds, such as a saturation, where a record begins
DECAYED = (3.0, 8.0, 18.0)  # time constants at which a rest is cut: what decays is followed until it is gone
CELLS_PER_PERIOD = 8  # of an oscillation while the mass rests
MOST_PARTS = 4000  # of one rest


@dataclass(frozen=True)
class _Slots:
    """Slots of blocks (..., k): which unknown each holds (KNOWN: a constant), and its value."""

    index: Indices
    value: Array

    @staticmethod
    def joined(*parts: _Slots) -> _Slots:
        """One after the other, for as many blocks as the longest has."""
        blocks = max((p.index.shape[0] for p in parts if p.index.ndim == 2), default=1)
        width = sum(p.index.shape[-1] for p in parts)
        out, first = _Slots(np.empty((blocks, width), np.int64), np.empty((blocks, width))), 0
        for p in parts:
            mine = slice(first, first + p.index.shape[-1])
            out.index[:, mine], out.value[:, mine] = p.index, p.value
            first = mine.stop
        return out


NONE: Mapping[str, float | int] = MappingProxyType(
    {"lower": -np.inf, "upper": np.inf, "mean": 0.0, "sd": np.inf, "about": KNOWN}
)
"""An unknown without bounds and prior."""
CONSTANT = _Slots(np.array([KNOWN]), np.zeros(1))  # an event time or a load that is known


class NlpBuilder:
    """Gathers unknowns, rows and blocks while a layout is built; thrown away afterwards."""

    def __init__(self, model: Model, unknowns: Unknowns, free: Indices) -> None:
        self.model, self.unknowns = model, unknowns
        self.theta = np.full(len(unknowns.names), KNOWN)
        self.theta[free] = np.arange(free.size)
        mean, sd, about = unknowns.prior_mean.copy(), unknowns.prior_sd.copy(), np.full(unknowns.free.size, KNOWN)
        for i in np.flatnonzero((unknowns.prior_about >= 0) & ~unknowns.own).tolist():
            j = int(unknowns.prior_about[i])
            if self.theta[i] >= 0 and self.theta[j] >= 0:
                about[i] = self.theta[j]
            elif self.theta[i] >= 0:
                mean[i] += unknowns.start[j]
            elif self.theta[j] >= 0:  # fixed, it says of the other one what its prior says of both
                weights = np.array([sd[j], sd[i]]) ** -2.0
                mean[j] = weights @ [mean[j], unknowns.start[i] - mean[i]] / weights.sum()
                sd[j] = weights.sum() ** -0.5
        self.count, self.rows = 0, 0
        self.starts, self.scales = list[Array](), list[Array]()
        self.more: list[tuple[Indices, str, float | NDArray[Any]]] = []  # what differs from `NONE`
        bounds = {"lower": unknowns.lower[free], "upper": unknowns.upper[free]}
        self.add(unknowns.start[free], unknowns.spread[free], **bounds, mean=mean[free], sd=sd[free], about=about[free])
        self.source = unknowns.source
        self.groups: dict[tuple[int, str], int] = {}  # of logs: which unknown each shares
        self.parts: dict[BlockKind, list[Family]] = {}

    def add(self, start: Array, scale: Array, **more: float | NDArray[Any]) -> Indices:
        """New unknowns; more: bounds lower, upper; mean, sd of a prior, and about: the unknown that is added to the
        mean. Returns their indices."""
        self.starts.append(start)
        self.scales.append(scale)
        index = np.arange(self.count, self.count + start.size)
        self.more += [(index, name, value) for name, value in more.items()]
        self.count += start.size
        return index

    def columns(self) -> dict[str, NDArray[Any]]:
        """start, scale, lower, upper, mean, sd, about of all unknowns so far, each (n,)."""
        out = {name: np.full(self.count, value) for name, value in NONE.items()}
        for index, name, value in self.more:
            out[name][index] = value
        return {"start": np.concatenate(self.starts), "scale": np.concatenate(self.scales), **out}

    def state(self, value: Array, scale: Array, known: tuple[int, ...]) -> Indices:
        """Unknowns for one node state; the components in `known` stay constants."""
        index = np.full(value.size, KNOWN)
        free = [i for i in range(value.size) if i not in known]
        index[free] = self.add(value[free], scale[free])
        return index

    def put(
        self, kind: BlockKind, at: tuple[int, int], slots: _Slots, constants: Array, edges: Array, own: Indices
    ) -> None:
        """Blocks of one kind in a part of a log (`at`): their slots are the given ones and the parameters, of which
        this log has some for itself."""
        of, n = block(self.model, kind), slots.index.shape[0]
        theta = np.where(own >= 0, own, self.theta)[self.source]
        index = np.concatenate([slots.index, np.broadcast_to(theta, (n, theta.size))], axis=1)
        start = np.broadcast_to(self.unknowns.start[self.source], (n, theta.size))
        value = np.concatenate([slots.value, start], axis=1)
        rows = self.rows + np.arange(n * of.n_rows).reshape(n, of.n_rows)
        self.rows += n * of.n_rows
        log, part = np.full(n, at[0]), np.full(n, at[1])
        family = Family(of, index, value, constants.reshape(n, -1), rows, log, part, edges.reshape(n, -1, 2))
        self.parts.setdefault(kind, []).append(family)

    def families(self) -> tuple[Family, ...]:
        """All blocks so far, one family per kind."""
        names = [f.name for f in fields(Family) if f.name != "block"]
        return tuple(
            Family(parts[0].block, *(np.concatenate([getattr(part, name) for part in parts]) for name in names))
            for parts in self.parts.values()
        )


class _LogTranscriber:
    """Walks along one log, phase by phase, and notes its blocks and where its events, loads and nodes stand among the
    unknowns.

    It stands at a node: with its state, the offset of its time, since when, the normal force, and whether the contact
    slid worn before. Every block that is put ends in the next node.
    """

    def __init__(
        self, builder: NlpBuilder, number: int, log: LogData, trajectory: ShootingTrajectory, grid: Grid
    ) -> None:
        self.c, self.number, self.log, self.trajectory, self.grid = builder, number, log, trajectory, grid
        model = self.model = builder.model
        self.n_x = len(model.states)
        self.start_theta = trajectory.theta(builder.unknowns.start)
        self.p = builder.unknowns.values(self.start_theta, log.base)
        k, m = (self.p[model.parameter_names.index(n)] for n in ("stiffness", "mass"))
        force = 0.1 * log.mean_normal_force
        by_unit = {"m": force / k, "m/s": force / np.sqrt(k * m), "N": force}
        self.size = np.array([by_unit.get(s.unit, 1.0) for s in model.states])
        self.rest_rows = self.size.copy()
        self.rest_rows[SPEED] = force  # the onset guard is a force
        self.tick = 0.1 * float(np.sqrt(m / k))
        self.clamped = () if model.clamped is None else (model.clamped,)
        self.node, self.offset, self.load = _Slots(np.full(self.n_x, KNOWN), trajectory.start), CONSTANT, CONSTANT
        self.since, self.worn = log.begin, False
        parts = trajectory.loaded_at.size
        self.loads = np.full(parts, KNOWN)
        self.loads_in_slips: list[int] = []
        self.strengths = np.full(parts if log.strength_sd > 0.0 else 0, KNOWN)

    def walk(self) -> Places:
        """Note everything of this log."""
        # Where sticks have a strength of their own, `own` is that of the stick.
        self.own = self.shared = self._own()
        start, trajectory = self._begin(), self.trajectory
        until, nodes = np.full(trajectory.until.shape, KNOWN), np.full(trajectory.nodes.shape, KNOWN)
        slips, with_jitter = trajectory.slip_parts, trajectory.own_slips if self.log.tremor_sd > 0.0 else []
        ends = [*trajectory.until.tolist(), self.log.end]
        for i, (part, stretch) in enumerate(zip(trajectory.part, trajectory.stretches, strict=True)):
            mine = slice(*trajectory.first[i : i + 2].tolist())
            if i == 0 or part != trajectory.part[i - 1]:
                self._load(part, self.log.expected[0] if part in slips else 0.0)
            if stretch.steady:
                nodes[mine] = self._steady(part, stretch)
                continue
            end = CONSTANT
            if stretch.ended_by != "time":
                left, right = stretch.until - self.since, ends[i + 1] - stretch.until
                index = self.c.add(np.zeros(1), np.array([self.tick]), lower=-0.45 * left, upper=0.45 * right)
                end, until[i] = _Slots(index, np.zeros(1)), index[0]
            if stretch.kind == "rest":
                nodes[mine] = self._rest(part, stretch, end)
            else:
                nodes[mine] = self._slide(part, stretch, end, jitter=i in with_jitter)
            self.since, self.offset = stretch.until, end
        if trajectory.rests_at_end and self.since < self.log.end:
            self.load = CONSTANT
            self._rest(trajectory.parts, None, CONSTANT)
        loads_in_slips = np.array(self.loads_in_slips, dtype=np.int64)
        return Places(start, until, nodes, self.loads, self.shared, loads_in_slips, self.strengths)

    def _own(self) -> Indices:
        """The parameters (n_p,) this log has for itself or with its group, KNOWN for the others; those of the first log
        are the shared ones."""
        u, known, own = self.c.unknowns, self.c.groups, np.full(len(self.model.parameters), KNOWN)
        for i in np.flatnonzero(u.own).tolist():
            key = (i, (self.log.groups[i] if self.log.groups else "") or f"log {self.number}")
            if key not in known:
                one, start = [i], self.start_theta[[i]]
                mean, sd = u.own_prior(i, float(start[0]))
                more = {"lower": u.lower[i], "upper": u.upper[i], "mean": mean, "sd": sd}
                new = self.number > 0
                known[key] = int(self.c.add(start, u.spread[one], **more)[0] if new else self.c.theta[i])
            if self.number > 0:
                own[i] = known[key]
        return own

    def _begin(self) -> Indices:
        """The state the record starts from: elongation free, the other states with a weak prior."""
        start, value = self.node.index, self.trajectory.start
        first = next(iter(self.trajectory.stretches), None)
        kind = "rest" if first is None else first.kind
        if first is not None and first.steady:
            return start
        start[[0]] = self.c.add(value[[0]], self.size[[0]])
        if kind != "rest":
            start[[SPEED]] = self.c.add(value[[SPEED]], self.size[[SPEED]])
        extra = [i for i in range(2, self.n_x) if not (kind == "worn" and i in self.clamped)]
        if extra:
            bounded = np.array([self.model.states[i].lower is not None for i in extra])
            mean = np.where(bounded, BOUNDED_START, value[extra])
            sd = np.where(bounded, BOUNDED_START_SD, self.size[extra])
            start[extra] = self.c.add(value[extra], self.size[extra], mean=mean, sd=sd)
        return start

    def _load(self, part: int, expected: float) -> None:
        """The normal force of this part: known to within the error of its measurement, or exactly.

        Of a slow log the periods are known to a millisecond, which is a millionth of the load: no measured load is
        that good, and a fit that took it as exact would answer with wrong friction.
        """
        sd = float(self.log.onset_load_sd_at(self.trajectory.loaded_at[[part]])[0])
        self.load = CONSTANT
        if sd > 0.0:
            value = self.trajectory.deviation[[part]]
            self.load = _Slots(self.c.add(value, np.array([sd]), mean=expected, sd=sd), value)
            self.loads[part] = self.load.index[0]
        if self.strengths.size:
            self._strength(part)

    def _strength(self, part: int) -> None:
        """The static friction of this stick, and of the slip after it: about that of all, scattered."""
        at, sd = self.model.parameter_names.index("mu_s"), self.log.strength_sd
        source = self.c.source[at]
        shared = int(np.where(self.shared >= 0, self.shared, self.c.theta)[source])
        mean = self.start_theta[[source]]
        value = self.trajectory.strength[[part]] if self.trajectory.strength.size else mean
        own = self.c.add(value, np.array([sd]), mean=mean if shared < 0 else 0.0, sd=sd, about=shared)
        self.strengths[part] = own[0]
        self.own = self.shared.copy()
        self.own[at] = own[0]

    def _constants(self, rows: Array, start: float, end: float, slope_at: float) -> Array:
        force_start, force_end = self.log.normal_force.at([start, end])
        slope = self.log.normal_force.line(slope_at)[1]
        drive = self.log.speed_at(0.5 * (start + end))
        ends = [drive, force_start, force_end, slope, start, end - start, 0.0, 1.0]
        return np.concatenate([self.log.base, rows, ends])

    def _put(self, kind: BlockKind, part: int, slots: _Slots, constants: Array, edges: Array) -> None:
        self.c.put(kind, (self.number, part), slots, constants, edges, self.own)

    def _rest(self, part: int, stretch: Stretch | None, end: _Slots) -> Indices:
        """A rest that ends in a node, at an event or at a given time; or (None) the last one, which the end of the
        window cuts. Indices of the node (n_x,)."""
        until = self.log.end if stretch is None else stretch.until
        constants = self._constants(self.rest_rows, self.since, until, until)
        if self.worn:
            self._age(part, constants)
        *before, last = [(0.0, 1.0)] if self.model.straight else parts_of_rest(self.model, self.p, until - self.since)
        for fractions in before:
            slots = _Slots.joined(self.node, self.offset, end, self.load)
            self._put(RestBlock(), part, slots, *self._cut(constants, fractions))
        if stretch is None:
            slots = _Slots.joined(self.node, self.offset, end, self.load)
            self._put(RestBlock(), part, slots, *self._cut(constants, last))
            return self.node.index
        value = stretch.nodes[-1].copy()
        value[SPEED] = 0.0
        node = _Slots(self.c.state(value, self.size, (SPEED,)), value)
        kind = RestBlock("time" if stretch.ended_by == "time" else "onset")
        self._put(kind, part, _Slots.joined(self.node, node, self.offset, end, self.load), *self._cut(constants, last))
        self.node, self.worn = node, False
        return node.index

    def _age(self, part: int, rest: Array) -> None:
        """A node where the contact has aged before the mass rests. rest: the constants of the rest that follows."""
        theta = self.start_theta[self.c.source]
        slots = np.concatenate([self.node.value, np.zeros(self.n_x + 3), theta])
        defect = block(self.model, AgeingBlock()).evaluate(slots[None], rest[None], derivatives=False)[0][0]
        value, others = self.node.value.copy(), [i for i in range(self.n_x) if i != SPEED]
        value[SPEED] = 0.0
        value[others] = np.where(np.isfinite(defect), -defect * self.rest_rows[others], value[others])
        node = _Slots(self.c.state(value, self.size, (SPEED,)), value)
        slots_ = _Slots.joined(self.node, node, self.offset, self.offset, self.load)
        self._put(AgeingBlock(), part, slots_, rest, np.full((1, 2), self.since))
        self.node, self.worn = node, False

    def _cut(self, constants: Array, fractions: tuple[float, float]) -> tuple[Array, Array]:
        """The constants of a rest for one part of it, and the windows of its cells (cells, 2) [s]."""
        own = constants.copy()
        own[-2:] = fractions
        since, duration = constants[-4], constants[-3]
        edges = since + duration * np.linspace(*fractions, (1 if self.model.straight else REST_CELLS) + 1)
        return own, np.stack([edges[:-1], edges[1:]], axis=1)

    def _slide(self, part: int, stretch: Stretch, end: _Slots, *, jitter: bool) -> Indices:
        """A part of a slide in one mode, whatever ends it: indices of the nodes at the ends of its intervals (n, n_x).

        Args:
            jitter: where the measured normal force misses fast rhythms, its deviation becomes another one on the way: a
                tremor goes through half a period while a slip lasts.
        """
        worn, released = stretch.kind == "worn", stretch.ended_by == "release"
        inside = self.clamped if worn else ()
        at_end = (SPEED,) if stretch.ended_by == "arrest" else ()
        if worn or stretch.ended_by == "wear":
            at_end = (*self.clamped, *at_end)
        load = self.load
        if jitter:
            sd, value = self.log.load_sd_at([stretch.until]), self.trajectory.sliding_deviation[[part]]
            index = self.c.add(value, sd, mean=self.log.expected[1], sd=sd)
            self.loads_in_slips.append(int(index[0]))
            load = _Slots(np.append(load.index, index), np.append(load.value, value))
        nodes, values = self._nodes(stretch.nodes, inside, at_end)
        slots = _Slots.joined(
            _Slots(np.vstack([self.node.index, nodes[:-1]]), np.vstack([self.node.value, values[:-1]])),
            _Slots(nodes, values),
            self.offset,
            end,
            load,
        )
        intervals, steps = nodes.shape[0], self.grid.steps
        constants = self._line_by_line(stretch, intervals)
        cells = self.since + (stretch.until - self.since) * shares(intervals * steps)
        edges = np.stack([cells[:-1], cells[1:]], axis=1).reshape(intervals, steps, 2)
        kind = SlideBlock(steps, worn, jitter=jitter)
        last = intervals - 1 if released else intervals  # the guard is in the last interval
        for of, some in ((kind, slice(0, last)), (SlideBlock(steps, worn, released=True), slice(last, None))):
            if slots.index[some].size:
                self._put(of, part, _Slots(slots.index[some], slots.value[some]), constants[some], edges[some])
        self.node, self.load = _Slots(nodes[-1], values[-1]), _Slots(load.index[-1:], load.value[-1:])
        self.worn = worn
        return nodes

    def _nodes(self, states: Array, inside: tuple[int, ...], at_end: tuple[int, ...]) -> tuple[Indices, Array]:
        """Unknowns and values (n, n_x) of the nodes of a slide.

        Args:
            inside, at_end: states that are known there, at their bounds or at rest.
        """
        values, index = states.copy(), np.full(states.shape, KNOWN)
        for row, known in ((slice(None, -1), inside), (slice(-1, None), at_end)):
            for component in known:
                values[row, component] = self.model.states[component].lower or 0.0
        unknown = _unknown(*states.shape, inside, at_end)
        index[unknown] = self.c.add(values[unknown], np.tile(self.size, (states.shape[0], 1))[unknown])
        return index, values

    def _line_by_line(self, stretch: Stretch, intervals: int) -> Array:
        """The constants of the intervals of a slide, with the normal force as a straight line over each: the tremor of
        a finger goes through half a period while a slip lasts. Written as lines from the start of the slide.

        A trajectory whose events coincide has a slide of no length: its normal force is level, not undefined."""
        rows, fractions = self.size.copy(), shares(intervals)
        if stretch.ended_by == "release":
            rates = self._rates(stretch.nodes[-1], stretch.until)[list(self.clamped)]
            rows[list(self.clamped)] = np.max(np.abs(rates) * self.size)  # a typical rate of the bounded state
        since = (stretch.until - self.since) * fractions
        forces = self.log.normal_force.at(self.since + since)
        width = since[1:] - since[:-1]
        slope = np.divide(forces[1:] - forces[:-1], width, out=np.zeros(intervals), where=width > 0.0)
        local = np.tile(self._constants(rows, self.since, stretch.until, self.since), (intervals, 1))
        local[:, -7], local[:, -5] = forces[:-1] - slope * since[:-1], slope
        local[:, -2], local[:, -1] = fractions[:-1], fractions[1:]
        return local

    def _steady(self, part: int, stretch: Stretch) -> Indices:
        """Pieces of steady sliding, each with the states at its ends; what came before has faded."""
        worn = stretch.kind == "steady_worn"
        known = (SPEED, *(self.clamped if worn else ()))
        pieces = stretch.nodes.reshape(-1, 2, self.n_x)
        edges = np.linspace(self.since, stretch.until, pieces.shape[0] + 1)
        places = np.full(pieces.shape, KNOWN)
        rows = np.maximum(np.max(np.abs(self._rates(pieces[0, 0], self.since)) * self.size, axis=1), 1e-300)
        rows[ELONGATION] = 1.0
        for i, (span, ends) in enumerate(zip(pairwise(edges.tolist()), pieces, strict=True)):
            for j in range(2):
                places[i, j] = self.c.state(ends[j], self.size, known)
            at_ends = (_Slots(places[i, j], ends[j]) for j in range(2))
            slots = _Slots.joined(*at_ends, CONSTANT, CONSTANT, self.load)
            self._put(SteadyBlock(worn), part, slots, self._constants(rows, *span, span[1]), np.array([span]))
        value = pieces[-1, 1].copy()
        value[SPEED] = self.log.speed_at(0.5 * (edges[-2] + edges[-1]))
        self.node, self.offset = _Slots(places[-1, 1], value), CONSTANT
        self.since, self.worn = stretch.until, worn
        return places.reshape(stretch.nodes.shape)

    def _rates(self, state: Array, at: float) -> Array:
        """Derivatives of the rates of all states with respect to the states (n_x, n_x) [1/s per unit]."""
        u = np.array([self.log.speed_at(at), self.log.normal_force.at(at), 1.0, at])
        return linearised(self.model, False, state[None], self.p[None], u[None])[1][0]


def parts_of_rest(model: Model, p: Array, duration: float) -> list[tuple[float, float]]:
    """Fractions of a rest [s] that one block each can follow: fine where something decays, and where it oscillates."""
    if duration <= 0.0:
        return [(0.0, 1.0)]
    rates, frequencies = (np.array(f(p)).ravel() for f in (model.decays, model.waves))
    ends = [c / r for r in rates for c in DECAYED if c / r < duration]
    edges = np.unique([0.0, *ends, duration])
    longest = min((REST_CELLS * 2 * np.pi / (CELLS_PER_PERIOD * w) for w in frequencies), default=np.inf)
    cuts = [
        np.linspace(a, b, 1 + min(max(int(np.ceil((b - a) / longest)), 1), MOST_PARTS))[:-1] for a, b in pairwise(edges)
    ]
    inner = np.append(np.concatenate(cuts), duration) / duration
    return list(zip(inner[:-1].tolist(), inner[1:].tolist(), strict=True))


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


def transcribe(logs: list[LogData], trajectories: list[ShootingTrajectory], unknowns: Unknowns, grid: Grid) -> Layout:
    """Lay out the multiple-shooting problem of several logs around their trajectories."""
    free = np.flatnonzero(unknowns.free)
    builder = NlpBuilder(unknowns.model, unknowns, free)
    places = tuple(
        _LogTranscriber(builder, number, log, trajectory, grid).walk()
        for number, (log, trajectory) in enumerate(zip(logs, trajectories, strict=True))
    )
    columns = builder.columns()
    return Layout(
        unknowns=unknowns,
        trajectories=tuple(trajectories),
        grid=grid,
        free=free,
        families=builder.families(),
        scale=columns["scale"],
        start=columns["start"],
        lower=columns["lower"],
        upper=columns["upper"],
        prior_mean=columns["mean"],
        prior_sd=columns["sd"],
        prior_about=columns["about"],
        rows=builder.rows,
        places=places,
    )
