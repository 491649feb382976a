"""fit from files or records to a result: the truth is found, and what cannot be fitted is refused with a reason."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import (
    DEMO,
    NOISE,
    RIG,
    SPEEDS,
    simulated_case,
)
from identify import Scene, fit
from identify.base.outcome import Status
from identify.effects import MAIN
from identify.examples import FOLDER
from identify.identification import find
from identify.logs.regime import Regime
from tests.support.document_check import SCHEMA, check_document, validator

MIDDLE = (2, 3)  # the logs at 1 and 5 mm/s of the study's problem: soon fitted


@pytest.fixture(scope="module")
def demo():
    return fit(Scene.from_toml(FOLDER / "pair.toml"))


@pytest.fixture(scope="module")
def case():
    return simulated_case(DEMO, 11)


def _scene(logs, rig=RIG, **more):
    entries = [{"path": f"log_{i}.csv", "drive_speed": SPEEDS[i][0]} for i in logs]
    return Scene.from_document(
        {"effects": [*MAIN, "varying_normal_force"], "rig": dict(rig), "logs": entries} | more, Path()
    )


def _records(case, logs):
    return [case.records[i] for i in logs]


def test_the_example_pair_is_found(demo):
    truth = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))["parameters"]
    document = check_document(demo.result)
    assert demo.converged
    assert document["parameters"].keys() == truth.keys()
    for name, parameter in document["parameters"].items():
        off = parameter["value"] - truth[name]
        assert parameter["verdict"] == "identified"
        assert abs(off) < 3 * parameter["standard_error"], name
        assert abs(off) < 0.05 * abs(truth[name]), name
    assert document["fit"]["cycles"] == sum(log["slip_count"] for log in document["logs"])
    assert document["fit"]["rms_N"] == pytest.approx(5e-3, rel=0.02)
    v_cr = document["derived"]["v_cr"]
    assert v_cr["interval"][0] < truth["D"] / truth["t_cr"] < v_cr["interval"][1]
    assert [log["friction_sign"] for log in document["logs"]] == [1, 1, 1, -1]
    assert {"mass", "stiffness", "damping"} <= document["rig_sensitivity"].keys()


def test_curves_of_a_fit(demo):
    for curves, log in zip(demo.logs, demo.result["logs"], strict=True):
        residual = (curves.friction_force - curves.fitted_force)[curves.used]
        assert np.std(residual) == pytest.approx(5e-3, rel=0.05)
        assert curves.cycles.shape == (log["slip_count"], 5)
        assert np.all(np.diff(curves.cycles[:, :2].ravel()) > 0), "onsets and arrests take turns"
        assert np.all(np.abs(curves.cycles[:, 4]) < 6)
        slip = curves.slip
        fitted = np.interp(curves.time[slip.samples], slip.time, slip.force)
        shown = curves.fitted_force[slip.samples]
        np.testing.assert_allclose(fitted, shown, atol=2e-3 * np.ptp(slip.force) + 1e-3)
        assert np.max(slip.sliding_speed) > 2 * curves.drive_speed


def test_a_mass_that_is_pulled_back_is_no_success(one_try):
    # With so little kinetic friction the spring pulls the mass back by a hair after each slip; a fit that takes every
    # slip for a forward one describes the force within its noise, with mu_k0 off by nine standard errors.
    pair = {"mu_s": 0.4053, "mu_k0": 0.1612, "delta_mu_k": -0.07649, "a": 606.2, "D": 39.93e-6, "t_cr": 0.4138}
    rig = {"mass": 0.2006, "stiffness": 1901.0, "damping": 158.9}
    case = simulated_case(pair, 5, rig=rig)
    assert case.reverses
    result = check_document(fit(_scene((1, 2), rig), _records(case, (1, 2))).result)
    assert result["status"] == "wrong_event_count"
    assert "pulled back" in result["message"]


def test_a_drive_that_only_loads_still_gives_the_classical_table():
    """A force that rises and never falls holds no cycle and no level: nothing to fit, and the table all the same."""
    random = np.random.default_rng(3)
    times = np.arange(3001) / 1000
    record = Record(times, np.full(times.size, 2.0), 0.3 * times + NOISE * random.standard_normal(times.size))
    outcome = fit(_scene((2,)), [record])
    result = check_document(outcome.result)
    assert outcome.status is Status.NO_CYCLES
    assert "log_2.csv" in result["message"]
    assert result["logs"][0]["classical"]["rows"][0]["cycles"] == 0
    assert outcome.logs[0].slip is None
    assert not np.any(np.isfinite(outcome.logs[0].fitted_force))


@pytest.mark.usefixtures("no_further_logs")
def test_sliding_alone_holds_its_level_and_says_so():
    random = np.random.default_rng(3)
    times = np.arange(3001) / 1000
    record = Record(times, np.full(times.size, 2.0), 0.9 + NOISE * random.standard_normal(times.size))
    outcome = fit(_scene((2,)), [record])
    result = check_document(outcome.result)
    assert outcome.status is Status.CONVERGED
    assert "friction level at its speed (1 mm/s)" in result["message"] and "add a log that sticks" in result["message"]
    assert {found["verdict"] for found in result["parameters"].values()} == {"not identifiable"}
    row = result["logs"][0]["classical"]["rows"][0]
    assert row["mean_coefficient"] == pytest.approx(0.45, rel=0.01)
    assert row["cycles"] == 0
    assert row["sliding_percent"] == pytest.approx(100.0)
    assert outcome.logs[0].slip is None
    fitted = outcome.logs[0].fitted_force
    assert fitted[np.isfinite(fitted)] == pytest.approx(0.9, abs=1e-3)
    assert np.count_nonzero(np.isfinite(fitted)) > 2900


@pytest.mark.usefixtures("no_further_logs")
def test_fixed_prior_and_estimated_rig_quantities(case):
    more = {
        "parameters": {
            "t_cr": {"fixed": 0.5},
            "mass": {"start": 0.23, "prior": {"mean": 0.21, "sd": 0.02}},
        }
    }
    result = check_document(fit(_scene(MIDDLE, **more), _records(case, MIDDLE)).result)
    assert result["status"] == "converged"
    parameters = result["parameters"]
    assert parameters["t_cr"]["verdict"] == "fixed"
    assert parameters["t_cr"]["value"] == 0.5
    mass = parameters["mass"]
    assert abs(mass["value"] - 0.2) < 4 * mass["standard_error"]
    assert mass["standard_error"] < 0.005, "the data know it better than its prior"
    assert set(result["correlation"]["names"]) == {"mu_s", "mu_k0", "D", "delta_mu_k", "a", "mass"}


def test_the_sign_of_the_force_and_masked_samples_do_not_matter(case):
    """Force negative throughout, some samples missing: the same answer but for the missing samples."""
    logs = (1, 2)
    quiet = {"progress": lambda _stage, _share: None}
    _, plain = find(_scene(logs), _records(case, logs), **quiet)
    records = []
    for record in _records(case, logs):
        force = -record.friction_force
        force[100::997] = np.nan
        records.append(Record(record.time, record.normal_force, force))
    prepared, holed = find(_scene(logs), records, **quiet)
    assert [log.sign for log in prepared] == [-1, -1]
    assert (plain.status, holed.status) == (Status.CONVERGED, Status.CONVERGED)
    sd = np.sqrt(np.diag(plain.covariance))
    free = plain.unknowns.free
    off = (holed.attempt.solved.theta - plain.attempt.solved.theta)[free]
    assert np.max(np.abs(off) / sd) < 0.3


def test_the_schema_lists_what_the_program_says() -> None:
    assert set(SCHEMA["properties"]["status"]["enum"]) == {status.value for status in Status}
    regimes = SCHEMA["$defs"]["log"]["properties"]["regime"]["enum"]
    assert {each.value for each in Regime} <= set(regimes)


@pytest.mark.parametrize(
    ("path", "wrong"),
    [
        (("status",), "fine"),
        (("parameters", "mu_s", "value"), "0.62"),
        (("parameters", "mu_s", "verdict"), "good"),
        (("parameters", "mu_s", "interval"), [0.6]),
        (("search", 0, "more"), 1),
        (("search", 0, "logs"), [0]),
        (("timing_s", "total"), -1.0),
        (("logs", 0, "friction_sign"), 0),
    ],
)
def test_what_breaks_a_promise_is_seen(demo, path, wrong) -> None:
    document = check_document(demo.result)
    broken = copy.deepcopy(document)
    place = broken
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = wrong
    assert validator().is_valid(document) and not validator().is_valid(broken)
