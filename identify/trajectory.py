"""A simulated motion, and its samples at any times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.averaging import averaged, rest_edges
from identify.errors import SimulationError
from identify.model import SPEED, Model
from identify.phases import Phase, Slide
from identify.stepping import steps

Array = NDArray[np.float64]

LAST_DIGITS = 1e-13  # no estimate says less
COMPARED = 2000  # times at which forces are compared


@dataclass(frozen=True)
class Achieved:
    """Estimated relative errors: of switch times, against the mean time between onsets (the duration, with fewer than
    two); of forces, against the largest one. Infinite where another tolerance leads to other switches."""

    switches: float
    forces: float


@dataclass(frozen=True)
class Second:
    """Another run of the same scene, and the share of the distance to it that is the first one's error."""

    run: Callable[[], Trajectory]
    share: float


@dataclass(frozen=True)
class Trajectory:
    """A simulated motion: its phases in order, and everything that can be sampled from them.

    `duration` [s] counts from the start of the simulation; all quantities are SI. `accuracy` was asked for.
    """

    model: Model
    phases: Sequence[Phase]
    duration: float
    accuracy: float | None = None
    second: Second | None = field(default=None, repr=False, compare=False)

    @cached_property
    def achieved(self) -> Achieved | None:
        """The error as far as it can be told without a truth: from a second run with another tolerance, made when
        this is first asked for. None where no second run is known."""
        if self.second is None:
            return None
        apart = distance(self, self.second.run())
        share = self.second.share
        return Achieved(share * apart.switches + LAST_DIGITS, share * apart.forces + LAST_DIGITS)

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the integration methods at work, in the order in which they came into play."""
        return tuple(dict.fromkeys(phase.method.name for phase in self.phases if isinstance(phase, Slide)))

    @cached_property
    def onsets(self) -> Array:
        """Times at which a resting mass is set in motion [s]."""
        return np.array([p.start + p.duration for p in self.phases if p.mode == "stick" and p.ended_by])

    @cached_property
    def arrests(self) -> Array:
        """Times at which a sliding mass comes to rest [s]."""
        return np.array([p.start + p.duration for p in self.phases if p.mode != "stick" and p.ended_by == "speed"])

    @cached_property
    def saturations(self) -> Array:
        """Times at which the bounded state (gamma) reaches its lower bound [s]."""
        return np.array([p.start + p.duration for p in self.phases if p.ended_by == "clearance"])

    def sample(self, times: ArrayLike) -> dict[str, Array]:
        """The motion at rising `times` (n,) [s] within the simulation.

        Returns:
            arrays (n,): "force" (what the load cell shows, averaged where it averages) [N], one per state of the model
            ("elongation" [m], "sliding_speed" [m/s], "gamma"), "normal_force" [N], "coefficient" (friction force of
            the contact over normal force), "sliding" (1 in slip, 0 in stick).

        Raises:
            SimulationError: times outside the simulation.
        """
        t = np.atleast_1d(np.asarray(times, float))
        if t.size and (t[0] < 0.0 or t[-1] > self.duration * (1 + 1e-12)):
            raise SimulationError(f"asked for {t[0]:.6g} to {t[-1]:.6g} s of a simulation of {self.duration:.6g} s")
        out = self._moments(t)
        span = float(np.array(self.model.averaging(self.phases[0].situated.p)).item())
        if span > 0.0:
            out["force"] = averaged(lambda at: self._moments(at)["force"], self._edges, t, span)
        return out

    @cached_property
    def _edges(self) -> Array:
        """Times between which the force is smooth [s]."""
        p = self.phases[0].situated.p
        rates, omegas = (np.array(f(p)).ravel() for f in (self.model.decays, self.model.waves))
        inner = [p.start + (rest_edges(p.duration, rates, omegas) if p.mode == "stick" else p.t) for p in self.phases]
        return np.unique(np.concatenate([[0.0, self.duration], *inner]))

    def _moments(self, t: Array) -> dict[str, Array]:
        """The samples at rising times t (n,) [s], the force of the moment."""
        names = [s.name for s in self.model.states]
        out = {name: np.empty(t.size) for name in (*names, "force", "normal_force", "coefficient", "sliding")}
        starts = np.array([p.start for p in self.phases])
        cuts = np.append(np.searchsorted(t, starts[1:], side="left"), t.size)
        first = 0
        for phase, last in zip(self.phases, cuts.tolist(), strict=True):
            if last > first:
                _sample_phase(self.model, phase, t[first:last] - phase.start, out, slice(first, last))
            first = last
        return out


def distance(trajectory: Trajectory, other: Trajectory) -> Achieved:
    """How far two motions of the same scene are apart, as `Achieved` measures it."""
    period = trajectory.duration / max(trajectory.onsets.size, 1)
    kinds = ("onsets", "arrests", "saturations")
    pairs = [(getattr(trajectory, kind), getattr(other, kind)) for kind in kinds]
    if any(ours.size != theirs.size for ours, theirs in pairs):
        return Achieved(np.inf, np.inf)
    apart = max((float(np.max(np.abs(a - b))) for a, b in pairs if a.size), default=0.0)
    # Where a drive speed or a switch makes the force jump or bend, a shift in time is not an error of the force.
    starts = np.array([phase.start for phase in trajectory.phases[1:]])
    times = np.linspace(0.0, trajectory.duration, COMPARED)
    beside = np.searchsorted(starts, times)
    edges = np.concatenate([[-np.inf], starts, [np.inf]])
    times = times[np.minimum(times - edges[beside], edges[beside + 1] - times) > 2.0 * apart]
    ours, theirs = (motion.sample(times)["force"] for motion in (trajectory, other))
    largest = float(np.max(np.abs(ours), initial=0.0)) or 1.0
    return Achieved(apart / period, float(np.max(np.abs(ours - theirs), initial=0.0)) / largest)


def _cubic(model: Model, phase: Phase, node: NDArray[np.int_], t: Array) -> Array:
    """States (n_x, n) at local times t (n,) behind the nodes (n,) by Hermite's cubic through the two nodes around them:
    an implicit step that was good over its length need not be so over a part of it."""
    s = phase.situated
    field = model.slip if phase.mode == "slip" else model.saturated

    def at(nodes: NDArray[np.int_]) -> tuple[Array, Array]:
        x = phase.x[nodes].T
        return x, np.array(field(x, np.repeat(s.p[:, None], nodes.size, axis=1), s.at(phase.t[nodes], s.direction)))

    (x0, rate0), (x1, rate1) = at(node), at(node + 1)
    h = phase.t[node + 1] - phase.t[node]
    share = (t - phase.t[node]) / h
    bend = share * (1.0 - share) * ((1.0 - share) * (h * rate0 - x1 + x0) - share * (h * rate1 - x1 + x0))
    return np.asarray(x0 + share * (x1 - x0) + bend)


def _sample_phase(model: Model, phase: Phase, t: Array, out: dict[str, Array], where: slice) -> None:
    """Fill the samples of one phase; t (n,) is local to it."""
    s, n = phase.situated, t.size
    t = np.clip(t, 0.0, phase.duration)
    p = np.repeat(s.p[:, None], n, axis=1)
    u = s.at(t, s.direction)
    if phase.mode == "stick":
        x = np.array(model.rest(np.repeat(phase.x[0][:, None], n, axis=1), p, u, t[None, :]))
    else:
        node = np.clip(np.searchsorted(phase.t, t, side="right") - 1, 0, max(phase.t.size - 2, 0))
        # The step function itself is the dense output: a shorter step from the node before.
        xth = np.vstack([phase.x[node].T, phase.t[node], t - phase.t[node]])
        assert isinstance(phase, Slide)
        constants, tolerances = (np.repeat(a[:, None], n, axis=1) for a in (s.constants, phase.tolerances))
        x, norm = steps(model, phase.method, phase.mode, xth, constants, tolerances)
        refused = ~(norm <= 1.0)
        if refused.any():
            x[:, refused] = _cubic(model, phase, node[refused], t[refused])
    for i, state in enumerate(model.states):
        out[state.name][where] = x[i]
    out["force"][where] = np.array(model.load_cell(x, p, u)).ravel()
    out["normal_force"][where] = u[1]
    if phase.mode == "stick":
        out["coefficient"][where] = np.array(model.driving_force(x, p, u)).ravel() / u[1]
    else:
        field = model.slip if phase.mode == "slip" else model.saturated
        acceleration = np.array(field(x, p, u))[SPEED]
        mass = s.p[model.parameter_names.index("mass")]
        load = np.array(model.load(x, p, u)).ravel()
        out["coefficient"][where] = (load - mass * acceleration) / u[1]
    out["sliding"][where] = float(phase.mode != "stick")
