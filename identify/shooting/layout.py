"""From motions to the layout of the problem: where every unknown stands in the vector the solver sees, and which block
takes which of them, along every log, phase by phase.

Known values (speed at onset and arrest, a clamped state) are constants, never variables with equal bounds: otherwise
rows become redundant and the multipliers never converge. A slot of a block holds an unknown or a constant: two numbers,
its index among the unknowns (KNOWN: a constant) and its value; slots are arrays (2, ..., k) of such pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION, SPEED, Model
from identify.shooting.blocks import (
    REST_CELLS,
    AgeingBlock,
    Block,
    BlockKind,
    RestBlock,
    SlideBlock,
    SteadyBlock,
    block,
)
from identify.shooting.shooting_trajectory import ShootingTrajectory, Stretch
from identify.simulation.sliding import linearised

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

KNOWN = -1  # index of a slot that holds a constant


@dataclass(frozen=True)
class Grid:
    """Shooting intervals and RK4 steps per interval in the two parts of a slip: while the bounded state
    falls (`slip`), and once it is at its bound (`worn`)."""

    slip: int
    worn: int
    steps: int


COARSE_GRID = Grid(slip=8, worn=8, steps=2)


@dataclass(frozen=True)
class Family:
    """All blocks of one kind: slots and constants per block, where their rows and cells stand.

    slots (B, n_slots) indices of unknowns or KNOWN; fixed (B, n_slots) the values of the known ones;
    constants (B, n_constants); rows (B, n_rows) row numbers; log, cycle (B,); edges (B, n_cells, 2) the
    reference time window of each cell [s].
    """

    block: Block
    slots: Indices
    fixed: Array
    constants: Array
    rows: Indices
    log: Indices
    cycle: Indices
    edges: Array

    def slot_values(self, x: Array) -> Array:
        """What the slots hold at the unknowns x (n,), in physical units (B, n_slots)."""
        return np.where(self.slots >= 0, x[self.slots], self.fixed)


@dataclass(frozen=True)
class Places:
    """Where the trajectory of one log stands among the unknowns: indices in the shapes of `ShootingTrajectory`, KNOWN
    for constants; of `until` the indices of their offsets."""

    start: Indices
    until: Indices
    nodes: Indices
    deviation: Indices
    own: Indices
    slip_deviation: Indices
    strength: Indices

    @property
    def events(self) -> Indices:
        """All offsets of event times."""
        return self.until[self.until >= 0]

    def read(self, trajectory: ShootingTrajectory, x: Array) -> ShootingTrajectory:
        """The trajectory moved to the unknowns x (n,), in physical units."""

        names = ("start", "nodes", "deviation", "own")
        pairs = [(getattr(self, name), getattr(trajectory, name)) for name in names]
        start, nodes, deviation, own = (np.where(i >= 0, x[i], old) if old.size else old for i, old in pairs)
        until = trajectory.until + np.where(self.until >= 0, x[self.until], 0.0)
        moved = replace(trajectory, start=start, until=until, nodes=nodes, deviation=deviation, own=own)
        return replace(moved, slip_deviation=x[self.slip_deviation], strength=x[self.strength])


@dataclass(frozen=True)
class Layout:
    """The whole problem: families of blocks over one vector of n unknowns and m rows.

    trajectories, grid: what it was transcribed from; free (f,) indices of the parameters that are unknown: they are the
    first f unknowns; scale (n,) size of each unknown; start, lower, upper (n,) in physical units; prior_mean, prior_sd
    (n,); prior_about (n,): the unknown about which a prior is, beyond its mean, KNOWN where none is; places: per log.
    """

    unknowns: Unknowns
    trajectories: tuple[ShootingTrajectory, ...]
    grid: Grid
    free: Indices
    families: tuple[Family, ...]
    scale: Array
    start: Array
    lower: Array
    upper: Array
    prior_mean: Array
    prior_sd: Array
    prior_about: Indices
    rows: int
    places: tuple[Places, ...]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.scale.size

    def at(self, x: Array) -> tuple[Array, list[ShootingTrajectory]]:
        """Theta (n_p,) and the motions of all logs, moved to the unknowns x (n,), in physical units."""
        theta = self.unknowns.start.copy()
        theta[self.free] = x[: self.free.size]
        return theta, [place.read(one, x) for place, one in zip(self.places, self.trajectories, strict=True)]

    @cached_property
    def varied(self) -> Indices:
        """Unknowns (v,) whose prior is about another unknown."""
        return np.flatnonzero(self.prior_about >= 0)

    def off_prior(self, x: Array) -> Array:
        """By how many standard deviations the unknowns x (n,) are off their priors (n,)."""
        return (self.beside(x) - self.prior_mean) / self.prior_sd

    def beside(self, x: Array) -> Array:
        """Unknowns x (n, ...), those whose prior is about another one less that one."""
        out = x.copy()
        out[self.varied] -= x[self.prior_about[self.varied]]
        return out

    def prior_gradient(self, off: Array) -> Array:
        """Gradient (n,) of half the squares of what `off_prior` gives."""
        out = off / self.prior_sd
        np.subtract.at(out, self.prior_about[self.varied], out[self.varied])
        return out

    @property
    def prior_hessian(self) -> tuple[Array, Array]:
        """Hessian of the same: its diagonal (n,), and the entries (v,) that join `varied` with what they are about."""
        diagonal = 1.0 / self.prior_sd**2
        joins = -diagonal[self.varied]
        np.subtract.at(diagonal, self.prior_about[self.varied], joins)
        return diagonal, joins


def kept_parameters(layout: Layout) -> Indices:
    """Indices of all parameters among the unknowns: the shared ones, then those that single logs have."""
    own = np.unique(np.concatenate([place.own for place in layout.places])) if layout.places else np.array([], int)
    return np.concatenate([np.arange(layout.free.size), own[own >= layout.free.size]]).astype(np.int64)


# ----------------------------------------------------------------------------------------------------------------------
# From motions to a layout.
# ----------------------------------------------------------------------------------------------------------------------

BOUNDED_START_SD = 0.5  # of a state with bounds, such as a saturation, where a record begins: about half way
CONSTANT = np.array([[float(KNOWN)], [0.0]])  # an event time or a load that is known


def _joined(*slots: Array) -> Array:
    """Slots one after the other, for as many blocks as the longest has (2, blocks, k)."""
    blocks = max((part.shape[1] for part in slots if part.ndim == 3), default=1)
    each = (part if part.ndim == 3 else part[:, None] for part in slots)
    return np.concatenate([np.broadcast_to(part, (2, blocks, part.shape[-1])) for part in each], axis=2)


class NlpBuilder:
    """Gathers unknowns, rows and blocks while a layout is built; thrown away afterwards."""

    def __init__(self, model: Model, unknowns: Unknowns, free: Indices) -> None:
        self.model, self.unknowns, self.free = model, unknowns, free
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
        self.count, self.rows, self._columns = 0, 0, list[Array]()
        bounds = unknowns.lower[free], unknowns.upper[free]
        self.add(unknowns.start[free], unknowns.spread[free], bounds, (mean[free], sd[free]), about[free])
        self.groups: dict[tuple[int, str], int] = {}  # of logs: which unknown each shares
        self.parts: dict[BlockKind, list[Family]] = {}

    def add(
        self,
        start: Array | float,
        scale: Array | float,
        bounds: tuple[Array | float, Array | float] = (-np.inf, np.inf),
        prior: tuple[Array | float, Array | float] = (0.0, np.inf),
        about: Indices | int = KNOWN,
    ) -> Array:
        """Slots (2, n) of new unknowns; prior: mean and sd; about: the unknown that is added to the mean."""
        rows = np.empty((7, np.size(start)))
        for row, value in zip(rows, (start, scale, *bounds, *prior, about), strict=True):
            row[:] = value
        self._columns.append(rows)
        first, self.count = self.count, self.count + rows.shape[1]
        return np.stack([np.arange(first, self.count), rows[0]])

    def columns(self) -> dict[str, Array]:
        """What a layout has of all unknowns so far, each (n,)."""
        names = ("start", "scale", "lower", "upper", "prior_mean", "prior_sd", "prior_about")
        return dict(zip(names, np.concatenate(self._columns, axis=1), strict=True))

    def states(self, values: Array, scale: Array, known: NDArray[np.bool_]) -> Array:
        """Slots (2, ..., n_x) of states; the components that are `known` are constants."""
        out = np.stack([np.full(values.shape, float(KNOWN)), values])
        out[:, ~known] = self.add(values[~known], np.broadcast_to(scale, values.shape)[~known])
        return out

    def put(
        self, kind: BlockKind, at: tuple[int, int], slots: Array, constants: Array, edges: Array, own: Indices
    ) -> None:
        """Blocks of one kind in a part of a log (`at`): their slots are the given ones and the parameters, of which
        this log has some for itself."""
        of, n = block(self.model, kind), slots.shape[1]
        theta = np.stack([np.where(own >= 0, own, self.theta), self.unknowns.start])
        index, value = _joined(slots, theta)
        rows = self.rows + np.arange(n * of.n_rows).reshape(n, of.n_rows)
        self.rows += n * of.n_rows
        log, part = np.full(n, at[0]), np.full(n, at[1])
        placed = constants.reshape(n, -1), rows, log, part, edges.reshape(n, -1, 2)
        self.parts.setdefault(kind, []).append(Family(of, index.astype(np.int64), value, *placed))

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
        self.start_theta = trajectory.theta(builder.unknowns.start)
        self.p = builder.unknowns.values(self.start_theta, log.base)
        k, m = (self.p[model.parameter_names.index(n)] for n in ("stiffness", "mass"))
        force = 0.1 * log.mean_normal_force
        by_unit = {"m": force / k, "m/s": force / np.sqrt(k * m), "N": force}
        self.size = np.array([by_unit.get(s.unit, 1.0) for s in model.states])
        self.rest_rows = self.size.copy()
        self.rest_rows[SPEED] = force  # the onset guard is a force
        self.tick = 0.1 * float(np.sqrt(m / k))
        self.is_speed = np.arange(self.size.size) == SPEED
        self.clamped = np.arange(self.size.size) == (KNOWN if model.clamped is None else model.clamped)
        self.lowest = np.array([s.lower or 0.0 for s in model.states])
        self.offset, self.load, self.since, self.worn = CONSTANT, CONSTANT, log.begin, False

    def walk(self) -> Places:
        """Note everything of this log."""
        trajectory, log, u, first = self.trajectory, self.log, self.c.unknowns, self.number == 0
        shared = np.full(len(self.model.parameters), KNOWN)  # parameters of this log or its group; of the first, theta
        for i in np.flatnonzero(u.own).tolist():
            key = (i, (log.groups[i] if log.groups else "") or f"log {self.number}")
            if key not in self.c.groups:
                start, bounds = float(self.start_theta[i]), (u.lower[i], u.upper[i])
                added = self.c.theta[[i]] if first else self.c.add(start, u.spread[i], bounds, u.own_prior(i, start))[0]
                self.c.groups[key] = int(added[0])
            shared[i] = KNOWN if first else self.c.groups[key]
        self.own = shared  # where sticks have a strength of their own, with that of the stick
        # The state the record starts from: elongation free, the other states with a weak prior.
        value, kind = trajectory.start, trajectory.modes[0][0] if trajectory.modes else "rest"
        known = np.ones(value.size, bool)
        if kind not in ("steady", "steady_worn"):
            known[ELONGATION], known[SPEED] = False, kind == "rest"
        self.node = begin = self.c.states(value, self.size, known)
        extra = ~self.is_speed & (np.arange(value.size) != ELONGATION) & ~(self.clamped & (kind == "worn"))
        if extra.any() and not known[ELONGATION]:
            bounded = np.array([s.lower is not None for s in self.model.states])[extra]
            weak = np.where(bounded, 0.5, value[extra]), np.where(bounded, BOUNDED_START_SD, self.size[extra])
            begin[:, extra] = self.c.add(value[extra], self.size[extra], prior=weak)
        until, nodes = np.full(trajectory.until.shape, KNOWN), np.full(trajectory.nodes.shape, KNOWN)
        loads = np.full(trajectory.loaded_at.size, KNOWN)
        strengths, loads_in_slips = loads[: loads.size * (log.strength_sd > 0.0)].copy(), list[float]()
        ends = [*trajectory.until.tolist(), log.end]
        for i, (part, stretch) in enumerate(zip(trajectory.part, trajectory.stretches, strict=True)):
            if i == 0 or part != trajectory.part[i - 1]:
                # The normal force to within its error: if exact, event times would tell it to a millionth.
                sd, self.load = log.normal_force_sd, CONSTANT
                if sd > 0.0:
                    self.load = self.c.add(trajectory.deviation[part], sd, prior=(0.0, sd))
                loads[part] = int(self.load[0, 0])
                if strengths.size:  # the static friction of this stick, and of the slip after it: about that of all
                    at, sd, own = self.model.parameter_names.index("mu_s"), log.strength_sd, trajectory.strength
                    about, mean = int(np.where(shared >= 0, shared, self.c.theta)[at]), self.start_theta[at]
                    prior = (mean if about < 0 else 0.0, sd)
                    added = self.c.add(own[part] if own.size else mean, sd, prior=prior, about=about)
                    self.own = shared.copy()
                    self.own[at] = strengths[part] = added[0, 0]
            end = CONSTANT
            if stretch.ended_by != "time" and not stretch.steady:
                left, right = stretch.until - self.since, ends[i + 1] - stretch.until
                end = self.c.add(0.0, self.tick, (-0.45 * left, 0.45 * right))
                until[i] = end[0, 0]
            if stretch.steady:
                states = self._steady(part, stretch)
            elif stretch.kind == "rest":
                states = self._rest(part, stretch, end)
            else:
                if jitter := log.jitter_sd > 0.0 and i in trajectory.own_slips:
                    error, value = log.normal_force_sd, trajectory.sliding_deviation[part]
                    # A tremor goes through half a period while a slip lasts: the deviation at its end is another one.
                    self.load = np.concatenate([self.load, self.c.add(value, error, prior=(0.0, error))], axis=1)
                    loads_in_slips.append(self.load[0, 1])
                states = self._slide(part, stretch, end, jitter=jitter)
            nodes[trajectory.first[i] : trajectory.first[i + 1]] = states[0]
            self.since, self.offset = stretch.until, end
        if trajectory.rests_at_end and self.since < log.end:
            self.load = CONSTANT
            self._rest(trajectory.parts, None, CONSTANT)
        in_slips = np.array(loads_in_slips, dtype=np.int64)
        return Places(begin[0].astype(np.int64), until, nodes, loads, shared, in_slips, strengths)

    def _constants(self, rows: Array, start: float, end: float, slope_at: float) -> Array:
        force_start, force_end = self.log.normal_force.at([start, end])
        slope = self.log.normal_force.line(slope_at)[1]
        drive = self.log.speed_at(0.5 * (start + end))
        ends = [drive, force_start, force_end, slope, start, end - start, 0.0, 1.0]
        return np.concatenate([self.log.base, rows, ends])

    def _put(self, kind: BlockKind, part: int, slots: Array, constants: Array, edges: Array) -> None:
        self.c.put(kind, (self.number, part), slots, constants, edges, self.own)

    def _rest(self, part: int, stretch: Stretch | None, end: Array) -> Array:
        """A rest that ends in a node, at an event or at a given time, or (None) with the window: slots of the node."""
        until = self.log.end if stretch is None else stretch.until
        constants = self._constants(self.rest_rows, self.since, until, until)
        if self.worn:
            self._age(part, constants)
        begin, straight = self.node, self.model.straight
        parts = [(0.0, 1.0)] if straight else parts_of_rest(self.model, self.p, until - self.since)
        for fractions in parts:
            kind, between = RestBlock(), [begin]
            if stretch is not None and fractions is parts[-1]:
                kind = RestBlock("time" if stretch.ended_by == "time" else "onset")
                self.node = self.c.states(np.where(self.is_speed, 0.0, stretch.nodes[-1]), self.size, self.is_speed)
                between = [begin, self.node]
            own = np.concatenate([constants[:-2], fractions])
            edges = self.since + (until - self.since) * np.linspace(*fractions, (1 if straight else REST_CELLS) + 1)
            slots = _joined(*between, self.offset, end, self.load)
            self._put(kind, part, slots, own, np.stack([edges[:-1], edges[1:]], axis=1))
        return self.node

    def _age(self, part: int, rest: Array) -> None:
        """A node where the contact has aged before the mass rests. rest: the constants of the rest that follows."""
        slots = np.concatenate([self.node[1], np.zeros(self.size.size + 3), self.start_theta])
        defect = block(self.model, AgeingBlock()).evaluate(slots[None], rest[None], derivatives=False)[0][0]
        value, others = np.where(self.is_speed, 0.0, self.node[1]), ~self.is_speed
        value[others] = np.where(np.isfinite(defect), -defect * self.rest_rows[others], value[others])
        node = self.c.states(value, self.size, self.is_speed)
        joined = _joined(self.node, node, self.offset, self.offset, self.load)
        self._put(AgeingBlock(), part, joined, rest, np.full((1, 2), self.since))
        self.node, self.worn = node, False

    def _slide(self, part: int, stretch: Stretch, end: Array, *, jitter: bool) -> Array:
        """A part of a slide in one mode: slots (2, n, n_x) of its nodes; jitter: the load changes on the way."""
        worn, released = stretch.kind == "worn", stretch.ended_by == "release"
        intervals, steps = len(stretch.nodes), self.grid.steps
        known = np.tile(self.clamped & worn, (intervals, 1))
        known[-1] = (self.clamped & (worn or stretch.ended_by == "wear")) | (
            self.is_speed & (stretch.ended_by == "arrest")
        )
        nodes = self.c.states(np.where(known, self.lowest, stretch.nodes), self.size, known)
        before = np.concatenate([self.node[:, None], nodes[:, :-1]], axis=1)
        slots = _joined(before, nodes, self.offset, end, self.load)
        rows = self.size.copy()
        if released:  # a typical rate of the bounded state
            rates = self._rates(stretch.nodes[-1], stretch.until)[self.clamped]
            rows[self.clamped] = np.max(np.abs(rates) * self.size)
        # The normal force is a straight line over each interval: the tremor of a finger goes through half a period
        # while a slip lasts. Written as lines from the start of the slide; level where events coincide.
        fractions = np.linspace(0.0, 1.0, intervals + 1)
        since = (stretch.until - self.since) * fractions
        forces, width = self.log.normal_force.at(self.since + since), np.diff(since)
        slope = np.divide(np.diff(forces), width, out=np.zeros(intervals), where=width > 0.0)
        constants = np.tile(self._constants(rows, self.since, stretch.until, self.since), (intervals, 1))
        constants[:, -7], constants[:, -5] = forces[:-1] - slope * since[:-1], slope
        constants[:, -2], constants[:, -1] = fractions[:-1], fractions[1:]
        cells = self.since + (stretch.until - self.since) * np.linspace(0.0, 1.0, intervals * steps + 1)
        edges = np.stack([cells[:-1], cells[1:]], axis=1).reshape(intervals, steps, 2)
        last = intervals - 1 if released else intervals  # the guard is in the last interval
        plain, guarded = SlideBlock(steps, worn, jitter=jitter), SlideBlock(steps, worn, released=True)
        for kind, some in ((plain, slice(0, last)), (guarded, slice(last, None))):
            if len(edges[some]):
                self._put(kind, part, slots[:, some], constants[some], edges[some])
        self.node, self.load, self.worn = nodes[:, -1], self.load[:, -1:], worn
        return nodes

    def _steady(self, part: int, stretch: Stretch) -> Array:
        """Pieces of steady sliding, each with the states at its ends; what came before has faded. Slots (2, n, n_x)."""
        worn, pieces = stretch.kind == "steady_worn", stretch.nodes.reshape(-1, 2, self.size.size)
        edges = np.linspace(self.since, stretch.until, len(pieces) + 1)
        rows = np.maximum(np.max(np.abs(self._rates(pieces[0, 0], self.since)) * self.size, axis=1), 1e-300)
        rows[ELONGATION] = 1.0
        nodes = self.c.states(pieces, self.size, np.broadcast_to(self.is_speed | (self.clamped & worn), pieces.shape))
        for i, span in enumerate(pairwise(edges.tolist())):
            slots = _joined(nodes[:, i, 0], nodes[:, i, 1], CONSTANT, CONSTANT, self.load)
            self._put(SteadyBlock(worn), part, slots, self._constants(rows, *span, span[1]), np.array([span]))
        self.node, self.worn = nodes[:, -1, 1].copy(), worn
        self.node[1, SPEED] = self.log.speed_at(0.5 * (edges[-2] + edges[-1]))
        return nodes.reshape(2, -1, self.size.size)

    def _rates(self, state: Array, at: float) -> Array:
        """Derivatives of the rates of all states with respect to the states (n_x, n_x) [1/s per unit]."""
        u = np.array([self.log.speed_at(at), self.log.normal_force.at(at), 1.0, at])
        return linearised(self.model, False, state[None], self.p[None], u[None])[1][0]


def parts_of_rest(model: Model, p: Array, duration: float) -> list[tuple[float, float]]:
    """Fractions of a rest [s] that one block each can follow: fine where something decays, and where it oscillates."""
    if duration <= 0.0:
        return [(0.0, 1.0)]
    rates, frequencies = (np.array(f(p)).ravel() for f in (model.decays, model.waves))
    # What decays is followed until it is gone: by time constants.
    ends = [c / r for r in rates for c in (3.0, 8.0, 18.0) if c / r < duration]
    # Eight cells on a period of what oscillates.
    longest = min((REST_CELLS * 2 * np.pi / (8 * w) for w in frequencies), default=np.inf)
    cuts = [
        np.linspace(a, b, 1 + min(max(int(np.ceil((b - a) / longest)), 1), 4000))[:-1]  # of one rest
        for a, b in pairwise(np.unique([0.0, *ends, duration]))
    ]
    inner = np.append(np.concatenate(cuts), duration) / duration
    return list(pairwise(inner.tolist()))


def transcribe(logs: list[LogData], trajectories: list[ShootingTrajectory], unknowns: Unknowns, grid: Grid) -> Layout:
    """Lay out the multiple-shooting problem of several logs around their trajectories."""
    builder = NlpBuilder(unknowns.model, unknowns, np.flatnonzero(unknowns.free))
    places = tuple(
        _LogTranscriber(builder, number, log, trajectory, grid).walk()
        for number, (log, trajectory) in enumerate(zip(logs, trajectories, strict=True))
    )
    columns = builder.columns()
    return Layout(
        unknowns=unknowns,
        trajectories=tuple(trajectories),
        grid=grid,
        free=builder.free,
        families=builder.families(),
        rows=builder.rows,
        places=places,
        prior_about=columns.pop("prior_about").astype(np.int64),
        **columns,
    )
