"""What users read: intervals whose ends differ, one unit per kind of quantity, an operating point, no contradiction."""

import re
from dataclasses import replace

import pytest

from identify.base.document import from_document
from identify.base.result import ClassicalTable, LogResult, Result
from identify.base.wording import quantity, three_figures, told_apart
from identify.prediction.point_prediction import PointPrediction
from identify.prediction.wording import amplitude_text, said, stability_text
from identify.report.report_page import render_page
from identify.report.report_tables import answer_table, classical_pages, without_groups_of
from identify.report.report_wording import plain_symbol
from identify.report.summary import summary
from tests.support.fake_fit import failed, fake_fit


def entry(value, unit, interval=None, **more):
    return {"value": value, "unit": unit, "interval": interval, "validity": ""} | more


def document(outcome="always sticks", drop=0.889, low=0.88871, high=0.88929):
    return {
        "operating_point": {"drive_speed": entry(1e-4 / 60, "m/s"), "normal_force": entry(0.943, "N")},
        "stability": {
            "outcome": outcome,
            "critical_speed": entry(0.02112, "m/s", [0.021079, 0.021163]),
            "sliding_unstable_between": [],
            "searched_between": [1e-6, 1.0],
            "sliding": {
                "stable": outcome == "bistable",
                "growth_rate": entry(-1.0, "1/s"),
                "friction_force": entry(0.4, "N"),
                "eigenvalues": [],
                "worn": False,
            },
            "multiplier": None,
            "multipliers": None,
            "stick_slip_between": [{"from": None, "to": entry(0.02112, "m/s", [0.021079, 0.021163])}],
            "windows": [
                {"from": 1e-6, "to": 0.02112, "outcome": outcome},
                {"from": 0.02112, "to": 1.0, "outcome": "never sticks"},
            ],
        },
        "amplitude": {
            "drop": entry(0.9 * drop, "N"),
            "peak_to_valley": entry(drop, "N", [low, high]),
            "period": entry(212.2, "s", [212.188, 212.237]),
            "peak_speed": entry(0.01427, "m/s", [0.01426, 0.014278]),
            "stick_duration": entry(212.1, "s"),
            "slip_duration": entry(0.1042, "s"),
            "slip_distance": entry(3.5e-4, "m"),
            "onset_force": entry(0.9, "N"),
            "arrest_force": entry(0.011, "N"),
        },
        "groups": {},
        "closed_forms": {"a_V_max": entry(None, ""), "slip": "restick", "ignores": []},
    }


def prediction(*arguments, **options):
    return from_document(PointPrediction, document(*arguments, **options))


@pytest.mark.parametrize("spread", [0.3, 0.03, 3e-3, 3e-4, 3e-5, 3e-6])
@pytest.mark.parametrize("drop", [0.889, 0.0889, 1.0, 123.4])
def test_ends_of_an_interval_differ_and_hold_the_value(drop, spread):
    text = amplitude_text(prediction(drop=drop, low=drop * (1 - spread), high=drop * (1 + spread)))
    found = re.search(r"falls by ([\d.]+) (m?N) \(95 %: ([\d.]+) to ([\d.]+)\) from peak to valley", text)
    assert found, text
    value, low, high = (float(found[i]) * (1e-3 if found[2] == "mN" else 1.0) for i in (1, 3, 4))
    assert low < value < high
    assert (high - low) / (2 * drop * spread) == pytest.approx(1.0, abs=0.5)


def test_amplitude_says_where_and_everything_in_the_units_of_the_rest():
    text = amplitude_text(prediction())
    assert text.startswith("At 0.1 mm/min and 0.943 N the force falls by 0.889")
    assert "µm/s" not in text and "943 mN" not in text
    none = document()
    none["amplitude"]["drop"] = entry(None, "N", validity="no stick-slip here")
    none["amplitude"]["drop"]["validity"] = "no stick-slip here"
    assert (
        amplitude_text(from_document(PointPrediction, none))
        == "Amplitude at 0.1 mm/min and 0.943 N: none; no stick-slip here."
    )


@pytest.mark.parametrize("value", [0.02112, 1e-3, 7.46e-5, 1.2e-5, 9e-6, 1.6e-6, 1.3])
def test_speeds_have_one_unit_in_sentences_and_tables(value):
    unit = "mm/min" if value < 1e-5 else "mm/s"
    assert said(value, "m/s").endswith(f" {unit}") and quantity(value, "m/s").endswith(f"\N{NO-BREAK SPACE}{unit}")


def test_what_it_does_is_without_groups_of():
    text = stability_text(prediction())
    assert text.startswith("At 0.1 mm/min and 0.943 N it sticks and slips, however the motion starts. Stick-slip ends")
    assert "always sticks" not in text
    assert "depends on the start" in stability_text(prediction("bistable"))


def test_what_all_entries_say_of_their_validity_stands_once():
    why = "not valid here: the linear law runs away (alpha = -1.02, at or below -1)"
    forms = {name: entry(None, "N", validity=why) for name in ("drop", "period")}
    table = answer_table([("log 1", {"closed_forms": forms, "stability": {"outcome": "always sticks"}})])
    headings = [row[0] for row in table.rows if len(row) == 1]
    assert [cell.note for cell in headings] == ["", why]
    cells = {row[0].shown: row[1] for row in table.rows if len(row) > 1}
    assert cells["what it does here"].shown == "stick-slip, from any start"
    assert (cells["period"].shown, cells["period"].note, cells["period"].kind) == ("–", "", "doubt")


