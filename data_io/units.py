"""The one place where units become SI.

Pint knows the units; here is only what laboratories write differently (`sec`, `µm`, `²`) and the rule that a mass
unit where a force is expected means gram-force: tribometers print `g` and mean gf.
"""

from __future__ import annotations

import contextlib
import functools
import math
import re
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from data_io.values import FloatArray, UnitError

if TYPE_CHECKING:
    import pint

SI_UNIT: Final = {
    "time": "s",
    "force": "N",
    "length": "m",
    "speed": "m/s",
    "mass": "kg",
    "stiffness": "N/m",
    "dimensionless": "",
}
"""SI unit of each kind of quantity that a log can hold."""

_LOG_KINDS: Final = ("time", "force", "length", "speed", "dimensionless")

STANDARD_GRAVITY: Final = 9.80665
"""[m/s²], exact by definition (CGPM 1901): the weight of 1 kg is 1 kgf."""

_EXAMPLES: Final = {
    "s": "s, ms, min",
    "N": "N, mN, uN, g, kgf",
    "m": "m, mm, um",
    "m/s": "m/s, mm/s, mm/min, um/s",
    "kg": "kg, g",
    "N/m": "N/m, kN/m, N/mm",
    "s/m": "s/m, s/mm",
    "": 'nothing, or "%"',
}
_QUANTITY = re.compile(r"([+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?)\s*(.*)", re.DOTALL)
_POWER = re.compile(
    r"(?<=[A-Za-zΩ°%)])\s*\*\*\s*(?:-?\d{1,2}(?:\.\d{1,2})?(?![\d.*(])|\(-?\d{1,2}(?:[./]\d{1,2})?\)(?!\s*\*\*))"
)
"""A power that is cheap to evaluate: its exponent is written out and small."""
_UNIT_WORD = re.compile(r"[A-Za-zµμ/·²³]{1,12}\d?")
_CELL = re.compile(r"([+-]?[\d.,]{1,40}(?:[eE][+-]?\d{1,3})?)\s?([^\d\s.,;+-]\S{0,12})")
_ALLOWED = re.compile(r"[A-Za-zµμΩ°%0-9²³⁻¹·*/^(). \-]{0,40}")
_SPELLING: Final = {
    "µ": "u", "μ": "u", "²": "**2", "³": "**3", "⁻¹": "**-1", "·": "*", "^": "**", "kp": "kgf",
}  # fmt: skip
_WORDS: Final = {
    "newton": "N", "newtons": "N", "gram": "g", "grams": "g", "seconds": "s", "second": "s", "sec": "s", "secs": "s",
    "minutes": "min", "micron": "um", "microns": "um", "mikron": "um", "msec": "ms", "gr": "g",
    "none": "", "-": "", "1": "",
}  # fmt: skip

_USUAL: Final = {
    "": {"": 1.0},
    "s": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0},
    "N": {"N": 1.0, "mN": 1e-3},
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "mm/sec": 1e-3, "mm/min": 1e-3 / 60.0, "um/s": 1e-6},
    "kg": {"kg": 1.0, "g": 1e-3},
    "N/m": {"N/m": 1.0, "N/mm": 1e3},
    "N s/m": {"N s/m": 1.0},
}
"""Factors of the units most logs and scenes have: loading pint takes 0.4 s of every command."""
_OF_USUAL: Final = {unit: (si, size) for si, units in _USUAL.items() for unit, size in units.items()}

Number = TypeVar("Number", float, FloatArray)


