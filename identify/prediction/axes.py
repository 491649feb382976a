"""What a map can be drawn over: each quantity, and what of an operating point it moves.

A quantity moves itself and what is tied to it, everything else stays: `mu_k0` takes mu_s with it (their difference
stays), `mu_step` is mu_s - mu_k0 at constant mu_k0, `zeta` sets the damping h = 2 zeta k. Pressure and area move the
normal force F_n = p A: pressure at the area of the point (or along its area law), area at the pressure of the point;
beside a normal force they move the nominal area, which counts only where friction depends on pressure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.errors import SimulationError
from identify.model.model import Model

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

AREA = ("contact_area", "area_force", "area_exponent")


@dataclass(frozen=True)
class Site:
    """An operating point: every parameter of the model by name [SI], drive speed [m/s] and normal force [N], both
    positive; nominal contact area [m^2] under that force where it is known, and its exponent with the force; covariance
    (f, f) of `names` (parameters, "drive_speed", "normal_force") in their own SI units (not of logarithms; variances of
    what is not identifiable may be huge or infinite), None where all is exact."""

    model: Model
    values: Mapping[str, float]
    drive_speed: float
    normal_force: float
    area: float | None = None
    area_exponent: float = 0.0
    covariance: ArrayLike | None = None
    names: tuple[str, ...] = ()

    @property
    def setting(self) -> Array:
        """w (n_w,): parameters, normal force, drive speed."""
        return np.array([*(self.values[n] for n in self.model.parameter_names), self.normal_force, self.drive_speed])


@dataclass(frozen=True)
class Axis:
    """A quantity: name, words for a picture, unit, its value at the operating point, the values it may take, and
    whether it is drawn in powers (or evenly)."""

    name: str
    label: str
    unit: str
    value: float
    lower: float
    upper: float
    logarithmic: bool

    def place(self, value: float) -> float:
        """The coordinate of a value: its logarithm, or its share of a typical size."""
        return float(np.log(value)) if self.logarithmic else value / self._size

    def value_at(self, place: ArrayLike) -> Array:
        """The value at a coordinate; arrays too."""
        return np.asarray(np.exp(place) if self.logarithmic else np.multiply(place, self._size))

    @property
    def _size(self) -> float:
        return abs(self.value) or 0.1


# name: words, unit, lower, upper, drawn in powers
OWN: Mapping[str, tuple[str, str, float, float, bool]] = {
    "drive_speed": ("drive speed", "m/s", 1e-12, 1e3, True),
    "normal_force": ("normal force", "N", 1e-9, 1e9, True),
    "pressure": ("contact pressure", "Pa", 1e-6, 1e12, True),
    "area": ("contact area", "m^2", 1e-12, 1e3, True),
    "zeta": ("damping ratio ζ", "", 1e-9, 1e3, True),
    "mu_step": ("μs − μk0", "", 1e-6, 20.0, False),
}
WORDS = {
    "mass": "mass",
    "stiffness": "stiffness k",
    "damping": "damping h",
    "mu_k0": "μk0 (μs − μk0 constant)",
    "D": "relaxation length D",
    "t_cr": "creep time t_cr",
}
EVEN = ("mu_s", "mu_k0", "delta_mu_k")


def known_axes(model: Model) -> tuple[str, ...]:
    """Names of every quantity that can be moved in a model."""
    names = (*OWN, *(name for name in model.parameter_names if name not in AREA))
    return tuple(name for name in names if name != "zeta" or "damping" in names)


def axis(site: Site, name: str) -> Axis:
    """A quantity at an operating point.

    Raises:
        SimulationError: one that the model does not have, or an area that nobody stated.
    """
    if name not in known_axes(site.model):
        raise SimulationError(f"{name!r} is no quantity of this model; known are {', '.join(known_axes(site.model))}")
    if name in ("pressure", "area") and site.area is None:
        raise SimulationError(f'the {name} is not known here: give [contact] area = "0.8 cm^2" in the scene')
    known = {**site.values, "drive_speed": site.drive_speed, "normal_force": site.normal_force}
    known |= {"area": site.area or np.nan, "pressure": site.normal_force / (site.area or np.nan)}
    known |= {"mu_step": known["mu_s"] - known["mu_k0"]}
    known |= {"zeta": known["damping"] / (2.0 * known["stiffness"])} if "damping" in known else {}
    value = known[name]
    if name in OWN:
        return Axis(name, OWN[name][0], OWN[name][1], value, *OWN[name][2:])
    p = site.model.parameter(name)
    powers = name not in EVEN and p.lower >= 0.0 and value > 0.0
    return Axis(name, WORDS.get(name, p.symbol), p.unit, value, p.lower, p.upper, powers)


def _named(model: Model, settings: Array) -> dict[str, Array]:
    """Settings (..., n_w) by name: parameters, "normal_force", "drive_speed"."""
    return dict(zip((*model.parameter_names, "normal_force", "drive_speed"), np.moveaxis(settings, -1, 0), strict=True))


def check_axes(site: Site, names: Sequence[str]) -> None:
    """Refuse quantities that cannot be moved together.

    Raises:
        SimulationError: which, and what to do.
    """
    if len(set(names)) < len(names):
        raise SimulationError(f"{names[0]} was named twice; a map needs two different quantities")
    for pair in (("zeta", "damping"), ("mu_s", "mu_step")):
        if set(pair) <= set(names):
            raise SimulationError(f"{pair[0]} and {pair[1]} are the same thing; keep one of them")
    if "normal_force" in names and {"pressure", "area"} & set(names) and "contact_area" not in site.values:
        raise SimulationError(
            "at a given normal force this model does not depend on pressure or area; map pressure against area, or "
            "add the effect pressure_dependence"
        )


def moved(site: Site, changes: Mapping[str, ArrayLike]) -> Array:
    """The settings (..., n_w) of a point with some quantities moved; values may be arrays of one shape."""
    return np.stack(np.broadcast_arrays(*moved_values(site, changes).values()), axis=-1)


def moved_values(site: Site, changes: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """The same by name (parameters, "normal_force", "drive_speed")."""
    now = _named(site.model, site.setting)
    new = {name: np.asarray(value, float) for name, value in changes.items()}
    v = now | {name: value for name, value in new.items() if name in now}
    if "mu_k0" in new and "mu_s" not in new:
        v["mu_s"] = new["mu_k0"] + (now["mu_s"] - now["mu_k0"])
    if "mu_step" in new:
        v["mu_s"] = v["mu_k0"] + new["mu_step"]
    if "zeta" in new:
        v["damping"] = 2.0 * new["zeta"] * v["stiffness"]
    area, pressure = new.get("area"), new.get("pressure")
    if site.area is None or (area is None and pressure is None):
        return v
    if area is None:
        assert pressure is not None
        if "normal_force" not in new:  # along A = A_0 (F_n/F_0)^e: p = p_0 (F_n/F_0)^(1 - e)
            share = pressure * site.area / site.normal_force
            v["normal_force"] = site.normal_force * share ** (1.0 / (1.0 - site.area_exponent))
        area = v["normal_force"] / pressure
    elif "normal_force" not in new:
        v["normal_force"] = (site.normal_force / site.area if pressure is None else pressure) * area
    if "contact_area" in v:
        v["contact_area"] = area * (v["normal_force"] / v["area_force"]) ** (-v["area_exponent"])
    return v


def admissible(model: Model, settings: Array) -> Bools:
    """Whether the model takes settings (..., n_w), shape (...): every parameter within its bounds, friction falls and
    stays positive."""
    v = _named(model, settings)
    inside = np.all([(q.lower <= v[q.name]) & (v[q.name] <= q.upper) for q in model.parameters], axis=0)
    kinetic = v["mu_k0"] + np.minimum(v.get("delta_mu_k", 0.0), 0.0)
    return np.asarray(inside & (v["mu_s"] > v["mu_k0"]) & (kinetic > 0.0))
