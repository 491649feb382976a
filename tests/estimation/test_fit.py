"""fit from files or records to a result: the truth is found, and what cannot be fitted is refused with a reason."""

from __future__ import annotations

import copy
import json
from functools import reduce
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, NOISE, RIG, SPEEDS, simulated_case
from identify import FitOptions, Scene, fit
from identify.base.result import Status
from identify.effects import MAIN
from identify.estimation.search import SearchProblem, search
from identify.examples import FOLDER
from identify.logs.scene_records import prepare_scene
from tests.support.document_check import check_document, validator
from tests.support.finding import find

MIDDLE = (2, 3)  # the logs at 1 and 5 mm/s of the study's problem: soon fitted


@pytest.fixture(scope="module")
def demo():
    return fit(Scene.from_toml(FOLDER / "pair.toml"), options=FitOptions(accuracy_table=True))


@pytest.fixture(scope="module")
def case():
    return simulated_case(DEMO, 11)


def _scene(logs, rig=RIG, **more):
    entries = [{"path": f"log_{i}.csv", "drive_speed": SPEEDS[i][0]} for i in logs]
    return Scene.from_document(
        {"effects": [*MAIN, "varying_normal_force"], "rig": dict(rig), "logs": entries} | more, Path()
    )


def _records(case, logs):
    """Of the faster logs the first half."""
    columns = ((r.time, r.normal_force, r.friction_force) for r in (case.records[i] for i in logs))
    return [Record(*(c[: c.size // (1 if i < 2 else 2)] for c in each)) for i, each in zip(logs, columns, strict=True)]


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
    for row, level in zip(document["accuracy_table"], document["accuracy"]["levels"], strict=True):
        worst = max(map(abs, row["left_in_standard_errors"].values()))
        assert (row["accuracy"], worst) == (level["accuracy"], level["error_in_standard_errors"])


def test_curves_of_a_fit(demo):
    for curves, log in zip(demo.logs, demo.result["logs"], strict=True):
        residual = (curves.friction_force - curves.fitted_force)[curves.used]
        assert np.std(residual) == pytest.approx(5e-3, rel=0.05)
        assert curves.cycles.shape == (log["slip_count"], 5)
        assert np.all(np.diff(curves.cycles[:, :2].ravel()) > 0), "onsets and arrests take turns"
        assert np.all(np.abs(curves.cycles[:, 4]) < 6)


def test_a_mass_that_is_pulled_back_is_no_success():
    # With so little kinetic friction the spring pulls the mass back by a hair after each slip; a fit that takes every
    # slip for a forward one describes the force within its noise, with mu_k0 off by nine standard errors.
    pair = {"mu_s": 0.4053, "mu_k0": 0.1612, "delta_mu_k": -0.07649, "a": 606.2, "D": 39.93e-6, "t_cr": 0.4138}
    rig = {"mass": 0.2006, "stiffness": 1901.0, "damping": 158.9}
    case = simulated_case(pair, 5, rig=rig)
    assert case.reverses
    made = prepare_scene(_scene((1, 2), rig), _records(case, (1, 2)))
    found, _ = search(SearchProblem(made.logs, made.unknowns, thorough=False))
    assert found.gate.status is Status.WRONG_EVENT_COUNT and "pulled back" in found.gate.message


def _alone(force):
    """A fit of one log with this friction force under 2 N, and its document."""
    noise = NOISE * np.random.default_rng(3).standard_normal(3001)
    outcome = fit(_scene((2,)), [Record(np.arange(3001) / 1000, np.full(3001, 2.0), force + noise)])
    return outcome, check_document(outcome.result), outcome.result["logs"][0]["classical"]["rows"][0]


@pytest.mark.usefixtures("no_predictions")
def test_sliding_alone_holds_its_level_and_says_so():
    outcome, result, row = _alone(0.9)
    assert outcome.status is Status.CONVERGED
    assert "friction level at its speed (1 mm/s)" in result["message"] and "add a log that sticks" in result["message"]
    assert {found["verdict"] for found in result["parameters"].values()} == {"not identifiable"}
    assert (row["cycles"], row["sliding_percent"]) == (0, pytest.approx(100.0))
    assert row["kinetic_mean_coefficient"] == pytest.approx(0.45, rel=0.01)
    fitted = outcome.logs[0].fitted_force[np.isfinite(outcome.logs[0].fitted_force)]
    assert fitted == pytest.approx(0.9, abs=1e-3) and fitted.size > 2900


@pytest.mark.usefixtures("no_predictions")
def test_fixed_prior_and_estimated_rig_quantities(case):
    more = {"t_cr": {"fixed": 0.5}, "mass": {"start": 0.23, "prior": {"mean": 0.21, "sd": 0.02}}}
    result = check_document(fit(_scene(MIDDLE, parameters=more), _records(case, MIDDLE)).result)
    assert result["status"] == "converged"
    t_cr, mass = (result["parameters"][name] for name in ("t_cr", "mass"))
    assert (t_cr["verdict"], t_cr["value"]) == ("fixed", 0.5)
    assert abs(mass["value"] - 0.2) < 4 * mass["standard_error"]
    assert mass["standard_error"] < 0.005, "the data know it better than its prior"
    assert set(result["correlation"]["names"]) == {"mu_s", "mu_k0", "D", "delta_mu_k", "a", "mass"}


def test_the_sign_of_the_force_and_masked_samples_do_not_matter(case):
    """Force negative throughout, some samples missing: the same answer but for the missing samples."""
    logs = (1, 2)
    _, plain = find(_scene(logs), _records(case, logs))
    records = []
    for record in _records(case, logs):
        force = -record.friction_force
        force[100::997] = np.nan
        records.append(Record(record.time, record.normal_force, force))
    prepared, holed = find(_scene(logs), records)
    assert [log.sign for log in prepared] == [-1, -1]
    assert (plain.status, holed.status) == (Status.CONVERGED, Status.CONVERGED)
    sd = np.sqrt(np.diag(plain.covariance))
    free = plain.unknowns.free
    off = (holed.attempt.solved.theta - plain.attempt.solved.theta)[free]
    assert np.max(np.abs(off) / sd) < 0.3


@pytest.mark.parametrize(
    ("path", "wrong"),
    [
        (("status",), "fine"),
        (("parameters", "mu_s", "interval"), [0.6]),
        (("search", 0, "more"), 1),
        (("timing_s", "total"), -1.0),
    ],
)
def test_what_breaks_a_promise_is_seen(demo, path, wrong) -> None:
    document = check_document(demo.result)
    broken = copy.deepcopy(document)
    reduce(lambda place, key: place[key], path[:-1], broken)[path[-1]] = wrong
    assert validator().is_valid(document) and not validator().is_valid(broken)
