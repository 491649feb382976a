"""The frozen values a scene is made of: rig, contact, initial state, what is said of a parameter, a log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, get_type_hints

from identify.base.errors import SceneError
from identify.model.composition import ForceSensorPlace
from identify.scene import tables
from identify.scene.tables import AREA_LAW, CONTACT, INITIAL, NOT_NEGATIVE, POSITIVE, RIG, Course, Key, check

DriveSpeed = float | tuple[tuple[float, float], ...] | Course
RIG_TOLERANCES = ("mass", "stiffness", "damping", "drive_speed")
# What rigs and their force sensors are usually known to, relative, one standard deviation: a mass on a scale with what
# moves along, a stiffness from a weight and a dial gauge, a damping from a ring-down, a drive, two calibrated sensors.
USUAL_TOLERANCES: Mapping[str, float] = {
    "mass": 0.02,
    "stiffness": 0.02,
    "damping": 0.2,
    "drive_speed": 0.01,
    "friction_force": 0.01,
    "normal_force": 0.01,
    "friction_zero": 0.005,  # of the normal force, as the next
    "normal_zero": 0.005,
    "specimen": 0.02,  # scatter of all friction from log to log, where each speed stands in one log
}


@dataclass(frozen=True)
class Rig:
    """The machine around the contact, SI: mass m [kg] (0 only where no effect asks for it), stiffness k [N/m],
    damping h of eq. 1 [N/m].

    `drive_speed` [m/s] is constant, a programme of (start [s], speed [m/s]), piecewise constant, or a `Course`;
    `normal_force` [N] only where a log has none; `noise` [N] is the standard deviation of the force; `force_sensor`:
    where that is measured, between "drive" and mass or under the "counterface"; `arm` [m] at which a measured torque
    acts.
    `tolerances`: relative standard deviation by name (mass, stiffness, damping, drive_speed);
    what is absent is taken as exact. `ratio_tolerances`: the same of what ties them, where it is known: "zeta" of h/k,
    "natural_frequency" of sqrt(k/m).

    Raises:
        SceneError: a number that no rig can have.
    """

    mass: float
    stiffness: float
    damping: float
    drive_speed: DriveSpeed | None = None
    normal_force: float | None = None
    noise: float | None = None
    force_sensor: ForceSensorPlace = "drive"
    arm: float | None = None
    tolerances: Mapping[str, float] = field(default_factory=dict)
    ratio_tolerances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("mass", "stiffness", "damping", "normal_force", "noise", "arm", "drive_speed"):
            check(name, RIG[name], getattr(self, name))
        for name, tolerance in self.tolerances.items():
            if name not in RIG_TOLERANCES:
                raise SceneError(
                    f"{name} has a tolerance, which nothing carries on; expected one for {', '.join(RIG_TOLERANCES)}: "
                    "give the value alone"
                )
            check(f"the tolerance of {name}", Key(sign=NOT_NEGATIVE), tolerance)
        for name, tolerance in self.ratio_tolerances.items():
            check(f"the tolerance of {name}", Key(sign=POSITIVE), tolerance)

    @property
    def zeta(self) -> float:
        """Damping ratio h/(2k)."""
        return self.damping / (2.0 * self.stiffness)

    @property
    def natural_frequency(self) -> float:
        """Undamped natural frequency sqrt(k/m) [rad/s]; infinite without a mass."""
        return math.sqrt(self.stiffness / self.mass) if self.mass else math.inf

    @property
    def plate(self) -> tuple[float, float] | None:
        """Natural frequency [rad/s] and damping ratio where the force is measured under the counterface, else None."""
        return (self.natural_frequency, self.zeta) if self.force_sensor == "counterface" else None

    @property
    def half_period(self) -> float:
        """Half a natural period, the time scale of one slip [s]."""
        return math.pi / self.natural_frequency


@dataclass(frozen=True)
class Contact:
    """Apparent contact area [m^2]: `area`, or coefficient * (normal force in N)**exponent. All None: unknown."""

    area: float | None = None
    coefficient: float | None = None
    exponent: float | None = None

    def __post_init__(self) -> None:
        check("the contact area", CONTACT["area"], self.area)
        check("the coefficient of area_law", AREA_LAW["coefficient"], self.coefficient)

    @property
    def parameters(self) -> dict[str, tuple[str, float]]:
        """The parameters of the effect pressure_dependence that it stands for, and where the scene says so."""
        law: dict[str, float] = {}
        if self.coefficient is not None and self.exponent is not None:
            law = {"contact_area": self.coefficient, "area_force": 1.0, "area_exponent": self.exponent}
        elif self.area is not None:
            law = {"contact_area": self.area, "area_exponent": 0.0}
        where = "[contact] area_law" if self.area is None else "[contact] area"
        return {name: (where, value) for name, value in law.items()}

    def area_at(self, normal_force: float) -> float | None:
        """Apparent area [m^2] under a normal force [N]; None where the scene does not say."""
        if self.coefficient is not None and self.exponent is not None:
            return self.coefficient * normal_force**self.exponent
        return self.area


@dataclass(frozen=True)
class Initial:
    """State at the start of a simulation, SI: at rest, spring unloaded, fresh contact unless given."""

    elongation: float = 0.0
    sliding_speed: float = 0.0
    gamma: float = 0.0

    def __post_init__(self) -> None:
        for name in ("elongation", "sliding_speed"):
            check(f"the initial {name}", INITIAL[name], getattr(self, name))
        if not 0.0 <= self.gamma <= 1.0:
            raise SceneError(f"the initial gamma is {self.gamma:g}; expected a share between 0 and 1: correct it")


EACH_LOG = "log"  # what `per` calls a parameter that every log has for itself


@dataclass(frozen=True)
class ParameterSpec:
    """What a scene says of one parameter, SI. `start` and `fixed` are None where the user gave none.

    `per`: None for one value over all logs, "log" for one per log, else the label whose values have one each.
    `stated`: whether the scene names the parameter, whatever the value; what it leaves out has the documented default.

    Raises:
        SceneError: values that contradict each other.
    """

    name: str
    start: float | None
    lower: float
    upper: float
    fixed: float | None = None
    prior_mean: float | None = None
    prior_sd: float | None = None
    per: str | None = None
    stated: bool = field(default=False, compare=False)

    @property
    def states_value(self) -> bool:
        """Whether the scene gives a number of the parameter, equal to its default or not."""
        return self.stated and any(value is not None for value in (self.start, self.fixed, self.prior_mean))

    def __post_init__(self) -> None:
        bounds = f"its bounds {self.lower:g} to {self.upper:g}"
        if not self.lower < self.upper:
            raise SceneError(f"{self.name} has {bounds}; expected lower below upper: swap or widen them")
        for word, value in (("start", self.start), ("fixed value", self.fixed), ("prior mean", self.prior_mean)):
            if value is not None and not self.lower <= value <= self.upper:
                raise SceneError(
                    f"the {word} of {self.name} is {value:g}, outside {bounds}; move it inside or widen the bounds"
                )
        check(f"the prior sd of {self.name}", Key(sign=POSITIVE), self.prior_sd)
        fixed, own = self.fixed is not None, self.start is not None or self.prior_mean is not None
        if fixed and (own or self.per is not None):
            also = "a start or a prior" if own else f"per = {self.per!r}"
            raise SceneError(f"{self.name} is fixed and has {also} as well; keep one of them")


@dataclass(frozen=True)
class LogEntry:
    """One log of a scene and what differs from log to log. None: as in [rig], or left to the reader.

    path; step, run, columns and units as `data_io.read_log` takes them; drive_speed, normal_force,
    stiffness, mass, damping, noise as in `Rig`; window (start, stop) [s] is the part to use,
    exclude are parts to leave out [s], skip_cycles cycles to drop at the start; tare is a force [N]
    to subtract, or the (start, stop) [s] over which the unloaded force is averaged, normal_tare the same
    of the normal force; crosstalk the share of the normal force that the friction sensor shows, tilt [rad] the angle
    of the surface; flip_sign forces the sign of the friction force (None: from the data); labels are free words;
    rate [Hz] makes the clock of a log that has none; arm [m] and area [m^2] make forces of its torques and stresses.
    """

    path: Annotated[Path, Key(read=tables.text)]
    drive_speed: Annotated[DriveSpeed | None, RIG["drive_speed"]] = None
    step: Annotated[int | None, Key(read=partial(tables.of_kind, int))] = None
    run: Annotated[int | None, Key(read=partial(tables.of_kind, int))] = None
    columns: Annotated[Mapping[str, str] | None, Key(read=tables.words)] = None
    units: Annotated[Mapping[str, str] | None, Key(read=tables.words)] = None
    normal_force: Annotated[float | None, RIG["normal_force"]] = None
    stiffness: Annotated[float | None, RIG["stiffness"]] = None
    mass: Annotated[float | None, Key("kg", sign=POSITIVE, usual=RIG["mass"].usual)] = None
    damping: Annotated[float | None, RIG["damping"]] = None
    noise: Annotated[float | None, RIG["noise"]] = None
    window: Annotated[tuple[float, float] | None, Key("s", tables.span)] = None
    exclude: Annotated[tuple[tuple[float, float], ...], Key("s", tables.spans)] = ()
    skip_cycles: Annotated[int, Key(read=partial(tables.of_kind, int), sign=NOT_NEGATIVE)] = 0
    tare: Annotated[float | tuple[float, float] | None, Key("N", tables.zero)] = None
    normal_tare: Annotated[float | tuple[float, float] | None, Key("N", tables.zero)] = None
    crosstalk: Annotated[float | None, Key(read=tables.part, limit=1.0)] = None
    tilt: Annotated[float | None, Key("rad", limit=math.pi / 4)] = None
    flip_sign: Annotated[bool | None, Key(read=partial(tables.of_kind, bool))] = None
    labels: Annotated[Mapping[str, str], Key(read=tables.words)] = field(default_factory=dict)
    rate: Annotated[float | None, Key("Hz", sign=POSITIVE)] = None
    arm: Annotated[float | None, RIG["arm"]] = None
    area: Annotated[float | None, CONTACT["area"]] = None

    def __post_init__(self) -> None:
        where = f"of log {self.path.name}"
        for name, key in LOG.items():
            check(f"{name} {where}", key, getattr(self, name))
        for start, stop in ((self.window,) if self.window else ()) + self.exclude:
            if not start < stop:
                raise SceneError(f"a window {where} runs from {start:g} to {stop:g} s; expected start before stop")


_HINTS = get_type_hints(LogEntry, include_extras=True)
LOG: Mapping[str, Key] = {name: hint.__metadata__[0] for name, hint in _HINTS.items()}
"""What the keys of a [[logs]] table hold."""
