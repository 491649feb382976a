"""The creep velocity D/t_cr of every pair of a fit, below which the contact ages while it slides."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from identify.base.quantiles import NORMAL
from identify.diagnosis.findings import Findings
from identify.logs.prepare import Prepared
from identify.report.log_outlook import of_log

VALIDITY = "creep velocity D/t_cr (eq. 2): the contact stays fresh while it slides faster"


def creep_velocities(prepared: list[Prepared], found: Findings) -> dict[str, Any]:
    """ "v_cr" of the first group and "v_cr (V08)" of the others, as numbers of the result; empty without one."""
    unknowns, names = found.unknowns, found.unknowns.names
    if found.attempt is None or found.covariance is None or not {"D", "t_cr"} <= set(names):
        return {}
    both = [int(unknowns.source[names.index(name)]) for name in ("D", "t_cr")]
    out: dict[str, Any] = {}
    seen = set()
    for number in found.attempt.logs:
        groups = prepared[number].data.groups
        mine = [groups[i] or f"log {number + 1}" for i in both if unknowns.grouped[i]]
        group = ", ".join(dict.fromkeys(mine))
        if group not in seen:
            out[f"v_cr ({group})" if out else "v_cr"] = _of(number, prepared[number], found, group)
            seen.add(group)
    return out


def _of(number: int, log: Prepared, found: Findings, group: str) -> dict[str, Any]:
    unknowns, names = found.unknowns, found.unknowns.names
    known = of_log(number, log, found)
    assert not isinstance(known, str), "a log that took part has values"
    theta, covariance = known
    p = unknowns.values(theta, log.data.base)
    value = float(p[names.index("D")] / p[names.index("t_cr")])
    free = np.flatnonzero(unknowns.free)
    d, t = (free == unknowns.source[names.index(name)] for name in ("D", "t_cr"))
    entry: dict[str, Any] = {"value": value, "unit": "m/s", "validity": VALIDITY} | ({"group": group} if group else {})
    variance = np.diag(covariance)
    open_ = [name for name, at in (("D", d), ("t_cr", t)) if not np.all(np.isfinite(variance[at]))]
    if open_:
        reason = f"interval open: these data do not tell {' and '.join(open_)}"
        return entry | {"interval": [None, None], "reason": reason}
    slope = d.astype(float) - t.astype(float)
    moved = slope != 0.0
    half = NORMAL * math.sqrt(float(slope[moved] @ covariance[np.ix_(moved, moved)] @ slope[moved]))
    return entry | {"interval": [value * math.exp(-half), value * math.exp(half) if half < 700.0 else None]}
