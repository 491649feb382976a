"""What is public is documented: shapes and units in every docstring, and the reference page made from them."""

from __future__ import annotations

import inspect
import re

import pytest

import data_io
import identify
from experiments.make_python_reference import PAGE, members, page

PUBLIC = [*members(identify), *members(data_io)]
UNIT = re.compile(r"\[[^\]]{1,12}\]|\bSI\b|dimensionless|with a unit|\bshare\b|\bpixel|as in `|as for `", re.IGNORECASE)
SHAPE = re.compile(r"\([a-z0-9_ +]+,[a-z0-9_, +]*\)|broadcast|data frame|DataFrame|as in `|as for `", re.IGNORECASE)


def lacking(name: str, public: object, around: str) -> list[str]:
    """What a docstring lacks: itself, the units of numbers, the shapes of arrays."""
    told = inspect.getdoc(public) or ""
    types = " ".join(map(str, getattr(public, "__annotations__", {}).values()))
    out = [] if told and not told.startswith(f"{name}(") else ["a docstring"]
    if re.search(r"float|Array", types) and not UNIT.search(told + around):
        out.append("units")
    if "Array" in types and not SHAPE.search(told + around):
        out.append("shapes")
    return out


def test_a_public_name_has_a_docstring_with_shapes_and_units():
    assert {name: without for name, *rest in PUBLIC if (without := lacking(name, *rest))} == {}


@pytest.mark.parametrize(
    ("name", "public"), [(n, f) for n, f, _ in members(identify) if inspect.isfunction(f) and not n[0].isupper()]
)
def test_a_public_function_has_the_sections_of_numpydoc(name, public):
    """Every argument under Parameters; what comes back, and an error where the text names one, under their own."""
    told = inspect.getdoc(public)
    parameters, _, rest = told.partition("Parameters\n----------\n")[2].partition("\n\n")
    missing = [p for p in inspect.signature(public).parameters if not re.search(rf"^(\w+, )*{p}\b", parameters, re.M)]
    assert not missing and rest.startswith("Returns\n-------\n") and "Args:" not in told


def test_the_reference_page_is_what_the_docstrings_say():
    assert PAGE.read_text(encoding="utf-8") == page(), "run experiments/make_python_reference.py"
