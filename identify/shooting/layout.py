"""Where every unknown stands in the vector the solver sees, and which block takes which of them.

Known values (speed at onset and arrest, a clamped state) are constants, never variables with equal bounds:
otherwise rows become redundant and the multipliers never converge.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import Guess, Stretch
from identify.logs.unknowns import Unknowns
from identify.shooting.blocks import Block

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
class StretchPlaces:
    """Where a stretch of a tail stands among the unknowns: the offset of its end, its nodes; KNOWN for constants."""

    until: int
    nodes: Indices

    def read(self, stretch: Stretch, x: Array) -> Stretch:
        """The stretch moved to the unknowns x (n,)."""
        until = stretch.until + (float(x[self.until]) if self.until >= 0 else 0.0)
        return replace(stretch, until=until, nodes=np.where(self.nodes >= 0, x[self.nodes], stretch.nodes))


@dataclass(frozen=True)
class Places:
    """Where the guess of one log stands among the unknowns: indices in the shapes of `Guess`, KNOWN for constants;
    event times as the indices of their offsets."""

    start: Indices
    onset: Indices
    saturation: Indices
    arrest: Indices
    deviation: Indices
    slip: Indices
    saturated: Indices
    own: Indices
    tail: tuple[StretchPlaces, ...] = ()
    slip_deviation: Indices = field(default_factory=lambda: np.empty(0, np.int64))

    @property
    def events(self) -> Indices:
        """All offsets of event times."""
        tail = [place.until for place in self.tail]
        index = np.concatenate([self.onset, self.saturation, self.arrest, np.array(tail, dtype=np.int64)])
        return index[index >= 0]

    def read(self, guess: Guess, x: Array) -> Guess:
        """The guess moved to the unknowns x (n,), in physical units."""

        def state(index: Indices, old: Array) -> Array:
            return np.where(index >= 0, x[index], old)

        def time(index: Indices, old: Array) -> Array:
            return old + np.where(index >= 0, x[index], 0.0)

        return Guess(
            state(self.start, guess.start),
            time(self.onset, guess.onset),
            time(self.saturation, guess.saturation),
            time(self.arrest, guess.arrest),
            state(self.deviation, guess.deviation),
            state(self.slip, guess.slip),
            state(self.saturated, guess.saturated),
            state(self.own, guess.own) if guess.own.size else guess.own,
            tuple(place.read(stretch, x) for place, stretch in zip(self.tail, guess.tail, strict=True)),
            x[self.slip_deviation],
        )


@dataclass(frozen=True)
class Layout:
    """The whole problem: families of blocks over one vector of n unknowns and m rows.

    free (f,) indices of the parameters that are unknown: they are the first f unknowns; scale (n,) size of
    each unknown; start, lower, upper (n,) in physical units; events (e,) indices of the event offsets;
    prior_mean, prior_sd (n,); places: per log.
    """

    unknowns: Unknowns
    free: Indices
    families: tuple[Family, ...]
    scale: Array
    start: Array
    lower: Array
    upper: Array
    events: Indices
    prior_mean: Array
    prior_sd: Array
    rows: int
    places: tuple[Places, ...]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.scale.size


def kept_parameters(layout: Layout) -> Indices:
    """Indices of all parameters among the unknowns: the shared ones, then those that single logs have."""
    own = np.unique(np.concatenate([place.own for place in layout.places])) if layout.places else np.array([], int)
    return np.concatenate([np.arange(layout.free.size), own[own >= layout.free.size]]).astype(np.int64)
