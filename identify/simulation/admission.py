"""What a simulation is asked must make sense: checked once, before anything moves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from identify.base.errors import SimulationError
from identify.effects import ALL
from identify.effects.quantities import Parameter
from identify.model.model import BASE_STATES, Model

ROUNDING = 1e-9  # by which a state may start outside its bounds
LARGE = 1e100
PHASE = 1e-3  # [rad]: what rounding may make of the phase of a vibration at the end of a record


def admit(model: Model, values: Mapping[str, float], duration: float, start: Mapping[str, float]) -> None:
    """Let pass what can be simulated.

    Args:
        values: parameters by name, SI. duration: [s]. start: initial states by name.

    Raises:
        SimulationError: a parameter that is missing, not finite or has a sign that it cannot have; a duration that is
            not positive and finite, or so long that a vibration has no phase any more; a state that nobody knows, that
            is not finite or that lies outside its bounds.
    """
    if not 0.0 < duration < np.inf:
        raise SimulationError(f"the duration is {duration} s; expected a positive time")
    for parameter in model.parameters:
        if parameter.name not in values:
            raise SimulationError(f"the parameter {parameter.name} is missing; give it a value")
        if not _possible(parameter, values[parameter.name]):
            raise SimulationError(
                f"the parameter {parameter.name} is {values[parameter.name]:g} {parameter.unit}".rstrip()
                + f"; expected {_expected(parameter)}"
            )
    _tell_phases(model, values, duration)
    if not start:
        return
    states = {s.name: s for s in model.states}
    known = {s.name for s in BASE_STATES} | {s.name for effect in ALL for s in effect.states} | set(states)
    for name, value in start.items():
        if name not in known:
            raise SimulationError(
                f"the motion is to start with {name!r}, which is no state; states are {sorted(known)}"
            )
        state = states.get(name)
        low = -LARGE if state is None or state.lower is None else state.lower - ROUNDING
        high = LARGE if state is None or state.upper is None else state.upper + ROUNDING
        if not low <= value <= high:
            raise SimulationError(f"{name} starts at {value:g}; expected a number from {low:.3g} to {high:.3g}")


def _tell_phases(model: Model, values: Mapping[str, float], duration: float) -> None:
    if not model.vibrates:
        return
    p = np.array([values[name] for name in model.parameter_names], float)
    omegas, forces = (np.array(f(p)).ravel() for f in (model.waves, model.swings))
    fastest = float(np.max(omegas[forces > 0.0], initial=0.0))
    if np.finfo(float).eps * fastest * duration > PHASE:
        raise SimulationError(
            f"the drive vibrates {fastest * duration / (2.0 * np.pi):.1g} times within {duration:g} s: no digits are "
            "left of the phase of the vibration; shorten the record, or leave out that vibration"
        )


def _possible(parameter: Parameter, value: float) -> bool:
    """Whether its law can be evaluated: the box says which sign it has, not how large it may be."""
    if parameter.lower > 0.0:
        return 0.0 < value < np.inf
    return (0.0 if parameter.lower == 0.0 else -np.inf) <= value < np.inf and value > -np.inf


def _expected(parameter: Parameter) -> str:
    if parameter.lower > 0.0:
        return "a positive number"
    return "a number from 0 on" if parameter.lower == 0.0 else "a finite number"
