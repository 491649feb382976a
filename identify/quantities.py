"""What effects are made of: parameters, states and the ports they deliver their terms to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType, SimpleNamespace
from typing import Any, Literal, Protocol

Expression = Any  # a CasADi SX, or a float
NOTHING: Mapping[str, Expression] = MappingProxyType({})


@dataclass(frozen=True)
class Parameter:
    """One number of the model: its SI unit, admissible box and how it is searched.

    `scale` "log" means that the logarithm is estimated (the quantity is positive); `spread` is
    the typical size of its uncertainty before a fit, in `scale` units: it only conditions.
    """

    name: str
    unit: str
    lower: float
    upper: float
    default: float
    symbol: str
    meaning: str
    scale: Literal["linear", "log"] = "log"
    spread: float = 0.5


@dataclass(frozen=True)
class State:
    """One state of the model. A state with a `lower` bound is clamped there while its rate points outward."""

    name: str
    unit: str
    start: float
    lower: float | None = None
    upper: float | None = None


@dataclass(frozen=True)
class Situation:
    """What an effect may look at, as CasADi expressions, all in SI.

    p: parameters by name; x: the effects' states by name; v: sliding speed along the direction
    of slip [m/s] (never negative but for trial steps of a solver); drive_speed [m/s], signed;
    direction: +1 or -1, the sign of sliding; elongation of the spring [m]; normal_force [N].
    """

    p: SimpleNamespace
    x: SimpleNamespace
    v: Expression
    elongation: Expression
    drive_speed: Expression
    normal_force: Expression
    direction: Expression


@dataclass(frozen=True)
class Terms:
    """The ports: every effect adds to some of them, the model sums each port over its effects.

    inertia [kg]; rig_force [N], transmitted by the rig and seen by the load cell, positive along
    the drive; kinetic [1], added to the kinetic friction coefficient; strengthening [1], share of
    (mu_s - mu_k) that is present (None: the effect has none); rates: d(state)/dt by state name.
    """

    inertia: Expression = 0.0
    rig_force: Expression = 0.0
    kinetic: Expression = 0.0
    strengthening: Expression | None = None
    rates: Mapping[str, Expression] = field(default_factory=lambda: NOTHING)


class Effect(Protocol):
    """One effect: a file that declares all it needs. `null` are values at which it is as good as absent."""

    @property
    def name(self) -> str:
        """What the scene calls it."""
        ...

    @property
    def source(self) -> str:
        """Equation or reference."""
        ...

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What it needs to know."""
        ...

    @property
    def states(self) -> tuple[State, ...]:
        """What it keeps in memory."""
        ...

    @property
    def null(self) -> Mapping[str, float]:
        """Parameter values at which it is as good as absent."""
        ...

    def terms(self, s: Situation) -> Terms:
        """The effect's contribution to every port in this situation."""
        ...

    def at_rest(self, s: Situation, t: Expression) -> Mapping[str, Expression]:
        """The effect's states after resting for t [s] from the situation s: closed form."""
        ...

    def at_arrest(self, s: Situation, deceleration: Expression) -> Mapping[str, Expression]:
        """The effect's states when a slip that had them clamped comes to rest, deceleration [m/s^2] > 0."""
        ...


class Stateless:
    """What an effect without states of its own answers about them."""

    states: tuple[State, ...] = ()

    def at_rest(self, s: Situation, t: Expression) -> Mapping[str, Expression]:
        """No states: nothing evolves."""
        return NOTHING

    def at_arrest(self, s: Situation, deceleration: Expression) -> Mapping[str, Expression]:
        """No states: nothing evolves."""
        return NOTHING
