"""All that moves one scene: which method is at work, its tolerances and its first steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identify.model.model import ELONGATION, SPEED, Model
from identify.model.modes import GUARDS, ModeName, sliding_modes
from identify.simulation import resting
from identify.simulation.bursts import SHORTEST
from identify.simulation.plan import Plan, Scales, growth
from identify.simulation.stepper import Situated, Stepper, borrowed, give_back

Array = NDArray[np.float64]

PATIENCE = 3000  # trials of one slide after which the next method takes over, where there is one
CRAWLING = 300, 1e-3  # trials after which it does so if their mean length is less than that, in natural times
FIRST = 1e-3  # of the natural time: the very first step
BEGINNING = 0.1  # of the time in which a slip that has just begun grows e-fold: no first step is longer
FLOOR = 1e-6  # absolute over relative tolerance, of typical states
ROUNDING = 1e-12  # what the rounding of the forces makes of the speed within a thousandth of the natural time
CREEP = 1e-13  # of the typical speed: a mass that creeps to rest under a drive at rest does not get slower


class Machine:
    """All that moves one scene: its rests, and the stepper of the method that is at work.

    Holds buffers, so one per thread. It remembers between phases which method that is and how long a first step may
    be: one slip is like the next.

    Args:
        p: parameters (n_p,).
        locate: False takes the step at whose end a guard is negative as it is (a control for tests: accuracy is lost).
        stops: False slides on where the mass comes to rest, by the motion forwards.
    """

    def __init__(
        self, model: Model, p: Array, scale: Scales, plan: Plan, *, locate: bool = True, stops: bool = True
    ) -> None:
        self.model, self.locate, self.scale, self.p, self.stops = model, locate, scale, p, stops
        floor = FLOOR * self.scale.state
        # The speed of a slip that starts from balance grows from nothing: relative down to the rounding of the forces.
        floor[SPEED] *= min(ROUNDING / plan.rtol, 1.0)
        self.tolerances = np.concatenate([[plan.rtol], plan.rtol * floor])
        self._left, self._borrowed = list(plan.methods), list[Stepper]()
        self.stepper = self._next()
        self.rests = resting.borrowed(model)
        fastest = growth(model, p, scale)
        self.longest_first = BEGINNING / fastest if fastest > 0.0 else np.inf
        self.modes = sliding_modes(model.clamped is not None)
        self.first = dict.fromkeys(self.modes, min(FIRST * self.scale.time, self.longest_first))
        self.creep = CREEP * scale.state[SPEED]
        self.following = {name: dict(mode.exits) for name, mode in self.modes.items()}
        self.exits = {
            name: tuple(GUARDS.index(guard) for guard, _ in mode.exits if stops or guard != "speed")
            for name, mode in self.modes.items()
        }

    def _next(self) -> Stepper:
        """The stepper of the first method that is left."""
        method, scale = self._left[0], self.scale
        stepper = borrowed(self.model, method, self.stops)
        self._borrowed.append(stepper)
        longest = min(method.reach * scale.time, scale.longest)
        stepper.tune(self.p, self.tolerances, (longest, SHORTEST * scale.time, scale.farthest, self.locate))
        return stepper

    def close(self) -> None:
        """Give back what others can use: the run is over."""
        resting.give_back(self.rests)
        while self._borrowed:
            give_back(self._borrowed.pop())

    def begins(self, situated: Situated, x: Array) -> ModeName:
        """The mode in which a mass that moves begins: a fresh contact that would age below nothing is clamped."""
        clamped = self.model.clamped
        if clamped is None or x[clamped] > (self.model.states[clamped].lower or 0.0):
            return "slip"
        falls = float(self.model.slip(x, self.p, situated.at(0.0, situated.direction))[clamped]) < 0.0
        return "saturated" if falls else "slip"

    def creeps(self, situated: Situated, x: Array) -> bool:
        """Whether a mass can creep to rest for ever: nothing that drives it moves or changes with time."""
        if situated.drive_speed != 0.0 or situated.force_slope != 0.0 or self.model.clocked:
            return False
        still = x.copy()
        still[SPEED] = 0.0
        return float(self.model.slip(still, self.p, situated.at(0.0))[ELONGATION]) == 0.0

    def held_back(self, tried: int, reached: float) -> bool:
        """Whether so many trials that have reached so far [s] are too many, and there is a method to take over."""
        crawls = tried > CRAWLING[0] and reached < tried * CRAWLING[1] * self.scale.time
        return len(self._left) > 1 and (crawls or tried > PATIENCE)

    def give_over(self) -> bool:
        """Let the next method take over for good; False where there is none."""
        if len(self._left) == 1:
            return False
        del self._left[0]
        self.stepper = self._next()
        return True
