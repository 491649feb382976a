"""The likelihood of a record whose cycles differ: slips are filtered, strength and level of a stick integrated out.

Forces are over the load. A stick met at a level l has strength A, its onset is at l + A; A scatters about the strength
g(T) that the contact has regained after a rest T. Sliding by u takes friction to l + b(u) + x(u) + what is left of A by
the law of the effects: b is Brownian along the track and goes on under the next stick, x (Ornstein-Uhlenbeck) is fine
roughness. For every cycle the likelihood is computed on nodes of A; between cycles the level is matched by its moments.

A lane is one node of one cycle, usual or odd. Lanes stand cycle by cycle, the longest slip first, so that those still
sliding are a leading slice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.uneven.events import Sticks
from identify.uneven.slip_functions import CYCLE, MET, chain_functions, slip_functions

Array = NDArray[np.float64]

NODES = 9  # of a stick's strength, in cycles whose strength is about known
REACH = 4.0  # deviations of its logarithm, to either side
ODD_WANDER = 4.0  # by how much more the level wanders in odd slips
FIRST_LEVEL = 1.0  # of the drop: sd of the level where no cycle is seen before
LEAST_WANDER = 1e-4  # of the variance that the wander makes of the level in a slip: it is not known better after it


@dataclass(frozen=True)
class Nodes:
    """Where the likelihood of every cycle is computed: log_strength (c, n), evenly spaced per cycle."""

    log_strength: Array

    @property
    def step(self) -> Array:
        """Between neighbouring nodes (c,)."""
        return (self.log_strength[:, -1] - self.log_strength[:, 0]) / (self.log_strength.shape[1] - 1)

    @staticmethod
    def wide(sticks: Sticks, count: int = 25) -> Nodes:
        """From 8 % of the drop to 140 % of it: an undamped slip falls by twice the strength if the level stays."""
        log_drop = np.log(np.maximum(sticks.drop, 1e-6))
        return Nodes(log_drop[:, None] + np.linspace(np.log(0.08), np.log(1.4), count))

    @staticmethod
    def about(mean: Array, sd: Array, count: int = NODES) -> Nodes:
        """As far as a strength with this mean and sd of its logarithm, each (c,), may lie."""
        return Nodes(mean[:, None] + sd[:, None] * np.linspace(-REACH, REACH, count))


@dataclass(frozen=True)
class Cycles:
    """What the likelihood finds of every cycle, each (c,): log_likelihood given all before; and once the cycle itself
    was seen: log_strength of the stick with its deviation, level at the onset and after the slip, odd: the probability
    that the slip is."""

    log_likelihood: Array
    log_strength: Array
    log_strength_sd: Array
    level: Array
    level_after: Array
    odd: Array


class Likelihood:
    """Of one record, at nodes of its sticks' strengths."""

    def __init__(self, sticks: Sticks, nodes: Nodes) -> None:
        count, width = nodes.log_strength.shape
        self.sticks, self.nodes = sticks, nodes
        self.functions = slip_functions()
        self.chain, self.chain_back = chain_functions(width)
        self.block = 2 * width
        order = np.argsort(-sticks.samples, kind="stable")
        self.order, self.back = order, np.argsort(order)
        self.samples, self.time, self.force = sticks.samples[order], sticks.time[order], sticks.force[order]
        self.rig = np.array(sticks.rig.over_load(sticks.noise))
        known = np.isfinite(sticks.rest) & sticks.follows
        rest = np.where(known, sticks.rest, np.median(sticks.rest[known]) if known.any() else sticks.usual_rest)
        self.stick = np.column_stack([sticks.fallen, sticks.line, rest, np.full(count, sticks.usual_rest), known])
        place = np.empty((count, 2, width, 3))
        place[..., 0] = nodes.log_strength[:, None, :]
        place[..., 1] = np.array([1.0, ODD_WANDER**2])[:, None]
        place[..., 2] = sticks.fallen[:, None, None]
        self.place = place[order].reshape(-1, 3)
        f, resolved = self.functions, sticks.resolved
        self.ended, self.ended_back = (f.arrest, f.arrest_back) if resolved else (f.whole, f.whole_back)
        self.end = self._lanes(np.column_stack([sticks.above if resolved else sticks.end, sticks.arrest]))
        self.first_level = np.column_stack([0.5 * (sticks.line + sticks.arrest), (FIRST_LEVEL * sticks.drop) ** 2])
        self.least = LEAST_WANDER * sticks.end / sticks.rig.stiffness

    def _lanes(self, per_cycle: Array) -> Array:
        """Rows (c, m) of cycles for every lane (l, m)."""
        return np.repeat(per_cycle[self.order], self.block, axis=0)

    def _cycles(self, lanes: Array) -> Array:
        """Rows (l, m) of lanes by cycle (c, lanes of one, m)."""
        return lanes.reshape(self.order.size, self.block, -1)[self.back]

    def __call__(self, theta: Array) -> Cycles:
        """Of every cycle, given those before; theta (p,): as THETA has it."""
        return self._forward(theta).cycles

    def with_scores(self, theta: Array) -> tuple[Cycles, Array]:
        """The same, and derivatives by theta (c, p) of the log likelihood of the record, as they come from the samples
        of every cycle: they add up to the gradient."""
        found = self._forward(theta)
        return found.cycles, self._backward(theta, found)

    def _forward(self, theta: Array) -> _Forward:
        f, rig = self.functions, self.rig
        count, lanes = self.order.size, self.place.shape[0]
        all_theta, all_rig = np.broadcast_to(theta, (lanes, theta.size)), np.broadcast_to(rig, (lanes, rig.size))
        met = f.met([all_theta[:count], all_rig[:count], self.stick])[0]
        begun = f.begin([all_theta, self._lanes(met), all_rig, self.place])[0]
        state, kept = begun[:, : f.state_size], begun[:, f.state_size :]
        states = []
        for i, size in self._steps():
            states.append(state[:size].copy())
            state[:size] = f.step([state[:size], kept[:size], all_rig[:size], self._sample(i, size)])[0]
        slips = self.ended([state, kept, all_rig, self.end])[0]
        per_cycle = self._cycles(slips).transpose(0, 2, 1).reshape(count, -1)
        level = np.empty((count + 1, 2))
        before, found = np.empty((count, 2)), np.empty((count, 3 + len(CYCLE)))
        for j in range(count):
            before[j] = level[j] if self.sticks.follows[j] else self.first_level[j]
            found[j] = self._chain(j, before[j], met[j], per_cycle[j], theta)
            level[j + 1] = found[j, 1:3]
        columns = dict(zip(CYCLE, found[:, 3:].T, strict=True))
        cycles = Cycles(log_likelihood=found[:, 0], level_after=found[:, 1], **columns)
        return _Forward(cycles, met, begun, states, state, kept, per_cycle, before)

    def _steps(self) -> list[tuple[int, int]]:
        """Numbers of the samples after the first, and how many lanes are still sliding then."""
        most = int(self.samples[0]) if self.samples.size else 0
        return [(i, int(np.count_nonzero(self.samples > i)) * self.block) for i in range(1, most)]

    def _sample(self, i: int, size: int) -> Array:
        """Time since the sample before, and force, for every lane (l, 2)."""
        still = size // self.block
        rows = np.column_stack([self.time[:still, i] - self.time[:still, i - 1], self.force[:still, i]])
        return np.repeat(rows, self.block, axis=0)

    def _chain(self, j: int, before: Array, met: Array, slips: Array, theta: Array) -> Array:
        self.chain.bind(self._given(j, before, met, slips, theta))
        return self.chain().copy()

    def _given(self, j: int, before: Array, met: Array, slips: Array, theta: Array) -> list[Array]:
        eta, step = self.nodes.log_strength[j], self.nodes.step[j : j + 1]
        first = np.ascontiguousarray(met[: len(MET)])
        return [before, first, slips, theta, np.ascontiguousarray(eta), step, self.rig, self.least[j : j + 1]]

    def _backward(self, theta: Array, found: _Forward) -> Array:
        """From the last cycle to the first, and in each from the arrest to the onset."""
        f, count, lanes = self.functions, self.order.size, self.place.shape[0]
        scores, by_met = np.zeros((count, theta.size)), np.zeros_like(found.met)
        by_slips, by_level = np.empty_like(found.slips), np.zeros(2)
        many = found.slips.shape[1]
        for j in reversed(range(count)):
            given = self._given(j, found.before[j], found.met[j], found.slips[j], theta)
            self.chain_back.bind([*given, np.append(1.0, by_level)])
            back = self.chain_back()
            by_level = back[:2].copy() if self.sticks.follows[j] else np.zeros(2)
            by_met[j, : len(MET)] += back[2 : 2 + len(MET)]
            by_slips[j], scores[j] = back[2 + len(MET) :][:many], back[2 + len(MET) + many :]
        rig = np.broadcast_to(self.rig, (lanes, self.rig.size))
        seed = by_slips.reshape(count, 3, self.block).transpose(0, 2, 1)[self.order].reshape(lanes, 3)
        by_state, by_kept = self.ended_back([found.state, found.kept, rig, self.end, seed])
        for (i, size), state in reversed(list(zip(self._steps(), found.states, strict=True))):
            back, more = f.step_back(
                [state, found.kept[:size], rig[:size], self._sample(i, size), np.ascontiguousarray(by_state[:size])]
            )
            by_state[:size] = back
            by_kept[:size] += more
        all_theta = np.broadcast_to(theta, (lanes, theta.size))
        by_theta, lane_met = f.begin_back(
            [all_theta, self._lanes(found.met), rig, self.place, np.hstack([by_state, by_kept])]
        )
        scores += self._cycles(by_theta).sum(axis=1)
        by_met += self._cycles(lane_met).sum(axis=1)
        return scores + f.met_back([all_theta[:count], rig[:count], self.stick, by_met])[0]


@dataclass(frozen=True)
class _Forward:
    """What the way back needs of the way there."""

    cycles: Cycles
    met: Array
    begun: Array
    states: list[Array]
    state: Array
    kept: Array
    slips: Array
    before: Array