def test_windows_of_several_logs_stand_in_one_row():
    outcomes = ("bistable", "always sticks")
    answers = [(outcome, {"stability": document(outcome)["stability"]}) for outcome in outcomes]
    rows = {row[0].shown: row[1:] for row in answer_table(answers).rows if len(row) > 1}
    told = [cell.shown.replace("\N{NO-BREAK SPACE}", " ") for cell in rows["over all drive speeds"]]
    assert told[0] == "stick-slip or steady sliding up to 21.12 mm/s; steady sliding above"
    assert told[1].startswith("stick-slip up to 21.12 mm/s")


def test_the_fall_of_a_record_is_not_called_the_drop_of_the_model():
    fit = fake_fit(logs=1)
    log = fit.result["logs"][0]
    told = {"drop": {"value": 0.9241, "unit": "N"}, "drop_scatter": {"value": 0.01, "unit": "N"}}
    derived = {"amplitude": {"drop": entry(0.836, "N")}}
    logs = [{**log, "derived": derived, "quality": {"verdict": "accept", "findings": [], "figures": told}}]
    page = render_page(replace(fit, result={**fit.result, "logs": logs}), [])
    quality = page[page.index('id="quality">') :]
    assert "fall of the force (peak to valley)" in quality and "drop of the force (onset to rest)" not in quality
    assert "drop of the force (onset to rest)" in page[: page.index('id="quality">')]
    (table,) = classical_pages([LogResult(classical=ClassicalTable(({"drop_N": 0.9241},)))])
    assert [row[0].shown for row in table.rows] == ["fall of the force (peak to valley)"]


def test_the_report_names_the_group_of_every_parameter():
    fit = fake_fit(logs=1)
    told = fit.result["parameters"]
    second = {**told["mu_s"], "group": "B", "per": "volunteer", "parameter": "mu_s"}
    parameters = {**told, "mu_s": {**told["mu_s"], "group": "A", "per": "volunteer"}, "mu_s (B)": second}
    derived = {"v_cr": entry(1e-4, "m/s", group="A"), "v_cr (B)": entry(2e-4, "m/s", group="B")}
    page = render_page(replace(fit, result={**fit.result, "parameters": parameters, "derived": derived}), [])
    assert "<bdi>μₛ (A)</bdi>" in page and "<bdi>μₛ (B)</bdi>" in page
    assert "<bdi>D</bdi>" in page, "what all groups share has none"
    assert "v_cr (A)" in page and "v_cr (B)" in page
    assert plain_symbol("mu_s (B)") == "μₛ (B)" and plain_symbol("v (B)") == "v (B)"


def test_a_group_that_stands_elsewhere_is_not_said_again():
    groups = {name: entry(1.0, "") for name in ("Pi", "v_cr", "zeta")}
    entries = {"groups": groups, "closed_forms": {"Pi": entry(1.0, "")}}
    assert list(without_groups_of(entries, {"v_cr": entry(1.0, "m/s")})["groups"]) == ["zeta"]
    assert without_groups_of({"text": "no answer"}, {}) == {"text": "no answer"}


def test_a_refused_fit_shows_no_green_badge():
    page = render_page(fake_fit(), [])
    assert 'chip good">data: good' in page
    refused = render_page(failed(fake_fit(), "model_misfit", "the model does not follow"), [])
    section = refused[refused.index('<section class="log"') :]
    assert "data: good" in section and 'chip good">data' not in section


def test_logs_that_took_no_part_are_named_in_the_terminal(capsys):

    fit = fake_fit()
    logs = [{**log, "reason_left_out": None} for log in fit.result["logs"]]
    logs[1]["reason_left_out"] = "fast.csv shows no complete stick-slip cycle"
    out = summary(Result.from_dict({**fit.result, "logs": logs}))
    assert "log 2 took no part: fast.csv shows no complete stick-slip cycle" in out and "log 1 took" not in out


@pytest.mark.parametrize(
    ("value", "said_as"),
    [
        (1800.0, "1800"),
        (2163.2, "2160"),
        (999.6, "1000"),
        (999999.0, "1e+06"),
        (-1234.0, "-1230"),
        (0.298, "0.298"),
        (1.5e-5, "1.5e-05"),
        (0.0, "0"),
        (float("inf"), "inf"),
    ],
)
def test_a_number_is_written_out_where_that_is_soon_read(value, said_as):
    assert three_figures(value) == said_as


def test_two_numbers_are_told_apart():
    assert told_apart(0.2, 0.3) == ("0.2", "0.3")
    assert told_apart(1634.6, 1470.0) == ("1630", "1470")
    # Said of a fit that a user was to correct: "a mass of 0.292 kg instead of 0.292 kg".
    assert told_apart(0.29247, 0.29212) == ("0.2925", "0.2921")
    assert told_apart(0.3, 0.3) == ("0.3", "0.3")
