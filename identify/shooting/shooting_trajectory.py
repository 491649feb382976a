"""The motion behind one log: what it goes through one after the other, when each ends, and its states in between."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import own_or
from identify.model.model import SPEED

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

Kind = Literal["rest", "slip", "renewed", "steady", "steady_renewed"]
End = Literal["onset", "wear", "release", "arrest", "turn", "time"]

# The stretches of a train of cycles by letters, and a train of them.
LETTERS = {("rest", "onset"): "o", ("slip", "wear"): "w", ("renewed", "arrest"): "a", ("slip", "arrest"): "A"}
TRAIN = re.compile("(o(A|wa))*")


@dataclass(frozen=True)
class Stretch:
    """One stretch of a motion: a rest, a part of a slide, or steady sliding.

    kind; until: its end [s]; ended_by: the guard that falls to zero there ("turn": the speed, and the mass slides back
    without a rest), or "time" where it is a time that is given (the drive changes, the window ends); nodes (n, n_x): of
    a rest its end; of a slide the ends of its shooting intervals; of steady sliding start and end of each piece.
    """

    kind: Kind
    until: float
    ended_by: End
    nodes: Array


@dataclass(frozen=True)
class ShootingTrajectory:
    """Event times and node states of one log, of s stretches with N nodes in all and p parts.

    start (n_x,): state at the begin of the window; modes: kind, end and number of nodes of every stretch; until (s,):
    when each ends [s]; nodes (N, n_x) of one stretch after the other; a rest up to the end of the window is no stretch;
    deviation (p,) of the normal force from its measured course in every part [N]; own (n_p,): search variables this log
    has for itself (NaN: shared with the others; empty: all are); slip_deviation (q,): that in every slip from rest
    (`slip_parts`), where it has one of its own (empty: as at the onset); strength (p,): theta of mu_s in every part
    (empty: as for all).
    """

    start: Array
    modes: tuple[tuple[Kind, End, int], ...]
    until: Array
    nodes: Array
    deviation: Array
    own: Array = field(default_factory=lambda: np.empty(0))
    slip_deviation: Array = field(default_factory=lambda: np.empty(0))
    strength: Array = field(default_factory=lambda: np.empty(0))

    @staticmethod
    def of(start: Array, stretches: Sequence[Stretch], own: Array) -> ShootingTrajectory:
        """The motion that is made of these stretches, with the normal force as it was measured."""
        modes = tuple((stretch.kind, stretch.ended_by, len(stretch.nodes)) for stretch in stretches)
        until = np.array([stretch.until for stretch in stretches])
        nodes = np.concatenate([start[None, :][:0], *(stretch.nodes for stretch in stretches)])
        motion = ShootingTrajectory(start, modes, until, nodes, np.empty(0), own)
        return replace(motion, deviation=np.zeros(motion.loaded_at.size))

    def theta(self, shared: Array) -> Array:
        """Theta (n_p,) of this log."""
        return own_or(shared, self.own)

    @cached_property
    def first(self) -> Indices:
        """Number of the first node of each stretch, and of all nodes (s + 1,)."""
        return np.cumsum([0, *(count for _, _, count in self.modes)])

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """The stretches one by one."""
        nodes = np.split(self.nodes, self.first[1:-1]) if self.modes else []
        return tuple(
            Stretch(kind, until, ended_by, own)
            for (kind, ended_by, _), until, own in zip(self.modes, self.until.tolist(), nodes, strict=True)
        )

    @cached_property
    def ways(self) -> Array:
        """Direction of sliding in every stretch (s,), +1 or -1; of a rest that of the slide after it."""
        sums = np.add.reduceat(self.nodes[:, SPEED], self.first[:-1]) if self.modes else np.empty(0)
        after = [next((v for v in sums[i:].tolist() if v), 1.0) for i in range(sums.size)]
        return np.sign(after)

    @property
    def rests_at_end(self) -> bool:
        """Whether the mass rests when the window ends."""
        return not self.modes or self.modes[-1][0] == "rest" or self.modes[-1][1] == "arrest"

    def ending(self, ended_by: End) -> Indices:
        """Which stretches end so."""
        return np.array([i for i, mode in enumerate(self.modes) if mode[1] == ended_by], dtype=np.int64)

    def at_end(self, which: Indices) -> Array:
        """The states (k, n_x) in which some stretches (k,) end."""
        return self.nodes[self.first[1:][which] - 1]

    # Parts of the record that are judged one by one, with a normal force each: a rest begins a new one.

    @cached_property
    def part(self) -> list[int]:
        """Number (from 0) of the part that each stretch is in."""
        rests = np.array([kind == "rest" for kind, _, _ in self.modes], dtype=np.int64)
        return np.cumsum(np.diff(rests, prepend=1) > 0).tolist()

    @property
    def parts(self) -> int:
        """Number of parts; what is nothing but a rest is one."""
        return self.part[-1] + 1 if self.modes else 1

    @cached_property
    def loaded_at(self) -> Array:
        """When the deviation of the normal force counts in every part (p,) [s]: at the onset, or early in a slide."""
        return self.until[np.unique(np.array(self.part, dtype=np.int64), return_index=True)[1]]

    @cached_property
    def own_slips(self) -> list[int]:
        """The slips from rest in which the normal force may have a deviation of its own, by their stretches."""
        begun = [i for i in range(1, len(self.modes)) if self.modes[i - 1][1] == "onset"]
        return [i for i in begun if self.modes[i][0] == "slip" and self.modes[i][1] in ("wear", "arrest")]

    @property
    def slip_parts(self) -> Indices:
        """Number of the part of each such slip (q,)."""
        return np.array([self.part[i] for i in self.own_slips], dtype=np.int64)

    @property
    def sliding_deviation(self) -> Array:
        """Deviation of the normal force in every part (p,) [N] while the mass slides."""
        out, own = self.deviation.copy(), self.slip_deviation
        out[self.slip_parts[: own.size]] = own
        return out

    # Sticks and slips.

    @property
    def slips(self) -> Array:
        """How long the mass slides from an onset to the arrest after it [s]; of every slip that has both."""
        onsets, arrests = self.ending("onset"), self.ending("arrest")
        before = np.searchsorted(onsets, arrests)
        begun = np.append(np.nan, self.until[onsets])[before]
        return (self.until[arrests] - begun)[np.isfinite(begun)]

    @cached_property
    def _train(self) -> Array:
        """Onset and arrest (c, 2) of every slip of a train of whole cycles; empty of any other motion."""
        letters = "".join(LETTERS.get(mode[:2], "-") for mode in self.modes)
        if not TRAIN.fullmatch(letters):
            return np.empty((0, 2))
        return np.column_stack([self.until[self.ending("onset")], self.until[self.ending("arrest")]])

    @property
    def cycles(self) -> int:
        """Number of cycles of a train of them, each a rest and a slip; 0 of any other motion."""
        return len(self._train)

    @property
    def onset(self) -> Array:
        """When each slip of such a train begins (c,) [s]."""
        return self._train[:, 0]

    @property
    def arrest(self) -> Array:
        """When each of its slips ends (c,) [s]."""
        return self._train[:, 1]

    @property
    def sticks(self) -> Array:
        """How long the mass sticks between its slips (c - 1,) [s]."""
        return self.onset[1:] - self.arrest[:-1]


def turned_back(trajectory: ShootingTrajectory) -> list[NDArray[np.bool_]]:
    """Nodes at which the mass moves backwards: of every stretch (n,), none of rests and of steady sliding. That is no
    motion of the model, in which the mass would rest in between."""
    pairs = zip(trajectory.ways.tolist(), trajectory.stretches, strict=True)
    speeds = [way * stretch.nodes[:, SPEED] for way, stretch in pairs]
    fastest = np.zeros(trajectory.parts)  # of the slip; what is renewed throughout has its own
    for part, stretch, speed in zip(trajectory.part, trajectory.stretches, speeds, strict=True):
        if stretch.kind == "slip":
            fastest[part] = max(fastest[part], float(np.max(np.abs(speed))))
    return [
        (speed < -1e-3 * (fastest[part] or np.max(np.abs(speed)))) & (stretch.kind in ("slip", "renewed"))
        for part, stretch, speed in zip(trajectory.part, trajectory.stretches, speeds, strict=True)
    ]
