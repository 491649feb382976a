"""Where every unknown stands in the vector the solver sees, and which block takes which of them.

Known values (speed at onset and arrest, a clamped state) are constants, never variables with equal bounds:
otherwise rows become redundant and the multipliers never converge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.blocks import Block, BlockKind, block
from identify.guess import Grid, Guess, LogData
from identify.model import SPEED, Model
from identify.unknowns import Unknowns

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


@dataclass(frozen=True)
class Layout:
    """The whole problem: families of blocks over one vector of n unknowns and m rows.

    free (f,) indices of the parameters that are unknown: they are the first f unknowns; scale (n,) size of
    each unknown; start, lower, upper (n,) in physical units; events (e,) indices of the event offsets;
    prior_mean, prior_sd (n,).
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

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.scale.size


class _Collector:
    """Gathers unknowns, rows and blocks while the layout is built; thrown away afterwards."""

    def __init__(self, model: Model, unknowns: Unknowns, free: Indices) -> None:
        self.model, self.unknowns = model, unknowns
        self.scale: list[Array] = [unknowns.spread[free]]
        self.start: list[Array] = [unknowns.start[free]]
        self.lower: list[Array] = [unknowns.lower[free]]
        self.upper: list[Array] = [unknowns.upper[free]]
        self.mean: list[Array] = [unknowns.prior_mean[free]]
        self.sd: list[Array] = [unknowns.prior_sd[free]]
        self.count, self.rows = free.size, 0
        self.theta = np.full(len(unknowns.names), KNOWN)
        self.theta[free] = np.arange(free.size)
        self.events: list[int] = []
        self.parts: dict[tuple[BlockKind, int], list[tuple[Array, ...]]] = {}

    def add(
        self,
        start: Array,
        scale: Array,
        lower: Array | None = None,
        upper: Array | None = None,
        mean: Array | None = None,
        sd: Array | None = None,
    ) -> Indices:
        """New unknowns; without bounds, without prior unless given. Returns their indices."""
        n = start.size
        infinite = np.full(n, np.inf)
        self.start.append(start)
        self.scale.append(scale)
        self.lower.append(-infinite if lower is None else lower)
        self.upper.append(infinite if upper is None else upper)
        self.mean.append(np.zeros(n) if mean is None else mean)
        self.sd.append(infinite if sd is None else sd)
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
        index = int(self.add(0 * one, scale * one, -0.45 * left * one, 0.45 * right * one)[0])
        self.events.append(index)
        return index

    def put(
        self,
        kind: BlockKind,
        steps: int,
        log: int,
        cycle: int,
        slots: list[Indices],
        fixed: list[Array],
        constants: Array,
        edges: Array,
    ) -> None:
        """One block: its slots are the given ones and the parameters."""
        made = block(self.model, kind, steps)
        rows = np.arange(self.rows, self.rows + made.n_rows)
        self.rows += made.n_rows
        entry = (
            np.concatenate([*slots, self.theta]),
            np.concatenate([*fixed, self.unknowns.start]),
            constants,
            rows,
            np.array([log]),
            np.array([cycle]),
            edges,
        )
        self.parts.setdefault((kind, steps), []).append(entry)

    def families(self) -> tuple[Family, ...]:
        return tuple(
            Family(block(self.model, kind, steps), *(np.stack(column) for column in zip(*entries, strict=True)))
            for (kind, steps), entries in self.parts.items()
        )


def lay_out(
    logs: list[LogData], guesses: list[Guess], unknowns: Unknowns, grid: Grid, *, free: Indices | None = None
) -> Layout:
    """Lay out the multiple-shooting problem of several logs around their guesses.

    Args:
        free: indices of the parameters that are unknown; default those `unknowns` marks as free.
    """
    model = unknowns.model
    chosen = np.flatnonzero(unknowns.free) if free is None else free
    collector = _Collector(model, unknowns, chosen)
    for number, (log, guess) in enumerate(zip(logs, guesses, strict=True)):
        _lay_out_log(collector, number, log, guess, grid)
    families = tuple(
        Family(f.block, f.slots, f.fixed, f.constants, f.rows, f.log[:, 0], f.cycle[:, 0], f.edges)
        for f in collector.families()
    )
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
    )


