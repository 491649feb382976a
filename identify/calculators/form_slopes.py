"""Exact derivatives of every number of the closed forms at an operating point, by rig, pair, speed and load."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from identify.calculators.comparison import Contact
from identify.closed_forms import stability
from identify.closed_forms.groups import formed, settings
from identify.closed_forms.jump import jump
from identify.numerics.dual import Dual, lifted, plain, sqrt, variables

CYCLE = ("drop", "period", "slip_duration", "peak_speed")
Table = dict[str, dict[str, float]]


def form_slopes(pair: Contact, drive_speed: float, normal_force: float) -> tuple[Table, Table]:
    """(closed forms, groups): {name: {quantity: derivative}} over `steady.QUANTITIES`, SI; a quantity that is absent
    moves nothing. Names as in an outlook."""
    q = variables(settings(pair.rig, pair.friction, drive_speed, normal_force))
    with np.errstate(all="ignore"):
        g = formed(q)
        cycle = jump(pair.rig, pair.friction, drive_speed, normal_force, derivatives=True)[1]
        limit, table = stability.critical_loading(plain(g["alpha"]), derivatives=True)
        fall = (q["mu_s"] - q["mu_k0"]) * q["normal_force"] / sqrt(q["mass"] * q["stiffness"])
        forms: dict[str, Any] = {
            "critical_speed": fall / lifted(limit, [(g["alpha"], table["alpha"])]),
            "Pi": g["Pi"],
            "Pi_fc": _stability(stability.critical_friction, g["z"] / 2, g["tau_cr"]),
            "Pi_fc_printed": _stability(stability.critical_friction, g["zeta"], g["tau_cr"], "printed"),
            "Omega_c": _stability(stability.critical_frequency, g["z"] / 2, g["tau_cr"]),
        }
    told = {name: _floats(value) for name, value in forms.items()}
    return {name: cycle[name] for name in CYCLE} | told, {name: _floats(value) for name, value in g.items()}


def _stability(function: Any, zeta: Any, tau_cr: Any, form: str = "derived") -> Any:
    value, table = function(plain(zeta), plain(tau_cr), form, derivatives=True)
    return lifted(value, [(zeta, table["zeta"]), (tau_cr, table["tau_cr"])])


def _floats(value: Any) -> dict[str, float]:
    slopes: Mapping[str, Any] = value.slopes if isinstance(value, Dual) else {}
    return {name: float(slope) for name, slope in slopes.items()}
