"""Steps of one scene with one method: the compiled trials and bursts with their buffers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identify.bursts import DIPS, MODES, Pace, burst
from identify.compiled import Compiled, compiled
from identify.methods import Method
from identify.model import Model
from identify.modes import GUARDS, ModeName, sliding_modes
from identify.situated import Situated
from identify.stepping import N_GUARDS, coefficient, ends, trial

Array = NDArray[np.float64]


class Stepper:
    """Steps one model with one method; holds buffers, so one at a time uses it: see `borrowed`."""

    def __init__(self, model: Model, method: Method) -> None:
        self.model, self.method = model, method
        self.places = Pace(len(model.states))
        n = self.places.n
        self._z, self._xth = np.zeros(self.places.size), np.zeros(n + 2)
        self._bounds, self._constants = np.zeros(6), np.zeros(len(model.parameters) + 5)
        self._tolerances = np.zeros(n + 1)
        x, t = self._xth[:-2], self._xth[-2:-1]
        self._trials: dict[ModeName, Compiled] = {}
        self._ends: dict[ModeName, Compiled] = {}
        self._coefficients: dict[ModeName, Compiled] = {}
        for mode in sliding_modes(model.clamped is not None):
            self._trials[mode] = compiled(trial(model, method, mode))
            self._trials[mode].bind([self._xth, self._constants, self._tolerances])
            self._ends[mode] = compiled(ends(model, mode))
            self._ends[mode].bind([self._z[:n], self._constants, np.zeros(1)])
            self._coefficients[mode] = compiled(coefficient(model, mode))
            self._coefficients[mode].bind([x, self._constants, t])
        self._burst: Compiled = compiled(burst(model, method))
        self._burst.bind([self._z, self._bounds, self._constants, self._tolerances])

    def tune(self, p: Array, tolerances: Array, bounds: tuple[float, float, float, bool]) -> None:
        """Set parameters p (n_p,), tolerances of a step (rtol, then atol (n_x,)), and its bounds: longest and shortest
        [s], farthest way [m], whether switches are located (else a burst stops at the step that passes one).
        """
        self._constants[:-5] = p
        self._tolerances[:] = tolerances
        longest, shortest, farthest, locate = bounds
        self._bounds[1:5] = longest, shortest, float(locate), farthest

    def start(
        self, mode: ModeName, x: Array | list[float], situated: Situated, limit: float, h: float, *, through: bool
    ) -> None:
        """Begin to slide in a mode from x (n_x,) with a step of length h [s]; it may last `limit` [s].

        Args:
            through: whether to go on in the other mode of sliding.
        """
        self._constants[-5:] = situated.numbers
        self._bounds[0], self._bounds[-1] = limit, through
        self._z[: self.places.n] = x
        self._z[self.places.ends] = self._ends[mode]()
        n = self.places.n
        self._z[n : n + 10] = (0.0, MODES.index(mode), 0.0, h, 0.0, 0.0, 0.0, 0.0, 0.0, DIPS)

    @property
    def speeding(self) -> float:
        """How fast the speed along the direction of slip rises at the last node [m/s^2]."""
        return self.ends[N_GUARDS + GUARDS.index("speed")]

    def go_on(self) -> list[list[float]]:
        """Several trials from where the last call stopped: rows of state, time, mode, stop and h as in `Pace`, the last
        one where it stopped."""
        rows = self._burst().reshape(self.method.trials, -1)
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

    def coefficient(self, mode: ModeName, x: list[float], t: float) -> float:
        """Friction coefficient in state x at time t [s], positive where friction brakes."""
        self._xth[:-2], self._xth[-2] = x, t
        return float(self._coefficients[mode]()[0])


_IDLE: dict[tuple[Model, Method], list[Stepper]] = {}


def borrowed(model: Model, method: Method) -> Stepper:
    """A stepper nobody uses: one that was given back, or a new one."""
    idle = _IDLE.get((model, method))
    return idle.pop() if idle else Stepper(model, method)


def give_back(stepper: Stepper) -> None:
    """Let others use it."""
    _IDLE.setdefault((stepper.model, stepper.method), []).append(stepper)
