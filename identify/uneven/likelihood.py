"""The likelihood of a record whose cycles differ: slips are filtered, strength and level of a stick integrated out.

Forces are over the load. A stick met at a level l has strength A, its onset is at l + A; A scatters about the strength
g(T) that the contact has regained after a rest T. Sliding by u takes friction to l + b(u) + x(u) + what is left of A:
b is Brownian along the track and goes on under the next stick, x (Ornstein-Uhlenbeck) is fine roughness. For every
cycle the likelihood is computed on nodes of A; between cycles the level is matched by its moments.

A batch row is one node of one cycle. Rows stand cycle by cycle, the longest slip first, so that those still sliding are
a leading slice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.uneven.events import Sticks
from identify.uneven.slip_functions import CYCLE, ONSET, chain_functions, slip_functions

Array = NDArray[np.float64]

NODES, REACH = 9, 4.0  # of a stick's strength where it is about known, and its deviations to either side


@dataclass(frozen=True)
class Nodes:
    """Where the likelihood of every cycle is computed: log_strength (c, n), evenly spaced per cycle."""

    log_strength: Array

    @staticmethod
    def wide(sticks: Sticks) -> Nodes:
        """From 8 % of the drop to 140 % of it: an undamped slip falls by twice the strength if the level stays."""
        log_drop = np.log(np.maximum(sticks.drop, 1e-6))
        return Nodes(log_drop[:, None] + np.linspace(np.log(0.08), np.log(1.4), 25))

    @staticmethod
    def about(mean: Array, sd: Array) -> Nodes:
        """As far as a strength with this mean and sd of its logarithm, each (c,), may lie."""
        return Nodes(mean[:, None] + sd[:, None] * np.linspace(-REACH, REACH, NODES))


@dataclass(frozen=True)
class Cycles:
    """Per cycle, each (c,): log_likelihood given all before; and given the cycle itself: log_strength of the stick with
    its deviation, level at the onset."""

    log_likelihood: Array
    log_strength: Array
    log_strength_sd: Array
    level: Array


@dataclass(frozen=True)
class _Forward:
    """What the reverse pass needs of the forward one."""

    cycles: Cycles
    onset: Array
    begun: Array
    states: list[Array]
    state: Array
    slips: Array
    before: Array


class Likelihood:
    """Of one record, at nodes of its sticks' strengths."""

    def __init__(self, sticks: Sticks, nodes: Nodes) -> None:
        count, self.width = nodes.log_strength.shape
        self.sticks, self.nodes, self.functions = sticks, np.ascontiguousarray(nodes.log_strength), slip_functions()
        self.chain, self.chain_back = chain_functions(self.width)
        self.order = np.argsort(-sticks.samples, kind="stable")
        self.back = np.argsort(self.order)
        self.time, self.force, samples = (a[self.order] for a in (sticks.time, sticks.force, sticks.samples))
        # Numbers of the samples after the first, and how many cycles are still sliding then.
        self.steps = [(i, int(np.count_nonzero(samples > i))) for i in range(1, int(samples.max(initial=1)))]
        self.rig = np.array(sticks.rig.over_load(sticks.noise))
        known = np.isfinite(sticks.rest)
        rest = np.where(known, sticks.rest, np.median(sticks.rest[known]) if known.any() else sticks.usual_rest)
        self.stick = np.column_stack([sticks.fallen, sticks.line, rest, np.full(count, sticks.usual_rest), known])
        fallen = np.broadcast_to(sticks.fallen[:, None], self.nodes.shape)
        self.place = np.stack([self.nodes, fallen], axis=-1)[self.order].reshape(-1, 2)
        self.end = self._rows(np.column_stack([sticks.above, sticks.arrest]))
        # Where no cycle precedes, the level is known to a drop.
        self.first_level = np.column_stack([0.5 * (sticks.line + sticks.arrest), sticks.drop**2])

    def _rows(self, per_cycle: Array) -> Array:
        """Values (c, m) of cycles for every batch row (r, m)."""
        return np.repeat(per_cycle[self.order], self.width, axis=0)

    def _cycles(self, rows: Array) -> Array:
        """Values (r, m) of batch rows by cycle (c, n, m)."""
        return rows.reshape(self.order.size, self.width, -1)[self.back]

    def __call__(self, theta: Array) -> Cycles:
        """Of every cycle, given those before; theta (p,): as THETA has it."""
        return self._forward(theta).cycles

    def with_scores(self, theta: Array) -> tuple[Cycles, Array]:
        """The same, and derivatives by theta (c, p) of the log likelihood of the record, as they come from the samples
        of every cycle: they add up to the gradient."""
        forward = self._forward(theta)
        return forward.cycles, self._backward(theta, forward)

    def _forward(self, theta: Array) -> _Forward:
        f, count, rows = self.functions, self.order.size, self.place.shape[0]
        all_theta, all_rig = (np.broadcast_to(values, (rows, values.size)) for values in (theta, self.rig))
        onset = f.onset([all_theta[:count], all_rig[:count], self.stick])[0]
        begun = f.begin([all_theta, self._rows(onset), all_rig, self.place])[0]
        state, kept = begun[:, : f.state_size].copy(), begun[:, f.state_size :]
        states = []
        for i, cycles in self.steps:
            size = cycles * self.width
            states.append(state[:size].copy())
            state[:size] = f.step([state[:size], kept[:size], all_rig[:size], self._sample(i, cycles)])[0]
        slips = self._cycles(f.arrest([state, kept, all_rig, self.end])[0]).transpose(0, 2, 1).reshape(count, -1)
        level, before = np.empty(2), np.empty((count, 2))
        chained = np.empty((count, 3 + len(CYCLE)))
        for j in range(count):
            before[j] = level if self.sticks.follows[j] else self.first_level[j]
            self.chain.bind(self._given(j, before[j], onset[j], slips[j], theta))
            chained[j] = self.chain()
            level = chained[j, 1:3]
        columns = dict(zip(CYCLE, chained[:, 3:].T, strict=True))
        of_cycles = Cycles(log_likelihood=chained[:, 0], **columns)
        return _Forward(of_cycles, onset, begun, states, state, slips, before)

    def _sample(self, i: int, cycles: int) -> Array:
        """Time since the sample before, and force, for every batch row (r, 2)."""
        rows = np.column_stack([self.time[:cycles, i] - self.time[:cycles, i - 1], self.force[:cycles, i]])
        return np.repeat(rows, self.width, axis=0)

    def _given(self, j: int, before: Array, onset: Array, slips: Array, theta: Array) -> list[Array]:
        eta, sticks = self.nodes[j], self.sticks
        least = np.array([1e-4 * sticks.drop[j] / sticks.rig.stiffness])
        return [before, onset, slips, theta, eta, np.diff(eta[:2]), self.rig, least]

    def _backward(self, theta: Array, forward: _Forward) -> Array:
        """From the last cycle to the first, and in each from the arrest to the onset."""
        f, count, rows = self.functions, self.order.size, self.place.shape[0]
        scores, by_onset = np.zeros((count, theta.size)), np.empty_like(forward.onset)
        by_slips, by_level, ends = np.empty_like(forward.slips), np.zeros(2), np.cumsum([2, len(ONSET), 3 * self.width])
        for j in reversed(range(count)):
            given = self._given(j, forward.before[j], forward.onset[j], forward.slips[j], theta)
            self.chain_back.bind([*given, np.append(1.0, by_level)])
            back, by_onset[j], by_slips[j], scores[j] = np.split(self.chain_back().copy(), ends)
            by_level = back if self.sticks.follows[j] else np.zeros(2)
        all_theta, rig = (np.broadcast_to(values, (rows, values.size)) for values in (theta, self.rig))
        seed = by_slips.reshape(count, 3, self.width).transpose(0, 2, 1)[self.order].reshape(rows, 3)
        kept = forward.begun[:, f.state_size :]
        by_state, by_kept = f.arrest_back([forward.state, kept, rig, self.end, seed])
        for (i, cycles), state in zip(reversed(self.steps), reversed(forward.states), strict=True):
            size = cycles * self.width
            by_state[:size], more = f.step_back(
                [state, kept[:size], rig[:size], self._sample(i, cycles), by_state[:size]]
            )
            by_kept[:size] += more
        by_begun = np.hstack([by_state, by_kept])
        by_theta, more = f.begin_back([all_theta, self._rows(forward.onset), rig, self.place, by_begun])
        scores += self._cycles(by_theta).sum(axis=1)
        by_onset += self._cycles(more).sum(axis=1)
        return scores + f.onset_back([all_theta[:count], rig[:count], self.stick, by_onset])[0]
