"""One phase of motion without inertia: rest until the drive overcomes the grip, slide while the forces balance.

As in `phases`, switch times are located on the step itself, and time is local to the phase.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.base.crossing import first_zero
from identify.base.errors import SimulationError
from identify.model.model import Model
from identify.model.modes import GuardName, ModeName, sliding_modes
from identify.simulation.phases import Phase
from identify.simulation.quasistatic_balance import negligible
from identify.simulation.quasistatic_collocation import ESTIMATE_ORDER, Collocator, Local
from identify.simulation.resting import courses, swing
from identify.simulation.situated import Situated

Array = NDArray[np.float64]

MAX_STEPS = 200_000  # of one sliding phase: a bound, so that no scene runs for ever
FIRST = 1e-2  # the first step that is tried: the time in which the states change by that share of their sizes
SHORTEST = 1e-13  # of the first step: there is no shorter one
PER_PERIOD = 32  # steps in a period of the drive's vibration: an arrest between two is not passed over
_POWER = -1.0 / (ESTIMATE_ORDER + 1)
_EARLY = np.concatenate([[0.0], np.geomspace(1e-16, 1.0, 193)])


@dataclass(frozen=True)
class BalancedPhase(Phase):
    """A stretch of one mode without inertia; `v` (s,) are the speeds along the direction of slip at the nodes [m/s]."""

    v: Array


def sizes(model: Model, p: Array, normal_force: float) -> Array:
    """Sizes of the states (n_x,) by their units: a load of one normal force, and the elongation it makes."""
    k = float(p[model.parameter_names.index("stiffness")])
    of_unit = {"m": normal_force / k, "N": normal_force}
    return np.array([of_unit.get(state.unit, 1.0) for state in model.states])


def stick(model: Model, x: Array, situated: Situated, start: float, limit: float) -> BalancedPhase:
    """Rest from state x until the grip is overcome, or for `limit` [s].

    Without inertia a slip may come to rest with nothing to spare: what the first force that counts says, holds.
    """

    def spare(times: Array, shares: Array | None = None) -> Array:
        p, u = situated.p[:, None], situated.at(times)
        state = np.array(model.rest(x, p, u, times[None, :]))
        driving = model.driving_force(state, p, u) if shares is None else model.pulled(x, p, u, times[None, :], shares)
        return np.asarray(np.array(model.grip(state, p, u)).ravel() - np.abs(np.array(driving).ravel()))

    onset = _onset(model, situated, spare, limit)
    end = limit if onset is None else onset
    after = np.array(model.rest(x, situated.p, situated.at(end), end)).ravel()
    ended_by: GuardName | None = None if onset is None else "speed"
    return BalancedPhase("stick", start, situated, np.array([0.0, end]), np.stack([x, after]), ended_by, np.zeros(2))


def _onset(
    model: Model, situated: Situated, spare: Callable[[Array, Array | None], Array], limit: float
) -> float | None:
    """When the grip is overcome; None: not within the limit."""
    if limit <= 0.0:
        return None
    least = negligible(situated, float(np.max(situated.p[:2])))
    times = _EARLY * limit
    forces = spare(times, None)
    counts = np.flatnonzero(np.abs(forces) > least)
    if not counts.size:
        return None
    first = int(counts[0])
    if forces[first] < 0.0:
        return float(times[max(first - 1, 0)])
    since = float(times[first])
    if limit - since <= 0.0:
        return None
    *below, whole = courses(model, situated.p, lambda t, shares: spare(since + t, shares))
    found = first_zero(whole, limit - since, below)
    return None if found is None else since + found


@dataclass(frozen=True)
class _Node:
    """A point of a slide: time in the phase [s], state (n_x,), speed [m/s] and what the balance says there."""

    t: float
    x: Array
    v: float
    here: Local


class Slide:
    """Sliding in one mode until one of its guards falls to zero, or no stable speed balances the forces any more.

    Args:
        locate: False takes the step at whose end a guard is negative as it is (a control for tests).
    """

    def __init__(self, machine: Collocator, mode: ModeName, situated: Situated, *, locate: bool = True) -> None:
        self.machine, self.mode, self.situated, self._locates = machine, mode, situated, locate
        self._exits = tuple(dict(sliding_modes(machine.model.clamped is not None)[mode].exits))
        self._shortest, self._longest = 0.0, swing(machine.model, situated.p)[0] / PER_PERIOD

    def run(self, x: Array, v: float, start: float, limit: float) -> BalancedPhase:
        """The phase from state x and speed v, beginning at `start` [s], of `limit` [s] at most.

        Raises:
            SimulationError: more than MAX_STEPS steps.
        """
        self.machine.situate(self.situated)
        node = _Node(0.0, x, v, self.machine.local(self.mode, x, v, 0.0))
        nodes = [node]
        h = min(limit, FIRST * float(np.min(self.machine.scale / np.maximum(np.abs(node.here.rate), 1e-300))))
        self._shortest = SHORTEST * h
        for _ in range(MAX_STEPS):
            h = min(h, self._longest)
            last = h >= limit - node.t
            h = limit - node.t if last else h
            there, norm = self._advance(node, h)
            if there is None:
                h, last = self._reach(node, h), False
                there, norm = self._advance(node, h) if h > 0.0 else (None, 0.0)
                if there is None or (norm <= 1.0 and not self._fallen(there)):
                    return self._phase([*nodes, *([there] if there else [])], start, "fold")
            if norm > 1.0:
                h *= max(0.2, 0.9 * norm**_POWER)
                if h < self._shortest:
                    return self._phase(nodes, start, "fold")
                continue
            if self._fallen(there):
                end, guard = self._end(node, there, h)
                return self._phase([*nodes, end], start, guard)
            node = replace(there, t=limit) if last else there
            nodes.append(node)
            if last:
                return self._phase(nodes, start, None)
            h *= min(5.0, max(0.2, 0.9 * max(norm, 1e-10) ** _POWER))
        raise SimulationError(
            f"the {self.mode} phase at {start:.6g} s did not end within {MAX_STEPS} steps (it reached {node.t:.3g} s): "
            "without inertia its speed changes too fast; add the effect inertia"
        )

    def _phase(self, nodes: list[_Node], start: float, guard: GuardName | None) -> BalancedPhase:
        t, x, v = np.array([n.t for n in nodes]), np.array([n.x for n in nodes]), np.array([n.v for n in nodes])
        return BalancedPhase(self.mode, start, self.situated, t, x, guard, v)

    def _advance(self, node: _Node, h: float) -> tuple[_Node | None, float]:
        """The point after a step, None where no stable speed is found, and the error norm."""
        step = self.machine.step(self.mode, node.x, node.v, node.here, node.t, h)
        if step is None:
            return None, 0.0
        stages, norm = step
        x = stages[-1, :-1].copy()
        there = self.machine.local(self.mode, x, float(stages[-1, -1]), node.t + h)
        lost = not there.stable
        if there.speed < 0.0:
            # A speed that is unstable at zero did not get below zero by itself: that is another branch.
            lost = lost or self.machine.local(self.mode, x, 0.0, node.t + h).by_speed > 0.0
        return (None if lost else _Node(node.t + h, x, there.speed, there)), norm

    def _reach(self, node: _Node, h: float) -> float:
        """The longest part of a step at whose end there is a stable speed [s]; 0: there is none.

        Only roughly, while a step that long would not be accurate enough anyway.
        """
        low, high = 0.0, h
        while high - low > max(1e-12 * high, self._shortest):
            middle = 0.5 * (low + high)
            there, norm = self._advance(node, middle)
            low, high = (low, middle) if there is None else (middle, high)
            if there is not None and norm > 1.0:
                break
        return low

    def _guard(self, guard: GuardName, node: _Node) -> float:
        model = self.machine.model
        if guard == "speed" or model.clamped is None:
            return node.v
        if guard == "release":
            return -node.here.free
        return float(node.x[model.clamped] - (model.states[model.clamped].lower or 0.0))

    def _fallen(self, node: _Node) -> list[GuardName]:
        return [guard for guard in self._exits if self._guard(guard, node) < 0.0]

    def _end(self, node: _Node, there: _Node, h: float) -> tuple[_Node, GuardName]:
        """Where in the step the first guard is zero, and which."""
        length, guard = min((self._root(g, node, h) if self._locates else h, g) for g in self._fallen(there))
        end = self._advance(node, length)[0] if length > 0.0 else node
        end = end or there
        x, model = end.x.copy(), self.machine.model
        if guard == "clearance" and model.clamped is not None:
            x[model.clamped] = model.states[model.clamped].lower or 0.0
        return replace(end, x=x, v=0.0 if guard == "speed" else end.v), guard

    def _root(self, guard: GuardName, node: _Node, h: float) -> float:
        """The step length at which a guard is zero [s]."""

        def value(length: float) -> float:
            there = self._advance(node, length)[0] if length > 0.0 else node
            return -np.inf if there is None else self._guard(guard, there)

        # A slide may start with a guard at zero: find where it is positive first, if anywhere.
        low = next((f * h for f in (0.0, 0.5, 0.25, 0.1, 1e-2, 1e-4) if value(f * h) > 0.0), None)
        if low is None:
            return 0.0
        return float(brentq(value, low, h, xtol=1e-15 * h, rtol=1e-14))
