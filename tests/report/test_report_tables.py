"""What users read: intervals whose ends differ, one unit per kind of quantity, an operating point, no contradiction."""

import re
from dataclasses import replace

import pytest

from identify.base.document import from_document
from identify.base.result import ClassicalTable, LogResult, ParameterResult, Result
from identify.base.wording import three_figures, told_apart
from identify.prediction.point_prediction import PointPrediction
from identify.prediction.wording import amplitude_text
from identify.report.report_page import render_page
from identify.report.report_tables import (
    answer_table,
    classical_pages,
    parameter_table,
    sentences,
    shown_error,
    spread_of,
)
from identify.report.report_wording import plain_symbol
from identify.report.summary import summary
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


@pytest.mark.parametrize("spread", [0.3, 3e-3, 3e-6])
@pytest.mark.parametrize("drop", [0.889, 0.0889, 123.4])
def test_ends_of_an_interval_differ_and_hold_the_value(drop, spread):
    numbers = ("drop", "period", "peak_speed", "stick_duration", "slip_duration", "slip_distance", "onset_force")
    amplitude = {name: entry(1.0, "") for name in (*numbers, "arrest_force")}
    document = {
        "operating_point": {"drive_speed": entry(1e-4 / 60, "m/s"), "normal_force": entry(0.943, "N")},
        "stability": {"outcome": "always sticks", "critical_speed": entry(0.02, "m/s"), "sliding_unstable_between": [],
                      "searched_between": [1e-6, 1.0], "multiplier": None, "multipliers": None,
                      "sliding": {"stable": False, "growth_rate": entry(-1.0, "1/s"), "worn": False, "eigenvalues": [],
                                  "friction_force": entry(0.4, "N")},
                      "stick_slip_between": [], "windows": []},
        "amplitude": {**amplitude, "peak_to_valley": entry(drop, "N", [drop * (1 - spread), drop * (1 + spread)])},
        "groups": {},
        "closed_forms": {"a_V_max": entry(None, ""), "slip": "restick", "ignores": []},
    }  # fmt: skip
    text = amplitude_text(from_document(PointPrediction, document))
    found = re.search(
        r"^At 0.1 mm/min and 0.943 N the force falls by ([\d.]+) (m?N) \(95 %: ([\d.]+) to ([\d.]+)\)", text
    )
    assert found, text
    value, low, high = (float(found[i]) * (1e-3 if found[2] == "mN" else 1.0) for i in (1, 3, 4))
    assert low < value < high
    assert (high - low) / (2 * drop * spread) == pytest.approx(1.0, abs=0.5)


def test_a_value_stands_with_its_interval_and_its_validity():
    entries = {"drop": entry(0.5, "N", [0.49, 0.51]), "period": entry(None, "s", validity="not valid here: too fast")}
    rows = answer_table([("log 1", entries), ("log 2", {"drop": entry(2.0, "N", [1.9, None])})]).cells
    assert [row[0].shown for row in rows] == ["drop of the force (onset to rest)", "period"]
    assert (rows[0][1].shown, rows[0][1].note) == ("0.5\N{NO-BREAK SPACE}N", "0.490 to 0.510")
    assert rows[0][2].note.startswith("above 1.9") and rows[1][2].shown == "–"
    assert (rows[1][1].shown, rows[1][1].note, rows[1][1].kind) == ("–", "not valid here: too fast", "doubt")


def test_the_fall_of_a_record_is_not_called_the_drop_of_the_model():
    fit = fake_fit(logs=1)
    figures = {"drop": {"value": 0.9241, "unit": "N"}, "drop_scatter": {"value": 0.01, "unit": "N"}}
    derived = {"amplitude": {"drop": entry(0.836, "N")}}
    quality = {"verdict": "accept", "findings": [], "figures": figures}
    logs = [{**fit.result["logs"][0], "derived": derived, "quality": quality}]
    page = render_page(replace(fit, result={**fit.result, "logs": logs}), [])
    before, of_record = page.split('id="quality">')
    assert "fall of the force (peak to valley)" in of_record and "drop of the force (onset to rest)" not in of_record
    assert "drop of the force (onset to rest)" in before
    (table,) = classical_pages([LogResult(classical=ClassicalTable(({"drop_N": 0.9241},)))])
    assert [row[0].shown for row in table.rows] == ["fall of the force (peak to valley)"]


