"""One simulated slide as stretches of a trajectory: which phases it has, and the states at their shooting nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.model.model import SPEED, Model
from identify.shooting.shooting_trajectory import Stretch
from identify.simulation.phases import Phase
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

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
