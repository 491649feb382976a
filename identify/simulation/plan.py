"""From one number, the accuracy, to a method and its tolerance for every sliding mode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import compiled
from identify.base.errors import SimulationError
from identify.model.model import ELONGATION, SPEED, Model
from identify.model.modes import ModeName, sliding_modes
from identify.simulation.methods import HIGH, LINEAR, LOW, MIDDLE, STIFF, Method
from identify.simulation.scales import Scales, scales
from identify.simulation.stepping import takes

Array = NDArray[np.float64]

ACCURACY = 1e-10  # where nobody asks and no noise is known
BELOW_NOISE = 0.1  # of the noise: what the integration may be wrong by
LOOSEST = 1e-4  # where the noise would allow more: a record stays free of visible errors
# Down to this accuracy the method is the cheapest (docs/accuracy.md).
BY_ACCURACY: tuple[tuple[float, Method], ...] = ((1e-1, LOW), (1e-3, MIDDLE), (0.0, HIGH))
SAFETY = 10.0  # tolerance of a step: this much finer than the accuracy of the record
FINEST, COARSEST = 1e-14, 1e-2  # tolerances of a step
APART = 100.0  # tolerances of two runs whose distance tells the error
CAUTION = 10.0  # of that factor, how much is not counted on towards a looser run
TIGHT_SHARE = 1.5  # of the distance to a tighter run: that has an error too
TIGHTEST = 1e-13  # rounding takes over below
STIFF_FROM = 300.0  # decay rates times the natural time: explicit steps would be held back by them, not by their error
SPEEDS = (1e-3, 1e-1)  # of the speed at which one normal force stops the mass: where decays are looked at


@dataclass(frozen=True)
class Plan:
    """rtol: relative tolerance of one step; methods per sliding mode, in the order in which they take over."""

    rtol: float
    methods: Mapping[ModeName, tuple[Method, ...]]

    def other(self) -> tuple[Plan, float]:
        """A plan to judge this one by, and the share of the distance between the two that is the error of this one:
        a tighter one where there is room for it, else a looser one."""
        rtol, share = other(self.rtol)
        return Plan(rtol, self.methods), share


def other(rtol: float) -> tuple[float, float]:
    """A tolerance to judge one by, and the share of the distance between the two runs that is the error of the one."""
    if rtol / APART >= TIGHTEST:
        return rtol / APART, TIGHT_SHARE
    return rtol * APART, CAUTION / APART


def accuracy_for(noise: float | None, force: float) -> float:
    """The accuracy a record deserves: an order below its noise [N] over its force [N]; without noise `ACCURACY`."""
    if not noise:
        return ACCURACY
    return float(np.clip(BELOW_NOISE * noise / force, ACCURACY, LOOSEST))


def plan(model: Model, p: Array, scale: Scales, accuracy: float, *, steady: bool) -> Plan:
    """Methods and tolerance that keep switch times and forces of a record within `accuracy` (relative).

    Linear laws are summed in closed form; motions with fast decays are left to an implicit method; the rest to the
    cheapest explicit one, behind which the implicit one waits.

    Args:
        p: parameters (n_p,). steady: whether the normal force stands still.
    """
    chosen = next(method for least, method in BY_ACCURACY if accuracy >= least)
    methods: dict[ModeName, tuple[Method, ...]] = {}
    stiff = _stiff(model, p, scale)
    for mode in sliding_modes(model.clamped is not None):
        # What holds an explicit method back may hold the implicit one back more: then the first one has the last word.
        general = (STIFF, chosen) if stiff else (chosen, STIFF, chosen)
        methods[mode] = (LINEAR, *general) if takes(model, LINEAR, mode, steady) and not stiff else general
    return Plan(float(np.clip(accuracy / SAFETY, FINEST, COARSEST)), methods)


def only(model: Model, method: Method, rtol: float) -> Plan:
    """One method for every mode, with a tolerance of its steps: for comparisons.

    Raises:
        SimulationError: the method does not integrate this motion.
    """
    modes = sliding_modes(model.clamped is not None)
    refused = [mode for mode in modes if not takes(model, method, mode, steady=False)]
    if refused and not all(takes(model, method, mode, steady=True) for mode in refused):
        raise SimulationError(
            f"{method.name} is for {method.says}, and the mode {refused[0]} of this model is not of that kind: "
            "leave the choice to the accuracy, or take another method"
        )
    return Plan(rtol, dict.fromkeys(modes, (method,)))


@lru_cache(maxsize=32)
def _jacobian(model: Model) -> ca.Function:
    """(x, p, u) -> d(dx/dt)/dx while sliding, column by column."""
    x, p, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters)), ca.SX.sym("u", 4)
    return ca.Function("jacobian", [x, p, u], [ca.densify(ca.vec(ca.jacobian(model.slip(x, p, u), x)))])


def _stiff(model: Model, p: Array, scale: Scales) -> bool:
    """Whether small disturbances of sliding, slow or fast, decay much faster than the mass moves."""
    return _pace(model, p.tobytes(), scale.normal_force)[0]


def growth(model: Model, p: Array, scale: Scales) -> float:
    """The fastest growth [1/s] of a slip that has just begun, its contact saturated: it grows from nothing."""
    return _pace(model, p.tobytes(), scale.normal_force)[1]


@lru_cache(maxsize=256)
def _pace(model: Model, parameters: bytes, normal_force: float) -> tuple[bool, float]:
    """Whether the motion is stiff, and its growth: kept, as many runs share their parameters."""
    p = np.frombuffer(parameters)
    scale = scales(model, p, normal_force)
    return _decays(model, p, scale), _grows(model, p, scale)


def _decays(model: Model, p: Array, scale: Scales) -> bool:
    slopes = _slopes(model, p, scale, [s.start for s in model.states], SPEEDS)
    # No eigenvalue exceeds the largest row sum: mostly that is enough to say no.
    bound = np.abs(slopes * (scale.state / scale.state[:, None])).sum(axis=2).max()
    if not np.isfinite(bound) or bound * scale.time <= STIFF_FROM:
        return False
    return float(-np.min(np.linalg.eigvals(slopes).real)) * scale.time > STIFF_FROM


def _grows(model: Model, p: Array, scale: Scales) -> float:
    slopes = _slopes(model, p, scale, [s.start if s.upper is None else s.upper for s in model.states], (0.0,))[0]
    return max(float(np.max(np.linalg.eigvals(slopes).real)), 0.0) if np.all(np.isfinite(slopes)) else 0.0


def _slopes(model: Model, p: Array, scale: Scales, states: list[float], speeds: tuple[float, ...]) -> Array:
    """d(dx/dt)/dx (m, n_x, n_x) while sliding at m speeds (in typical ones) under the typical elongation."""
    n = len(model.states)
    x, u = np.array(states, float), np.array([0.0, scale.normal_force, 1.0, 0.0])
    x[ELONGATION] = scale.state[ELONGATION]
    call = compiled(_jacobian(model))
    call.bind([x, np.array(p), u])
    slopes = np.empty((len(speeds), n, n))
    for i, share in enumerate(speeds):
        x[SPEED] = share * scale.state[SPEED]
        slopes[i] = call().reshape(n, n).T
    return slopes
