"""One phase of motion without inertia: rest until the drive overcomes the static limit, slide while the forces balance.

As in `phases`, switch times are located on the step itself, and time is local to the phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.model.model import Model
from identify.model.modes import GuardName, ModeName, sliding_modes
from identify.simulation.phases import Phase, from_zero
from identify.simulation.plan import Plan
from identify.simulation.quasistatic import (
    CLOSE,
    ESTIMATE_ORDER,
    NEWTON_STEPS,
    NODES,
    Collocator,
    Local,
    local_function,
    negligible,
    settle,
    stage_function,
)
from identify.simulation.resting import Resting, borrowed, give_back, swing
from identify.simulation.stepper import Situated
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

MAX_STEPS = 200_000  # of one sliding phase: a bound, so that no scene runs for ever
FIRST = 1e-2  # the first step that is tried: the time in which the states change by that share of their sizes
SHORTEST = 1e-13  # of the first step: there is no shorter one
PER_PERIOD = 32  # steps in a period of the drive's vibration: an arrest between two is not passed over
_POWER = -1.0 / (ESTIMATE_ORDER + 1)


@dataclass(frozen=True)
class BalancedPhase(Phase):
    """A stretch of one mode without inertia; `v` (s,) are the speeds along the direction of slip at the nodes [m/s],
    `drive_force` that of the drive on a resting contact at its end [N]."""

    v: Array
    drive_force: float = 0.0


def sizes(model: Model, p: Array, normal_force: float) -> Array:
    """Sizes of the states (n_x,) by their units: a load of one normal force, and the elongation it makes."""
    k = float(p[model.parameter_names.index("stiffness")])
    of_unit = {"m": normal_force / k, "N": normal_force}
    return np.array([of_unit.get(state.unit, 1.0) for state in model.states])


def stick(rests: Resting, x: Array, situated: Situated, limit: float) -> BalancedPhase:
    """Rest from state x until the static limit is overcome, or for `limit` [s].

    Without inertia a slip may come to rest with nothing to spare: what the first force that counts says, holds.
    """
    least = negligible(situated, float(np.max(situated.p[:2])))
    onset, after, force = rests.from_balance(x, situated, limit, least)
    end = limit if onset is None else onset
    ended_by: GuardName | None = None if onset is None else "speed"
    times, states = np.array([0.0, end]), np.stack([x, after])
    return BalancedPhase("stick", situated.time, situated, times, states, ended_by, np.zeros(2), force)


@dataclass(frozen=True)
class _Node:
    """A point of a slide: time in the phase [s], state (n_x,), speed [m/s] and what the balance says there."""

    t: float
    x: Array
    v: float
    here: Local


class BalancedSlide:
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

        return from_zero(value, h)


# ----------------------------------------------------------------------------------------------------------------------
# A motion simulated without inertia, and its samples: as `trajectory`, the speed following from the balance.
# ----------------------------------------------------------------------------------------------------------------------

METHOD = "radau in balance"  # the name by which its method is reported
BRIEF = 1e-6  # of a step: what is nearer to its start lies on a straight line


@dataclass(frozen=True)
class BalancedTrajectory(Trajectory):
    """A motion without inertia: phases with speeds, and the same samples as with it."""

    phases: Sequence[BalancedPhase]

    @property
    def methods(self) -> tuple[str, ...]:
        """The one method there is, where anything slides."""
        return (METHOD,) if any(phase.mode != "stick" for phase in self.phases) else ()

    def _moments(self, t: Array) -> dict[str, Array]:
        """The samples at rising times t (n,) [s], the force of the moment."""
        names = (*(s.name for s in self.model.states), "sliding_speed")
        out = {name: np.empty(t.size) for name in (*names, "force", "normal_force", "coefficient", "sliding")}
        starts = np.array([p.start for p in self.phases])
        cuts = np.append(np.searchsorted(t, starts[1:], side="left"), t.size)
        first = 0
        for phase, last in zip(self.phases, cuts.tolist(), strict=True):
            if last > first:
                _sample_phase(self.model, phase, t[first:last] - phase.start, out, slice(first, last))
            first = last
        return out


def _sample_phase(model: Model, phase: BalancedPhase, t: Array, out: dict[str, Array], where: slice) -> None:
    """Fill the samples of one phase; t (n,) is local to it."""
    s, n = phase.situated, t.size
    t = np.clip(t, 0.0, phase.duration)
    p, u = np.repeat(s.p[:, None], n, axis=1), s.at(t, s.direction)
    speeds = np.zeros((1, n))
    if phase.mode == "stick":
        x = np.array(model.rest(np.repeat(phase.x[0][:, None], n, axis=1), p, u, t[None, :]))
        load = np.array(model.driving_force(x, p, u)).ravel()
    else:
        x, speeds = _within(model, phase, t)
        load = np.array(model.load(x, p, u, speeds)).ravel()
    for i, state in enumerate(model.states):
        out[state.name][where] = x[i]
    out["sliding_speed"][where] = s.direction * speeds[0]
    out["force"][where] = np.array(model.load_cell(x, p, u, speeds)).ravel()
    out["normal_force"][where] = u[1]
    out["coefficient"][where] = load / u[1]
    out["sliding"][where] = float(phase.mode != "stick")


def _within(model: Model, phase: BalancedPhase, t: Array) -> tuple[Array, Array]:
    """States (n_x, n) and speeds (1, n) at times t (n,) of a slide: a shorter step from the node before each."""
    s, n = phase.situated, t.size
    node = np.clip(np.searchsorted(phase.t, t, side="right") - 1, 0, max(phase.t.size - 2, 0))
    at, x0, v0 = phase.t[node], phase.x[node].T, phase.v[node][None, :]
    whole = phase.t[np.minimum(node + 1, phase.t.size - 1)] - at
    h = t - at
    taken = np.maximum(h, BRIEF * whole)
    share = np.divide(h, taken, out=np.zeros(n), where=taken > 0.0)
    p, drive = np.repeat(s.p[:, None], n, axis=1), np.repeat(s.inputs[:, None], n, axis=1)
    x, v = _step(model, phase, (x0, v0, p, drive), at, taken)
    x = x0 + share * (x - x0)
    local = np.array(local_function(model, phase.mode)(x, v, p, drive, t[None, :]))
    speeds = np.where(share < 1.0, v0[0] + share * (v[0] - v0[0]), local[-2])
    return x, np.where(phase.t[-1] == t, phase.v[-1], speeds)[None, :]


def _step(
    model: Model, phase: BalancedPhase, given: tuple[Array, Array, Array, Array], at: Array, h: Array
) -> tuple[Array, Array]:
    """States and speeds after a step of each lane, by Newton's method on all of them together."""
    x, v, p, drive = given
    n, lanes = x.shape
    slopes = np.array(local_function(model, phase.mode)(x, v, p, drive, at[None, :]))[:n]
    growth = np.concatenate([slopes, np.zeros((1, lanes))])
    first = np.concatenate([x, v])
    stages = np.concatenate([first + c * h * growth for c in NODES])
    function, size = stage_function(model, phase.mode), 3 * (n + 1)
    for _ in range(NEWTON_STEPS):
        result = np.array(function(stages, x, p, drive, at[None, :], h[None, :]))
        matrices = result[size:].T.reshape(lanes, size, size).transpose(0, 2, 1)
        change = np.linalg.solve(matrices, result[:size].T[:, :, None])[:, :, 0].T
        stages = stages - change
        if np.all(
            np.abs(change[-n - 1 : -1]) <= CLOSE * (1e-300 + np.max(np.abs(stages[-n - 1 : -1]), axis=1))[:, None]
        ):
            break
    return stages[-n - 1 : -1], stages[-1:]


