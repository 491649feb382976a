"""What a model does along the window of a log: its forces, steady states, rests and slides, where the log has them."""

from __future__ import annotations

from bisect import bisect_right
from functools import cached_property, lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.logs.log_data import LogData
from identify.model.model import Model
from identify.shooting.onset_places import DataSide, Wave
from identify.simulation.drive import NormalForce
from identify.simulation.phases import Stick, rest
from identify.simulation.resting import Resting
from identify.simulation.simulate import run
from identify.simulation.situated import Situated
from identify.simulation.steadiness import Steadiness, steadiness
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

TOLERANCE = 1e-7  # of a simulation step
BLOCK = 64  # knots of the load under the least of which a rest is looked at first


@lru_cache(maxsize=32)
def _moved_by_load(model: Model) -> bool:
    """Whether the load says how a rest goes on, not only when it ends."""
    x, p, u, t = (
        ca.SX.sym(n, k) for n, k in (("x", len(model.states)), ("p", len(model.parameters)), ("u", 4), ("t", 1))
    )
    return bool(ca.depends_on(model.rest(x, p, u, t), u[1]))


class Along:
    """A model with its parameters (n_p,), under the drive and the load of a log; `half` is half a period [s], `data`
    the places of its samples where a slide may begin."""

    def __init__(self, model: Model, log: LogData, p: Array) -> None:
        self.model, self.log, self.p = model, log, p
        self.values = dict(zip(model.parameter_names, p.tolist(), strict=True))
        self.half = float(np.pi * np.sqrt(self.values["mass"] / self.values["stiffness"]))
        changes = [] if log.programme is None else log.programme.changes(log.begin, log.end)
        self.data = DataSide(log, self.half, tuple(changes))

    @cached_property
    def rests(self) -> Resting:
        """Rests of the model: steady sliding has none."""
        return Resting(self.model)

    def inputs(self, t: float, just_before: bool = False) -> Array:
        """Inputs (4,) of the model at a time [s]."""
        speed = self.log.speed_at(np.nextafter(t, -np.inf) if just_before else t)
        return np.array([speed, float(self.log.normal_force.at(t)), 1.0, t])

    def force(self, t: float, x: Array, just_before: bool = False) -> float:
        """The friction force that the load cell shows in a state [N]."""
        return float(np.array(self.model.load_cell(x, self.p, self.inputs(t, just_before))).item())

    def steady(self, t: float, just_before: bool = False) -> Steadiness | None:
        """The state of steady sliding at a time [s]."""
        u = self.inputs(t, just_before)
        return steadiness(self.model, self.p, u) if u[0] > 0.0 else None

    def drive_motion(self, t: float) -> float:
        """How far the drive has gone since the begin of the window [m]."""
        edges = [self.log.begin, *(c for c in self.data.changes if c < t), t]
        return sum((b - a) * self.log.speed_at(0.5 * (a + b)) for a, b in pairwise(edges))

    def moving_from(self, t: float) -> float:
        """When the drive next moves, from t on [s]."""
        return next((c for c in (t, *self.data.changes) if c >= t and self.log.speed_at(c) > 0.0), self.log.end)

    def onset(self, t: float, x: Array) -> tuple[float, Array, list[tuple[float, Array]]]:
        """When a rest from x at t ends [s] (NaN: not within the window), the state there, and time and state at each
        change of the drive before it."""
        legs: list[tuple[float, Array]] = []
        while t < self.log.end:
            change = self.data.change_after(t)
            made, until = self._quiet(t, x, change) or self._rest(t, x, change)
            t, x = made.start + made.duration, made.end
            if made.ended_by is not None:
                if made.pull < 0.0:
                    raise SimulationError("the mass is pulled back")
                return t, x, legs
            t = until
            if t == change:
                legs.append((t, x))
        return np.nan, x, legs

    def _rest(self, t: float, x: Array, change: float) -> tuple[Stick, float]:
        """A rest from x at t [s] until the slope of the load changes, or the drive does; and when that is [s]."""
        force, slope = self.log.normal_force.line(t)
        knot = bisect_right(self.log.normal_force.times, t)
        until = min([change, *self.log.normal_force.times[knot : knot + 1]])
        return rest(self.rests, x, Situated(self.p, self.log.speed_at(t), 1.0, force, slope, t), t, until - t), until

    def _quiet(self, t: float, x: Array, change: float) -> tuple[Stick, float] | None:
        """As `_rest`, over BLOCK knots of a load of many at once, where not even the least of them would end it."""
        load = self.log.normal_force
        last = bisect_right(load.times, t) + BLOCK
        if last >= len(load.times) or not load.times[last] < change or _moved_by_load(self.model):
            return None
        until = load.times[last]
        least = float(np.min([load.at(t), *load.knots[1][last - BLOCK : last + 1]]))
        made = rest(self.rests, x, Situated(self.p, self.log.speed_at(t), 1.0, least, 0.0, t), t, until - t)
        return (made, until) if made.ended_by is None else None

    def motion(self, t: float, x: Array, duration: float) -> Trajectory:
        """The simulated motion from state x at t [s]."""
        names = [s.name for s in self.model.states]
        load = self.log.normal_force
        times = np.array([t, *load.between(t, t + duration)[0], t + duration])
        course = NormalForce.of((times - t, load.at(times)))
        start = dict(zip(names, x.tolist(), strict=True))
        return run(self.model, self.values, self.log.speed_at(t), course, duration, start=start, rtol=TOLERANCE)

    def placed(self, since: float, onset: float, x: Array, spread: float = np.inf) -> float:
        """Where on the data a slide that starts at `onset` from x fits best; after `since` [s]. spread: of the
        onset as it is expected [s]; infinite: the data alone say."""
        local = np.linspace(0.0, 2.0 * self.half, 200)
        wave = self.motion(onset, x, float(local[-1])).sample(local)["force"]
        slope = self.values["stiffness"] * self.log.speed_at(onset)
        return self.data.placed(since, onset, Wave(local, wave, slope), spread)
