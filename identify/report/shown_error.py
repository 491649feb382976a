"""Which standard error stands beside a value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scipy.special import ndtri

from identify.report.quantity_text import finite

UNLIKE = 1.5  # times: an interval so much longer or shorter than the error has it is not that of a normal distribution


def shown_error(entry: Mapping[str, Any]) -> float | None:
    """The standard error of a parameter's entry in its unit; None where it is null, and where the interval beside it
    says otherwise: there the profile was followed to where the misfit does rise, and a reader who sees "0.620 ± 0.008"
    beside "0.618 to 0.631" has to guess which of them holds."""
    error, normal = finite(entry.get("standard_error")), _normal(entry)
    if not error or normal is None:
        return error
    return error if error / UNLIKE <= normal <= error * UNLIKE else None


def scatter(entry: Mapping[str, Any]) -> float | None:
    """What the digits of a value follow, in its unit: the standard error that is shown, else that of a normal
    distribution with so long an interval; None where neither is told."""
    error = shown_error(entry)
    return _normal(entry) if error is None else error


def _normal(entry: Mapping[str, Any]) -> float | None:
    """The standard error of a normal distribution with an interval as long as the entry's; None where it is open."""
    interval = entry.get("interval")
    if not isinstance(interval, Sequence) or isinstance(interval, str) or len(interval) != 2:
        return None
    low, high = finite(interval[0]), finite(interval[1])
    if low is None or high is None:
        return None
    return 0.5 * (high - low) / float(ndtri(0.5 + 0.5 * (finite(entry.get("level")) or 0.95)))
