"""Every effect in company: compositions to test it in, admissible values of everything, functions as numpy."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pint
from numpy.typing import NDArray

from identify.effects import ALL, MAIN
from identify.effects.quantities import Effect, Parameter
from identify.model.model import Model, assemble
from identify.simulation.plan import Stepping
from identify.simulation.simulate import run
from tests.support import effect_oracle

Array = NDArray[np.float64]

BY_NAME = {effect.name: effect for effect in ALL}
FORCE, SPEED = 1.3, 1e-3  # an ordinary normal force [N] and drive speed [m/s]
UNITS = pint.UnitRegistry()
# Sizes of states by their unit, as they occur at ordinary loads.
SIZES = {"m": 3e-4, "m/s": 2e-2, "N": 0.7, "": 0.6}
# Functions of (x, p, u) and the unit of their result; "state" and "rate": that of each state, that per second.
OF_STATE = {
    "slip": "rate",
    "renewed": "rate",
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
    """The same composition with the effect off, and with it those that cannot do without."""
    return tuple(n for n in company(effect) if n != effect.name and effect.name not in _effect(n, effect).needs)


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


# ---- motions, compared with the independent integrator

# Where the defaults hardly tell, or tell too late for a short run.
TELLING = {
    "occlusion_time": 1.0,
    "occlusion_hastening": 0.5,
    "occlusion_level": 0.2,
    "sensor_gain": 1.05,
    "sensor_offset": 0.02,
    "averaging_time": 3e-3,
    "finger_drift": 2e-5,
    "tremor_phase": 0.4,
    "excitation_amplitude": 5e-6,
    "slope": -2.0,
    "damping_frequency": 20.0,
    "direct_strength": 0.01,
    "lag_time": 2e-3,
    "second_lag_time": 2e-3,
}
WHOLE = ("field_seed",)
RTOL = 1e-13  # of both integrators, per step
TIMES, FORCES = 2e-12, 1e-10  # s, N: what they leave over a run
DRIVE, LOAD, DURATION = 2e-3, 1.3, 0.6  # m/s, N, s: a few cycles
COURSE = ((0.0, 1.3), (0.15, 1.1), (0.4, 1.6), (0.6, 1.5))  # a normal force that varies: (s, N)


@dataclass(frozen=True)
class Departure:
    """How far two runs differ: slips, event times [s], force [N] (also between the events)."""

    slips: int
    times: float
    force: float


def numbers(names: tuple[str, ...], random: np.random.Generator | None = None) -> dict[str, float]:
    """Parameter values that make every effect tell; drawn around them with `random`."""
    model = assemble(names)
    centre = [replace(q, default=TELLING.get(q.name, q.default)) for q in model.parameters]
    p = {q.name: q.default if random is None else drawn(q, random) for q in centre}
    return p | {name: float(round(p[name])) for name in WHOLE if name in p}


def load_of(names: tuple[str, ...]) -> float | tuple[tuple[float, float], ...]:
    """The normal force of a run: its course where it counts."""
    return COURSE if "varying_normal_force" in names else LOAD


def departure(
    names: tuple[str, ...],
    p: dict[str, float],
    *,
    drive: float = DRIVE,
    against: dict[str, float] | None = None,
) -> Departure:
    """The simulation against the independent integrator, which may be told other numbers (`against`)."""
    load = load_of(names)
    force = load if isinstance(load, float) else tuple(np.array(load).T)
    ours = run(assemble(names), p, drive, force, DURATION, accuracy=Stepping(RTOL))
    theirs = _independent(names, tuple((against or p).items()), drive)
    times = np.linspace(0.0, DURATION, 241)
    apart = float(np.max(np.abs(ours.sample(times)["force"] - theirs.force(times))))
    events = [(ours.onsets, theirs.onsets), (ours.arrests, theirs.arrests)]
    if any(a.size != len(b) for a, b in events):
        return Departure(ours.arrests.size, math.inf, apart)
    late = max((float(np.max(np.abs(a - b), initial=0.0)) for a, b in events), default=0.0)
    return Departure(ours.arrests.size, late, apart)


@lru_cache(maxsize=2)
def _independent(names: tuple[str, ...], p: tuple[tuple[str, float], ...], drive: float) -> effect_oracle.Run:
    return effect_oracle.simulate(names, dict(p), drive, load_of(names), DURATION, rtol=RTOL)


def subset(random: np.random.Generator) -> tuple[str, ...]:
    """A random composition with inertia: of interchangeable laws one at most, with all it needs."""
    names, roles = ["inertia"], {""}
    for index in random.permutation(len(ALL)):
        effect = ALL[index]
        wanted = [effect.name, *effect.needs]
        new = [n for n in wanted if n not in names]
        if random.random() < 0.5 and not any(BY_NAME[n].role in roles - {""} for n in new):
            names += new
            roles |= {BY_NAME[n].role for n in new}
    return tuple(sorted(names, key=list(BY_NAME).index))
