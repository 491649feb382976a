"""From one number, the accuracy, to a method and its tolerance for every sliding mode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.model.model import ELONGATION, SPEED, Model
from identify.simulation.sliding import linearised
from identify.simulation.steppers import HIGH, STIFF, Method

# What a simulation is asked must make sense: checked once, before anything moves.

Array = NDArray[np.float64]


def admit(model: Model, values: Mapping[str, float], duration: float) -> None:
    """Let pass what can be simulated.

    Args:
        values: parameters by name, SI. duration: [s].

    Raises:
        SimulationError: a parameter that is missing, not finite or has a sign that it cannot have; a duration that is
            not positive and finite, or so long that a vibration has no phase any more.
    """
    if not 0.0 < duration < np.inf:
        raise SimulationError(f"the duration is {duration} s; expected a positive time")
    for parameter in model.parameters:
        if parameter.name not in values:
            raise SimulationError(f"the parameter {parameter.name} is missing; give it a value")
        value, low = values[parameter.name], parameter.lower
        # A law can be evaluated at any size of the right sign.
        if not (abs(value) < np.inf and (value > 0.0 if low > 0.0 else value >= 0.0 or low < 0.0)):
            expected = "a positive number" if low > 0.0 else "a number from 0 on" if low == 0.0 else "a finite number"
            shown = f"{value:g} {parameter.unit}".rstrip()
            raise SimulationError(f"the parameter {parameter.name} is {shown}; expected {expected}")
    period = swing(model, np.array([values[name] for name in model.parameter_names], float))[0]
    if 2.0 * np.pi * np.finfo(float).eps * duration / period > 1e-3:  # [rad] of rounding at the end
        raise SimulationError(
            f"the drive vibrates {duration / period:.1g} times within {duration:g} s: no digits are "
            "left of the phase of the vibration; shorten the record, or leave out that vibration"
        )


# Typical sizes of a scene: they set first steps and absolute tolerances.

SPEEDS = (1e-3, 1e-1)  # of the speed at which one normal force stops the mass: where decays are looked at


@dataclass(frozen=True)
class Scales:
    """Typical time [s] and state sizes (n_x,) of a scene.

    No step is longer than `longest` [s] or goes farther than `farthest` [m]: an error estimate sees no vibration
    and no track that it steps over. No first step of a slide is longer than `first` [s]. stiff: whether small
    disturbances of sliding, slow or fast, decay much faster than the mass moves.
    """

    time: float
    state: Array
    longest: float
    farthest: float = np.inf
    first: float = np.inf
    stiff: bool = False


def swing(model: Model, p: Array) -> tuple[float, float]:
    """Shortest period [s] of what oscillates in the drive (infinite without), bound of its force on the contact [N]."""
    if not model.vibrates:
        return np.inf, 0.0
    forces, omegas = np.array(model.swings(p)).ravel(), np.array(model.waves(p)).ravel()
    moving = forces > 0.0
    return (2.0 * np.pi / float(np.max(omegas[moving])), float(np.sum(forces))) if moving.any() else (np.inf, 0.0)


def scales(model: Model, p: Array, normal_force: float) -> Scales:
    """Natural time scale sqrt(m/k), and the states a load of one normal force [N] gives; p (n_p,)."""
    values = dict(zip(model.parameter_names, p.tolist(), strict=True))
    k, m = values["stiffness"], values["mass"]
    state, time = np.ones(len(model.states)), float(np.sqrt(m / k))
    state[ELONGATION], state[SPEED] = normal_force / k, normal_force / np.sqrt(k * m)
    farthest = float(np.min(np.array(model.finest(p)))) if model.finest.numel_out(0) else np.inf
    # A slip that begins, its contact saturated: it grows from nothing. Then slow and fast sliding.
    begin = [s.start if s.upper is None else s.upper for s in model.states]
    x = np.array([begin, *([[s.start for s in model.states]] * len(SPEEDS))])
    x[:, ELONGATION], x[:, SPEED] = state[ELONGATION], state[SPEED] * np.array([0.0, *SPEEDS])
    u = np.array([0.0, normal_force, 1.0, 0.0])
    slopes = linearised(model, False, x, *(np.repeat(q[None], len(x), axis=0) for q in (p, u)))[1]
    slopes[~np.isfinite(slopes).all(axis=(1, 2))] = 0.0
    rates = np.linalg.eigvals(slopes).real
    growth, decay = float(np.max(rates[0])), -float(np.min(rates[1:]))
    # No first step is longer than a tenth of the time in which a slip that has just begun grows e-fold.
    first = 0.1 / growth if growth > 0.0 else np.inf
    # Four steps on one period or wave, at least.
    # Explicit steps would be held back by faster decays, not by their error.
    return Scales(time, state, swing(model, p)[0] / 4.0, farthest / 4.0, first, decay * time > 300.0)


ACCURACY = 1e-10  # where nobody asks and no noise is known
SAFETY = 10.0  # tolerance of a step: this much finer than the accuracy of the record
FINEST, COARSEST = 1e-14, 1e-2  # tolerances of a step
APART = 100.0  # tolerances of two runs whose distance tells the error
LOOSER_SHARE = 0.1  # of the distance to the looser one of them is at most the error of the tighter one


@dataclass(frozen=True)
class Stepping:
    """Relative tolerance of one step; where a comparison or a control says so, the one method for all sliding (None: as
    the motion asks for), and whether switches are located (see `Machine`)."""

    rtol: float
    method: Method | None = None
    locate: bool = True

    @staticmethod
    def of(accuracy: float) -> Stepping:
        """That of a motion with a relative accuracy."""
        return Stepping(float(np.clip(accuracy / SAFETY, FINEST, COARSEST)))

    def methods(self, stiff: bool) -> tuple[Method, ...]:
        """Methods in the order in which they take over.

        Motions with fast decays are left to an implicit method, the rest to an explicit one of high order. Either waits
        behind the other, and what holds an explicit method back may hold the implicit one back more: then the first one
        has the last word.
        """
        if self.method is not None:
            return (self.method,)
        return (STIFF, HIGH) if stiff else (HIGH, STIFF, HIGH)

    def other(self) -> tuple[Stepping, float]:
        """Steps to judge these by, and the share of the distance between the two that is the error of these: tighter
        ones where there is room for them, else looser ones."""
        if self.rtol / APART >= 1e-13:  # rounding takes over below
            # The tighter ones have an error too.
            return replace(self, rtol=self.rtol / APART), 1.5
        return replace(self, rtol=self.rtol * APART), LOOSER_SHARE


def accuracy_for(noise: float | None, force: float) -> float:
    """The accuracy a record deserves: an order below its noise [N] over its force [N]; without noise `ACCURACY`."""
    if not noise:
        return ACCURACY
    return float(np.clip(0.1 * noise / force, ACCURACY, 1e-4))
