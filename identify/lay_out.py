"""Build a layout: walk along every log, stick by stick and slip by slip, and note unknowns and blocks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.blocks import REST_CELLS, BlockKind
from identify.collector import Collector
from identify.guess import Grid, Guess, LogData
from identify.layout import KNOWN, Indices, Layout, Places
from identify.model import SPEED
from identify.unknowns import Unknowns

Array = NDArray[np.float64]
NO_OFFSET = np.array([KNOWN])
ZERO = np.zeros(1)
DECAYED = (3.0, 8.0, 18.0)  # time constants at which a rest is cut: what decays is followed until it is gone
CELLS_PER_PERIOD = 8  # of an oscillation while the mass rests
FORGOTTEN = 1e3  # spreads
MOST_PARTS = 4000  # of one rest


class _LogWalk:
    """Walks along one log; knows where it is: the node before, its offset, whether it re-aged there."""

    def __init__(self, collector: Collector, number: int, log: LogData, guess: Guess, grid: Grid) -> None:
        self.c, self.number, self.log, self.guess, self.grid = collector, number, log, guess, grid
        model = collector.model
        self.n_x = len(model.states)
        p = collector.unknowns.values(guess.theta(collector.unknowns.start), log.base)
        at_pace = collector.unknowns.values(guess.theta(collector.pace), log.base)
        k, m = (p[model.parameter_names.index(n)] for n in ("stiffness", "mass"))
        force = 0.1 * log.mean_normal_force
        by_unit = {"m": force / k, "m/s": force / np.sqrt(k * m), "N": force}
        self.size = np.array([by_unit.get(s.unit, 1.0) for s in model.states])
        self.rates, self.frequencies = (
            np.array(f(at_pace)).ravel() for f in (model.decays, model.waves)
        )  # of what makes a rest no straight line
        self.rest_rows = self.size.copy()
        self.rest_rows[SPEED] = force  # the onset guard is a force
        self.tick = 0.1 * float(np.sqrt(m / k))
        self.held = () if model.clamped is None else (model.clamped,)
        shape = (guess.cycles, self.n_x)
        self.own = np.full(len(model.parameters), KNOWN)
        self.events = {name: np.full(guess.cycles, KNOWN) for name in ("onset", "saturation", "arrest")}
        self.loads = np.full(guess.cycles, KNOWN)
        self.slip = np.full((shape[0], grid.slip + 1, shape[1]), KNOWN)
        self.saturated = np.full((shape[0], grid.saturated + 1, shape[1]), KNOWN)

    def walk(self) -> Places:
        """Note everything of this log."""
        self._own()
        # The state the record starts from: elongation free, the other states with a weak prior.
        start = np.full(self.n_x, KNOWN)
        start[[0]] = self.c.add(self.guess.start[[0]], self.size[[0]])
        extra = list(range(2, self.n_x))
        if extra:
            bounded = np.array([self.c.model.states[i].lower is not None for i in extra])
            mean = np.where(bounded, 0.5, self.guess.start[extra])
            sd = np.where(bounded, 0.5, self.size[extra])
            start[extra] = self.c.add(self.guess.start[extra], self.size[extra], mean=mean, sd=sd)
        self.node, self.value, self.offset = start, self.guess.start, NO_OFFSET
        self.since, self.reaged = self.log.begin, False
        for cycle in range(self.guess.cycles):
            self._load(cycle)
            self._stick(cycle)
            self._slide(cycle)
        constants = self._constants(self.rest_rows, self.since, self.log.end, self.log.end)
        for part in self._parts(self.since, self.log.end):
            self._rest_part(self.guess.cycles, NO_OFFSET, NO_OFFSET, ZERO, constants, part)
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
        )

    def _own(self) -> None:
        """The parameters this log has for itself or with its group; those of the first log are the shared ones."""
        u, known = self.c.unknowns, self.c.groups
        for i in np.flatnonzero(u.own).tolist():
            group = self.log.groups[i] if self.log.groups else ""
            key = (i, group or f"log {self.number}")
            if key not in known:
                known[key] = int(self.c.theta[i]) if self.number == 0 else self._own_unknown(i)
            if self.number > 0:
                self.own[i] = known[key]

    def _own_unknown(self, i: int) -> int:
        """A new unknown for parameter i."""
        u, one = self.c.unknowns, np.array([i])
        start = self.guess.theta(u.start)[one]
        mean = np.where(np.isfinite(u.prior_mean[one]), start, 0.0)
        # A phase of nothing has no information at all: a prior that says nothing keeps the matrices regular.
        sd = np.minimum(u.prior_sd[one], FORGOTTEN * u.spread[one])
        if u.grouped[i] and u.prior_sd[i] < FORGOTTEN * u.spread[i]:
            mean = u.prior_mean[one]
        return int(self.c.add(start, u.spread[one], u.lower[one], u.upper[one], mean=mean, sd=sd)[0])

    def _load(self, cycle: int) -> None:
        """The normal force of this cycle: known to within the error of its measurement, or exactly.

        A slow log tells its periods to a millisecond, which is a millionth of the load: no measured load is
        that good, and a fit that took it as exact would answer with wrong friction.
        """
        sd = np.array([self.log.normal_force_sd])
        if sd[0] > 0.0:
            self.loads[cycle] = self.c.add(self.guess.deviation[[cycle]], sd, mean=ZERO, sd=sd)[0]
        self.load = np.array([self.loads[cycle]])
        self.load_value = self.guess.deviation[[cycle]] if sd[0] > 0.0 else ZERO

    def _constants(self, rows: Array, start: float, end: float, slope_at: float) -> Array:
        force_start, force_end = self.log.normal_force.at([start, end])
        slope = self.log.normal_force.line(slope_at)[1]
        ends = [self.log.drive_speed, force_start, force_end, slope, start, end - start, 0.0, 1.0]
        return np.concatenate([self.log.base, rows, ends])

    def _middle(self, cycle: int) -> float:
        """When the slip saturates, or its end where it never does [s]."""
        return float(self.guess.saturation[cycle] if self.guess.saturates[cycle] else self.guess.arrest[cycle])

    def _stick(self, cycle: int) -> None:
        """The stick before a slip: continuity and the onset guard."""
        on = float(self.guess.onset[cycle])
        index = self.c.event(self.tick, on - self.since, self._middle(cycle) - on)
        value = self.guess.slip[cycle, 0].copy()
        value[SPEED] = 0.0
        node = self.c.state(value, self.size, (SPEED,))
        constants = self._constants(self.rest_rows, self.since, on, on)
        *before, last = self._parts(self.since, on)
        for part in before:
            self._rest_part(cycle, np.array([index]), self.load, self.load_value, constants, part)
        self.c.put(
            "stick_reaged" if self.reaged else "stick",
            1,
            self.number,
            cycle,
            [self.node, node, self.offset, np.array([index]), self.load],
            [self.value, value, ZERO, ZERO, self.load_value],
            *self._cut(constants, last),
            self.own,
        )
        self.events["onset"][cycle], self.slip[cycle, 0] = index, node
        self.node, self.value, self.offset = node, value, np.array([index])

    def _rest_part(
        self, cycle: int, end: Indices, load: Indices, load_value: Array, constants: Array, part: tuple[float, float]
    ) -> None:
        """A part of a rest without the guard that ends it."""
        self.c.put(
            "rest_reaged" if self.reaged else "rest",
            1,
            self.number,
            cycle,
            [self.node, self.offset, end, load],
            [self.value, ZERO, ZERO, load_value],
            *self._cut(constants, part),
            self.own,
        )

    def _cut(self, constants: Array, part: tuple[float, float]) -> tuple[Array, Array]:
        """The constants of a rest for one part of it (fractions), and the windows of its cells [s]."""
        own = constants.copy()
        own[-2:] = part
        cells = 1 if self.c.model.straight else REST_CELLS
        since, duration = constants[-4], constants[-3]
        edges = since + duration * np.linspace(*part, cells + 1)
        return own, np.stack([edges[:-1], edges[1:]], axis=1)

    def _parts(self, since: float, until: float) -> list[tuple[float, float]]:
        """Fractions of a rest that one block each can follow: fine where something decays, and where it oscillates."""
        if self.c.model.straight or until <= since:
            return [(0.0, 1.0)]
        duration = until - since
        ends = [c / r for r in self.rates for c in DECAYED if c / r < duration]
        edges = np.unique([0.0, *ends, duration])
        longest = min((REST_CELLS * 2 * np.pi / (CELLS_PER_PERIOD * w) for w in self.frequencies), default=np.inf)
        cuts = [
            np.linspace(a, b, 1 + min(max(int(np.ceil((b - a) / longest)), 1), MOST_PARTS))[:-1]
            for a, b in pairwise(edges)
        ]
        inner = np.append(np.concatenate(cuts), duration) / duration
        return list(zip(inner[:-1].tolist(), inner[1:].tolist(), strict=True))

    def _slide(self, cycle: int) -> None:
        """The slip: until the bounded state is at its bound, then until the mass rests."""
        on, arrest, middle = float(self.guess.onset[cycle]), float(self.guess.arrest[cycle]), self._middle(cycle)
        following = self.guess.onset[cycle + 1] if cycle + 1 < self.guess.cycles else self.log.end
        room = float(following) - arrest
        if self.guess.saturates[cycle] and self.held:
            index = self.c.event(self.tick, middle - on, arrest - middle)
            self.events["saturation"][cycle] = index
            self._part("slip", cycle, self.slip, self.guess.slip[cycle], (on, middle), index, (), self.held)
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
            self._part("slip", cycle, self.slip, self.guess.slip[cycle], (on, arrest), index, (), (SPEED,))
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
        """The shooting intervals of one part of a slip."""
        intervals, steps, n_x = nodes.shape[0] - 1, self.grid.steps, self.n_x
        values = nodes[1:].copy()
        unknown = np.ones((intervals, n_x), bool)
        for row, known in ((slice(None, -1), known_inside), (slice(-1, None), known_at_end)):
            for component in known:
                values[row, component] = self.c.model.states[component].lower or 0.0
                unknown[row, component] = False
        index = np.full((intervals, n_x), KNOWN)
        index[unknown] = self.c.add(values[unknown], np.broadcast_to(self.size, unknown.shape)[unknown])
        befores = np.concatenate([self.node[None], index[:-1]])
        d_end = np.array([end])
        tail = np.concatenate([self.offset, d_end, self.load])
        tail_values = np.concatenate([ZERO, ZERO, self.load_value])
        constants = np.tile(self._constants(self.size, *span, span[0]), (intervals, 1))
        fractions = np.arange(intervals + 1) / intervals
        constants[:, -2:] = np.stack([fractions[:-1], fractions[1:]], axis=1)
        cells = span[0] + (span[1] - span[0]) * np.linspace(0.0, 1.0, intervals * steps + 1)
        self.c.put_all(
            kind,
            steps,
            self.number,
            cycle,
            np.concatenate([befores, index, np.tile(tail, (intervals, 1))], axis=1),
            np.concatenate(
                [np.concatenate([self.value[None], values[:-1]]), values, np.tile(tail_values, (intervals, 1))], axis=1
            ),
            constants,
            np.stack([cells[:-1], cells[1:]], axis=1).reshape(intervals, steps, 2),
            self.own,
        )
        places[cycle, 1:] = index
        self.node, self.value = index[-1], values[-1]
        self.offset = d_end


def lay_out(
    logs: list[LogData],
    guesses: list[Guess],
    unknowns: Unknowns,
    grid: Grid,
    *,
    free: Indices | None = None,
    pace: Array | None = None,
) -> Layout:
    """Lay out the multiple-shooting problem of several logs around their guesses.

    Args:
        free: indices of the parameters that are unknown; default those `unknowns` marks as free.
        pace: theta (n_p,) whose time scales cut the rests into blocks; default the start.
    """
    model = unknowns.model
    chosen = np.flatnonzero(unknowns.free) if free is None else free
    collector = Collector(model, unknowns, chosen, unknowns.start if pace is None else pace)
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
        chosen,
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
