"""What effects are made of: parameters, states and the ports they deliver their terms to."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType, SimpleNamespace
from typing import Any, ClassVar, Literal

from identify.base.wording import three_figures

Expression = Any  # a CasADi SX, or a float
NOTHING: Mapping[str, Expression] = MappingProxyType({})


@dataclass(frozen=True)
class Parameter:
    """One number of the model: its SI unit, admissible box and how it is searched.

    `scale` "log" means that the logarithm is estimated (the quantity is positive); `spread` is
    the typical size of its uncertainty before a fit, in `scale` units: it only conditions.
    `kind`: "friction" is searched unless fixed; "rig" stands in [rig]; "given" is taken as the scene (or
    the default) has it and searched only where [parameters] gives it a start or a prior. `own`: where it is searched,
    every log has its own (a phase: each record begins at its own time).
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
    kind: Literal["friction", "rig", "given"] = "friction"
    own: bool = False


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
    direction: +1 or -1, the sign of sliding; elongation of the spring [m]; normal_force [N];
    time [s] since the start of the record; pace: how fast contacts age against the clock (1: as it says).
    """

    p: SimpleNamespace
    x: SimpleNamespace
    v: Expression
    elongation: Expression
    drive_speed: Expression
    normal_force: Expression
    direction: Expression
    time: Expression
    pace: Expression


@dataclass(frozen=True)
class Wave:
    """A harmonic displacement amplitude * sin(omega * time + phase) of the drive [m], [rad/s], [rad]."""

    amplitude: Expression
    omega: Expression
    phase: Expression


@dataclass(frozen=True)
class Series:
    """A Kelvin-Voigt element in series with the rig: stiffness [N/m], damping [N s/m] (positive).

    Its deformation [m] is the state called `state`; its rate is written by the model.
    """

    state: str
    stiffness: Expression
    damping: Expression


@dataclass(frozen=True)
class Lag:
    """A first-order lag of the load cell: time constant [s], and the state [N] that follows the force."""

    state: str
    time: Expression


@dataclass(frozen=True)
class Terms:
    """The ports: every effect adds to some of them, the model sums each port over its effects.

    inertia [kg]; damping [N s/m], a damper beside the spring of the rig; kinetic [1], added to the kinetic
    friction coefficient; strengthening [1], share of (mu_s - mu_k) that is present (None: the effect has none);
    strength [1], logarithm of a factor on that share; excess [1], added to the coefficient whatever the
    strengthening, at rest too; level [1], logarithm of a factor on all friction; loading [1], relative change of
    the rate at which the drive stretches the spring while sticking; clock [s], ageing time gained over the clock by
    s.time, a function of s.time and p alone; waves and drift [m/s], motion of the drive beyond its programme; series,
    a compliance between rig and contact; lag, gain [1], offset [N] and averaging [s] of the load cell; rates:
    d(state)/dt by state name.
    """

    inertia: Expression = 0.0
    damping: Expression = 0.0
    kinetic: Expression = 0.0
    strengthening: Expression | None = None
    strength: Expression = 0.0
    excess: Expression = 0.0
    level: Expression = 0.0
    loading: Expression = 0.0
    clock: Expression = 0.0
    waves: tuple[Wave, ...] = ()
    drift: Expression = 0.0
    series: Series | None = None
    lag: Lag | None = None
    gain: Expression = 1.0
    offset: Expression = 0.0
    averaging: Expression = 0.0
    rates: Mapping[str, Expression] = field(default_factory=lambda: NOTHING)


@dataclass(frozen=True)
class Importance:
    """When an effect matters: a dimensionless group, its value, and the sentence that says what it means."""

    group: str
    value: float
    sentence: str


class Effect(ABC):
    """One effect: a file that declares all it needs.

    name: what the scene calls it; says: one line; source: equation or reference; `null`: parameter values at
    which it is as good as absent (zero or infinity for a log-scaled parameter: a limit); `role`: of the effects that
    share a role (interchangeable laws) a scene takes one at most; `needs`: effects it cannot do without.
    """

    name: ClassVar[str]
    says: ClassVar[str]
    source: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    states: ClassVar[tuple[State, ...]] = ()
    null: ClassVar[Mapping[str, float]] = NOTHING
    role: ClassVar[str] = ""
    needs: ClassVar[tuple[str, ...]] = ()
    follows_load: ClassVar[bool] = False  # whether it asks for the measured course of the normal force, not its mean

    def terms(self, s: Situation) -> Terms:
        """The effect's contribution to every port in this situation."""
        return Terms()

    def at_rest(self, s: Situation, aged: Expression) -> Mapping[str, Expression]:
        """Those of its states that change while the mass rests, after an ageing time `aged` [s] from the situation s:
        closed form. The states of a series element and of a lag are the model's business."""
        return NOTHING

    def at_stick(self, s: Situation) -> Mapping[str, Expression]:
        """Those of its states that jump where a slip has come to rest and a stick begins."""
        return NOTHING

    def finest(self, p: SimpleNamespace) -> Expression | None:
        """Shortest length of sliding over which its terms swing to and fro [m]; None where they do not."""
        return None

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance | None:
        """When it matters, from the numbers of a scene; None where numbers alone do not decide it."""
        return None

    def refusal(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> str | None:
        """Why it does not apply at this operating point (outside its measured range), a sentence with its remedy."""
        return None

    def unfit(self, p: Mapping[str, float]) -> str | None:
        """Why a fit cannot follow what a simulation does with it, a sentence with its remedy."""
        return None


# Typical numbers of a slip and of a stick, from the numbers of a scene alone: undamped, for orders of magnitude.

TINY = 1e-300


def fall(p: Mapping[str, float], normal_force: float) -> float:
    """Fall of the friction force from static to kinetic [N], positive."""
    return max(abs(p["mu_s"] - p["mu_k0"]) * normal_force, TINY)


def stick_time(p: Mapping[str, float], normal_force: float, drive_speed: float) -> float:
    """How long the drive takes to load the spring by a drop of twice the fall [s]."""
    return 2 * fall(p, normal_force) / (p["stiffness"] * max(abs(drive_speed), TINY))


def slip_time(p: Mapping[str, float], normal_force: float, drive_speed: float) -> float:
    """Half a natural period [s]; a rig without mass has none, its time is that of a stick."""
    mass = p.get("mass", 0.0)
    return math.pi * math.sqrt(mass / p["stiffness"]) if mass else stick_time(p, normal_force, drive_speed)


def slip_speed(p: Mapping[str, float], normal_force: float, drive_speed: float) -> float:
    """Highest speed of a slip [m/s]; a rig without mass slides at the speed of the drive."""
    mass = p.get("mass", 0.0)
    swing = fall(p, normal_force) / math.sqrt(mass * p["stiffness"]) if mass else 0.0
    return abs(drive_speed) + swing


def lost_per_period(damping_ratio: float) -> float:
    """Share of its amplitude that a free swing loses in one period."""
    if damping_ratio >= 1.0:
        return 1.0
    return -math.expm1(-2 * math.pi * damping_ratio / math.sqrt(1 - damping_ratio**2))


def change_in_a_slip(speed: float, share: float) -> str:
    """How much kinetic friction changes up to the highest speed of a slip [m/s], as a share of the fall, in words."""
    return (
        f"up to about {three_figures(1e3 * speed)} mm/s in a slip kinetic friction changes by "
        f"{three_figures(100 * share)} % of μs − μk0"
    )
