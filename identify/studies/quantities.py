"""What is pooled: the parameters of every fit on the scale where their errors are even, with their covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import NORMAL
from identify.effects import ALL
from identify.report.quantity_text import finite
from identify.studies.fits import FitEntry
from identify.uneven.answer import SCALES

Array = NDArray[np.float64]

TOLD = ("identified", "weak")
DECLARED = {p.name: p for effect in ALL for p in effect.parameters}


@dataclass(frozen=True)
class Quantity:
    """A parameter that fits estimate: name, SI unit, whether it is pooled as a logarithm."""

    name: str
    unit: str
    logarithmic: bool

    def shown(self, y: float) -> float:
        """The value in SI units."""
        return float(np.exp(y)) if self.logarithmic else y


@dataclass(frozen=True)
class Values:
    """Quantities of n fits: y (n, m) on their scales, NaN where a fit does not tell one; covariance (n, m, m);
    untold: fits by index that do not tell a quantity, with the reason."""

    quantities: tuple[Quantity, ...]
    y: Array
    covariance: Array
    untold: Mapping[str, tuple[tuple[int, str], ...]]


def values(entries: Sequence[FitEntry]) -> Values:
    """The parameters that these fits estimate, in the order in which they first occur."""
    names = list(dict.fromkeys(name for e in entries for name, p in e.document["parameters"].items() if _estimated(p)))
    quantities = tuple(_quantity(name, entries) for name in names)
    n, m = len(entries), len(quantities)
    y, covariance = np.full((n, m), np.nan), np.full((n, m, m), np.nan)
    untold: dict[str, list[tuple[int, str]]] = {name: [] for name in names}
    for i, entry in enumerate(entries):
        sd = np.full(m, np.nan)
        for k, quantity in enumerate(quantities):
            parameter = entry.document["parameters"].get(quantity.name)
            y[i, k], sd[k], reason = _told(parameter, quantity)
            if reason and quantity.name not in entry.elsewhere:
                untold[quantity.name].append((i, reason))
        covariance[i] = _correlation(entry, names) * np.outer(sd, sd)
    return Values(quantities, y, covariance, {name: tuple(found) for name, found in untold.items()})


def tells(entry: FitEntry) -> bool:
    """Whether a fit has a number for any parameter."""
    return any(_numbered(p) for p in entry.document["parameters"].values())


def verdicts(entry: FitEntry) -> str:
    """The verdicts on the parameters of a fit in words: "mu_s, a not identifiable; D at bound"."""
    found: dict[str, list[str]] = {}
    for name, p in entry.document["parameters"].items():
        verdict = str(p.get("verdict") or "no value") if isinstance(p, Mapping) else "no value"
        found.setdefault("no standard error" if verdict in TOLD else verdict, []).append(str(name))
    return "; ".join(f"{', '.join(names)} {verdict}" for verdict, names in found.items()) or "it has no parameter"


def _estimated(parameter: Any) -> bool:
    return isinstance(parameter, Mapping) and parameter.get("verdict") in TOLD


def _numbered(parameter: Any) -> bool:
    """Whether a parameter was estimated with a standard error."""
    return (
        _estimated(parameter)
        and finite(parameter.get("value")) is not None
        and bool(finite(parameter.get("standard_error")))
    )


def _quantity(name: str, entries: Sequence[FitEntry]) -> Quantity:
    told = [e.document["parameters"][name] for e in entries if name in e.document["parameters"]]
    positive = all((finite(p.get("value")) or 0.0) > 0.0 for p in told if _estimated(p))
    declared = DECLARED.get(name)
    unit = next((str(p["unit"]) for p in told if p.get("unit")), "")
    logarithmic = name in SCALES or (declared is not None and declared.scale == "log")
    return Quantity(name, unit, logarithmic and positive)


def _told(parameter: Any, quantity: Quantity) -> tuple[float, float, str]:
    """Value and standard deviation on the scale of the quantity, or why there is none.

    The interval counts where it has two ends: where a profile was run, it is the better of the two.
    """
    if not isinstance(parameter, Mapping):
        return np.nan, np.nan, "not in its model"
    value, error = finite(parameter.get("value")), finite(parameter.get("standard_error"))
    if value is None or not error or not _numbered(parameter):
        return np.nan, np.nan, str(parameter.get("verdict") or "no value")
    ends = parameter.get("interval")
    low, high = (finite(end) for end in ends) if isinstance(ends, list) and len(ends) == 2 else (None, None)
    if quantity.logarithmic:
        width = np.log(high / low) if low is not None and high is not None and 0.0 < low < high else 0.0
        return float(np.log(value)), float(width) / (2.0 * NORMAL) or error / value, ""
    width = high - low if low is not None and high is not None else 0.0
    return value, width / (2.0 * NORMAL) or error, ""


def _correlation(entry: FitEntry, names: Sequence[str]) -> Array:
    """Correlation of the fit's errors among `names`; none where the fit does not tell it."""
    out = np.eye(len(names))
    told = entry.document.get("correlation")
    if not isinstance(told, Mapping):
        return out
    known = [str(name) for name in told.get("names") or ()]
    try:
        matrix = np.array(told.get("matrix"), dtype=float)
    except (TypeError, ValueError):
        return out
    if matrix.shape != (len(known), len(known)):
        return out
    for j, first in enumerate(names):
        for k, second in enumerate(names):
            if j != k and first in known and second in known:
                value = matrix[known.index(first), known.index(second)]
                out[j, k] = np.clip(value, -1.0, 1.0) if np.isfinite(value) else 0.0
    return out
