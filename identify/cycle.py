"""One stick-slip cycle of the composed model, from one arrest to the next: the map whose fixed point is the orbit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.model import ELONGATION, SPEED, Model
from identify.modes import ModeName, sliding_modes
from identify.phases import scales, slide, stepper, stick
from identify.stepping import Situated

Array = NDArray[np.float64]

SLIDES_AFTER = 12.0  # half periods sqrt(m/k) pi without coming to rest: the mass slides
CREEP = 1e-6  # of a half period: a slip this short is no slip, the contact creeps along with the drive
MAX_PHASES = 200  # of one cycle; more is chatter


@dataclass(frozen=True)
class Cycle:
    """A stick and the slip that follows it, SI.

    start, onset, end: states (n_x,) at rest at the arrest before, at the onset of slip, at the arrest after;
    stick and slip are durations [s]; peak_speed is the largest sliding speed [m/s]; wear is the smallest value
    a bounded state reached (0: the contact was worn fresh; NaN without such a state).
    """

    start: Array
    onset: Array
    end: Array
    stick: float
    slip: float
    peak_speed: float
    wear: float


@lru_cache(maxsize=16)
def _spare_grip(model: Model) -> ca.Function:
    """(x, p, u, t) -> grip minus pull of the drive after resting for t [s] from x, and its rate [N, N/s]."""
    x, p = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters))
    u, t = ca.SX.sym("u", 3), ca.SX.sym("t")
    rested = model.rest(x, p, u, t)
    spare = model.grip(rested, p, u) - model.driving_force(rested, p, u)
    return ca.Function("spare_grip", [x, p, u, t], [spare, ca.jacobian(spare, t), rested])


class CycleMap:
    """The return map of one model under one normal force [N]; holds a stepper, so one per thread.

    A rest state is written y (n_y,): the states of the model without the sliding speed.
    """

    def __init__(self, model: Model, normal_force: float, p: Array, rtol: float = 1e-7) -> None:
        self.model, self.normal_force, self.p = model, normal_force, np.asarray(p, float)
        self._machine = stepper(model, self.p, normal_force, rtol)
        self._scales = scales(model, self.p, normal_force)
        self.scale = np.delete(self._scales.state, SPEED)  # typical size of y
        self._modes = sliding_modes(model.clamped is not None)

    @property
    def half_period(self) -> float:
        """Half a natural period [s]."""
        return float(np.pi * self._scales.time)

    def rested(self) -> Array:
        """Where a test starts: spring unloaded, every state saturated (the strongest first kick)."""
        states = [0.0, *(s.start if s.upper is None else s.upper for s in self.model.states[2:])]
        return np.array(states)

    def run(self, y: Array, drive_speed: float, p: Array | None = None, patience: float = SLIDES_AFTER) -> Cycle | None:
        """The cycle that starts at rest in y; None when the mass does not come to rest within `patience` half periods.

        Args:
            y: rest state (n_y,). drive_speed: [m/s], positive. p: parameters (n_p,), if not those of the map.
        """
        p = self.p if p is None else p
        start = np.insert(y, SPEED, 0.0)
        situated = Situated(p, drive_speed, 1.0, self.normal_force, 0.0)
        rest, stick_time = self._stick(start, situated)
        x, mode = rest, "slip"
        moving: list[Array] = []
        times: list[Array] = []
        elapsed, left = 0.0, patience * self.half_period
        for _ in range(MAX_PHASES):
            phase = slide(self._machine, _name(mode), x, situated, 0.0, left - elapsed, self._scales)
            moving.append(phase.x)
            times.append(elapsed + phase.t)
            x, elapsed = phase.x[-1], elapsed + phase.duration
            if phase.ended_by is None:
                return None
            if phase.ended_by != "speed":
                mode = dict(self._modes[_name(mode)].exits)[phase.ended_by]
                continue
            pull = float(self.model.driving_force(x, p, self._inputs(situated)))
            if abs(pull) < float(self.model.grip(x, p, self._inputs(situated))):
                if elapsed < CREEP * self.half_period:
                    return None
                speeds = np.concatenate(moving)[:, SPEED]
                peak = _peak(np.concatenate(times), speeds)
                wear = np.nan if (i := self.model.clamped) is None else float(np.min(np.concatenate(moving)[:, i]))
                return Cycle(start, rest, x, stick_time, elapsed, peak, wear)
            situated = Situated(p, drive_speed, float(np.sign(pull)), self.normal_force, 0.0)
            mode = "slip"
        return None

    def _stick(self, start: Array, situated: Situated) -> tuple[Array, float]:
        """State at the onset of slip, and how long the stick lasted [s].

        The spare grip is concave in time (the pull grows evenly, ageing saturates), so Newton's method from
        the right converges without a step back; where it is not, the general search takes over.
        """
        p, u = situated.p, self._inputs(situated)
        k = p[self.model.parameter_names.index("stiffness")]
        # Longer than any stick: by then the spring alone pulls with more than the strongest grip.
        longest = 2.0 * (float(np.max(p[:2])) * self.normal_force + k * abs(start[ELONGATION])) / (k * u[0])
        spare = _spare_grip(self.model)
        first = float(spare(start, p, u, 0.0)[1])
        t = longest
        for _ in range(60):
            value, slope, rested = spare(start, p, u, t)
            step = float(value) / float(slope)
            if not (float(slope) < 0.0 and step >= -1e-9 * t and float(slope) <= first):
                break
            t = max(t - step, 0.0)
            if abs(step) <= 1e-14 * t:
                return np.array(rested).ravel(), t
        rest = stick(self.model, start, situated, 0.0, 5.0 * longest)
        return rest.x[-1], rest.duration

    def _inputs(self, situated: Situated) -> Array:
        return np.array([situated.drive_speed, self.normal_force, 1.0])


def _peak(times: Array, speeds: Array) -> float:
    """Largest speed: vertex of the parabola through the highest node and its neighbours in time."""
    times, first = np.unique(times, return_index=True)
    speeds = speeds[first]
    i = int(np.clip(np.argmax(speeds), 1, max(times.size - 2, 1)))
    if times.size < 3:
        return float(np.max(speeds))
    left, right = times[i - 1] - times[i], times[i + 1] - times[i]
    below, above = (speeds[i - 1] - speeds[i]) / left, (speeds[i + 1] - speeds[i]) / right
    bend = (above - below) / (right - left)
    slope = below - bend * left
    if bend >= 0.0:
        return float(np.max(speeds))
    return float(speeds[i] - slope * slope / (4.0 * bend))


def _name(mode: str) -> ModeName:
    return "saturated" if mode == "saturated" else "slip"


def rest_state(x: Array) -> Array:
    """y of a state at rest."""
    return np.delete(x, SPEED)


def loads(map_: CycleMap, cycle: Cycle, drive_speed: float, p: Array | None = None) -> tuple[float, float]:
    """Force the load cell sees at the onset of slip and at the arrest [N]."""
    p, u = map_.p if p is None else p, np.array([drive_speed, map_.normal_force, 1.0])
    return float(map_.model.load_cell(cycle.onset, p, u)), float(map_.model.load_cell(cycle.end, p, u))
