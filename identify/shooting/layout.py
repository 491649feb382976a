"""Where every unknown stands in the vector the solver sees, and which block takes which of them.

Known values (speed at onset and arrest, a clamped state) are constants, never variables with equal bounds:
otherwise rows become redundant and the multipliers never converge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identify.logs.unknowns import Unknowns
from identify.model.model import Model
from identify.shooting.blocks import Block, BlockKind, block
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

KNOWN = -1  # index of a slot that holds a constant


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

        def state(index: Indices, old: Array) -> Array:
            return np.where(index >= 0, x[index], old)

        return replace(
            trajectory,
            start=state(self.start, trajectory.start),
            until=trajectory.until + np.where(self.until >= 0, x[self.until], 0.0),
            nodes=state(self.nodes, trajectory.nodes),
            deviation=state(self.deviation, trajectory.deviation),
            own=state(self.own, trajectory.own) if trajectory.own.size else trajectory.own,
            slip_deviation=x[self.slip_deviation],
            strength=x[self.strength],
        )


@dataclass(frozen=True)
class Layout:
    """The whole problem: families of blocks over one vector of n unknowns and m rows.

    free (f,) indices of the parameters that are unknown: they are the first f unknowns; scale (n,) size of
    each unknown; start, lower, upper (n,) in physical units;
    prior_mean, prior_sd (n,); prior_about (n,): the unknown about which a prior is, beyond its mean, KNOWN where none
    is; places: per log.
    """

    unknowns: Unknowns
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

    @cached_property
    def varied(self) -> Indices:
        """Unknowns (v,) whose prior is about another unknown."""
        return np.flatnonzero(self.prior_about >= 0)

    def off_prior(self, x: Array) -> Array:
        """By how many standard deviations the unknowns x (n,) are off their priors (n,)."""
        return (self.beside(x) - self.prior_mean) / self.prior_sd

    def beside(self, x: Array) -> Array:
        """Unknowns x (n, ...), those whose prior is about another one less that one."""
        if not self.varied.size:
            return x
        out = x.copy()
        out[self.varied] -= x[self.prior_about[self.varied]]
        return out

    def prior_pull(self, off: Array) -> Array:
        """Gradient (n,) of half the squares of what `off_prior` gives."""
        pull = off / self.prior_sd
        if self.varied.size:
            np.subtract.at(pull, self.prior_about[self.varied], pull[self.varied])
        return pull

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
# Gathers what a layout is made of, while it is built: unknowns, rows and blocks.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Blocks:
    """Blocks of one kind and cycle: slots and fixed (B, n) but for the parameters, constants (B, n_c), edges
    (B, cells, 2); the number of the first row; theta (n_p,): the slots of the parameters."""

    slots: Indices
    fixed: Array
    constants: Array
    edges: Array
    first_row: int
    log: int
    cycle: int
    theta: Indices


class NlpBuilder:
    """Gathers unknowns, rows and blocks while a layout is built; thrown away afterwards."""

    def __init__(self, model: Model, unknowns: Unknowns, free: Indices) -> None:
        self.model, self.unknowns = model, unknowns
        self.scale: list[Array] = [unknowns.spread[free]]
        self.start: list[Array] = [unknowns.start[free]]
        self.lower: list[Array] = [unknowns.lower[free]]
        self.upper: list[Array] = [unknowns.upper[free]]
        self.theta = np.full(len(unknowns.names), KNOWN)
        self.theta[free] = np.arange(free.size)
        mean, sd, about = unknowns.prior_mean.copy(), unknowns.prior_sd.copy(), np.full(unknowns.free.size, KNOWN)
        for i in np.flatnonzero((unknowns.prior_about >= 0) & ~unknowns.own).tolist():
            j = int(unknowns.prior_about[i])
            if self.theta[i] >= 0 and self.theta[j] >= 0:
                about[i] = self.theta[j]
            elif self.theta[i] >= 0:
                mean[i] += unknowns.start[j]
            elif self.theta[j] >= 0:  # held, it says of the other one what its prior says of both
                weights = np.array([sd[j], sd[i]]) ** -2.0
                mean[j] = weights @ [mean[j], unknowns.start[i] - mean[i]] / weights.sum()
                sd[j] = weights.sum() ** -0.5
        self.mean: list[Array] = [mean[free]]
        self.sd: list[Array] = [sd[free]]
        self.about: list[Indices] = [about[free]]
        self.count, self.rows = free.size, 0
        self.source = unknowns.source
        self.groups: dict[tuple[int, str], int] = {}  # of logs: which unknown each shares
        self.made: dict[tuple[BlockKind, int], Block] = {}
        self.parts: dict[tuple[BlockKind, int], list[_Blocks]] = {}

    def add(
        self,
        start: Array,
        scale: Array,
        lower: Array | None = None,
        upper: Array | None = None,
        mean: Array | None = None,
        sd: Array | None = None,
        about: int = KNOWN,
    ) -> Indices:
        """New unknowns; without bounds, without prior unless given; about: the unknown that is added to the mean of
        it. Returns their indices."""
        n = start.size
        infinite = np.full(n, np.inf)
        self.start.append(start)
        self.scale.append(scale)
        self.lower.append(-infinite if lower is None else lower)
        self.upper.append(infinite if upper is None else upper)
        self.mean.append(np.zeros(n) if mean is None else mean)
        self.sd.append(infinite if sd is None else sd)
        self.about.append(np.full(n, about))
        self.count += n
        return np.arange(self.count - n, self.count)

    def state(self, value: Array, scale: Array, known: tuple[int, ...]) -> Indices:
        """Unknowns for one node state; the components in `known` stay constants."""
        index = np.full(value.size, KNOWN)
        free = [i for i in range(value.size) if i not in known]
        index[free] = self.add(value[free], scale[free])
        return index

    def event(self, scale: float, left: float, right: float) -> int:
        """The offset of one event time, kept within the phases beside it [s]."""
        one = np.ones(1)
        return int(self.add(0 * one, scale * one, -0.45 * left * one, 0.45 * right * one)[0])

    def put(
        self,
        of: tuple[BlockKind, int],
        at: tuple[int, int],
        slots: list[Indices],
        fixed: list[Array],
        constants: Array,
        edges: Array,
        own: Indices,
    ) -> None:
        """One block, of a kind and steps, at a log and cycle: its slots are the given ones and the parameters, of which
        this log has some for itself."""
        joined, values = np.concatenate(slots)[None, :], np.concatenate(fixed)[None, :]
        self.put_all(of, at, joined, values, constants[None, :], edges[None], own)

    def put_all(
        self,
        of: tuple[BlockKind, int],
        at: tuple[int, int],
        slots: Indices,
        fixed: Array,
        constants: Array,
        edges: Array,
        own: Indices,
    ) -> None:
        """Blocks of one kind and cycle: slots and fixed (B, n) but for the parameters, constants (B, n_c), edges
        (B, cells, 2)."""
        made = self.made.get(of)
        if made is None:
            made = self.made[of] = block(self.model, *of)
        theta = np.where(own >= 0, own, self.theta)[self.source]
        entry = _Blocks(slots, fixed, constants, edges, self.rows, *at, theta)
        self.rows += slots.shape[0] * made.n_rows
        self.parts.setdefault(of, []).append(entry)

    def families(self) -> tuple[Family, ...]:
        """All blocks so far, one family per kind."""
        return tuple(self._family(self.made[key], entries) for key, entries in self.parts.items())

    def _family(self, made: Block, entries: list[_Blocks]) -> Family:
        counts = np.array([e.slots.shape[0] for e in entries])
        count = int(counts.sum())
        theta = np.repeat(np.stack([e.theta for e in entries]), counts, axis=0)
        start = np.broadcast_to(self.unknowns.start[self.source], theta.shape)
        within = np.arange(count) - np.repeat(np.cumsum(counts) - counts, counts)
        first = np.repeat([e.first_row for e in entries], counts) + made.n_rows * within
        return Family(
            made,
            np.concatenate([np.concatenate([e.slots for e in entries]), theta], axis=1),
            np.concatenate([np.concatenate([e.fixed for e in entries]), start], axis=1),
            np.concatenate([e.constants for e in entries]),
            first[:, None] + np.arange(made.n_rows),
            np.repeat([e.log for e in entries], counts),
            np.repeat([e.cycle for e in entries], counts),
            np.concatenate([e.edges for e in entries]),
        )
