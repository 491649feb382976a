"""From motions to the layout of the problem: where every unknown stands in the vector the solver sees, and which block
takes which of them, along every log, phase by phase.

Known values (speed at onset and arrest, a clamped state) are constants, never variables with equal bounds: otherwise
rows become redundant and the multipliers never converge. A slot of a block holds an unknown or a constant: two numbers,
its index among the unknowns (KNOWN: a constant) and its value; slots are arrays (2, ..., k) of such pairs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION, SPEED, Model, on_course
from identify.shooting.blocks import (
    COURSE,
    REST_CELLS,
    AgeingBlock,
    Block,
    BlockKind,
    RestBlock,
    SlideBlock,
    SteadyBlock,
    block,
)
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.simulation.sliding import linearised

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

KNOWN = -1  # index of a slot that holds a constant
NEXT = 1e-9  # of a rest: changes of the drive that are closer are one


@dataclass(frozen=True)
class Grid:
    """Shooting intervals and RK4 steps per interval in the two parts of a slip: while the bounded state
    falls (`slip`), and once it is at its bound (`renewed`)."""

    slip: int
    renewed: int
    steps: int


COARSE_GRID = Grid(slip=8, renewed=8, steps=2)


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


# From motions to a layout.

BOUNDED_START_SD = 0.5  # of a state with bounds, such as a saturation, where a record begins: about half way
CONSTANT = np.array([[float(KNOWN)], [0.0]])  # an event time or a load that is known


def _joined(*slots: Array) -> Array:
    """Slots (2, n, k) of blocks one after the other; those of one unknown or constant per block are (2, n)."""
    return np.concatenate([part if part.ndim == 3 else part[..., None] for part in slots], axis=2)


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
        self.parts: dict[Block, list[Family]] = {}

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
        self, of: Block, log: int, parts: Indices, slots: Array, constants: Array, edges: Array, own: Indices
    ) -> None:
        """Blocks of one kind in parts (n,) of a log: their slots (2, n, k) are the given ones and the parameters, of
        which this log has some for itself: own (n, n_p)."""
        n = parts.size
        index = np.concatenate([slots[0], np.where(own >= 0, own, self.theta)], axis=1).astype(np.int64)
        value = np.concatenate([slots[1], np.broadcast_to(self.unknowns.start, own.shape)], axis=1)
        rows = self.rows + np.arange(n * of.n_rows).reshape(n, of.n_rows)
        self.rows += n * of.n_rows
        family = Family(of, index, value, constants, rows, np.full(n, log), parts, edges)
        self.parts.setdefault(of, []).append(family)

    def families(self) -> tuple[Family, ...]:
        """All blocks so far, one family per kind."""
        names = [f.name for f in fields(Family) if f.name != "block"]
        return tuple(
            Family(of, *(np.concatenate([getattr(part, name) for part in parts]) for name in names))
            for of, parts in self.parts.items()
        )


class _LogTranscriber:
    """The blocks of one log, all of a kind at once, and where its events, loads and nodes stand among the unknowns.

    Every phase (s of them, and one more where a rest lasts to the end of the window) begins in the state, at the offset
    and under the load in which the one before it ends.
    """

    def __init__(
        self, builder: NlpBuilder, number: int, log: LogData, trajectory: ShootingTrajectory, grid: Grid
    ) -> None:
        self.c, self.number, self.log, self.trajectory, self.grid = builder, number, log, trajectory, grid
        model = self.model = on_course(builder.model) if log.on_course else builder.model
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
        self.scales = slice(log.base.size, log.base.size + self.size.size)  # among the constants, as the course
        self.course = slice(self.scales.stop, self.scales.stop + COURSE)
        self.count = len(trajectory.modes)
        rests = int(trajectory.rests_at_end and max([log.begin, *trajectory.until[-1:]]) < log.end)
        modes = [mode[:2] for mode in trajectory.modes] + [("rest", "end")] * rests
        self.kind, self.ended_by = np.array(modes, dtype=str).reshape(-1, 2).T
        self.steady = np.isin(self.kind, ("steady", "steady_renewed"))
        self.renewed = np.isin(self.kind, ("renewed", "steady_renewed"))
        self.until = np.append(trajectory.until, np.full(rests, log.end))
        self.since = np.append(log.begin, self.until)[:-1]
        self.way = np.append(trajectory.ways, np.ones(rests))
        self.part = np.append(trajectory.part, np.full(rests, trajectory.parts)).astype(np.int64)

    def transcribe(self) -> Places:
        """Note everything of this log."""
        own, start = self._own(), self._start()
        loads, strengths = self._loads()
        self.own = np.tile(own, (self.part.size, 1))
        if strengths.size:
            of_stick = strengths[np.minimum(self.part, strengths.size - 1)]  # a last rest is not overcome
            self.own[:, self.model.parameter_names.index("mu_s")] = of_stick
        ends = self._ends()
        slip_loads = self._slip_loads()
        nodes = self._nodes()
        self.offset = np.concatenate([CONSTANT, ends], axis=1)[:, :-1]
        # The states in which the phases begin; after steady sliding the mass is as fast as the drive.
        last = nodes[:, self.trajectory.first[1:] - 1]
        after = self.steady[: self.count]
        last[1, after, SPEED] = self._speeds(self.until[: self.count][after], just_before=True)
        self.begin = np.concatenate([start[:, None], last], axis=1)[:, : self.kind.size]
        self.ends = ends
        self._rests(nodes)
        self._slides(nodes)
        for i in np.flatnonzero(self.steady).tolist():
            self._steady(i, nodes[:, self.trajectory.first[i] : self.trajectory.first[i + 1]])
        first, until, states = (each[0].astype(np.int64) for each in (start, ends[:, : self.count], nodes))
        return Places(first, until, states, loads, own, slip_loads, strengths)

    # What is unknown.

    def _own(self) -> Indices:
        """Parameters (n_p,) of this log or its group; of the first log they are theta."""
        u, first, out = self.c.unknowns, self.number == 0, np.full(len(self.model.parameters), KNOWN)
        for i in np.flatnonzero(u.own).tolist():
            key = (i, (self.log.groups[i] if self.log.groups else "") or f"log {self.number}")
            if key not in self.c.groups:
                start, bounds = float(self.start_theta[i]), (u.lower[i], u.upper[i])
                added = self.c.theta[[i]] if first else self.c.add(start, u.spread[i], bounds, u.own_prior(i, start))[0]
                self.c.groups[key] = int(added[0])
            out[i] = KNOWN if first else self.c.groups[key]
        self.shared = np.where(out >= 0, out, self.c.theta)
        return out

    def _start(self) -> Array:
        """The state the record starts from: elongation free, the other states with a weak prior."""
        value, kind = self.trajectory.start, str(self.kind[0]) if self.kind.size else "rest"
        known = np.ones(value.size, bool)
        if kind not in ("steady", "steady_renewed"):
            known[ELONGATION], known[SPEED] = False, kind == "rest"
        begin = self.c.states(value, self.size, known)
        extra = ~self.is_speed & (np.arange(value.size) != ELONGATION) & ~(self.clamped & (kind == "renewed"))
        if extra.any() and not known[ELONGATION]:
            bounded = np.array([s.lower is not None for s in self.model.states])[extra]
            weak = np.where(bounded, 0.5, value[extra]), np.where(bounded, BOUNDED_START_SD, self.size[extra])
            begin[:, extra] = self.c.add(value[extra], self.size[extra], prior=weak)
        return begin

    def _loads(self) -> tuple[Indices, Indices]:
        """Deviations of the normal force and strengths of the sticks, by parts (p,), where they are unknown.

        The normal force to within its error: if exact, event times would tell it to a millionth. The static friction of
        a stick, and of the slip after it, is about that of all.
        """
        log, trajectory, count = self.log, self.trajectory, self.trajectory.loaded_at.size
        self.load, sd = np.repeat(CONSTANT[:, None], self.part.size, axis=1), log.normal_force_sd  # (2, s, 1)
        loads, strengths = np.full(count, KNOWN), np.empty(0, dtype=np.int64)
        if sd > 0.0:
            added = self.c.add(trajectory.deviation, sd, prior=(0.0, sd))
            loads, known = added[0].astype(np.int64), self.part < count
            self.load[:, known, 0] = added[:, self.part[known]]
        if log.strength_sd > 0.0:
            at, values = self.model.parameter_names.index("mu_s"), trajectory.strength
            about, mean = int(self.shared[at]), self.start_theta[at]
            prior = (mean if about < 0 else 0.0, log.strength_sd)
            start = values if values.size else np.full(count, mean)
            strengths = self.c.add(start, log.strength_sd, prior=prior, about=about)[0].astype(np.int64)
        return loads, strengths

    def _slip_loads(self) -> Indices:
        """Deviations of the normal force at the ends of the slips from rest (q,), which then hold for what follows in
        that part: the jitter goes through half a period while a slip lasts."""
        slips, error = self.trajectory.own_slips, self.log.normal_force_sd
        self.jitter = np.zeros(self.part.size, dtype=bool)
        if not (self.log.jitter_sd > 0.0 and slips):
            return np.empty(0, dtype=np.int64)
        values = self.trajectory.sliding_deviation[self.trajectory.slip_parts]
        added = self.c.add(values, error, prior=(0.0, error))
        self.jitter[slips], self.load = True, np.repeat(self.load, 2, axis=2)
        for i, slot in zip(slips, added.T, strict=True):
            later = (self.part == self.part[i]) & (np.arange(self.part.size) > i)
            self.load[:, i, 1], self.load[:, later] = slot, slot[:, None, None]
        return added[0].astype(np.int64)

    def _ends(self) -> Array:
        """Offsets (2, s) of the ends of the phases from the reference; those that are given are constants."""
        ends, last = np.repeat(CONSTANT, self.part.size, axis=1), np.append(self.until, self.log.end)[1:]
        free = np.flatnonzero(~np.isin(self.ended_by, ("time", "end")) & ~self.steady)
        left, right = (self.until - self.since)[free], (last - self.until)[free]
        ends[:, free] = self.c.add(np.zeros(free.size), self.tick, (-0.45 * left, 0.45 * right))
        return ends

    def _nodes(self) -> Array:
        """Slots (2, N, n_x) of the nodes. Known are the speed at rest, at an arrest and in steady sliding, and a state
        at its bound."""
        trajectory, known = self.trajectory, np.zeros(self.trajectory.nodes.shape, dtype=bool)
        of = np.repeat(np.arange(self.count), np.diff(trajectory.first))
        last = np.isin(np.arange(of.size), trajectory.first[1:] - 1)
        kind, ended_by, steady = self.kind[of], self.ended_by[of], self.steady[of]
        known[:, SPEED] = steady | (kind == "rest") | (last & np.isin(ended_by, ("arrest", "turn")))
        known[:, self.clamped] = (self.renewed[of] | (last & (ended_by == "wear")))[:, None]
        lowest = np.array([s.lower or 0.0 for s in self.model.states])
        return self.c.states(np.where(known & ~steady[:, None], lowest, trajectory.nodes), self.size, known)

    # The blocks.

    def _speeds(self, times: Array, just_before: bool = False) -> Array:
        """Drive speeds (n,) at times (n,)."""
        times = np.nextafter(times, -np.inf) if just_before else times
        return np.array([self.log.speed_at(t) for t in times.tolist()])

    def _constants(self, of: Indices, rows: Array, since: Array, until: Array, slope_at: Array) -> Array:
        """Constants (n, n_constants) of phases `of` (n,) between times (n,) with row scales (n_x,) or (n, n_x)."""
        count, load = COURSE if self.model.on_course else 0, self.log.normal_force
        out = np.zeros((since.size, self.log.base.size + self.size.size + count + 8))
        out[:, : self.log.base.size], out[:, self.scales] = self.log.base, rows
        slopes = np.array([load.line(t)[1] for t in slope_at.tolist()])
        speeds = self._speeds(since if count else 0.5 * (since + until))
        columns = speeds, load.at(since), load.at(until), slopes, since, until - since
        out[:, -8:-2], out[:, -1] = np.stack(columns, axis=1), 1.0
        if count:
            out[:, self.course] = self._course(of, since, since, since)
        return out

    def _course(self, of: Indices, begin: Array, part: Array, inside: Array) -> Array:
        """Constants (n, COURSE) of phases `of` (n,) that begin at times (n,), in parts that do: way of the drive until
        then, its speed then, its acceleration inside and at the begin, and the direction of sliding."""
        way = self.log.moved(part) - self.log.moved(begin)
        rates = [np.array([self.log.acceleration_at(t) for t in times.tolist()]) for times in (inside, begin)]
        return np.stack([way, self._speeds(part), *rates, self.way[of]], axis=1)

    def _put(self, kind: BlockKind, of: Indices, slots: Sequence[Array], constants: Array, edges: Array) -> None:
        """Blocks (n,) of phases `of` (n,)."""
        if of.size:
            which = block(self.model, kind)
            self.c.put(which, self.number, self.part[of], _joined(*slots), constants, edges, self.own[of])

    def _rests(self, nodes: Array) -> None:
        """Rests that end in a node, at an event or at a given time, or with the window."""
        rests, straight = np.flatnonzero(self.kind == "rest"), self.model.straight
        since, until = self.since[rests], self.until[rests]
        constants = self._constants(rests, self.rest_rows, since, until, until)
        aged = (rests > 0) & self.renewed[rests - 1]
        if aged.any():
            self._age(rests[aged], constants[aged])
        spans = (until - since).tolist()
        parts = [[(0.0, 1.0)] if straight else parts_of_rest(self.model, self.p, span) for span in spans]
        if self.model.on_course:
            parts = [self._bent(*each) for each in zip(parts, since.tolist(), until.tolist(), strict=True)]
        which = np.repeat(np.arange(rests.size), [len(p) for p in parts])
        final, of, own = np.diff(which, append=rests.size) > 0, rests[which], constants[which]
        own[:, -2:] = np.array([ends for p in parts for ends in p]).reshape(-1, 2)
        if self.model.on_course:
            begin, span = since[which], (until - since)[which]
            inside = begin + own[:, -2:].mean(axis=1) * span
            own[:, self.course] = self._course(of, begin, begin + own[:, -2] * span, inside)
        cells = 1 if straight else REST_CELLS
        shares = own[:, -2:-1] + (own[:, -1:] - own[:, -2:-1]) * np.arange(cells + 1) / cells
        edges = since[which, None] + (until - since)[which, None] * shares
        edges = np.stack([edges[:, :-1], edges[:, 1:]], axis=2)
        ending = np.where(final, self.ended_by[of], "end")
        for kind, mine in (
            (RestBlock(), ending == "end"),
            (RestBlock("time"), ending == "time"),
            (RestBlock("onset"), ~np.isin(ending, ("end", "time"))),
        ):
            i = of[mine]
            ends = [] if kind.ended_by is None else [nodes[:, self.trajectory.first[i]]]
            slots = self.begin[:, i], *ends, self.offset[:, i], self.ends[:, i], self.load[:, i, 0]
            self._put(kind, i, slots, own[mine], edges[mine])

    def _bent(self, parts: list[tuple[float, float]], since: float, until: float) -> list[tuple[float, float]]:
        """Parts of a rest, as fractions of it, cut where the acceleration of the drive changes."""
        changes = self.log.programme.changes(since, until) if self.log.programme is not None else []
        cuts = np.unique([0.0, 1.0, *(a for a, _ in parts), *((t - since) / (until - since) for t in changes)])
        return list(pairwise(cuts[np.append(np.diff(cuts) > NEXT, True)].tolist()))

    def _age(self, rests: Indices, constants: Array) -> None:
        """Nodes where the contact has aged before the mass rests. constants: of the rests that follow."""
        begin, others = self.begin[:, rests], ~self.is_speed
        if self.model.on_course:
            constants[:, self.course.stop - 1] = self.way[rests - 1]
        known = np.concatenate([np.zeros(self.size.size + 3), self.start_theta])
        slots = np.concatenate([begin[1], np.tile(known, (rests.size, 1))], axis=1)
        defect = block(self.model, AgeingBlock()).evaluate(slots, constants, derivatives=False)[0]
        value = np.where(self.is_speed, 0.0, begin[1])
        aged = -defect * self.rest_rows[others]
        value[:, others] = np.where(np.isfinite(aged), aged, value[:, others])
        node = self.c.states(value, self.size, np.broadcast_to(self.is_speed, value.shape))
        at = self.offset[:, rests]
        edges = np.repeat(self.since[rests, None, None], 2, axis=2)
        self._put(AgeingBlock(), rests, (begin, node, at, at, self.load[:, rests, 0]), constants, edges)
        self.begin[:, rests] = node

    def _slides(self, nodes: Array) -> None:
        """Shooting intervals of all slides, those in which a contact is released at the end apart."""
        slides, steps = np.flatnonzero(~self.steady & (self.kind != "rest")), self.grid.steps
        first, count = self.trajectory.first[slides], np.diff(self.trajectory.first)[slides]
        of, n = np.repeat(slides, count), np.repeat(count, count)
        j = np.arange(of.size) - np.repeat(np.cumsum(count) - count, count)
        node = np.repeat(first, count) + j
        before = np.where((j == 0)[:, None], self.begin[:, of], nodes[:, node - 1])
        since, span = self.since[of], (self.until - self.since)[of]
        fractions = np.stack([j / n, (j + 1) / n], axis=1)
        constants = self._constants(slides, self.size, self.since[slides], self.until[slides], self.since[slides])
        constants = np.repeat(constants, count, axis=0)
        # The normal force is a straight line over each interval: the tremor of a finger goes through half a period
        # while a slip lasts. Written as lines from the start of the slide; level where events coincide.
        times = span[:, None] * fractions
        forces, width = self.log.normal_force.at(since[:, None] + times), np.diff(times)[:, 0]
        slope = np.divide(np.diff(forces)[:, 0], width, out=np.zeros(of.size), where=width > 0.0)
        constants[:, -7], constants[:, -5] = forces[:, 0] - slope * times[:, 0], slope
        if self.model.on_course:  # a line as well, along which the drive moves as far
            ends = since[:, None] + times
            speeds = np.stack([self._speeds(at) for at in ends.T], axis=1)
            rising = np.divide(np.diff(speeds)[:, 0], width, out=np.zeros(of.size), where=width > 0.0)
            way = np.diff(self.log.moved(ends))[:, 0]
            mean = np.divide(way, width, out=speeds[:, 0].copy(), where=width > 0.0)
            constants[:, -8], constants[:, self.course.start + 2] = mean - rising * times.mean(axis=1), rising
        constants[:, -2:] = fractions
        released = (self.ended_by[of] == "release") & (j == n - 1)
        for i in np.flatnonzero(released).tolist():  # a typical rate of the bounded state
            rates = self._rates(self.trajectory.nodes[node[i]], self.until[of[i]])[self.clamped]
            constants[i, self.scales][self.clamped] = np.max(np.abs(rates) * self.size)
        cells = (j[:, None] * steps + np.arange(steps + 1)) / (n * steps)[:, None]
        cells = since[:, None] + span[:, None] * cells
        edges = np.stack([cells[:, :-1], cells[:, 1:]], axis=2)
        slots = before, nodes[:, node], self.offset[:, of], self.ends[:, of]
        renewed, jitter = self.renewed[of], self.jitter[of]
        for kind, mine in (
            (SlideBlock(steps), ~renewed & ~jitter),
            (SlideBlock(steps, jitter=True), jitter),
            (SlideBlock(steps, renewed=True), renewed & ~released),
            (SlideBlock(steps, renewed=True, released=True), released),
        ):
            load = self.load[:, of[mine], : 2 if kind.jitter else 1]
            own = *(slot[:, mine] for slot in slots), load
            self._put(kind, of[mine], own, constants[mine], edges[mine])

    def _steady(self, i: int, nodes: Array) -> None:
        """Pieces of steady sliding, each with the states at its ends (2, 2 n, n_x); what came before has faded."""
        pieces = nodes.reshape(2, -1, 2, self.size.size)
        edges = np.linspace(self.since[i], self.until[i], pieces.shape[1] + 1)
        rates = self._rates(pieces[1, 0, 0], self.since[i])
        rows = np.maximum(np.max(np.abs(rates) * self.size, axis=1), 1e-300)
        rows[ELONGATION] = 1.0
        spans, of = np.stack([edges[:-1], edges[1:]], axis=1), np.full(pieces.shape[1], i)
        constants, zero = (
            self._constants(of, rows, spans[:, 0], spans[:, 1], spans[:, 1]),
            np.repeat(CONSTANT, of.size, axis=1),
        )
        slots = pieces[:, :, 0], pieces[:, :, 1], zero, zero, self.load[:, of, 0]
        self._put(SteadyBlock(bool(self.renewed[i])), of, slots, constants, spans[:, None])

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
        _LogTranscriber(builder, number, log, trajectory, grid).transcribe()
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
