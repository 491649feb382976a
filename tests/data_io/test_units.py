"""Units: factors from the definitions of the units, not from pint; what is no quantity is refused with a sentence."""

import math
import string

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_io.units import SI_UNIT, factor, parse_quantity, scaled
from data_io.values import UnitError

G = 9.80665  # standard gravity, exact by definition

FACTORS = [
    ("N", "force", 1.0), ("mN", "force", 1e-3), ("uN", "force", 1e-6), ("µN", "force", 1e-6), ("μN", "force", 1e-6),
    ("kN", "force", 1e3), ("g", "force", G / 1000), ("gf", "force", G / 1000), ("kgf", "force", G), ("kg", "force", G),
    ("s", "time", 1.0), ("sec", "time", 1.0), ("ms", "time", 1e-3), ("min", "time", 60.0), ("h", "time", 3600.0),
    ("m", "length", 1.0), ("mm", "length", 1e-3), ("um", "length", 1e-6), ("µm", "length", 1e-6),
    ("mm/sec", "speed", 1e-3), ("mm/s", "speed", 1e-3), ("mm/min", "speed", 1e-3 / 60), ("µm/s", "speed", 1e-6),
    ("mm s^-1", "speed", 1e-3), ("mm·s⁻¹", "speed", 1e-3), ("g", "mass", 1e-3), ("kN/m", "stiffness", 1e3),
    ("%", "dimensionless", 0.01), ("", "dimensionless", 1.0), ("-", "dimensionless", 1.0),
]  # fmt: skip


@pytest.mark.parametrize(("unit", "kind", "scale"), FACTORS)
def test_factors(unit, kind, scale):
    assert scaled(2.5, factor(unit, SI_UNIT[kind])) == pytest.approx(2.5 * scale, rel=1e-15)
    np.testing.assert_allclose(
        scaled(np.array([1.0, -2.0, np.nan]), factor(unit, SI_UNIT[kind])), [scale, -2 * scale, np.nan], rtol=1e-15
    )


def test_si_stays_bit_for_bit():
    values = np.array([0.1, 1 / 3, 5e-324, -0.0])
    assert scaled(values, factor("N", SI_UNIT["force"])).tobytes() == values.tobytes()


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.1 mm/min", "m/s", 0.1e-3 / 60), ("40 um", "m", 40e-6), ("500 s/m", "s/m", 500.0), ("2 %", "", 0.02),
        ("0.2 kg", "kg", 0.2), ("200g", "kg", 0.2), ("300 g", "N", 0.3 * G), ("1.47 N/mm", "N/m", 1470.0),
        ("0.8 cm^2", "m^2", 0.8e-4), ("0.8 cm²", "m^2", 0.8e-4), ("-3e-1 mN", "N", -3e-4), ("5", "N", 5.0),
        (7, "m/s", 7.0), (np.float64(0.5), "s", 0.5),
    ],
)  # fmt: skip
def test_quantities(text, unit, value):
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("0,1 mm/min", "m/s"), ("abc", "m"), ("3 rpm", "m/s"), ("3 apples", "N"), (True, "N"), (None, "N"), ("", "N"),
        ("nan", "N"), (math.inf, "N"), ("1e999 N", "N"), ("3 N + 2 N", "N"), ("3 N", "kg"), ("20 degC", "K"),
        ("3 N", ""),
        ("3 N m", "N"), ("3 **", "N"), ("3 (", "N"), ("1 / 0 s", "s"), ([3], "N"),
    ],
)  # fmt: skip
def test_what_is_no_quantity_is_refused(text, unit):
    with pytest.raises(UnitError, match=r"found|unknown|has a"):
        parse_quantity(text, unit)


@given(st.text(alphabet=string.printable + "µ²°", max_size=12))
def test_any_text_is_a_number_or_a_unit_error(text):
    try:
        assert math.isfinite(parse_quantity(text, "N"))
    except UnitError as error:
        assert str(error)