def parse_quantity(text: object, unit: str) -> float:
    """Read a quantity such as "0.1 mm/min" as a number in the SI unit `unit` ("m/s", "N", "s/m", "" for none).

    A bare number, or a string holding one, is taken as SI. Raises `UnitError` for everything else that is not a
    finite number with a unit of the same dimension.
    """
    if isinstance(text, str):
        match = _QUANTITY.fullmatch(text.strip())
        if match is None:
            raise UnitError(f"{text!r} was found where {_expected(unit)} was expected; write a number, then its unit")
        if re.match(r",\d", match[2]):
            raise UnitError(f"{text!r} has a decimal comma where a point was expected; write it with a point")
        number, given = float(match[1]), match[2]
    elif isinstance(text, (int, float, np.integer, np.floating)) and not isinstance(text, bool):
        number, given = float(text), ""
    else:
        raise UnitError(f"{text!r} was found where {_expected(unit)} was expected; write a number with its unit")
    if not math.isfinite(number):
        raise UnitError(f"{text!r} was found where {_expected(unit)} was expected; write a finite number")
    return float(scaled(number, factor(given, unit))) if given else number


@functools.lru_cache(maxsize=1024)
def factor(unit: str, si_unit: str) -> float:
    """Return the number that turns a value in `unit` into `si_unit`; raises `UnitError` if there is none."""
    if unit == si_unit:
        return 1.0
    own, size = _OF_USUAL.get(unit, (None, 0.0))
    if own == si_unit:
        return size
    if si_unit == "N*m":
        unit = re.sub(r"([mcuk]?N)([mc]?m)", r"\1*\2", unit)  # mNm
    if (own, si_unit) == ("kg", "N"):
        return size * STANDARD_GRAVITY
    measure = wanted = None
    if own is None or si_unit not in _USUAL:
        measure, wanted = _parsed(unit), _registry().Quantity(1.0, si_unit)
        if measure is not None and measure.is_compatible_with("kg") and wanted.is_compatible_with("N"):
            return float(measure.to("kg").magnitude) * STANDARD_GRAVITY
    if measure is None or wanted is None or not measure.is_compatible_with(wanted):
        given = f"the unit {unit!r}" if unit else "no unit"
        wrong = "is unknown" if measure is None and own is None else "was found"
        raise UnitError(
            f"{given} {wrong} where {'a unit of ' + si_unit if si_unit else 'a number without unit'} was expected; "
            f"use one of {_EXAMPLES.get(si_unit, si_unit)}"
        )
    return float(measure.to(wanted.units).magnitude)


def column_factor(unit: str, si_unit: str, file_unit: str | None = None) -> float:
    """Return the number that turns a column into `si_unit`; `unit` may be a scale, as "2.5 N/V" for a column in volts.

    A scale is what one unit of the file means; where the file says none, the unit below the slash. A header may say how
    much one count is: "0.01 s". Raises `UnitError`.
    """
    match = _QUANTITY.fullmatch(unit.strip())
    if match is None:
        return factor(unit, si_unit)
    counts = file_unit is None or _QUANTITY.fullmatch(file_unit.strip()) is not None
    if counts and match[2] and "/" not in match[2]:  # Time [0.01 s]: the unit of one count
        return float(match[1]) * factor(match[2], si_unit)
    above, _, counted = unit.strip().rpartition("/")
    if counts and file_unit and counted.strip() == file_unit.strip():  # 2.5 s/0.01 s: what one such count is
        return parse_quantity(above, si_unit)
    below = file_unit or (match[2].rpartition("/")[2] if "/" in match[2] else "")
    scale, own = _parsed(match[2] or "1"), _parsed(below or "1")
    whole = None if scale is None or own is None else scale * own
    if whole is None or not whole.is_compatible_with(si_unit or "dimensionless"):
        raise UnitError(
            f"the scale {unit!r} does not turn {below or 'a plain number'} into {si_unit}; give it as in "
            f'"2.5 {si_unit}/{below or "V"}"'
        )
    return float(match[1]) * float(whole.to(si_unit or "dimensionless").magnitude)


def lever_of(unit: str) -> str | None:
    """Return the unit [SI] of a torque ("N*m") or a stress ("Pa") that a unit is one of; None for any other."""
    measure = None if unit in _OF_USUAL else _parsed(re.sub(r"([mcuk]?N)([mc]?m)", r"\1*\2", unit))  # mNm
    return next((si for si in ("N*m", "Pa") if measure is not None and measure.is_compatible_with(si)), None)


