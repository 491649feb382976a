"""How a rest that is no straight line is cut into blocks, and where the contact stands once it re-aged before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.model.model import SPEED, Model
from identify.shooting.blocks import REST_CELLS, block
from identify.shooting.shooting_trajectory import Stretch
from identify.simulation.phases import Phase
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

DECAYED = (3.0, 8.0, 18.0)  # time constants at which a rest is cut: what decays is followed until it is gone
CELLS_PER_PERIOD = 8  # of an oscillation while the mass rests
MOST_PARTS = 4000  # of one rest


def parts_of_rest(rates: Array, frequencies: Array, duration: float) -> list[tuple[float, float]]:
    """Fractions of a rest [s] that one block each can follow: fine where something decays, and where it oscillates.

    Args:
        rates: of what decays [1/s]; frequencies: of what oscillates [rad/s].
    """
    if duration <= 0.0:
        return [(0.0, 1.0)]
    ends = [c / r for r in rates for c in DECAYED if c / r < duration]
    edges = np.unique([0.0, *ends, duration])
    longest = min((REST_CELLS * 2 * np.pi / (CELLS_PER_PERIOD * w) for w in frequencies), default=np.inf)
    cuts = [
        np.linspace(a, b, 1 + min(max(int(np.ceil((b - a) / longest)), 1), MOST_PARTS))[:-1] for a, b in pairwise(edges)
    ]
    inner = np.append(np.concatenate(cuts), duration) / duration
    return list(zip(inner[:-1].tolist(), inner[1:].tolist(), strict=True))


def cut(constants: Array, part: tuple[float, float], straight: bool) -> tuple[Array, Array]:
    """The constants of a rest for one part of it (fractions), and the windows of its cells (cells, 2) [s].

    Args:
        constants: of the block of the whole rest; straight: one cell follows it.
    """
    own = constants.copy()
    own[-2:] = part
    since, duration = constants[-4], constants[-3]
    edges = since + duration * np.linspace(*part, (1 if straight else REST_CELLS) + 1)
    return own, np.stack([edges[:-1], edges[1:]], axis=1)


def after_reageing(model: Model, state: Array, theta: Array, moment: Array, rows: Array) -> Array:
    """A state at rest once the contact re-aged (n_x,).

    Args:
        state: where the mass would rest with the contact still at its bound (n_x,); theta: as the slots of a block take
            it; moment: the constants of the block "reageing"; rows: its row scales (n_x,).
    """
    slots = np.concatenate([state, np.zeros(state.size + 3), theta])
    found = block(model, "reageing").evaluate(slots[None], moment[None], derivatives=False)[0][0]
    value, others = state.copy(), [i for i in range(state.size) if i != SPEED]
    value[SPEED] = 0.0
    value[others] = np.where(np.isfinite(found), -found * rows[others], value[others])
    return value


# ----------------------------------------------------------------------------------------------------------------------
# One simulated slide as stretches of a trajectory: which phases it has, and the states at their shooting nodes.
# ----------------------------------------------------------------------------------------------------------------------

INTERVAL = 1 / 4  # of half a period: shooting intervals of a slide
FIRST_INTERVALS = 8  # of the part of a slip in which the contact fades
BRIEF = 0.05  # of half a period: a contact that re-ages for so short before it rests does so in closed form,
CLEAR = 1.0  # where without that it would come to rest too: times the speed at which it begins to, below nothing
LOOK = 0.005  # of half a period: how far apart the speeds lie that say so


@dataclass
class SlideParts:
    """A slide as it is simulated, a piece at a time. begun: its onset [s]; half: half period of the rig [s]."""

    model: Model
    begun: float
    half: float
    _pieces: list[tuple[float, Trajectory]] = field(default_factory=list)
    _parts: list[tuple[str, float, str]] = field(default_factory=list)  # mode, end [s], what ended it

    def take(self, t: float, motion: Trajectory) -> Phase | None:
        """The motion from t [s] on; the phase at whose end the mass comes to rest, None where it does not."""
        self._pieces.append((t, motion))
        for phase in motion.phases:
            if phase.mode == "stick":
                continue
            self._note(phase.mode, t + phase.start + phase.duration, phase.ended_by)
            if phase.ended_by == "speed":
                self._merge()
                return phase
        return None

    def stretches(self, last: Literal["arrest", "time"], *, after_rest: bool) -> list[Stretch]:
        """The stretches with their nodes; last: what ends the last one; after_rest: the slide begins with an onset."""
        since, at, out = self.begun, _sampler(self.model, self._pieces), list[Stretch]()
        for i, (mode, end, ended) in enumerate(self._parts):
            first = i == 0 and mode == "slip" and after_rest
            count = max(ceil((end - since) / (INTERVAL * self.half)), FIRST_INTERVALS if first else 2)
            nodes = at(np.linspace(since, end, count + 1)[1:])
            if i + 1 == len(self._parts):
                ended = last
            if ended == "arrest":
                nodes[-1, SPEED] = 0.0
            kept = "wear" if ended == "clearance" else ended
            out.append(Stretch(mode, end, kept, nodes))  # type: ignore[arg-type]
            since = end
        return out

    def _note(self, mode: str, end: float, ended: str | None) -> None:
        """One more phase, joined to the one before where only the simulation was cut."""
        if self._parts and self._parts[-1][0] == mode and self._parts[-1][2] == "time":
            self._parts.pop()
        self._parts.append((mode, end, "time" if ended is None else ended))

    def _merge(self) -> None:
        """Leave out the brief re-ageing of a worn contact before it rests."""
        if len(self._parts) < 2 or self._parts[-2][2] != "release":
            return
        (mode, released, _), (_, end, ended) = self._parts[-2:]
        if end - released <= BRIEF * self.half and self._rests_anyway(released):
            self._parts[-2:] = [(mode, end, ended)]

    def _rests_anyway(self, released: float) -> bool:
        """Whether the mass would clearly come to rest with its contact worn all the way: the closed form starts
        from there. A mass that comes to rest by a hair does so because its contact ages."""
        h = LOOK * self.half
        moments = released - h * np.array([2.0, 1.0, 0.0])
        first, second, last = _sampler(self.model, self._pieces)(moments)[:, SPEED].tolist()
        pace, bend = (3.0 * last - 4.0 * second + first) / (2.0 * h), (last - 2.0 * second + first) / h**2
        return pace < 0.0 and pace**2 >= 2.0 * bend * (1.0 + CLEAR) * last


def _sampler(model: Model, pieces: list[tuple[float, Trajectory]]) -> Callable[[Array], Array]:
    """States (n, n_x) of joined motions at times (n,) [s]."""
    starts = np.array([t for t, _ in pieces])
    names = [s.name for s in model.states]

    def at(times: Array) -> Array:
        which = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        out = np.empty((times.size, len(names)))
        for i in np.unique(which).tolist():
            rows, (begin, motion) = which == i, pieces[i]
            sampled = motion.sample(np.clip(times[rows] - begin, 0.0, motion.duration))
            out[rows] = np.stack([sampled[name] for name in names], axis=1)
        return out

    return at
