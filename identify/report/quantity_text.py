"""Numbers as a laboratory reads them: a fitting unit, as many digits as mean something, a true minus sign."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.special import ndtri

from identify.base.result import ParameterResult
from identify.base.wording import speed_scale

# ----------------------------------------------------------------------------------------------------------------------
# Advice that several parameters share is said in full once.
# ----------------------------------------------------------------------------------------------------------------------

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


DASH = "–"
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
DECADES = 100.0  # from the smaller to the larger end of an interval, from which on no number of decimals suits both
# From large to small; the first unit in which the number is at least 0.1 is taken.
LAB_UNITS: dict[str, tuple[tuple[str, float], ...]] = {
    "m": (("mm", 1e-3), ("µm", 1e-6), ("nm", 1e-9)),
    "s": (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)),
    "N": (("N", 1.0), ("mN", 1e-3), ("µN", 1e-6)),
    "N/s": (("N/s", 1.0), ("mN/s", 1e-3), ("µN/s", 1e-6)),
    "kg": (("kg", 1.0), ("g", 1e-3), ("mg", 1e-6)),
    "Hz": (("Hz", 1.0), ("mHz", 1e-3)),
    "1/m^0.5": (("1/√mm", 10.0**1.5),),
    "Pa": (("kPa", 1e3), ("Pa", 1.0)),
    "m^2": (("cm²", 1e-4), ("mm²", 1e-6)),
    "W": (("W", 1.0), ("mW", 1e-3), ("µW", 1e-6)),
    "J": (("J", 1.0), ("mJ", 1e-3), ("µJ", 1e-6), ("nJ", 1e-9)),
}
# How a key of the result document tells its unit; longer endings first.
KEY_UNITS = (
    ("_m_per_s", "m/s"),
    ("_N_per_m", "N/m"),
    ("_N_per_s", "N/s"),
    ("_s_per_m", "s/m"),
    ("_per_s", "1/s"),
    ("_percent", "%"),
    ("_Hz", "Hz"),
    ("_kg", "kg"),
    ("_Pa", "Pa"),
    ("_N", "N"),
    ("_m", "m"),
    ("_s", "s"),
)


@dataclass(frozen=True)
class Scale:
    """A unit to show numbers in: SI value = shown value * factor."""

    unit: str
    factor: float


def scale_for(value: float | None, unit: str) -> Scale:
    """The unit in which the SI value reads well; unknown units stay as they are."""
    if unit == "m/s":
        return Scale(*speed_scale(value))
    known = LAB_UNITS.get(unit)
    if known is None or value is None or not math.isfinite(value) or value == 0:
        return Scale(unit, 1.0)
    for name, factor in known:
        if abs(value) >= 0.0999 * factor:
            return Scale(name, factor)
    return Scale(*known[-1])


def number(value: float | None, digits: int = 4) -> str:
    """The number with `digits` significant digits, trailing zeros dropped; a dash for None."""
    if value is None:
        return DASH
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
        power = str(int(exponent)).translate(SUPERSCRIPT)
        return _signed(f"{_trimmed(mantissa)}·10{power}")
    places = digits - 1 - _decade(value)
    text = f"{value:.{max(places, 0)}f}"
    return _signed(_trimmed(text))


def decimals(value: float, places: int) -> str:
    """The number with a fixed number of decimals (at most 8); places below 0 round to tens, hundreds, ..."""
    if places < 0:
        value = round(value, places)
    return _signed(f"{value:.{min(max(places, 0), 8)}f}")


def ends_text(low: float, high: float, places: int) -> str:
    """ "0.618 to 0.622": both ends with so many decimals; "0.0003 to 2040" where they lie decades apart, each with
    three significant digits."""
    near, far = sorted((abs(low), abs(high)))
    if low * high > 0 and far >= DECADES * near:
        return f"{number(float(f'{low:.3g}'), 3)} to {number(float(f'{high:.3g}'), 3)}"
    return f"{decimals(low, places)} to {decimals(high, places)}"


def places_for(error: float | None, value: float | None) -> int:
    """Decimals that show the error with two digits, or one where it begins with 4 or more; else four of the value."""
    if error is not None and error > 0:
        return (1 if error / 10.0 ** _decade(error) < 3.55 else 0) - _decade(error)
    return 3 - _decade(value or 0.0)


def places_of_positive(error: float | None, value: float) -> int:
    """The same of a value whose interval may span decades: three digits of the value at least."""
    return max(places_for(error, value), 2 - _decade(value))


def quantity(value: float | None, unit: str, digits: int = 4) -> str:
    """The SI value with a fitting unit: 37.4e-6, "m" -> "37.4 µm"."""
    if value is None:
        return DASH
    scale = scale_for(value, unit)
    space = "" if scale.unit in ("", "%") else "\N{NO-BREAK SPACE}"
    return f"{number(value / scale.factor, digits)}{space}{scale.unit}"


def speed(value: float | None) -> str:
    """A speed [m/s]; a slow one in mm/min, as it is on the dial of the tribometer."""
    return quantity(value, "m/s")


def split_key(key: str) -> tuple[str, str]:
    """Name and SI unit told by a key of the document: "onset_force_N" -> ("onset force", "N")."""
    for ending, unit in KEY_UNITS:
        if key.endswith(ending) and len(key) > len(ending):
            return key[: -len(ending)].replace("_", " "), unit
    return key.replace("_", " "), ""


def _decade(value: float) -> int:
    return 0 if value == 0 or not math.isfinite(value) else math.floor(math.log10(abs(value)))


def _trimmed(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


def _signed(text: str) -> str:
    """With a minus of its own width; what is rounded to zero has none."""
    if not any(digit in text for digit in "123456789"):
        text = text.removeprefix("-")
    return text.replace("-", "−")


# ----------------------------------------------------------------------------------------------------------------------
# Which standard error stands beside a value.
# ----------------------------------------------------------------------------------------------------------------------

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
