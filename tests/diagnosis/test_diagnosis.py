"""A misfit is traced to what is wrong with rig or sensor, and to nothing where nothing of the kind is."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from data_io import Record
from experiments.study_problem import DEMO, NOISE, NORMAL_FORCE, RIG, SPEEDS, simulated_case
from experiments.wrong_rigs import wrong
from identify import Scene, fit
from identify.base.outcome import Status
from identify.diagnosis import diagnosis
from identify.diagnosis.diagnosis import REMAINS, _explanations, _is_nearer, diagnose
from identify.diagnosis.fitted import Fitted, as_it_ended
from identify.diagnosis.hypotheses import GROSS, SLIGHT, found_and_stated
from identify.diagnosis.nested import fit_beside, fit_model
from identify.effects import MAIN
from identify.estimation.attempt import retested, solve_from
from identify.estimation.search import COST_CUTOFF, SearchProblem, search
from identify.estimation.starts import features_of, starts_of
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.shooting.starts import candidates, fit_features
from identify.simulation.simulate import run
from tests.support.document_check import check_document

pytestmark = pytest.mark.usefixtures("no_further_logs")

LOGS = (2, 3)  # 1 and 5 mm/s: soon fitted
ALONE = (3,)  # where one log is enough


@pytest.fixture(scope="module")
def case():
    return simulated_case(DEMO, 17)


def _scene(rig, chosen=LOGS):
    logs = [{"path": f"log_{i}.csv", "drive_speed": SPEEDS[i][0]} for i in chosen]
    return Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": logs})


def _prepared(scene, records):
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    return logs, unknowns


def _lagging(lag):
    """What a first-order sensor shows of the motion, on a fine grid, sampled: an answer from outside the model."""
    random, out = np.random.default_rng(2), []
    for speed, duration, rate in (SPEEDS[i] for i in LOGS):
        fine = 20 * rate
        motion = run(assemble(MAIN), DEMO | RIG, speed, NORMAL_FORCE, duration)
        force = motion.sample(np.arange(round(duration * fine) + 1) / fine)["force"]
        share = 1.0 - np.exp(-1.0 / (fine * lag))
        shown = lfilter([share / 2, share / 2], [1.0, share - 1.0], force)[::20]
        times = np.arange(shown.size) / rate
        out.append(Record(times, np.full(times.size, NORMAL_FORCE), shown + NOISE * random.standard_normal(times.size)))
    return out


def _diagnosed(scene, records):
    """What is said of the misfit that the data's own start ends in: a whole fit would try others first."""
    logs, unknowns = _prepared(scene, records)
    attempt, _ = search(SearchProblem(logs, unknowns, thorough=False))
    assert attempt is not None and attempt.gate.status is not Status.CONVERGED
    cause = diagnose(scene, records, logs, unknowns, attempt)
    assert cause is not None and cause.better is None
    return cause.sentence


def test_a_wrong_mass_is_named_with_the_right_one(case, one_try):
    made = fit(_scene(RIG | {"mass": 0.3}, ALONE), [case.records[i] for i in ALONE])
    result = check_document(made.result)
    assert result["status"] == "model_misfit"
    assert all(reason["value"] is None for reason in result["effects"]["reasons"])
    assert "a mass of 0.2 kg instead of 0.3 kg" in result["message"]
    assert (result["correlation"], result["derived"]) == (None, {})
    assert {p["value"] for p in result["parameters"].values()} == {None}
    assert 0.3 < result["last_iterate"]["mu_s"]["value"] < 0.7, "where it stood, though no answer"
    assert result["gate"]["chi2_per_sample"] > 1.2
    for curves, log in zip(made.logs, result["logs"], strict=True):  # what scatters is measured, not the misfit's model
        drop = float(np.mean(curves.cycles[:, 2] - curves.cycles[:, 3]))
        assert drop == pytest.approx(log["classical"]["rows"][0]["drop_N"], rel=0.03)
    assert "[parameters]" in result["message"], "it says what to do"


@pytest.mark.slow
def test_a_wrong_stiffness_is_named_with_the_right_one(case):
    said = _diagnosed(_scene(RIG | {"stiffness": 1764.0}), [case.records[i] for i in LOGS])
    assert "a stiffness of 1470 N/m instead of 1760 N/m" in said