# ----------------------------------------------------------------------------------------------------------------------
# Run a model without inertia forward: rest, sliding in balance of forces, located switches, jumps of the speed.
#
# It is the limit of a vanishing mass with hysteresis damping h > 0 and stiffness k fixed, reached with sqrt(m).
# (Without any damping a mass on an ageing contact is unstable, however small: it swings up at the rate k_D/(2 t_cr (k -
# k_D)), k_D = (mu_s - mu_k) F_n/D.) Where friction falls as sliding sets in, or softens with distance faster than the
# spring unloads (k < k_D), the motion jumps to another place: refused by name.
# ----------------------------------------------------------------------------------------------------------------------

MOMENT = 1e-7  # of the whole: time in which a contact that does not chatter changes its mode less than STALLED times


class BalancedMachine:
    """All that moves one scene without inertia, as `Machine` does with it; it remembers the speed between phases.

    Args:
        p: parameters (n_p,). sizes (n_x,): of the states; duration: [s], of the whole. The plan: its tolerance counts;
        locate as of `Machine`.
    """

    def __init__(
        self, model: Model, p: Array, sizes: Array, duration: float, plan: Plan, *, locate: bool = True
    ) -> None:
        self.model, self.p, self._locates, self.moment = model, p, locate, MOMENT * duration
        self.following: dict[ModeName, dict[GuardName, ModeName]] = {
            name: {**dict(mode.exits), "fold": name} for name, mode in sliding_modes(model.clamped is not None).items()
        }
        self._collocator, self._rests = Collocator(model, plan.rtol, sizes), borrowed(model)
        self._v, self._folded = 0.0, False

    def close(self) -> None:
        """Give back what others can use: the run is over."""
        give_back(self._rests)

    def rest(self, x: Array, situated: Situated, limit: float) -> BalancedPhase:
        """As `stick`."""
        self._v, self._folded = 0.0, False
        return stick(self._rests, x, situated, limit)

    def slide(self, mode: ModeName, x: Array, situated: Situated, limit: float) -> list[BalancedPhase]:
        """Slide from state x in one mode until it ends, or for `limit` [s].

        Raises:
            SimulationError: a jump to another place, or too many steps.
        """
        speed = settle(self._collocator, mode, x, situated, self._v, folded=self._folded)
        if speed is None:
            still = np.zeros(1)
            return [BalancedPhase(mode, situated.time, situated, still, x[None, :], "speed", still)]
        sliding = BalancedSlide(self._collocator, mode, situated, locate=self._locates)
        phase = sliding.run(x, speed, situated.time, limit)
        self._v, self._folded = float(phase.v[-1]), phase.ended_by == "fold"
        return [phase]

    def counts(self, phase: Phase) -> bool:
        """Whether a phase belongs to the motion: an arrest at a step of the drive is an arrest."""
        return phase.duration > 0.0 or phase.ended_by is not None

    def chatter(self, t: float, _longest: float) -> str:
        """Why time does not pass at t [s], and what to do."""
        return (
            f"the contact changes between rest and slide without time passing at {t:.6g} s (chatter): "
            "without inertia nothing holds it either way; add the effect inertia"
        )
