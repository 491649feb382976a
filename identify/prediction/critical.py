"""Rig quantities at which steady sliding loses stability, closed forms for a V << 1 (docs/equations.md, section 6).

G = (mu_s - mu_k0) F_n t_cr / D [N s/m] is the weakening that ageing brings; the limit is
G = c (1 + k t_cr^2 / (m + c t_cr)) with the damping constant c [N s/m] held fixed. The printed eq. (25) reads 2 zeta as
zeta (docs/printed_errors.md, E23 and E25), so its limits are those of half the damping: `form="printed"`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from identify.base.dual import Dual, plain, sqrt, variables, where

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