@pytest.mark.slow
def test_a_drive_that_is_slower_than_stated_is_named(case):
    scene = _scene(RIG)
    faster = tuple(replace(log, drive_speed=1.03 * log.drive_speed) for log in scene.logs)
    told = re.search(
        r"a drive speed (\S+) times the stated one",
        _diagnosed(replace(scene, logs=faster), [case.records[i] for i in LOGS]),
    )
    assert told is not None and float(told[1]) == pytest.approx(1 / 1.03, abs=0.003)


@pytest.mark.slow
def test_a_lag_of_the_sensor_is_named():
    said = _diagnosed(_scene(RIG), _lagging(5e-3))
    assert "a lag of the force sensor of 5" in said or "of 4.9" in said


def test_a_zero_of_the_friction_force_is_found_where_the_load_varies_and_not_looked_for_elsewhere():
    random, records, model = np.random.default_rng(3), [], assemble((*MAIN, "varying_normal_force"))
    for speed, duration, rate in (SPEEDS[i] for i in LOGS):
        course = ([0.0, duration], [1.0, 1.3])
        times = np.arange(round(duration * rate) + 1) / rate
        force = run(model, DEMO | RIG, speed, course, duration).sample(times)["force"]
        load = np.interp(times, *course) + 2e-3 * random.standard_normal(times.size)
        records.append(Record(times, load, force + 0.03 + 2e-3 * random.standard_normal(times.size)))
    scene = _scene(RIG).with_effects((*MAIN, "varying_normal_force"))
    prepared, _ = _prepared(scene, records)
    zero = next(hypothesis for hypothesis in SLIGHT if hypothesis.parameter == "sensor_offset")
    freed = fit_model(zero.freed(scene, prepared), records, thorough=False)
    value, _ = found_and_stated(zero, freed, scene)
    assert value == pytest.approx(0.03, abs=1e-3) and "reads 30" in zero.words(freed, round(value, 3), 0.0)
    constant = [replace(record, normal_force=np.ones(record.time.size)) for record in records]
    prepared, _ = _prepared(scene, constant)
    assert zero.freed(scene, prepared) is None, "a load that is always the same cannot tell it from a coefficient"


# That a right rig is not accused: tests/diagnosis/test_held.py.


def test_only_what_explains_all_logs_is_named(case):
    """A fit that leaves out a log leaves less of the misfit in any case."""
    scene, records = _scene(RIG | {"mass": 0.3}), [case.records[i] for i in LOGS]
    mass = next(hypothesis for hypothesis in GROSS if hypothesis.parameter == "mass")
    freed = fit_model(mass.freed(scene, []), records, thorough=False)
    ended = replace(freed, excess=1e4)
    assert [e.words[:16] for e in _explanations([(mass, freed)], scene, ended)] == ["a mass of 0.2 kg"]
    partial = replace(freed, attempt=replace(freed.attempt, log_numbers=(0,)))
    assert partial.excess == freed.excess
    assert not _explanations([(mass, partial)], scene, ended)


@pytest.mark.slow
def test_a_model_taken_over_from_another_one_is_judged_by_itself(case):
    """The motion of a converged fit does not make the model converge that lacks what it had."""
    scene, records = _scene(RIG | {"mass": 0.3}), [case.records[i] for i in LOGS]
    mass = next(hypothesis for hypothesis in GROSS if hypothesis.parameter == "mass")
    freed = fit_model(mass.freed(scene, []), records, thorough=False)
    assert freed.attempt.gate.status is Status.CONVERGED
    back = fit_beside(freed, scene, records)
    assert back.attempt.gate.status is not Status.CONVERGED and back.attempt.gate.chi2_per_sample > 1.2
    told = replace(freed.attempt, gate=back.attempt.gate)
    assert retested(told).gate.status is Status.CONVERGED


