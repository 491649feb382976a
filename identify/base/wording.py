"""How numbers are written: digits, units, intervals, speeds; and text for a terminal of 80 columns."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

LONG = 1e3, 1e6  # sizes that three figures would be said of with a power of ten, and that are soon read without


def three_figures(value: float) -> str:
    """A number with three figures: 0.298, 1.5e-05, and 1800 where that is as short as 1.8e+03."""
    short = f"{value:.3g}"
    return f"{float(short):.0f}" if LONG[0] <= abs(float(short)) < LONG[1] else short


def distinct(value: float, other: float) -> tuple[str, str]:
    """Two numbers with three figures, or with as many as distinguish them (eight at most)."""
    if three_figures(value) != three_figures(other):
        return three_figures(value), three_figures(other)
    pairs = ((f"{value:.{n}g}", f"{other:.{n}g}") for n in range(4, 9))
    return next((pair for pair in pairs if pair[0] != pair[1]), (three_figures(value), three_figures(other)))


# Text for a terminal of 80 columns.

WIDTH = 79
START_VALUES = "give start values nearer to the pair under [parameters], such as mu_s = { start = 0.6 }"


def columns(rows: Sequence[Sequence[str]], indent: str = "  ") -> str:
    """Rows of cells as aligned text, two blanks apart, one where that does not fit; the first row is the heading."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    gap = "  " if len(indent) + sum(widths) + 2 * (len(widths) - 1) <= WIDTH else " "
    lines = (indent + gap.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)


def wrapped(text: str, indent: str = "", hang: str = "  ") -> str:
    """Text broken at 79 columns; lines after the first hang further in."""
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent + hang)


# How speeds are said: in mm/s, slow ones in mm/min as on the dial of a tribometer; nowhere in anything else.

SLOW = 1e-5  # m/s, below which speeds are said per minute
LISTED = 8  # steps of a programme that are said one by one


def speed_scale(speed: float | None) -> tuple[str, float]:
    """The unit in which a speed [m/s] is said, and that unit in m/s."""
    if speed is not None and 0.0 < abs(speed) < SLOW:
        return "mm/min", 1e-3 / 60.0
    return "mm/s", 1e-3


def speed_text(speed: float, figures: int = 4) -> str:
    """A speed [m/s] as it stands on the dial: "0.1 mm/min", "5 mm/s"."""
    unit, size = speed_scale(speed)
    return f"{speed / size:.{figures}g} {unit}"


def programme_text(programme: Sequence[tuple[float, float]]) -> str:
    """A programme of (start [s], speed [m/s]) in words, the range of its speeds where it has many steps."""
    if len(programme) <= LISTED:
        first, *later = programme
        return ", ".join([speed_text(first[1]), *(f"from {start:.6g} s {speed_text(speed)}" for start, speed in later)])
    speeds = [speed for _, speed in programme]
    return f"{speed_text(min(speeds))} to {speed_text(max(speeds))} in {len(programme)} steps"


# Numbers as a laboratory reads them: a fitting unit, as many digits as mean something, a true minus sign.

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
# How a key of the result document ends by its unit; longer endings first.
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


def interval_text(ends: tuple[float | None, float | None], scale: Scale, places: int | None = None) -> str:
    """ "0.618 to 0.622" of SI ends in the unit of the scale, open ends as "above" and "below", "open" where both are.
    Ends that lie decades apart have three significant digits each: "0.0003 to 2040".

    places: decimals; None: as many as a quarter of the length is worth.
    """
    low, high = (None if end is None else end / scale.factor for end in ends)
    if low is not None and high is not None:
        near, far = sorted((abs(low), abs(high)))
        if places is None and (far >= 1e6 or high - low < 1e-6):
            return f"{number(low, 5)} to {number(high, 5)}"
        if low * high > 0 and far >= DECADES * near:
            return range_text(low, high, "")
        places = places_for((high - low) / 4, None) if places is None else places
        return f"{decimals(low, places)} to {decimals(high, places)}"
    if low is None and high is None:
        return "open"
    end = low if low is not None else high
    assert end is not None
    return f"{'below' if low is None else 'above'} {number(end, 3) if places is None else decimals(end, places)}"


def places_for(error: float | None, value: float | None) -> int:
    """Decimals that show the error with two digits, or one where it begins with 4 or more; else four of the value."""
    if error is not None and error > 0:
        return (1 if error / 10.0 ** _decade(error) < 3.55 else 0) - _decade(error)
    return 3 - _decade(value or 0.0)


def places_of_positive(error: float | None, value: float) -> int:
    """The same of a value whose interval may span decades: three digits of the value at least."""
    return max(places_for(error, value), 2 - _decade(value))


def value_and_interval(
    value: float | None,
    ends: tuple[float | None, float | None],
    scale: Scale,
    error: float | None = None,
    positive: bool = False,
) -> tuple[str, str]:
    """A SI value and its interval in the unit of the scale, with the decimals that a quarter of the interval is worth,
    else the error (without both three digits); "" for an interval without ends.

    positive: it may span decades, so that the value has three digits at least.
    """
    (low, high), interval = ends, "" if ends == (None, None) else interval_text(ends, scale)
    if value is None:
        return DASH, interval
    width = error if low is None or high is None else (high - low) / 4
    shown, places = value / scale.factor, places_of_positive if positive else places_for
    digits = places(width / scale.factor, shown) if width else places_for(None, shown) - 1
    return decimals(shown, digits), interval and interval_text(ends, scale, digits)


def quantity(value: float | None, unit: str, digits: int = 4) -> str:
    """The SI value with a fitting unit: 37.4e-6, "m" -> "37.4 µm"."""
    if value is None:
        return DASH
    scale = scale_for(value, unit)
    return f"{number(value / scale.factor, digits)}\N{NO-BREAK SPACE}{scale.unit}".removesuffix("\N{NO-BREAK SPACE}")


def range_text(low: float | None, high: float | None, unit: str, digits: int = 3) -> str:
    """ "0.58 to 0.78 s": two SI values in the unit that suits the larger, a dash for None."""
    scale = scale_for(max((abs(end) for end in (low, high) if end is not None), default=None), unit)
    ends = (DASH if v is None else number(float(f"{v / scale.factor:.{digits}g}"), digits) for v in (low, high))
    return f"{' to '.join(ends)} {scale.unit}".rstrip()


def split_key(key: str) -> tuple[str, str]:
    """Name and SI unit by a key of the document: "onset_force_N" -> ("onset force", "N")."""
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