def is_mass(unit: str) -> bool:
    """Tell a unit of mass, which a force column means as the weight of it."""
    if unit in _OF_USUAL:
        return _OF_USUAL[unit][0] == "kg"
    measure = _parsed(unit)
    return measure is not None and bool(measure.is_compatible_with("kg"))


@functools.lru_cache(maxsize=1024)
def kind_of(unit: str) -> str | None:
    """Name the kind of quantity a unit measures (a key of `SI_UNIT`; mass units count as force), None if no such."""
    si = next((kind for kind in _LOG_KINDS if unit == SI_UNIT[kind]), None)
    for kind in _LOG_KINDS if si is None else ():
        with contextlib.suppress(UnitError):
            factor(unit, SI_UNIT[kind])
            return kind
    return si


def unit_word(text: str) -> str | None:
    """Return the unit of time, force, length or speed that a word behind a number is; None for any other word.

    `N1` is the newton of channel 1.
    """
    if not _UNIT_WORD.fullmatch(text):
        return None
    plain = text.rstrip("0123456789")
    if plain != text and kind_of(plain) == "force":
        return plain
    return text if kind_of(text) not in (None, "dimensionless") else None


def split_cell(token: str) -> tuple[str, str] | None:
    """Split a cell such as `8.84 N` into number and unit, None for any other."""
    match = _CELL.fullmatch(token.strip())
    unit = unit_word(match[2]) if match else None
    return (match[1], unit) if match and unit else None


def scaled(values: Number, scale: float) -> Number:
    """Return values times a factor, rounded once: 40 um is 40 / 1e6 m."""
    if scale == 1.0:
        return values
    inverse = _inverse(scale)
    return values / inverse if inverse else values * scale


def rescaled(values: FloatArray, scale: float) -> FloatArray:
    """Return the same of a column that nobody else holds: written over unless it is read-only."""
    if scale == 1.0 or not values.flags.writeable:
        return np.asarray(scaled(values, scale))
    if inverse := _inverse(scale):
        values /= inverse
    else:
        values *= scale
    return values


def _inverse(scale: float) -> int:
    """Return the whole number whose inverse a scale is, else 0: 40 / 10**6 rounds once, 40 * 1e-6 twice."""
    inverse = round(1 / scale) if 0 < abs(scale) < 1 else 0
    return inverse if inverse and 1 / inverse == scale else 0


def _expected(unit: str) -> str:
    return f'a quantity in {unit} (such as "2 {unit}")' if unit else "a number without unit"


@functools.cache
def _registry() -> pint.UnitRegistry:
    import pint  # 0.5 s: only where a unit other than SI turns up

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=False)


def _parsed(unit: str) -> pint.Quantity | None:
    """Return the pint quantity of one `unit`, None where pint does not know it."""
    import tokenize

    import pint

    plain = unit.strip()
    if not _ALLOWED.fullmatch(plain) or re.search("°[CF]|deg[CF]", plain):  # a shifted zero is no factor
        return None
    for spelled, spelling in _SPELLING.items():
        plain = plain.replace(spelled, spelling)
    plain = re.sub(r"[A-Za-z]+|^[-1]$", lambda word: _WORDS.get(word[0].lower(), word[0]), plain)
    plain = re.sub(r"(?<=[A-Za-z)])(-?\d)", r"**\1", plain)
    bare = _POWER.sub("", plain)
    if "**" in bare or (")" in bare and "**" in plain and re.search(r"[02-9]|\d\d", bare)):  # no number to any power
        return None
    try:
        return _registry().Quantity(1.0, plain)
    except (pint.PintError, tokenize.TokenError, SyntaxError, ArithmeticError):
        return None
    except (AttributeError, TypeError, ValueError, AssertionError, IndexError, KeyError):  # what pint's parser leaks
        return None