def test_a_suspect_is_looked_for_at_random_where_its_own_start_is_hopeless():
    case, scene, _ = wrong("stiffness", 36)
    hypothesis = next(hypothesis for hypothesis in GROSS if hypothesis.parameter == "stiffness")
    freed = hypothesis.freed(scene, [])
    logs, unknowns = _prepared(freed, case.records)
    features, bases = features_of(logs)
    own = fit_features(unknowns, features, bases, candidates(unknowns, features, bases))
    assert own[0].cost > COST_CUTOFF
    found = list(starts_of(logs, unknowns, "data", 0, False, COST_CUTOFF))
    truth = case.rig["stiffness"] / freed.rig.stiffness
    assert np.exp(found[0][unknowns.names.index("stiffness")]) == pytest.approx(truth, rel=0.05)
    assert not list(starts_of(logs, unknowns, "data", 0, True, COST_CUTOFF))  # cycles that differ have no start


@pytest.fixture(scope="module")
def right(case):
    """A scene, its records and logs, and their answer."""
    scene, records = _scene(RIG), [case.records[i] for i in LOGS]
    logs, unknowns = _prepared(scene, records)
    return scene, records, logs, unknowns, search(SearchProblem(logs, unknowns))[0]


def _astray(attempt):
    return replace(attempt, solved=replace(attempt.solved, solution=replace(attempt.solved.solution, cost=1e4)))


@pytest.mark.slow
def test_a_better_answer_that_was_met_on_the_way_is_handed_back(right):
    """What is set free may explain nothing but lead the search out of another optimum, in which logs are left out."""
    scene, records, logs, unknowns, answer = right
    alone = solve_from(logs, [1], replace(unknowns, start=answer.solved.theta))
    cause = diagnose(scene, records, logs, unknowns, _astray(alone))
    assert cause is not None and cause.better is not None
    assert cause.better.log_numbers == (0, 1) and cause.better.gate.status is Status.CONVERGED
    # another optimum lies farther off
    np.testing.assert_allclose(cause.better.solved.theta, answer.solved.theta, atol=0.02)


def test_a_suspect_as_it_is_stated_leads_to_a_better_answer(right, monkeypatch):
    """A mass that is set free and found as stated explains nothing, but the start from the data describes the logs."""
    scene, records, logs, unknowns, answer = right
    mass = tuple(hypothesis for hypothesis in GROSS if hypothesis.parameter == "mass")
    monkeypatch.setattr(diagnosis, "GROSS", mass)
    monkeypatch.setattr(diagnosis, "SLIGHT", ())
    cause = diagnose(scene, records, logs, unknowns, _astray(answer))
    assert cause is not None and cause.sentence == "another answer of the same model"
    assert cause.better.gate.status is Status.CONVERGED
    np.testing.assert_allclose(cause.better.solved.theta, answer.solved.theta, atol=0.02)
    monkeypatch.setattr(diagnosis, "GROSS", ())
    assert diagnose(scene, records, logs, unknowns, _astray(answer)) is None


def test_a_better_answer_leaves_out_no_log_that_was_described(right):
    scene, _, logs, unknowns, answer = right
    ended = as_it_ended(scene, unknowns, logs, _astray(answer))
    back = Fitted(scene, unknowns, tuple(logs), answer, answer.excess)
    assert _is_nearer(back, ended) and not _is_nearer(ended, back)
    assert _is_nearer(back, as_it_ended(scene, unknowns, logs, replace(_astray(answer), log_numbers=(1,))))
    assert not _is_nearer(replace(back, attempt=replace(answer, log_numbers=(1,))), ended)
    assert not _is_nearer(replace(back, excess=ended.excess - 0.5 * REMAINS * ended.excess), ended)
    assert not _is_nearer(replace(back, attempt=None, excess=np.inf), ended)


def test_a_hidden_slip_is_not_blamed_on_the_rig(case, one_try):
    records = [case.records[i] for i in ALONE]
    time, force = records[0].time, records[0].friction_force.copy()
    inside = (time > 1.0) & (time < 1.35)
    force[inside] = np.interp(time[inside], time[~inside], force[~inside])
    records[0] = Record(time, records[0].normal_force, force)
    result = fit(_scene(RIG, ALONE), records).result
    assert result["status"] != "converged"
    assert "explains the misfit within the noise" not in result["message"]
