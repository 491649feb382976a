"""What users read: intervals whose ends differ, one unit per kind of quantity, an operating point, no contradiction."""

import re

import pytest

from identify.base.result import ParameterResult
from identify.report.report_page import render_page
from identify.report.report_tables import (
    answer_table,
    parameter_table,
    shown_error,
    spread_of,
)
from tests.support.fake_fit import failed, fake_fit, with_verdicts

NORMAL = 1.959963984540054  # Abramowitz & Stegun, table 26.5
NORMAL_90 = 1.6448536269514722


def entry(value, unit, interval=None, **more):
    return {"value": value, "unit": unit, "interval": interval, "validity": ""} | more


def parameter(value, error, interval, level=0.95):
    return ParameterResult(value, "", error, None if interval is None else tuple(interval), level, "identified")


@pytest.fixture(scope="module")
def fit():
    return fake_fit(samples=2000)


def test_a_value_stands_with_its_interval_and_its_validity():
    entries = {"drop": entry(0.5, "N", [0.49, 0.51]), "period": entry(None, "s", validity="not valid here: too fast")}
    rows = answer_table([("log 1", entries), ("log 2", {"drop": entry(2.0, "N", [1.9, None])})]).cells
    assert [row[0].shown for row in rows] == ["drop of the force (onset to rest)", "period"]
    assert (rows[0][1].shown, rows[0][1].note) == ("0.5\N{NO-BREAK SPACE}N", "0.490 to 0.510")
    assert rows[0][2].note.startswith("above 1.9") and rows[1][2].shown == "–"
    assert (rows[1][1].shown, rows[1][1].note, rows[1][1].kind) == ("–", "not valid here: too fast", "doubt")


@pytest.mark.parametrize("converged", [True, False])
def test_every_entry_of_the_contents_leads_somewhere(fit, converged):
    page = render_page(fit if converged else failed(fit, "model_misfit", "no"), [])
    contents = page[page.index('class="contents"') : page.index("</nav>")]
    targets = re.findall(r'href="#([^"]+)"', contents)
    assert len(targets) >= 6 - 2 * (not converged) and len(set(targets)) == len(targets)
    assert all(f'id="{target}"' in page for target in targets) and ("parameters" in targets) == converged


def test_the_parameters_are_a_latex_table(fit):
    text = parameter_table(with_verdicts(fit).typed.parameters).to_latex()
    rows = [line for line in text.splitlines() if line.endswith(r"\\") and not line.startswith(("parameter", "\\"))]
    assert len(rows) == 6 and all(row.count("&") == 4 for row in rows)
    assert rows[0].startswith(r"mu\_s & 0.6200 $\pm$ 0.0011 & 0.6178 to 0.6222 & 1 & ")
    assert any(r"$\mu$m" in row for row in rows)
    assert not re.search(r"(?<!\\)[%_](?!\{)", "\n".join(rows)), "nothing that LaTeX takes for something else"


@pytest.mark.parametrize(("level", "normal"), [(0.95, NORMAL), (0.9, NORMAL_90)])
def test_the_interval_of_a_normal_distribution_leaves_the_error_as_it_is(level, normal):
    told = parameter(0.62, 0.003, [0.62 - normal * 0.003, 0.62 + normal * 0.003], level)
    assert shown_error(told) == spread_of(told) == 0.003


@pytest.mark.parametrize(("error", "shown"), [(0.0034, True), (0.0045, True), (0.0055, False), (0.0021, False)])
def test_an_error_that_the_interval_contradicts_is_not_shown(error, shown):
    told = parameter(0.620, error, [0.618, 0.631])  # as long as with a standard error of 0.00332
    assert (shown_error(told) is not None) == shown
    assert spread_of(told) == (error if shown else pytest.approx(0.0065 / NORMAL))
    for interval in ([None, 0.613], [None, None], None):  # an open end contradicts nothing
        assert shown_error(parameter(0.586, None, interval)) is spread_of(parameter(0.586, None, interval)) is None
        assert shown_error(parameter(0.586, error, interval)) == error