def _lay_out_log(c: _Collector, number: int, log: LogData, guess: Guess, grid: Grid) -> None:
    model, n_x = c.model, len(c.model.states)
    p = c.unknowns.values(c.unknowns.start, log.base)
    k, m = (p[model.parameter_names.index(n)] for n in ("stiffness", "mass"))
    force = 0.1 * log.mean_normal_force
    size = np.ones(n_x)
    size[0], size[1] = force / k, force / np.sqrt(k * m)
    row = size.copy()
    tick = 0.1 * np.sqrt(m / k)
    held = () if model.clamped is None else (model.clamped,)
    no_offset = np.array([KNOWN])
    zero = np.zeros(1)

    rest_row = row.copy()
    rest_row[SPEED] = force  # the onset guard is a force

    def constants(scales: Array, start: float, end: float, slope_at: float, first: float, last: float) -> Array:
        force_start, force_end = log.normal_force.at([start, end])
        slope = log.normal_force.line(slope_at)[1]
        ends = [log.drive_speed, force_start, force_end, slope, end - start, first, last]
        return np.concatenate([log.base, scales, ends])

    def rest_constants(start: float, end: float) -> Array:
        return constants(rest_row, start, end, end, 0.0, 1.0)

    # The state the record starts from: elongation free, bounded states with a weak prior.
    extra = list(range(2, n_x))
    here = np.full(n_x, KNOWN)
    here[[0]] = c.add(guess.start[[0]], size[[0]])
    if extra:
        half = np.full(len(extra), 0.5)
        here[extra] = c.add(guess.start[extra], size[extra], mean=half, sd=half)
    value, since, offset, reaged = guess.start, log.begin, no_offset, False
    for j in range(guess.cycles):
        on, arrest = float(guess.onset[j]), float(guess.arrest[j])
        saturates = bool(guess.saturates[j]) and model.clamped is not None
        middle = float(guess.saturation[j]) if saturates else arrest
        d_on = np.array([c.event(tick, on - since, middle - on)])
        at_onset = c.state(guess.slip[j, 0], size, (SPEED,))
        rest_value = guess.slip[j, 0].copy()
        rest_value[SPEED] = 0.0
        c.put(
            "stick_reaged" if reaged else "stick",
            1,
            number,
            j,
            [here, at_onset, offset, d_on],
            [value, rest_value, zero, zero],
            rest_constants(since, on),
            np.array([[since, on]]),
        )
        before, before_value = at_onset, rest_value
        parts = [("slip", grid.slip, guess.slip[j], on, middle, ())]
        if saturates:
            parts.append(("saturated", grid.saturated, guess.saturated[j], middle, arrest, held))
        d_start = d_on
        for index, (kind, intervals, nodes, t0, t1, fixed) in enumerate(parts):
            last_part = index == len(parts) - 1
            right = (_next(guess, j, log) - arrest) if last_part else arrest - middle
            d_end = np.array([c.event(tick, t1 - t0, right)])
            for i in range(intervals):
                final = i == intervals - 1
                known = tuple(fixed)
                if final:
                    known = (*held, SPEED) if last_part and saturates else (SPEED,) if last_part else held
                node_value = nodes[i + 1].copy()
                if final and last_part:
                    node_value[SPEED] = 0.0
                for g in set(known) - {SPEED}:
                    node_value[g] = model.states[g].lower
                node = c.state(node_value, size, known)
                f0, f1 = i / intervals, (i + 1) / intervals
                cells = np.linspace(f0, f1, grid.steps + 1) * (t1 - t0) + t0
                c.put(
                    kind,
                    grid.steps,
                    number,
                    j,
                    [before, node, d_start, d_end],  # type: ignore[arg-type]
                    [before_value, node_value, zero, zero],
                    constants(row, t0, t1, t0, f0, f1),
                    np.stack([cells[:-1], cells[1:]], axis=1),
                )
                before, before_value = node, node_value
            d_start = d_end
        here, value, since, offset, reaged = before, before_value, arrest, d_start, saturates
    c.put(
        "rest_reaged" if reaged else "rest",
        1,
        number,
        guess.cycles,
        [here, offset, no_offset],
        [value, zero, zero],
        rest_constants(since, log.end),
        np.array([[since, log.end]]),
    )


def _next(guess: Guess, j: int, log: LogData) -> float:
    """When the stick after cycle j ends [s]."""
    return float(guess.onset[j + 1]) if j + 1 < guess.cycles else log.end
