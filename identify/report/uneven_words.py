"""What the first screen and the terminal say of a pair whose cycles differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from identify.report.quantity_text import finite, number, quantity

NOT_FOR = (
    "Use these numbers for this drive speed, stiffness and load only: whatever is computed from them for another is "
    "extrapolated, not supported by these records."
)
LABELS = {"static_peak": "static peak", "drop": "drop", "period": "period"}
BASES = {"static_peak": " of the load", "drop": " of the load", "period": ""}


def is_uneven(result: Mapping[str, Any]) -> bool:
    """Whether the estimator of uneven records gave this result."""
    return result.get("estimator") == "uneven" and result.get("status") == "converged"


def headline(result: Mapping[str, Any]) -> str:
    """What the friction of the pair is, how sure that is, and what not to use it for."""
    parameters = result["parameters"]
    strength, scatter = parameters["strength"], parameters["strength_scatter"]
    if strength["value"] is None:
        return "Friction differs from cycle to cycle, and these records do not tell its strength."
    low, high = (number(finite(end), 2) for end in strength["interval"])
    spread = f", and scatters by {100 * scatter['value']:.0f} % from stick to stick" if scatter["value"] else ""
    peak = (result.get("distributions") or {}).get("static_peak", {}).get("quantiles")
    at = f" above a level that wanders (static peaks {_range(peak, '')} in nine of ten cycles)" if peak else ""
    return (
        f"Friction differs from cycle to cycle: a stick holds {number(strength['value'], 3)} ({low} to {high}) of the "
        f"load{at}{spread}."
    )


def distribution_lines(result: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Name, median with the interval, and range from 5 to 95 % of static peak, drop and period."""
    for name, entry in (result.get("distributions") or {}).items():
        if name in LABELS:
            middle = entry["quantiles"]["50"]
            low, high = (quantity(finite(end), entry["unit"], 3) for end in middle["interval"])
            value = f"{quantity(finite(middle['value']), entry['unit'], 3)} ({low} to {high})"
            yield LABELS[name], value, f"{_range(entry['quantiles'], entry['unit'])}{BASES[name]}"


def _range(quantiles: Mapping[str, Any], unit: str) -> str:
    low, high = (quantity(finite(quantiles[q]["value"]), unit, 2) for q in ("5", "95"))
    return f"{low} to {high}"


def odd_slips(result: Mapping[str, Any]) -> str:
    """The odd slips by number; "" where there is none."""
    odd = result.get("odd_slips") or ()
    if not odd:
        return ""
    many = len({slip["log"] for slip in odd}) > 1
    named = ", ".join(f"{slip['cycle']} of log {slip['log']}" if many else str(slip["cycle"]) for slip in odd)
    return f"Odd slips, whose level changed by more than the wander explains: cycle {named}."
