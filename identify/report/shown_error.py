"""Which standard error stands beside a value, and advice of several parameters given once."""

from __future__ import annotations

import re
from collections.abc import Sequence

from scipy.special import ndtri

from identify.base.result import ParameterResult

_ADVICE = re.compile(r"add (a log of .+?), which is expected to tell it to ")


def said_once(reasons: Sequence[str]) -> list[str]:
    """Reasons of parameters in their order: a log that one of them has asked for already is "the same log"."""
    told: set[str] = set()
    out = []
    for reason in reasons:
        asked = _ADVICE.search(reason)
        if asked is not None and asked[1] in told:
            reason = reason.replace(asked[0], "the same log is expected to tell it to ")
        elif asked is not None:
            told.add(asked[1])
        out.append(reason)
    return out


UNLIKE = 1.5  # times: an interval so much longer or shorter than the error has it is not that of a normal distribution


def shown_error(entry: ParameterResult) -> float | None:
    """The standard error of a parameter in its unit; None where it is null, and where the interval beside it says
    otherwise: there the profile was followed to where the misfit does rise, and a reader who sees "0.620 ± 0.008"
    beside "0.618 to 0.631" has to guess which of them holds."""
    error, normal = entry.standard_error, _normal(entry)
    if not error or normal is None:
        return error
    return error if error / UNLIKE <= normal <= error * UNLIKE else None


def scatter(entry: ParameterResult) -> float | None:
    """What the digits of a value follow, in its unit: the standard error that is shown, else that of a normal
    distribution with so long an interval; None where neither is told."""
    error = shown_error(entry)
    return _normal(entry) if error is None else error


def _normal(entry: ParameterResult) -> float | None:
    """The standard error of a normal distribution with an interval as long as the entry's; None where it is open."""
    low, high = entry.ends
    if low is None or high is None:
        return None
    return 0.5 * (high - low) / float(ndtri(0.5 + 0.5 * (entry.level or 0.95)))
