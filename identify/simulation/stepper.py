"""Steps of one scene with one method: the compiled trials and bursts with their buffers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base import native
from identify.base.compiled import Compiled, compiled
from identify.model.model import Model
from identify.model.modes import GUARDS, ModeName, sliding_modes
from identify.simulation.bursts import DIPS, MODES, N_GUARDS, BurstState, burst, coefficient, ends, trial
from identify.simulation.steppers import Method

# ----------------------------------------------------------------------------------------------------------------------
# What stays the same during one phase of motion.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Situated:
    """Parameters p (n_p,), drive speed [m/s], direction of sliding (+1 or -1), normal force at the start of the phase
    [N] and its slope [N/s], time at its start [s]."""

    p: Array
    drive_speed: float
    direction: float
    normal_force: float
    force_slope: float
    time: float = 0.0

    @property
    def numbers(self) -> tuple[float, float, float, float, float]:
        """What the step functions read behind the parameters."""
        return (self.drive_speed, self.direction, self.normal_force, self.force_slope, self.time)

    @property
    def inputs(self) -> Array:
        """The same as an array, shape (5,)."""
        return np.array(self.numbers)

    @property
    def constants(self) -> Array:
        """p and the inputs, shape (n_p + 5,)."""
        return np.append(self.p, self.numbers)

    @cached_property
    def setting(self) -> Array:
        """Parameters, normal force at the start, drive speed: shape (n_p + 2,)."""
        return np.append(self.p, [self.normal_force, self.drive_speed])

    def at(self, t: float | Array, direction: float = 1.0) -> Array:
        """u of the model (4,) or (4, n) at times t [s] within the phase."""
        t = np.asarray(t, float)
        ones = np.ones_like(t)
        force = self.normal_force + self.force_slope * t
        return np.stack([self.drive_speed * ones, force, direction * ones, self.time + t])


Kind = tuple[Model, Method, bool]  # of a stepper: whether it stops where the mass comes to rest
SOME = 100  # bursts: before them nobody looks for machine code
MUCH = 20_000  # bursts: some seconds of the virtual machine, what the compiler takes


class _Bursts:
    """The bursts of one kind of stepper, bound to its buffers."""

    def __init__(self, kind: Kind, buffers: Sequence[Array]) -> None:
        self._kind, self._buffers = kind, buffers
        self._function = burst(*kind)
        self._call = self._bound(self._function)
        self._count, self._ask = 0, SOME
        self.hastened = False

    def _bound(self, function: ca.Function) -> Compiled:
        made = compiled(function)
        made.bind(self._buffers)
        return made

    def __call__(self) -> Array:
        self._count += 1
        return self._call()

    def hasten(self) -> None:
        """Take the machine code of the bursts where it is there, and have it made where they are used much: the same
        numbers sooner.
        """
        if self.hastened or self._count < self._ask:
            return
        key = _key(*self._kind)
        found = None if key is None else native.find(key, self._function.name())
        if found is not None:
            self._call = self._bound(found)
        elif key is not None and self._count >= MUCH and not native.busy():
            native.start([(self._function, key)])
        self.hastened = found is not None or key is None
        self._ask = MUCH if self._count < MUCH else self._count + MUCH


class Stepper:
    """Steps one model with one method, `stops` as of `burst`; holds buffers, so one at a time uses it: `borrowed`."""

    def __init__(self, model: Model, method: Method, stops: bool) -> None:
        self.model, self.method, self.kind = model, method, (model, method, stops)
        self.places = BurstState(len(model.states))
        n = self.places.n
        self._z, self._xth = np.zeros(self.places.size), np.zeros(n + 2)
        self._bounds, self._constants = np.zeros(5), np.zeros(len(model.parameters) + 5)
        self._tolerances = np.zeros(n + 1)
        x, t = self._xth[:-2], self._xth[-2:-1]
        self._trials: dict[ModeName, Compiled] = {}
        self._ends: dict[ModeName, Compiled] = {}
        self._coefficients: dict[ModeName, Compiled] = {}
        for mode in sliding_modes(model.clamped is not None):
            self._trials[mode] = compiled(trial(model, method, mode, stops))
            self._trials[mode].bind([self._xth, self._constants, self._tolerances])
            self._ends[mode] = compiled(ends(model, mode))
            self._ends[mode].bind([self._z[:n], self._constants, np.zeros(1)])
            self._coefficients[mode] = compiled(coefficient(model, mode))
            self._coefficients[mode].bind([x, self._constants, t])
        self.bursts = _Bursts(self.kind, [self._z, self._bounds, self._constants, self._tolerances])

    def tune(self, p: Array, tolerances: Array, bounds: tuple[float, float, float, bool]) -> None:
        """Set parameters p (n_p,), tolerances of a step (rtol, then atol (n_x,)), and its bounds: longest and shortest
        [s], farthest way [m], whether switches are located (else a burst stops at the step that passes one).
        """
        self._constants[:-5] = p
        self._tolerances[:] = tolerances
        longest, shortest, farthest, locate = bounds
        self._bounds[1:5] = longest, shortest, float(locate), farthest

    def start(self, mode: ModeName, x: Array | list[float], situated: Situated, limit: float, h: float) -> None:
        """Begin to slide in a mode from x (n_x,) with a step of length h [s]; it may last `limit` [s]."""
        self._constants[-5:] = situated.numbers
        self._bounds[0] = limit
        z, n = self._z, self.places.n
        z[:n] = x
        ends = self._ends[mode]().tolist()
        z[n:] = [0.0, MODES.index(mode), 0.0, h, 0.0, 0.0, 0.0, 0.0, 0.0, DIPS, *ends, 2 * MODES.index(mode)]

    @property
    def speeding(self) -> float:
        """How fast the speed along the direction of slip rises at the last node [m/s^2]."""
        return self.ends[N_GUARDS + GUARDS.index("speed")]

    def go_on(self) -> list[list[float]]:
        """Several trials from where the last call stopped: rows of state, time, mode, stop and h as in `BurstState`,
        the last one where it stopped."""
        rows = self.bursts().reshape(self.method.trials, -1)
        self._z[:] = rows[-1]
        stopped = int(np.count_nonzero(rows[:, self.places.stop]))
        return rows[: len(rows) - stopped + 1, : self.places.n + 4].tolist()

    @property
    def ends(self) -> list[float]:
        """Guards and their slopes at the last node."""
        return self._z[self.places.ends].tolist()

    def trial(self, mode: ModeName, x: list[float], t: float, h: float) -> list[float]:
        """A step of length h [s] from x at time t [s]: state after, error norm, guards, their slopes."""
        n = self.places.n
        self._xth[:n], self._xth[n], self._xth[n + 1] = x, t, h
        return self._trials[mode]().tolist()

    def coefficient(self, mode: ModeName, x: Sequence[float] | Array, situated: Situated, t: float) -> float:
        """Friction coefficient in state x at time t [s] of a phase, positive where friction brakes."""
        self._constants[-5:] = situated.numbers
        self._xth[:-2], self._xth[-2] = x, t
        return float(self._coefficients[mode]()[0])


_IDLE: dict[Kind, list[Stepper]] = {}


def borrowed(model: Model, method: Method, stops: bool = True) -> Stepper:
    """A stepper nobody uses: one that was given back, or a new one."""
    idle = _IDLE.get((model, method, stops))
    return idle.pop() if idle else Stepper(model, method, stops)


def give_back(stepper: Stepper) -> None:
    """Let others use it."""
    stepper.bursts.hasten()
    _IDLE.setdefault(stepper.kind, []).append(stepper)


@lru_cache(maxsize=64)
def _key(model: Model, method: Method, stops: bool) -> str | None:
    return native.key(burst(model, method, stops))


def forget() -> None:
    """Let go of the steppers nobody uses: new ones look again for machine code."""
    _IDLE.clear()
    _key.cache_clear()


def hastened(model: Model, method: Method) -> bool:
    """Wait until the bursts of a model and a method are machine code; False where there is no compiler."""
    function, key = burst(model, method, True), _key(model, method, True)
    if key is None:
        return False
    native.start([(function, key)])
    native.wait()
    _IDLE.pop((model, method, True), None)
    return native.find(key, function.name()) is not None
