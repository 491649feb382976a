"""Where a walk along one log stands, and the blocks it can put from there: rests and parts of slides."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import Grid, Guess, LogData
from identify.model.model import SPEED
from identify.shooting.block_equations import BlockKind
from identify.shooting.collector import Collector
from identify.shooting.layout import KNOWN, Indices
from identify.shooting.rest_parts import after_reageing, cut, parts_of_rest
from identify.simulation.steadiness import rate_slopes

Array = NDArray[np.float64]
NO_OFFSET = np.array([KNOWN])
ZERO = np.zeros(1)


class Footing:
    """The place in one log: the node before with its values, the offset of its time, since when, the normal force, and
    whether the contact re-aged there. Every block that is put ends in the next place."""

    def __init__(self, collector: Collector, number: int, log: LogData, guess: Guess, grid: Grid) -> None:
        self.c, self.number, self.log, self.guess, self.grid = collector, number, log, guess, grid
        model = collector.model
        self.n_x = len(model.states)
        p = collector.unknowns.values(guess.theta(collector.unknowns.start), log.base)
        k, m = (p[model.parameter_names.index(n)] for n in ("stiffness", "mass"))
        force = 0.1 * log.mean_normal_force
        by_unit = {"m": force / k, "m/s": force / np.sqrt(k * m), "N": force}
        self.size = np.array([by_unit.get(s.unit, 1.0) for s in model.states])
        # of what makes a rest no straight line
        self.rates, self.frequencies = (np.array(f(p)).ravel() for f in (model.decays, model.waves))
        self.rest_rows = self.size.copy()
        self.rest_rows[SPEED] = force  # the onset guard is a force
        self.tick = 0.1 * float(np.sqrt(m / k))
        self.held = () if model.clamped is None else (model.clamped,)
        self.own = np.full(len(model.parameters), KNOWN)
        self.node, self.value, self.offset = np.full(self.n_x, KNOWN), guess.start, NO_OFFSET
        self.load, self.load_value = NO_OFFSET, ZERO
        self.since, self.reaged = log.begin, False

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
        mean, sd = (np.array([x]) for x in u.own_prior(i, float(start[0])))
        return int(self.c.add(start, u.spread[one], u.lower[one], u.upper[one], mean=mean, sd=sd)[0])

    def _constants(self, rows: Array, start: float, end: float, slope_at: float) -> Array:
        force_start, force_end = self.log.normal_force.at([start, end])
        slope = self.log.normal_force.line(slope_at)[1]
        drive = self.log.speed_at(0.5 * (start + end))
        ends = [drive, force_start, force_end, slope, start, end - start, 0.0, 1.0]
        return np.concatenate([self.log.base, rows, ends])

    def _last_rest(self, cycle: int) -> None:
        """The rest that the end of the window cuts."""
        constants = self._constants(self.rest_rows, self.since, self.log.end, self.log.end)
        parts = self._parts(self.since, self.log.end)
        self._reaging(cycle, constants, len(parts), NO_OFFSET, ZERO)
        for part in parts:
            self._rest_part(cycle, NO_OFFSET, NO_OFFSET, ZERO, constants, part)

    def _rest_until(self, cycle: int, on: float, index: int, state: Array) -> Indices:
        """A rest that ends in a node: with the onset guard at an event, without it (index KNOWN) at a given time."""
        value = state.copy()
        value[SPEED] = 0.0
        node = self.c.state(value, self.size, (SPEED,))
        constants = self._constants(self.rest_rows, self.since, on, on)
        *before, last = self._parts(self.since, on)
        self._reaging(cycle, constants, len(before) + 1, self.load, self.load_value)
        for part in before:
            self._rest_part(cycle, np.array([index]), self.load, self.load_value, constants, part)
        self.c.put(
            _kind("hold" if index == KNOWN else "stick", self.reaged),
            1,
            self.number,
            cycle,
            [self.node, node, self.offset, np.array([index]), self.load],
            [self.value, value, ZERO, ZERO, self.load_value],
            *self._cut(constants, last),
            self.own,
        )
        self.node, self.value, self.offset = node, value, np.array([index])
        return node

    def _reaging(self, cycle: int, constants: Array, parts: int, load: Indices, load_value: Array) -> None:
        """A node after the contact re-aged, where more than one block would each go through that moment again."""
        if not self.reaged or parts == 1:
            return
        moment = self._cut(constants, (0.0, 0.0))[0]
        theta = self.guess.theta(self.c.unknowns.start)[self.c.source]
        value = after_reageing(self.c.model, self.value, theta, moment, self.rest_rows)
        node = self.c.state(value, self.size, (SPEED,))
        self.c.put(
            "reageing",
            1,
            self.number,
            cycle,
            [self.node, node, self.offset, self.offset, load],
            [self.value, value, ZERO, ZERO, load_value],
            moment,
            np.full((1, 2), self.since),
            self.own,
        )
        self.node, self.value, self.reaged = node, value, False

    def _rest_part(
        self, cycle: int, end: Indices, load: Indices, load_value: Array, constants: Array, part: tuple[float, float]
    ) -> None:
        """A part of a rest without the guard that ends it."""
        self.c.put(
            _kind("rest", self.reaged),
            1,
            self.number,
            cycle,
            [self.node, self.offset, end, load],
            [self.value, ZERO, ZERO, load_value],
            *self._cut(constants, part),
            self.own,
        )

    def _cut(self, constants: Array, part: tuple[float, float]) -> tuple[Array, Array]:
        return cut(constants, part, self.c.model.straight)

    def _parts(self, since: float, until: float) -> list[tuple[float, float]]:
        return [(0.0, 1.0)] if self.c.model.straight else parts_of_rest(self.rates, self.frequencies, until - since)

    def _line_by_line(self, rows: Array, span: tuple[float, float], intervals: int) -> Array:
        """The constants of the intervals of a slide, with the normal force as a straight line over each: the tremor of
        a finger goes through half a period while a slip lasts. Written as lines from the start of the slide.

        A guess whose events coincide has a slide of no length: its normal force is level, not undefined."""
        since = (span[1] - span[0]) * shares(intervals)
        forces = self.log.normal_force.at(span[0] + since)
        width = since[1:] - since[:-1]
        slope = np.divide(forces[1:] - forces[:-1], width, out=np.zeros(intervals), where=width > 0.0)
        local = np.tile(self._constants(rows, *span, span[0]), (intervals, 1))
        local[:, -7], local[:, -5] = forces[:-1] - slope * since[:-1], slope
        return local

    def _intervals(
        self,
        kind: BlockKind,
        cycle: int,
        nodes: Array,
        span: tuple[float, float],
        end: int,
        known_inside: tuple[int, ...],
        known_at_end: tuple[int, ...],
        local: Array | None = None,
    ) -> Indices:
        """The shooting intervals of one part of a slide: indices of the nodes at their ends (n, n_x).

        Args:
            end: index of the event that ends it, KNOWN at a given time; local: constants of each interval in place of
                those of the whole span.
        """
        intervals, steps, n_x = nodes.shape[0] - 1, self.grid.steps, self.n_x
        values, index = nodes[1:].copy(), np.full((intervals, n_x), KNOWN)
        for row, known in ((slice(None, -1), known_inside), (slice(-1, None), known_at_end)):
            for component in known:
                values[row, component] = self.c.model.states[component].lower or 0.0
        unknown = _unknown(intervals, n_x, known_inside, known_at_end)
        index[unknown] = self.c.add(values[unknown], np.broadcast_to(self.size, unknown.shape)[unknown])
        d_end, fractions = np.array([end]), shares(intervals)
        slots = np.empty((intervals, 2 * n_x + 2 + self.load.size), dtype=np.int64)
        fixed = np.zeros(slots.shape)
        for table, before, nodes_at, load in (
            (slots, self.node, index, self.load),
            (fixed, self.value, values, self.load_value),
        ):
            table[0, :n_x], table[1:, :n_x], table[:, n_x : 2 * n_x] = before, nodes_at[:-1], nodes_at
            table[:, 2 * n_x + 2 :] = load
        slots[:, 2 * n_x], slots[:, 2 * n_x + 1] = self.offset[0], end
        constants = np.tile(self._constants(self.size, *span, span[0]), (intervals, 1)) if local is None else local
        constants[:, -2], constants[:, -1] = fractions[:-1], fractions[1:]
        cells = span[0] + (span[1] - span[0]) * shares(intervals * steps)
        edges = np.empty((intervals, steps, 2))
        edges[..., 0], edges[..., 1] = cells[:-1].reshape(intervals, steps), cells[1:].reshape(intervals, steps)
        last = intervals - 1 if kind == "released" else intervals  # the guard is in the last interval
        for name, part in (("saturated" if kind == "released" else kind, slice(0, last)), (kind, slice(last, None))):
            if slots[part].size:
                self.c.put_all(
                    name, steps, self.number, cycle, slots[part], fixed[part], constants[part], edges[part], self.own
                )
        self.node, self.value = index[-1], values[-1]
        self.offset = d_end
        return index

    def _rates(self, state: Array, at: float) -> Array:
        """Derivatives of the rates of all states with respect to the states (n_x, n_x) [1/s per unit]."""
        unknowns, model = self.c.unknowns, self.c.model
        p = unknowns.values(self.guess.theta(unknowns.start), self.log.base)
        return rate_slopes(model, state, p, np.array([self.log.speed_at(at), self.log.normal_force.at(at), 1.0, at]))

    def _pace_of_bound(self, state: Array, at: float) -> float:
        """A typical rate of the bounded state [1/s]."""
        return float(np.max(np.abs(self._rates(state, at)[list(self.held)]) * self.size))


@lru_cache(maxsize=64)
def shares(parts: int) -> Array:
    """The shares at which something is cut into so many equal parts (parts + 1,); not to be written to."""
    out = np.linspace(0.0, 1.0, parts + 1)
    out.setflags(write=False)
    return out


@lru_cache(maxsize=64)
def _unknown(intervals: int, n_x: int, inside: tuple[int, ...], at_end: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which components of the nodes (intervals, n_x) at the ends of intervals are unknown; not to be written to."""
    out = np.ones((intervals, n_x), bool)
    out[:-1, list(inside)] = False
    out[-1, list(at_end)] = False
    out.setflags(write=False)
    return out


def _kind(kind: str, reaged: bool) -> BlockKind:
    """The kind of a rest, by whether the contact re-aged in the last moment of the slide before it."""
    return f"{kind}_reaged" if reaged else kind  # type: ignore[return-value]
