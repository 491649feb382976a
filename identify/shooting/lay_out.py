"""Build a layout: walk along every log, stick by stick and slip by slip, and note unknowns and blocks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import Grid, Guess, LogData, Stretch
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION, SPEED
from identify.shooting.block_equations import BlockKind
from identify.shooting.collector import Collector
from identify.shooting.footing import NO_OFFSET, ZERO, Footing
from identify.shooting.layout import KNOWN, Indices, Layout, Places, StretchPlaces

Array = NDArray[np.float64]


class _LogWalk(Footing):
    """Walks along one log and notes where its events, loads and nodes stand among the unknowns."""

    def __init__(self, collector: Collector, number: int, log: LogData, guess: Guess, grid: Grid) -> None:
        super().__init__(collector, number, log, guess, grid)
        self.events = {name: np.full(guess.cycles, KNOWN) for name in ("onset", "saturation", "arrest")}
        self.loads = np.full(guess.parts, KNOWN)
        self.loads_in_slips: list[int] = []
        self.sliding_deviation = guess.sliding_deviation
        self.tail: list[StretchPlaces] = []
        self.slip = np.full(guess.slip.shape, KNOWN)
        self.saturated = np.full(guess.saturated.shape, KNOWN)

    def walk(self) -> Places:
        """Note everything of this log."""
        self._own()
        start = self._begin()
        for cycle in range(self.guess.cycles):
            self._load(cycle, self.log.expected[0])
            self._stick(cycle)
            self._slide(cycle)
        if self.guess.tail:
            self._tail()
        else:
            self._last_rest(self.guess.cycles)
        events = self.events
        return Places(
            start,
            events["onset"],
            events["saturation"],
            events["arrest"],
            self.loads,
            self.slip,
            self.saturated,
            self.own,
            tuple(self.tail),
            np.array(self.loads_in_slips, dtype=np.int64),
        )

    def _begin(self) -> Indices:
        """The state the record starts from: elongation free, the other states with a weak prior."""
        start = np.full(self.n_x, KNOWN)
        first = self.guess.tail[0] if self.guess.tail and not self.guess.cycles else None
        begins_steady = first is not None and first.steady
        if not begins_steady:
            start[[0]] = self.c.add(self.guess.start[[0]], self.size[[0]])
        if first is not None and first.kind in ("slip", "saturated"):
            start[[SPEED]] = self.c.add(self.guess.start[[SPEED]], self.size[[SPEED]])
        known = self.held if first is not None and first.kind == "saturated" else ()
        extra = [] if begins_steady else [i for i in range(2, self.n_x) if i not in known]
        if extra:
            bounded = np.array([self.c.model.states[i].lower is not None for i in extra])
            mean = np.where(bounded, 0.5, self.guess.start[extra])
            sd = np.where(bounded, 0.5, self.size[extra])
            start[extra] = self.c.add(self.guess.start[extra], self.size[extra], mean=mean, sd=sd)
        self.node, self.value, self.offset = start, self.guess.start, NO_OFFSET
        return start

    def _load(self, cycle: int, expected: float) -> None:
        """The normal force of this cycle: known to within the error of its measurement, or exactly.

        A slow log tells its periods to a millisecond, which is a millionth of the load: no measured load is
        that good, and a fit that took it as exact would answer with wrong friction.
        """
        sd, mean = self.log.onset_load_sd_at(self.guess.loaded_at[[cycle]]), np.array([expected])
        if sd[0] > 0.0:
            self.loads[cycle] = self.c.add(self.guess.deviation[[cycle]], sd, mean=mean, sd=sd)[0]
        self.load = np.array([self.loads[cycle]])
        self.load_value = self.guess.deviation[[cycle]] if sd[0] > 0.0 else ZERO

    def _falling(self, cycle: int, span: tuple[float, float], end: int, known_at_end: tuple[int, ...]) -> None:
        """The slip until the bounded state is at its bound, or all of it.

        Where the measured normal force misses fast rhythms, its deviation becomes another one on the way: a tremor goes
        through half a period while a slip lasts.
        """
        kind: BlockKind = "slip"
        if self.log.tremor_sd > 0.0:
            kind = "slip_trembling"
            self._swing(cycle, float(self.guess.arrest[cycle]))
        self._part(kind, cycle, self.slip, self.guess.slip[cycle], span, end, (), known_at_end)
        self.load, self.load_value = self.load[-1:], self.load_value[-1:]

    def _swing(self, part: int, at: float) -> None:
        """The deviation of the normal force to which that at the onset goes over in a slip, as it is at a time [s]."""
        sd, mean = self.log.load_sd_at([at]), np.array([self.log.expected[1]])
        value = self.sliding_deviation[[part]]
        index = self.c.add(value, sd, mean=mean, sd=sd)
        self.loads_in_slips.append(int(index[0]))
        self.load, self.load_value = np.append(self.load, index), np.append(self.load_value, value)

    def _middle(self, cycle: int) -> float:
        """When the slip saturates, or its end where it never does [s]."""
        return float(self.guess.saturation[cycle] if self.guess.saturates[cycle] else self.guess.arrest[cycle])

    def _stick(self, cycle: int) -> None:
        """The stick before a slip: continuity and the onset guard."""
        on = float(self.guess.onset[cycle])
        index = self.c.event(self.tick, on - self.since, self._middle(cycle) - on)
        self.slip[cycle, 0] = self._rest_until(cycle, on, index, self.guess.slip[cycle, 0])
        self.events["onset"][cycle] = index

    def _slide(self, cycle: int) -> None:
        """The slip: until the bounded state is at its bound, then until the mass rests."""
        on, arrest, middle = float(self.guess.onset[cycle]), float(self.guess.arrest[cycle]), self._middle(cycle)
        following = self.guess.onset[cycle + 1] if cycle + 1 < self.guess.cycles else self.log.end
        room = float(following) - arrest
        if self.guess.saturates[cycle] and self.held:
            index = self.c.event(self.tick, middle - on, arrest - middle)
            self.events["saturation"][cycle] = index
            self._falling(cycle, (on, middle), index, self.held)
            index = self.c.event(self.tick, arrest - middle, room)
            both = (*self.held, SPEED)
            self._part(
                "saturated",
                cycle,
                self.saturated,
                self.guess.saturated[cycle],
                (middle, arrest),
                index,
                self.held,
                both,
            )
            self.reaged = True
        else:
            index = self.c.event(self.tick, arrest - on, room)
            self._falling(cycle, (on, arrest), index, (SPEED,))
            self.reaged = False
        self.events["arrest"][cycle] = index
        self.since = arrest

    def _part(
        self,
        kind: BlockKind,
        cycle: int,
        places: Indices,
        nodes: Array,
        span: tuple[float, float],
        end: int,
        known_inside: tuple[int, ...],
        known_at_end: tuple[int, ...],
    ) -> None:
        """The shooting intervals of one part of the slip of a cycle."""
        local = self._line_by_line(self.size, span, nodes.shape[0] - 1)
        places[cycle, 1:] = self._intervals(kind, cycle, nodes, span, end, known_inside, known_at_end, local)

    def _tail(self) -> None:
        """What follows the last cycle: rests and slides as they come."""
        stretches, units = self.guess.tail, self.guess.units
        swings, slips = self.guess.own_slips, self.guess.slip_parts
        for i, (unit, stretch) in enumerate(zip(units, stretches, strict=True)):
            if i == 0 or unit != units[i - 1]:
                self._load(unit, self.log.expected[0] if unit in slips else 0.0)
            if stretch.steady:
                self._steady(unit, stretch)
                continue
            last = i + 1 == len(stretches)
            if stretch.kind == "rest" and last:
                self._last_rest(unit)
                self.tail.append(StretchPlaces(KNOWN, np.full(stretch.nodes.shape, KNOWN)))
                continue
            index = KNOWN
            if stretch.ended_by != "time":
                room = (self.log.end if last else stretches[i + 1].until) - stretch.until
                index = self.c.event(self.tick, stretch.until - self.since, room)
            nodes = np.full(stretch.nodes.shape, KNOWN)
            if stretch.kind == "rest":
                nodes[-1] = self._rest_until(unit, stretch.until, index, stretch.nodes[-1])
                self.reaged = False
            else:
                nodes[1:] = self._sliding(unit, stretch, index, trembling=i in swings and self.log.tremor_sd > 0.0)
            self.tail.append(StretchPlaces(index, nodes))
            self.since = stretch.until

    def _sliding(self, unit: int, stretch: Stretch, index: int, *, trembling: bool) -> Indices:
        """A part of a slide in one mode, whatever ends it; trembling: a slip as `_falling` has it."""
        saturated = stretch.kind == "saturated"
        inside = self.held if saturated else ()
        arrests = (SPEED,) if stretch.ended_by == "arrest" else ()
        at_end = (*self.held, *arrests) if saturated or stretch.ended_by == "saturation" else arrests
        kind: BlockKind = "saturated" if saturated else "slip"
        rows = self.size.copy()
        if stretch.ended_by == "release":
            kind = "released"
            rows[list(self.held)] = self._pace_of_bound(stretch.nodes[-1], stretch.until)
        if trembling:
            kind = "slip_trembling"
            self._swing(unit, stretch.until)
        local = self._line_by_line(rows, (self.since, stretch.until), stretch.nodes.shape[0] - 1)
        self.reaged = saturated
        places = self._intervals(kind, unit, stretch.nodes, (self.since, stretch.until), index, inside, at_end, local)
        self.load, self.load_value = self.load[-1:], self.load_value[-1:]
        return places

    def _steady(self, unit: int, stretch: Stretch) -> None:
        """Pieces of steady sliding, each with the states at its ends; what came before has faded."""
        saturated = stretch.kind == "steady_saturated"
        known = (SPEED, *(self.held if saturated else ()))
        pieces = stretch.nodes.reshape(-1, 2, self.n_x)
        edges = np.linspace(self.since, stretch.until, pieces.shape[0] + 1)
        places = np.full(pieces.shape, KNOWN)
        kind: BlockKind = "steady_saturated" if saturated else "steady"
        rows = np.maximum(np.max(np.abs(self._rates(pieces[0, 0], self.since)) * self.size, axis=1), 1e-300)
        rows[ELONGATION] = 1.0
        for i, (span, ends) in enumerate(zip(pairwise(edges.tolist()), pieces, strict=True)):
            for j in range(2):
                places[i, j] = self.c.state(ends[j], self.size, known)
            self.c.put(
                kind,
                1,
                self.number,
                unit,
                [places[i, 0], places[i, 1], NO_OFFSET, NO_OFFSET, self.load],
                [ends[0], ends[1], ZERO, ZERO, self.load_value],
                self._constants(rows, *span, span[1]),
                np.array([span]),
                self.own,
            )
        self.tail.append(StretchPlaces(KNOWN, places.reshape(stretch.nodes.shape)))
        self.node, self.value, self.offset = places[-1, 1], pieces[-1, 1].copy(), NO_OFFSET
        self.value[SPEED] = self.log.speed_at(0.5 * (edges[-2] + edges[-1]))
        self.since, self.reaged = stretch.until, saturated


def lay_out(logs: list[LogData], guesses: list[Guess], unknowns: Unknowns, grid: Grid) -> Layout:
    """Lay out the multiple-shooting problem of several logs around their guesses."""
    free = np.flatnonzero(unknowns.free)
    collector = Collector(unknowns.model, unknowns, free)
    places = tuple(
        _LogWalk(collector, number, log, guess, grid).walk()
        for number, (log, guess) in enumerate(zip(logs, guesses, strict=True))
    )
    families = collector.families()
    joined = [
        np.concatenate(part)
        for part in (collector.scale, collector.start, collector.lower, collector.upper, collector.mean, collector.sd)
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
        np.array(collector.events, dtype=np.int64),
        mean,
        sd,
        collector.rows,
        places,
    )
