"""A result document against the truth: one rule for every sample of the acceptance table.

The deviation of a parameter is its distance from the truth in half-widths of its 95 % interval on the side of the
truth; an open end allows everything. Its size is what a relative error refers to: the value of the truth, for
`delta_mu_k` the difference mu_s - mu_k0.

near: within 5 % of the size, or within two half-widths.
false: off by more than 10 % of the size and by more than two half-widths, in a fit that ends with `converged`.
verdict error: `identified` or `weak` where the interval has not the width that the word promises (both ends within 20 %
of the value; within a factor of three), or the truth is farther away than that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

FRICTION = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
NEAR, FALSE, HALF_WIDTHS = 0.05, 0.10, 2.0
IDENTIFIED, WEAK = 0.20, 3.0
ROUNDING = 1e-6


@dataclass(frozen=True)
class Compared:
    """One parameter: relative error, deviation in half-widths (NaN where no interval is given), verdict, whether the
    interval holds the truth, whether the verdict is an error."""

    error: float
    deviation: float
    verdict: str
    wrong_verdict: bool

    @property
    def near(self) -> bool:
        """Whether the value is right."""
        return self.error <= NEAR or self.deviation <= HALF_WIDTHS

    @property
    def false(self) -> bool:
        """Whether the value is wrong and claimed."""
        return self.error > FALSE and self.deviation > HALF_WIDTHS


def compared(entry: Mapping[str, Any], truth: float, size: float, claimed_size: float) -> Compared | None:
    """One entry of `parameters` against its truth; None where it claims nothing.

    Args:
        size: what relative errors refer to; claimed_size: the same, of the values of the fit.
    """
    low, high = entry.get("interval_rig_exact") or entry["interval"]
    value, verdict = entry["value"], entry["verdict"]
    if verdict == "fixed" or (low is None and high is None):
        return None
    if value is None:
        beyond = max((low or truth) - truth, truth - (high or truth), 0.0)
        return Compared(beyond / size, math.inf if beyond else 0.0, verdict, False)
    end = high if truth > value else low
    off = abs(truth - value)
    deviation = 0.0 if end is None or off == 0.0 else off / max(abs(end - value), 1e-300)
    return Compared(off / size, deviation, verdict, _wrong_word(entry, truth, size, claimed_size))


def _wrong_word(entry: Mapping[str, Any], truth: float, size: float, claimed_size: float) -> bool:
    low, high = entry["interval"]
    value, verdict = entry["value"], entry["verdict"]
    if verdict not in ("identified", "weak"):
        return False
    if low is None or high is None:
        return True
    widest, off = max(value - low, high - value) / claimed_size, abs(truth - value) / size
    if verdict == "identified":
        return bool(widest > IDENTIFIED + ROUNDING or off > IDENTIFIED)
    if claimed_size != abs(value) or value <= 0.0 or low <= 0.0 or truth <= 0.0:  # judged by differences
        return bool(widest > 1.0 - 1.0 / WEAK + ROUNDING or off > 1.0 - 1.0 / WEAK)
    factors = (high / value, value / low, truth / value, value / truth)
    return max(factors) > WEAK + ROUNDING


def judged(result: Mapping[str, Any], truth: Mapping[str, float], required: Sequence[str] = FRICTION) -> dict[str, Any]:
    """What the acceptance table counts of one fit.

    Args:
        result: a `result.json`.
        truth: true value by key of `parameters` [SI].
        required: the parameters that may not be called not identifiable where the fit is to be right.
    """
    parameters, converged = result["parameters"], result["status"] == "converged"
    found: dict[str, Compared] = {}
    for name in truth:
        entry = parameters.get(name)
        if entry is None:
            continue
        size = _size(name, truth)
        claimed = _size(name, {key: e["value"] for key, e in parameters.items() if e["value"] is not None})
        one = compared(entry, truth[name], size, claimed)
        if one is not None:
            found[name] = one
    deviations = [one.deviation for one in found.values()]
    inside = sum(deviation <= 1.0 for deviation in deviations)
    verdicts = {name: parameters[name]["verdict"] for name in truth if name in parameters}
    told = all(verdicts.get(name, "none") != "not identifiable" for name in required)
    return {
        "status": result["status"],
        "answered": converged and any(parameters[name]["value"] is not None for name in verdicts),
        "right": converged and told and all(one.near for one in found.values()),
        "false": converged and any(one.false for one in found.values()),
        "inside": inside if converged else 0,
        "outside": len(deviations) - inside if converged else 0,
        "worst": max(deviations, default=0.0) if converged else None,
        "verdict_errors": [name for name, one in found.items() if one.wrong_verdict] if converged else [],
        "verdicts": verdicts,
        "message": result["message"],
    }


def _size(name: str, values: Mapping[str, float]) -> float:
    """What an error of a parameter is relative to; "delta_mu_k (B)" refers to "mu_s (B)", where there is one."""
    bare, _, group = name.partition(" ")
    if bare != "delta_mu_k":
        return max(abs(values.get(name, math.nan)), 1e-300)
    static, kinetic = (values.get(f"{n} {group}".strip(), values.get(n, math.nan)) for n in ("mu_s", "mu_k0"))
    return max(abs(static - kinetic), 1e-300)
