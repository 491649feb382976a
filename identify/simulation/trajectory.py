"""A simulated motion, and its samples at any times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_io.spelling import Spelled
from identify.base.compiled import Mapped
from identify.base.errors import SimulationError
from identify.model.model import Model
from identify.scene.tables import quantity
from identify.simulation.phases import Phase, Slide
from identify.simulation.plan import LOOSER_SHARE
from identify.simulation.stepper import ModeName, coefficient, inputs, numbers_of, rested, within
from identify.simulation.steppers import Method

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

# What a load cell shows that averages: the mean of its force over the last moments, exact on smooth pieces.

Array = NDArray[np.float64]

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
TURN = 2.0  # length of a piece in time constants, or radians: the rule is exact to rounding on it


def averaged(force: Callable[[Array], Array], edges: Array, times: Array, span: float) -> Array:
    """Mean force over the last `span` [s] before each of `times` (n,) [s]; before `span`, over what there is.

    Args:
        force: force [N] at rising times [s].
        edges: rising times [s] between which the force is smooth; they enclose `times`, and begin at the start.
    """
    begin = np.maximum(times - span, edges[0])
    knots = np.unique(np.concatenate([edges[(edges > begin[0]) & (edges < times[-1])], begin, times]))
    half = 0.5 * np.diff(knots)[:, None]
    points = knots[:-1, None] + half * (1.0 + _POINTS)
    integral = np.append(0.0, np.cumsum(half[:, 0] * (force(points.ravel()).reshape(points.shape) @ _WEIGHTS)))
    length = times - begin
    mean = np.diff(integral[np.searchsorted(knots, [begin, times])], axis=0)[0] / np.where(length > 0.0, length, 1.0)
    return np.where(length > 0.0, mean, force(times))


# The motion at any times: rests in closed form, slips inside the steps they were taken by, many in one call.


def inside(model: Model, phases: Sequence[Phase], which: NDArray[np.intp], local: Array) -> dict[str, Array]:
    """Samples (n,): states by name, "force", "coefficient", "normal_force", "sliding"; in phases `which` (n,), rising,
    at times from the start of each (n,) [s]: late phases lose no digits."""
    local = np.clip(local, 0.0, np.array([phase.duration for phase in phases])[which])
    numbers = np.array([phase.situated.numbers(model) for phase in phases])[which]
    n = len(model.states)
    xth = np.zeros((local.size, 2 * n + 3))
    kinds: dict[tuple[Method | None, ModeName], list[Array]] = {}
    edges = np.searchsorted(which, np.arange(len(phases) + 1))
    for i in np.unique(which).tolist():
        phase, rows = phases[i], np.arange(edges[i], edges[i + 1])
        at = local[rows]
        method = phase.method if isinstance(phase, Slide) else None
        kinds.setdefault((method, phase.mode), []).append(rows)
        if method is None:
            xth[rows, :n], xth[rows, n + 2] = phase.x[0], at
            continue
        node = np.clip(np.searchsorted(phase.t, at, side="right") - 1, 0, max(phase.t.size - 2, 0))
        beyond = np.minimum(node + 1, phase.t.size - 1)
        xth[rows, :n], xth[rows, n] = phase.x[node], phase.t[node]
        xth[rows, n + 1], xth[rows, n + 2] = phase.t[beyond] - phase.t[node], at - phase.t[node]
        xth[rows, n + 3 :] = phase.x[beyond]
    shown = np.empty((local.size, n + 2))
    tolerances = next((phase.tolerances for phase in phases if isinstance(phase, Slide)), np.ones(n + 1))
    for (method, mode), parts in kinds.items():
        rows = np.concatenate(parts)
        shared = [np.repeat(given[None], rows.size, axis=0) for given in (phases[0].situated.p, tolerances)]
        shown[rows] = _row(model, method, mode)([xth[rows], numbers[rows], *shared])[0]
    out = {state.name: shown[:, i].copy() for i, state in enumerate(model.states)}
    out["force"], out["coefficient"] = shown[:, n].copy(), shown[:, n + 1].copy()
    out["normal_force"] = numbers[:, 2] + numbers[:, 3] * local
    out["sliding"] = np.array([float(phase.mode != "stick") for phase in phases])[which]
    return out


@lru_cache(maxsize=64)
def _row(model: Model, method: Method | None, mode: ModeName) -> Mapped:
    """(as in `within`, inputs (n_u,), p, tolerances) -> state, force, coefficient."""
    n = len(model.states)
    xth, drive = ca.SX.sym("xth", 2 * n + 3), ca.SX.sym("drive", numbers_of(model))
    p, tolerances = ca.SX.sym("p", len(model.parameters)), ca.SX.sym("tolerances", n + 1)
    t = xth[n] + xth[n + 2]
    u = inputs(drive, t)
    if method is None:
        x = rested(model, xth[:n], p, drive, t)[0]
        force, shown = model.load_cell(x, p, u), model.driving_force(x, p, u) / u[1]
    else:
        x = within(model, method, mode)(xth, ca.vertcat(p, drive), tolerances)
        force, shown = model.sliding_cell(x, p, u), u[2] * coefficient(model, mode)(x, ca.vertcat(p, drive), t)
    row = ca.densify(ca.vertcat(x, force, shown))
    return Mapped(ca.Function("row", [xth, drive, p, tolerances], [row]))


EVEN = 2001  # times of a table beside those of the solver


@dataclass(frozen=True)
class Achieved:
    """Estimated relative errors: of switch times, against the mean time between onsets (the duration, with fewer than
    two); of forces, against the largest one. Infinite where another tolerance leads to other switches."""

    switches: float
    forces: float

    def within(self, accuracy: float) -> bool:
        """Whether both are at most that."""
        return self.switches <= accuracy and self.forces <= accuracy


@dataclass(frozen=True, repr=False)
class Trajectory(Spelled):
    """A simulated motion: its phases in order, and everything that can be sampled from them.

    `duration` [s] counts from the start of the simulation; all quantities are SI. `accuracy` was asked for. second:
    another run of the same scene, of the distance to which `share` is the error of this one (above 1: it is finer).
    """

    model: Model
    phases: Sequence[Phase]
    duration: float
    accuracy: float | None = None
    second: Callable[[], Trajectory] | None = field(default=None, repr=False, compare=False)
    share: float = 0.0

    @cached_property
    def achieved(self) -> Achieved | None:
        """The error as far as it can be told without a truth: from a second run with another tolerance, made when
        this is first asked for. None where no second run is known."""
        if self.second is None:
            return None
        apart = distance(self, self._other)
        # No estimate says less than the last digits.
        return Achieved(self.share * apart.switches + 1e-13, self.share * apart.forces + 1e-13)

    @cached_property
    def _other(self) -> Trajectory:
        assert self.second is not None
        return self.second()

    def refined(self) -> Trajectory:
        """The same scene as finely as its accuracy asks for: this motion where its estimated errors are within the
        accuracy, else one with tighter tolerances; where none gets there the tightest, whose `achieved` says so.

        A motion that nearly does two things needs more than a plan can know beforehand.
        """
        if self.second is None or self.accuracy is None or self.share < 1.0:
            return self
        apart = distance(self, self._other)
        if apart.within(self.accuracy / self.share):
            return self
        # The finer one was compared already: its own error is a small share of the same distance.
        if apart.within(self.accuracy / LOOSER_SHARE):
            return replace(self._other, second=lambda: self, share=LOOSER_SHARE)
        return self._other.refined()

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
    def wear_times(self) -> Array:
        """Times at which the bounded state (gamma) reaches its lower bound [s]."""
        return np.array([p.start + p.duration for p in self.phases if p.ended_by == "clearance"])

    def __repr__(self) -> str:
        slips = f"{self.onsets.size} slip{'s' * (self.onsets.size != 1)}"
        return f"simulated motion of {self.duration:g} s with {slips}: {', '.join(self.model.effects)}"

    def to_frame(self, rate: float | str | None = None) -> pd.DataFrame:
        """The motion as a table in SI: time and what `sample` gives.

        Args:
            rate: samples per second [Hz], number or text with a unit; None: where the solver stepped (densely in
                slips), and `EVEN` times between.
        """
        import pandas as pd

        if rate is None:
            times = np.union1d(self._edges, np.linspace(0.0, self.duration, EVEN))
        else:
            clock = quantity(rate, "1/s", "the rate")
            if not clock > 0.0:
                raise SimulationError(f"the rate is {clock:g} Hz; expected a positive number: correct it")
            times = np.arange(int(self.duration * clock * (1 + 1e-12)) + 1) / clock
        return pd.DataFrame({"time": times, **self.sample(times)})

    def plot(self) -> Figure:
        """Friction force at the load cell and sliding speed over time."""
        from data_io.notebook_figure import NotebookFigure

        frame = self.to_frame()
        figure = NotebookFigure(figsize=(9.0, 4.5), layout="constrained")
        force, speed = figure.subplots(2, 1, sharex=True)
        force.plot(frame["time"], frame["force"])
        force.set_ylabel("friction force (N)")
        speed.plot(frame["time"], 1e3 * frame["sliding_speed"])
        speed.set(xlabel="time (s)", ylabel="sliding speed (mm/s)")
        return figure

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
        p, pieces = self.phases[0].situated.p, [np.array([0.0, self.duration])]
        rates, omegas = (np.array(f(p)).ravel() for f in (self.model.decays, self.model.waves))
        fastest = float(np.max(omegas, initial=0.0))
        for phase in self.phases:
            local = [phase.t]
            if phase.mode == "stick":  # a decay until it is below rounding
                local += [np.arange(0.0, min(phase.duration, 40.0 / rate), TURN / rate) for rate in rates]
                local.append(np.linspace(0.0, phase.duration, 2 + int(phase.duration * fastest / TURN)))
            pieces += [phase.start + times for times in local]
        return np.unique(np.concatenate(pieces))

    def _moments(self, t: Array) -> dict[str, Array]:
        """The samples at rising times t (n,) [s], the force of the moment."""
        starts = np.array([phase.start for phase in self.phases])
        which = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)
        return inside(self.model, self.phases, which, t - starts[which])


def distance(trajectory: Trajectory, other: Trajectory) -> Achieved:
    """How far two motions of the same scene are apart, as `Achieved` measures it."""
    period = trajectory.duration / max(trajectory.onsets.size, 1)
    kinds = ("onsets", "arrests", "wear_times")
    pairs = [(getattr(trajectory, kind), getattr(other, kind)) for kind in kinds]
    if any(ours.size != theirs.size for ours, theirs in pairs):
        return Achieved(np.inf, np.inf)
    apart = max((float(np.max(np.abs(a - b))) for a, b in pairs if a.size), default=0.0)
    # Where a drive speed or a switch makes the force jump or bend, a shift in time is not an error of the force.
    starts = np.array([phase.start for phase in trajectory.phases[1:]])
    times = np.linspace(0.0, trajectory.duration, 2000)  # times at which forces are compared
    beside = np.searchsorted(starts, times)
    edges = np.concatenate([[-np.inf], starts, [np.inf]])
    times = times[np.minimum(times - edges[beside], edges[beside + 1] - times) > 2.0 * apart]
    ours, theirs = (motion.sample(times)["force"] for motion in (trajectory, other))
    largest = float(np.max(np.abs(ours), initial=0.0)) or 1.0
    return Achieved(apart / period, float(np.max(np.abs(ours - theirs), initial=0.0)) / largest)