def test_the_report_names_the_group_of_every_parameter():
    fit = fake_fit(logs=1)
    values = fit.result["parameters"]
    second = {**values["mu_s"], "group": "B", "per": "volunteer", "parameter": "mu_s"}
    parameters = {**values, "mu_s": {**values["mu_s"], "group": "A", "per": "volunteer"}, "mu_s (B)": second}
    derived = {"v_cr": entry(1e-4, "m/s", group="A"), "v_cr (B)": entry(2e-4, "m/s", group="B")}
    page = render_page(replace(fit, result={**fit.result, "parameters": parameters, "derived": derived}), [])
    assert "<bdi>μₛ (A)</bdi>" in page and "<bdi>μₛ (B)</bdi>" in page
    assert "<bdi>D</bdi>" in page, "what all groups share has none"
    assert "v_cr (A)" in page and "v_cr (B)" in page
    assert plain_symbol("mu_s (B)") == "μₛ (B)" and plain_symbol("v (B)") == "v (B)"


def test_of_several_logs_the_stability_is_a_table():
    texts = {"stability": {"text": "It sticks."}, "amplitude": {"text": "It falls."}}
    assert sentences(texts) == ("It sticks.", "It falls.") and sentences(texts, several=True) == ("It falls.",)


def test_a_refused_fit_shows_no_green_badge(fit):
    assert 'chip good">data: good' in render_page(fit, [])
    refused = render_page(failed(fit, "model_misfit", "the model does not follow"), [])
    section = refused[refused.index('<section class="log"') :]
    assert "data: good" in section and 'chip good">data' not in section


@pytest.mark.parametrize("converged", [True, False])
def test_every_entry_of_the_contents_leads_somewhere(fit, converged):
    page = render_page(fit if converged else failed(fit, "model_misfit", "no"), [])
    contents = page[page.index('class="contents"') : page.index("</nav>")]
    targets = re.findall(r'href="#([^"]+)"', contents)
    assert len(targets) >= 6 - 2 * (not converged) and len(set(targets)) == len(targets)
    assert all(f'id="{target}"' in page for target in targets) and ("parameters" in targets) == converged


def test_logs_that_took_no_part_are_named_in_the_terminal(fit):
    logs = [{**log, "reason_left_out": None} for log in fit.result["logs"]]
    logs[1]["reason_left_out"] = "fast.csv shows no complete stick-slip cycle"
    out = summary(Result.from_dict({**fit.result, "logs": logs}))
    assert "log 2 took no part: fast.csv shows no complete stick-slip cycle" in out and "log 1 took" not in out


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


@pytest.mark.parametrize("interval", [[None, 0.613], [None, None], None])
def test_an_interval_with_an_open_end_contradicts_nothing(interval):
    assert shown_error(parameter(0.586, None, interval)) is spread_of(parameter(0.586, None, interval)) is None
    assert shown_error(parameter(0.586, 0.01, interval)) == 0.01


@pytest.mark.parametrize(
    ("value", "text"),
    [(1800.0, "1800"), (999999.0, "1e+06"), (-1234.0, "-1230"), (0.298, "0.298"), (1.5e-5, "1.5e-05"), (0.0, "0")],
)
def test_a_number_with_three_figures(value, text):
    assert three_figures(value) == text


def test_two_numbers_are_written_so_that_they_differ():
    assert told_apart(1634.6, 1470.0) == ("1630", "1470")
    assert told_apart(0.29247, 0.29212) == ("0.2925", "0.2921")
    assert told_apart(0.3, 0.3) == ("0.3", "0.3")
