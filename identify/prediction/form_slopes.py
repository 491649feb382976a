"""Exact derivatives of every number of the closed forms at operating points, by rig, pair, speed and load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.dual import Dual, lifted, plain, sqrt, variables
from identify.prediction import stability
from identify.prediction.comparison import Contact, side_by_side
from identify.prediction.groups import formed, settings
from identify.prediction.jump import jump

CYCLE = ("drop", "period", "slip_duration", "peak_speed")
Array = NDArray[np.float64]
Table = dict[str, dict[str, float]]


def form_slopes(pairs: Sequence[Contact], drive_speed: Array, normal_force: Array) -> list[tuple[Table, Table]]:
    """For every pair (n,) at its drive speed and normal force (n,): (closed forms, groups), {name: {quantity:
    derivative}} over `steady.QUANTITIES`, SI; a quantity that is absent moves nothing. Names as in an outlook."""
    pair = side_by_side(pairs)
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
    slopes = {name: cycle[name] for name in CYCLE} | {name: _slopes(value) for name, value in forms.items()}
    by_group = {name: _slopes(value) for name, value in g.items()}
    return [(_at(slopes, i), _at(by_group, i)) for i in range(len(pairs))]


def _stability(function: Any, zeta: Any, tau_cr: Any, form: str = "derived") -> Any:
    value, table = function(plain(zeta), plain(tau_cr), form, derivatives=True)
    return lifted(value, [(zeta, table["zeta"]), (tau_cr, table["tau_cr"])])


def _slopes(value: Any) -> Mapping[str, Any]:
    return value.slopes if isinstance(value, Dual) else {}


def _at(columns: Mapping[str, Mapping[str, Any]], i: int) -> Table:
    """The derivatives (n,) of every name at one of the points."""
    return {name: {q: float(slope[i]) for q, slope in table.items()} for name, table in columns.items()}
