"""Every effect in company: compositions to test it in, admissible values of everything, functions as numpy."""

from __future__ import annotations

import math

import numpy as np
import pint
from numpy.typing import NDArray

from identify.effects import ALL, MAIN
from identify.model import Model
from identify.quantities import Effect, Parameter

Array = NDArray[np.float64]

BY_NAME = {effect.name: effect for effect in ALL}
FORCE, SPEED = 1.3, 1e-3  # an ordinary normal force [N] and drive speed [m/s]
UNITS = pint.UnitRegistry()
# Sizes of states by their unit, as they occur at ordinary loads.
SIZES = {"m": 3e-4, "m/s": 2e-2, "N": 0.7, "": 0.6}
# Functions of (x, p, u) and the unit of their result; "state" and "rate": that of each state, that per second.
OF_STATE = {
    "slip": "rate",
    "saturated": "rate",
    "driving_force": "N",
    "grip": "N",
    "load": "N",
    "load_cell": "N",
    "at_stick": "state",
}


def company(effect: Effect) -> tuple[str, ...]:
    """The main effects without rivals of this one, what it needs, and the effect itself."""
    names = [n for n in MAIN if not effect.role or BY_NAME[n].role != effect.role]
    wanted = [effect.name]
    while wanted:
        name = wanted.pop()
        if name not in names:
            names.append(name)
        wanted.extend(need for need in _effect(name, effect).needs if need not in names)
    return tuple(names)


def _effect(name: str, own: Effect) -> Effect:
    return own if name == own.name else BY_NAME[name]


def without(effect: Effect) -> tuple[str, ...]:
    """The same composition with the effect off."""
    return tuple(n for n in company(effect) if n != effect.name)


def together() -> tuple[str, ...]:
    """All effects that go together: of interchangeable laws the first in the table."""
    roles: set[str] = set()
    names = []
    for effect in ALL:
        if effect.role and effect.role in roles:
            continue
        roles.add(effect.role)
        names.append(effect.name)
    return tuple(names)


def drawn(parameter: Parameter, random: np.random.Generator) -> float:
    """A value inside the box, near the default."""
    if parameter.scale == "log":
        value = parameter.default * math.exp(0.3 * random.standard_normal())
    else:
        value = parameter.default + 0.5 * parameter.spread * random.standard_normal()
    return float(np.clip(value, parameter.lower, parameter.upper))


def values(model: Model, random: np.random.Generator | None = None) -> Array:
    """p at the defaults, or drawn near them (n_p,)."""
    return np.array([q.default if random is None else drawn(q, random) for q in model.parameters])


def state(model: Model, random: np.random.Generator) -> Array:
    """A state as it occurs in sliding (n_x,): speed positive, bounded states within their bounds."""
    x = np.empty(len(model.states))
    for i, s in enumerate(model.states):
        x[i] = SIZES[s.unit] * random.uniform(0.2, 1.4)
        if s.lower is not None and s.upper is not None:
            x[i] = random.uniform(s.lower, s.upper)
    return x


def inputs(random: np.random.Generator, direction: float = 1.0) -> Array:
    """u (4,): drive speed, normal force, direction of sliding, time."""
    return np.array([SPEED * random.uniform(0.5, 2), FORCE * random.uniform(0.5, 2), direction, random.uniform(1, 9)])


def result(model: Model, name: str, *arguments: Array | float) -> Array:
    """One function of the model, flat."""
    return np.array(getattr(model, name)(*arguments)).ravel()


def factor(unit: str, mass: float, length: float, time: float) -> float:
    """What the number of a quantity is multiplied with when the units of kg, m and s become smaller by these."""
    powers = dict(UNITS.Quantity(1.0, unit or "dimensionless").to_base_units().dimensionality)
    sizes = {"[mass]": mass, "[length]": length, "[time]": time}
    unknown = set(powers) - set(sizes)
    if unknown:
        raise ValueError(f"the unit {unit!r} is made of {sorted(unknown)}; expected kg, m and s only")
    return math.prod(sizes[dimension] ** power for dimension, power in powers.items())
