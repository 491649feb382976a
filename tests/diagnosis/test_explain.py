"""A misfit is traced to what is wrong with rig, sensor or a log, and to nothing where nothing of the kind is."""

import re
from dataclasses import replace

import pytest

from experiments.case_variants import misstated
from experiments.judgement import judged
from experiments.study_problem import DEMO, SPEEDS
from identify import fit
from identify.base.progress import to_nobody
from identify.base.result import Status
from identify.diagnosis.explain import explain, takes_misfit
from identify.diagnosis.findings import Findings
from identify.effects import MAIN
from identify.estimation.attempt import solve_from
from tests.support.two_logs import LOGS, drawn, prepared, records, scene, searched

LOADED = (*MAIN, "varying_normal_force")


def ended(stated, logs=None):
    """What a search from the data's own start ends in: a whole fit would try others first."""
    attempt, unknowns = searched(stated, logs)
    return Findings(attempt.gate.status, attempt.gate.message, unknowns, attempt)


def explained(stated, logs=None):
    found = ended(stated, logs)
    logs = logs or records()
    return explain(found, stated, logs, prepared(stated, logs)[0], to_nobody)


def told(message, pattern):
    match = re.search(pattern, message)
    assert match is not None, message
    return float(match[1])


def test_a_wrong_speed_of_one_log_is_named_with_the_log():
    stated = scene(times=(1.0, 1.05))
    end = ended(stated)
    assert takes_misfit(end.attempt, end.unknowns), "a fit solves no further start"
    found = explain(end, stated, records(), prepared(stated, records())[0], to_nobody)
    value = told(
        found.message, r"^a drive speed of log_3.csv (\S+) times the stated one \(5 mm/s instead of 5.25 mm/s\)"
    )
    assert value == pytest.approx(1 / 1.05, abs=0.0015)
    assert "in all logs" not in found.message.partition(" explains")[0]


@pytest.mark.slow
def test_a_wrong_load_of_one_log_is_named_with_the_log():
    """As the load of the one, or the other way round of the other: which of both, no data tell."""
    first, second = records(share=1.0)
    found = explained(scene(effects=LOADED), [replace(first, normal_force=1.03 * first.normal_force), second])
    value = told(found.message, r"a normal force of log_2.csv (\S+) times what is read")
    assert value == pytest.approx(1 / 1.03, abs=0.004)
    assert "a normal force of log_3.csv 1.03 times what is read" in found.message


@pytest.mark.slow
def test_a_zero_of_the_friction_force_is_named_where_the_load_varies():
    logs = drawn([SPEEDS[i] for i in LOGS], effects=LOADED, load=(1.0, 1.3), seed=3)
    logs = [replace(log, friction_force=log.friction_force + 0.06) for log in logs]
    found = explained(scene(effects=LOADED), logs)
    assert told(found.message, r"a friction force that reads (\S+) mN at zero") == pytest.approx(60.0, abs=5.0)


@pytest.mark.parametrize(
    ("restrained", "name", "by"),
    [
        ({"t_cr": {"prior": {"mean": 2.0, "sd": 0.02}}}, "t_cr", "its prior (2 s ± 0.02 s)"),
        pytest.param({"D": {"fixed": 1e-4}}, "D", "the value it is fixed at (0.1 mm)", marks=pytest.mark.slow),
        pytest.param({"a": {"upper": 150.0}}, "a", "its bounds", marks=pytest.mark.slow),
    ],
    ids=["prior", "held", "bound"],
)
def test_what_the_scene_says_of_a_parameter_is_named_where_the_data_contradict_it(restrained, name, by):
    message = explained(scene(**restrained), records(share=1.0)).message
    assert f"(ruled out by {by}" in message
    number, unit = message.split(f"{name} = ")[1].split()[:2]
    assert float(number) * (1e-6 if unit == "µm" else 1.0) == pytest.approx(DEMO[name], rel=0.15)


@pytest.mark.parametrize("stated", [{}, {"t_cr": {"prior": {"mean": 0.51, "sd": 0.02}}}], ids=["plain", "prior"])
def test_nothing_is_asked_of_what_is_right(stated):
    found, out = ended(scene(**stated)), explained(scene(**stated))
    assert (out.status, out.message, out.causes) == (Status.CONVERGED, found.message, ())


@pytest.mark.slow
def test_a_scatter_of_sticks_hides_no_filter():
    """Strengths of single sticks took up what a filter of the force does to slips: five of six intervals missed."""
    stated, logs, truth = misstated("filter", 53)
    result = fit(stated, logs).result
    line = judged(result, truth)
    assert not line["false"] and (line["right"] or result["status"] != "converged")


@pytest.mark.slow
def test_a_gain_of_one_log_is_found_where_no_motion_of_the_model_was_met():
    stated, logs, _ = misstated("gain", 10)
    first = fit(stated, logs).result["message"].split(";")[0]
    assert told(first, r"a friction force of log_1.csv that reads (\S+) times what it is explains") == 1.15


@pytest.mark.slow
def test_another_law_is_not_blamed_on_the_rig():
    """Friction that rises at once with speed, which the scene does not say: no quantity of the rig explains it."""
    more = {"direct_strength": 0.02, "direct_speed": 1e-4}
    logs = drawn([SPEEDS[i] for i in LOGS], more, (*MAIN, "direct_effect"), seed=3)
    found = ended(scene(), logs)
    assert 1.05 < found.attempt.gate.chi2_per_sample < 2.0 and found.status is Status.MODEL_MISFIT
    assert "explains the misfit within the noise" not in explained(scene(), logs).message


def test_an_answer_that_leaves_out_a_log_names_no_cause():
    """All is as stated: the search did not come to an answer of all logs."""
    found, logs = ended(scene()), prepared(scene(), records())[0]
    alone = solve_from(logs, [1], replace(found.unknowns, start=found.attempt.solved.theta))
    incomplete = replace(found, attempt=alone, status=Status.MODEL_MISFIT)
    out = explain(incomplete, scene(), records(), logs, to_nobody)
    assert out.causes == () and "not as stated" not in out.message
