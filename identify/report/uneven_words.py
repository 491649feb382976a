"""What the first screen and the terminal say of a pair whose cycles differ."""

from __future__ import annotations

from collections.abc import Iterator

from identify.base.result import DistributionResult, Result, UnevenResult
from identify.base.wording import number, quantity

DRAWN = "Drawn are cycles of the fitted pair, as they follow each other by chance."
NOT_FOR = (
    "Use these numbers for this drive speed, stiffness and load only: whatever is computed from them for another is "
    "extrapolated, not supported by these records."
)
LABELS = {"static_peak": "static peak", "drop": "drop", "period": "period"}
BASES = {"static_peak": " of the load", "drop": " of the load", "period": ""}


def is_uneven(result: Result) -> bool:
    """Whether the estimator of uneven records gave this result."""
    return result.estimator == "uneven" and result.converged


def headline(result: Result) -> str:
    """What the friction of the pair is, how sure that is, and what not to use it for."""
    strength, scatter = result.parameters["strength"], result.parameters["strength_scatter"]
    if strength.value is None:
        return "Friction differs from cycle to cycle, and these records do not tell its strength."
    low, high = (number(end, 2) for end in strength.ends)
    spread = f", and scatters by {100 * scatter.value:.0f} % from stick to stick" if scatter.value else ""
    peak = UnevenResult.of(result).distributions.get("static_peak")
    at = f" above a level that wanders (static peaks {_range(peak, '')} in nine of ten drawn cycles)" if peak else ""
    return (
        f"Friction differs from cycle to cycle: a stick holds {number(strength.value, 3)} ({low} to {high}) of the "
        f"load{at}{spread}."
    )


def distribution_lines(result: Result) -> Iterator[tuple[str, str, str]]:
    """Name, median with the interval, and range from 5 to 95 % of static peak, drop and period."""
    for name, entry in UnevenResult.of(result).distributions.items():
        if name in LABELS:
            middle = entry.quantiles["50"]
            low, high = (quantity(end, entry.unit, 3) for end in middle.interval)
            value = f"{quantity(middle.value, entry.unit, 3)} ({low} to {high})"
            yield LABELS[name], value, f"{_range(entry, entry.unit)}{BASES[name]}"


def _range(entry: DistributionResult, unit: str) -> str:
    low, high = (quantity(entry.quantiles[q].value, unit, 2) for q in ("5", "95"))
    return f"{low} to {high}"


def odd_slips(result: Result) -> str:
    """The odd slips by number; "" where there is none."""
    odd = UnevenResult.of(result).odd_slips
    if not odd:
        return ""
    many = len({slip.log for slip in odd}) > 1
    named = ", ".join(f"{slip.cycle} of log {slip.log}" if many else str(slip.cycle) for slip in odd)
    return f"Odd slips, whose level changed by more than the wander explains: cycle {named}."
