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
from identify.shooting.blocks import Block
from identify.shooting.shooting_trajectory import ShootingTrajectory

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
