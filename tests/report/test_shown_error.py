"""A standard error stands beside a value only where the interval beside both is its own."""

from __future__ import annotations

from typing import Any

import pytest

from identify.base.result import ParameterResult
from identify.report.report_tables import parameter_table
from identify.report.shown_error import scatter, shown_error

NORMAL = 1.959963984540054  # Abramowitz & Stegun, table 26.5
NORMAL_90 = 1.6448536269514722


def entry(
    value: float, error: float | None, interval: list[float | None] | None, level: float = 0.95
) -> ParameterResult:
    ends = None if interval is None else (interval[0], interval[1])
    return ParameterResult(value, "", error, ends, level, "identified")


@pytest.mark.parametrize(("level", "normal"), [(0.95, NORMAL), (0.9, NORMAL_90)])
def test_the_interval_of_a_normal_distribution_leaves_the_error_as_it_is(level: float, normal: float) -> None:
    told = entry(0.62, 0.003, [0.62 - normal * 0.003, 0.62 + normal * 0.003], level)
    assert shown_error(told) == 0.003
    assert scatter(told) == 0.003


@pytest.mark.parametrize(("error", "shown"), [(0.0034, True), (0.0045, True), (0.0055, False), (0.0021, False)])
def test_an_error_that_the_interval_denies_is_not_shown(error: float, shown: bool) -> None:
    told = entry(0.620, error, [0.618, 0.631])  # as long as with a standard error of 0.00332
    assert (shown_error(told) is not None) == shown
    assert scatter(told) == (error if shown else pytest.approx(0.0065 / NORMAL))


@pytest.mark.parametrize("interval", [[None, 0.613], [0.5, None], [None, None], None])
def test_nothing_is_denied_by_an_interval_with_an_open_end(interval: Any) -> None:
    assert shown_error(entry(0.586, None, interval)) is None
    assert scatter(entry(0.586, None, interval)) is None
    assert shown_error(entry(0.586, 0.01, interval)) == 0.01


def test_the_row_of_the_table_has_the_interval_alone_and_its_digits() -> None:
    table = parameter_table({"mu_s": entry(0.6204, 0.0083, [0.6181, 0.6309]), "mu_k0": entry(0.5, 0.01, [0.48, 0.52])})
    assert [(row[1].shown, row[2].shown) for row in table.cells] == [
        ("0.6204", "0.6181 to 0.6309"),
        ("0.500 ± 0.010", "0.480 to 0.520"),
    ]
