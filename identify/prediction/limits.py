"""At which speed, stiffness, damping, mass or normal force the closed forms change their answer.

Two limits (docs/equations.md, sections 5 and 6): of the slip, whether the mass sticks again (eqs. 17-18, Phi against
Phi_cr), and of steady sliding, whether small disturbances die out (eqs. 19-25, Pi against Pi_fc). Everything but the
one quantity is held, the damping h too, so that zeta = h/2k falls with the stiffness. Either limit may be crossed
several times, or never.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.dual import Dual, lifted, log, plain, sqrt, variables, where
from identify.prediction.groups import formed, settings
from identify.prediction.stability import QUANTITIES, FrictionLike, RigLike, critical_friction, log_critical_loading

# ----------------------------------------------------------------------------------------------------------------------
# Rig quantities at which steady sliding loses stability, closed forms for a V << 1 (docs/equations.md, section 6).
#
# G = (mu_s - mu_k0) F_n t_cr / D [N s/m] is the weakening that ageing brings; the limit is G = c (1 + k t_cr^2 / (m + c
# t_cr)) with the damping constant c [N s/m] held fixed. The printed eq. (25) reads 2 zeta as zeta
# (docs/printed_errors.md, E23 and E25), so its limits are those of half the damping: `form="printed"`.
# ----------------------------------------------------------------------------------------------------------------------

Form = Literal["derived", "printed"]
DAMPERS = {"derived": 1.0, "printed": 0.5}  # of the damping constant that counts


def critical_stiffness(
    mass: ArrayLike,
    viscous: ArrayLike,
    weakening: ArrayLike,
    t_cr: ArrayLike,
    form: Form = "derived",
    *,
    derivatives: bool = False,
) -> Any:
    """k_c [N/m]: steady sliding is stable above it; NaN where it is stable at every stiffness.

    Args:
        mass: m_s [kg]. viscous: c [N s/m]. weakening: G [N s/m]. t_cr: creep time [s]. Broadcast.
        form: "derived", or "printed" for the paper's own.
        derivatives: also return {argument: exact derivative}.

    Raises:
        ValueError: an unknown form.
    """

    def formula(mass: Any, viscous: Any, weakening: Any, t_cr: Any) -> Any:
        c = viscous * _damper(form)
        value = (weakening - c) / c * (mass + c * t_cr) / (t_cr * t_cr)
        return where(plain(c) < plain(weakening), value, np.nan)

    return _evaluated(formula, derivatives, mass=mass, viscous=viscous, weakening=weakening, t_cr=t_cr)


def critical_damping(
    mass: ArrayLike,
    stiffness: ArrayLike,
    weakening: ArrayLike,
    t_cr: ArrayLike,
    form: Form = "derived",
    *,
    derivatives: bool = False,
) -> Any:
    """c_c [N s/m]: steady sliding is stable above it (zeta_c = c_c / (2 sqrt(m k))).

    Args:
        mass: m_s [kg]. stiffness: k [N/m]. weakening: G [N s/m]. t_cr: creep time [s]. Broadcast.
        form, derivatives: as for `critical_stiffness`.

    Raises:
        ValueError: an unknown form.
    """

    def formula(mass: Any, stiffness: Any, weakening: Any, t_cr: Any) -> Any:
        r = weakening * t_cr - mass - stiffness * t_cr * t_cr
        root = sqrt(r * r + 4 * t_cr * weakening * mass)
        value = where(plain(r) > 0, (r + root) / (2 * t_cr), 2 * weakening * mass / (root - r))
        return value / _damper(form)

    return _evaluated(formula, derivatives, mass=mass, stiffness=stiffness, weakening=weakening, t_cr=t_cr)


def critical_mass(
    stiffness: ArrayLike,
    viscous: ArrayLike,
    weakening: ArrayLike,
    t_cr: ArrayLike,
    form: Form = "derived",
    *,
    derivatives: bool = False,
) -> Any:
    """m_c [kg]: steady sliding is stable below it; NaN where no mass makes the difference.

    Args:
        stiffness: k [N/m]. viscous: c [N s/m]. weakening: G [N s/m]. t_cr: creep time [s]. Broadcast.
        form, derivatives: as for `critical_stiffness`.

    Raises:
        ValueError: an unknown form.
    """

    def formula(stiffness: Any, viscous: Any, weakening: Any, t_cr: Any) -> Any:
        c = viscous * _damper(form)
        value = c * t_cr * (c + stiffness * t_cr - weakening) / (weakening - c)
        return where((plain(c) < plain(weakening)) & (plain(value) > 0), value, np.nan)

    return _evaluated(formula, derivatives, stiffness=stiffness, viscous=viscous, weakening=weakening, t_cr=t_cr)


def _damper(form: str) -> float:
    if form not in DAMPERS:
        raise ValueError(f"form was {form!r}; expected 'derived' or 'printed'")
    return DAMPERS[form]


def _evaluated(formula: Callable[..., Any], derivatives: bool, **arguments: ArrayLike) -> Any:
    """The formula of broadcast arguments, with its derivatives by each where asked."""
    shaped = np.broadcast_arrays(*(np.asarray(v, float) for v in arguments.values()))
    values = dict(zip(arguments, (v[()] for v in shaped), strict=True))
    with np.errstate(all="ignore"):
        if not derivatives:
            return formula(**values)[()]
        dual: Dual = formula(**variables(values))
        known = np.isfinite(dual.value)
        return dual.value[()], {name: np.where(known, dual.slopes.get(name, 0.0), np.nan)[()] for name in arguments}


Array = NDArray[np.float64]

WITHIN = 1e4  # factor either way in which a quantity is searched, where no range is given
SCANNED = 1000  # values looked at; two crossings closer together than their spacing are overlooked
HALVINGS = 60


@dataclass(frozen=True)
class Limits:
    """Where one quantity changes the answer: values (r,) [SI], rising.

    above: (r,) True where the answer beyond a value is the quiet one (the mass slides on; sliding is stable).
    slopes: by quantity of `steady.QUANTITIES`, how each value moves with it, (r,); NaN by the quantity itself.
    """

    quantity: str
    values: Array
    above: NDArray[np.bool_]
    slopes: Mapping[str, Array]


def slip_margin(q: Mapping[str, Any]) -> Any:
    """ln Phi_cr - ln Phi of `groups.settings` (or their `dual.variables`): positive where the slip goes on for ever."""
    g = formed(q)
    alpha, loading = plain(g["alpha"]), plain(g["loading"])
    if isinstance(g["alpha"], Dual):
        level, table = log_critical_loading(alpha, derivatives=True)
        limit = lifted(level, [(g["alpha"], table["alpha"])])
    else:
        limit = log_critical_loading(alpha)
    return where(loading > 0, limit - log(g["loading"]), np.where(alpha > -1, np.inf, np.nan))


def sliding_margin(q: Mapping[str, Any]) -> Any:
    """Pi_fc - Pi of `groups.settings` (or their `dual.variables`), z where the contact is worn: positive if stable."""
    g = formed(q)
    value, table = critical_friction(plain(g["z"]) / 2, plain(g["tau_cr"]), derivatives=True)
    limit = lifted(value, [(g["z"], table["zeta"] / 2), (g["tau_cr"], table["tau_cr"])])
    decided = plain(g["z"]) * plain(g["tau_cr"]) > -1
    third = where(decided, limit - g["Pi"], -np.inf)
    return where(plain(g["v_acr"]) <= 1, third, g["z"])


MARGINS: Mapping[str, Callable[[Mapping[str, Any]], Any]] = {"slip": slip_margin, "sliding": sliding_margin}


def limits(
    kind: str,
    quantity: str,
    rig: RigLike,
    friction: FrictionLike,
    drive_speed: float,
    normal_force: float,
    between: tuple[float, float] | None = None,
) -> Limits:
    """Where `quantity` changes the answer of a kind of limit, the other arguments held.

    Args:
        kind: "slip" or "sliding", see MARGINS.
        quantity: "drive_speed", "stiffness", "damping", "mass" or "normal_force" (any of `steady.QUANTITIES` that is
            positive); the value its argument has is only where the default search begins.
        rig, friction, drive_speed [m/s], normal_force [N]: as for `groups`, one operating point.
        between: range searched [SI]; by default a factor 1e4 either way of the value there is.

    Raises:
        ValueError: an unknown kind or quantity, or a range that is not positive.
    """
    if kind not in MARGINS or quantity not in QUANTITIES:
        raise ValueError(
            f"the limit of {kind!r} over {quantity!r} was asked for; expected one of {', '.join(MARGINS)} over one of "
            f"{', '.join(QUANTITIES)}"
        )
    q = settings(rig, friction, drive_speed, normal_force)
    start = float(q[quantity]) or _typical_damping(q, quantity)
    low, high = between or (start / WITHIN, start * WITHIN)
    if not 0.0 < low < high < np.inf:
        raise ValueError(f"{quantity} was to be searched from {low:g} to {high:g}; expected rising positive numbers")
    grid = np.geomspace(low, high, SCANNED)
    quiet = _quiet(kind, q, quantity, grid)
    turns = np.flatnonzero((quiet[:-1] != quiet[1:]) & np.isfinite(quiet[:-1]) & np.isfinite(quiet[1:]))
    values = _narrowed(kind, q, quantity, grid[turns], grid[turns + 1], quiet[turns])
    return Limits(quantity, values, quiet[turns + 1] == 1.0, _slopes(kind, q, quantity, values))


def _typical_damping(q: Mapping[str, Any], quantity: str) -> float:
    if quantity != "damping":
        raise ValueError(f"{quantity} is zero, which gives its search no scale; give the range to search")
    return 0.2 * float(q["stiffness"])


def _moved(q: Mapping[str, Any], quantity: str, values: Array) -> dict[str, Any]:
    """The settings with one quantity at many values."""
    return {name: values if name == quantity else np.broadcast_to(value, values.shape) for name, value in q.items()}


def _quiet(kind: str, q: Mapping[str, Any], quantity: str, values: Array) -> Array:
    """1 where the answer is the quiet one, 0 where not, NaN where there is none."""
    with np.errstate(all="ignore"):
        margin = MARGINS[kind](_moved(q, quantity, values))
    return np.where(np.isnan(margin), np.nan, (margin > 0).astype(float))


def _narrowed(kind: str, q: Mapping[str, Any], quantity: str, low: Array, high: Array, before: Array) -> Array:
    """The crossings between low and high (r,), by halving the logarithm."""
    for _ in range(HALVINGS if low.size else 0):
        middle = np.sqrt(low * high)
        same = _quiet(kind, q, quantity, middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    values = np.sqrt(low * high)
    if kind == "sliding" and quantity == "drive_speed" and q["D"] > 0 and q["t_cr"] > 0:
        worn = q["D"] / q["t_cr"]  # there the margin jumps
        values = np.where(np.abs(values / worn - 1) < 1e-12, worn, values)
    return values


def _slopes(kind: str, q: Mapping[str, Any], quantity: str, values: Array) -> dict[str, Array]:
    """How the crossings move, by differentiating the margin that stays zero."""
    with np.errstate(all="ignore"):
        margin = MARGINS[kind](variables(_moved(q, quantity, values)))
        assert isinstance(margin, Dual)
        by = {name: np.broadcast_to(margin.slopes.get(name, 0.0), values.shape) for name in QUANTITIES}
        out = {name: -slope / by[quantity] for name, slope in by.items()}
    if kind == "sliding" and quantity == "drive_speed" and q["D"] > 0 and q["t_cr"] > 0:
        worn = values == q["D"] / q["t_cr"]
        at = {"D": 1 / q["t_cr"], "t_cr": -q["D"] / q["t_cr"] ** 2}
        out = {name: np.where(worn, at.get(name, 0.0), slope) for name, slope in out.items()}
    return out | {quantity: np.full(values.shape, np.nan)}
