"""A misfit is traced to what is wrong with rig, sensor or a log, and to nothing where nothing of the kind is."""

import re
from dataclasses import replace

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, NOISE, NORMAL_FORCE, RIG, SPEEDS, simulated_case
from identify import Scene
from identify.base.outcome import Status
from identify.base.progress import to_nobody
from identify.diagnosis.explain import explain
from identify.diagnosis.findings import Findings
from identify.effects import MAIN
from identify.estimation.attempt import solve_from
from identify.estimation.goodness_of_fit import MORE
from identify.estimation.search import SearchProblem, search
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.simulation.simulate import run

pytestmark = pytest.mark.usefixtures("no_further_logs")

LOGS = (2, 3)  # 1 and 5 mm/s: soon fitted


@pytest.fixture(scope="module")
def case():
    return simulated_case(DEMO, 3)


@pytest.fixture(scope="module")
def records(case):
    return [case.records[i] for i in LOGS]


def scene(rig=RIG, chosen=LOGS, times=(1.0, 1.0), effects=MAIN, **parameters):
    logs = [{"path": f"log_{i}.csv", "drive_speed": f * SPEEDS[i][0]} for i, f in zip(chosen, times, strict=False)]
    return Scene.from_document({"effects": list(effects), "rig": rig, "logs": logs, "parameters": parameters})


def simulated(loads=((NORMAL_FORCE, NORMAL_FORCE),) * 2, effects=MAIN, more=(), shown=None, seed=3):
    """Logs whose normal force goes from one value to another, as a sensor shows them on a grid of 20 to a sample."""
    random, out, model = np.random.default_rng(seed), [], assemble(tuple(effects))
    values = {q.name: q.default for q in model.parameters} | DEMO | RIG | dict(more)
    for (speed, duration, rate), load in zip((SPEEDS[i] for i in LOGS), loads, strict=True):
        motion = run(model, values, speed, ([0.0, duration], list(load)), duration)
        force = motion.sample(np.arange(round(duration * rate * 20) + 1) / (20 * rate))["force"]
        force = force if shown is None else shown(force, 20 * rate)
        times = np.arange(round(duration * rate) + 1) / rate
        noisy = force[::20] + NOISE * random.standard_normal(times.size)
        out.append(Record(times, np.interp(times, [0.0, duration], load), noisy))
    return out


def ended(stated, logs, chosen=None):
    """What a search from the data's own start ends in: a whole fit would try others first."""
    unknowns = from_scene(stated)
    prepared = [prepare(stated, entry, record, unknowns) for entry, record in zip(stated.logs, logs, strict=True)]
    if chosen is None:
        attempt, left_out = search(SearchProblem(prepared, unknowns, thorough=False))
    else:
        attempt, left_out = solve_from(prepared, chosen, unknowns), {}
    return Findings(attempt.gate.status, attempt.gate.message, unknowns, attempt, left_out), prepared


def explained(stated, logs):
    found, prepared = ended(stated, logs)
    assert found.status is not Status.CONVERGED
    out, better = explain(found, stated, logs, prepared, to_nobody)
    assert better is None
    return out


def told(message, pattern):
    match = re.search(pattern, message)
    assert match is not None, message
    return float(match[1])


def test_a_wrong_speed_of_one_log_is_named_with_the_log(records):
    found = explained(scene(times=(1.0, 1.05)), records)
    value = told(
        found.message, r"^a drive speed of log_3.csv (\S+) times the stated one \(5 mm/s instead of 5.25 mm/s\)"
    )
    assert value == pytest.approx(1 / 1.05, abs=0.0015)
    assert "in all logs" not in found.message.partition(" explains")[0]


@pytest.mark.slow
def test_a_wrong_load_of_one_log_is_named_with_the_log(records):
    """As the load of the one, or the other way round of the other: which of both, no data tell."""
    wrong = [replace(records[0], normal_force=1.03 * records[0].normal_force), records[1]]
    found = explained(scene(effects=(*MAIN, "varying_normal_force")), wrong)
    value = told(found.message, r"a normal force of log_2.csv (\S+) times what is read")
    assert value == pytest.approx(1 / 1.03, abs=0.004)
    assert "a normal force of log_3.csv 1.03 times what is read" in found.message


@pytest.mark.slow
def test_a_zero_of_the_friction_force_is_named_where_the_load_varies():
    logs = simulated(loads=((1.0, 1.3),) * 2, effects=(*MAIN, "varying_normal_force"))
    logs = [replace(log, friction_force=log.friction_force + 0.06) for log in logs]
    found = explained(scene(effects=(*MAIN, "varying_normal_force")), logs)
    assert told(found.message, r"a friction force that reads (\S+) mN at zero") == pytest.approx(60.0, abs=5.0)


@pytest.mark.parametrize(
    ("restrained", "name", "by"),
    [
        ({"t_cr": {"prior": {"mean": 2.0, "sd": 0.02}}}, "t_cr", "its prior (2 s ± 0.02 s)"),
        ({"D": {"fixed": 1e-4}}, "D", "the value it is held at (0.1 mm)"),
        ({"a": {"upper": 150.0}}, "a", "its bounds"),
    ],
    ids=["prior", "held", "bound"],
)
def test_what_the_scene_says_of_a_parameter_is_named_where_the_data_contradict_it(records, restrained, name, by):
    found, prepared = ended(scene(**restrained), records)
    found, _ = explain(found, scene(**restrained), records, prepared, to_nobody)
    assert f"(ruled out by {by}" in found.message
    number, unit = found.message.split(f"{name} = ")[1].split()[:2]
    assert float(number) * (1e-6 if unit == "µm" else 1.0) == pytest.approx(DEMO[name], rel=0.15)


@pytest.mark.parametrize("stated", [{}, {"t_cr": {"prior": {"mean": 0.51, "sd": 0.02}}}], ids=["plain", "prior"])
def test_nothing_is_asked_of_what_is_right(records, stated):
    found, prepared = ended(scene(**stated), records)
    assert found.status is Status.CONVERGED
    out, better = explain(found, scene(**stated), records, prepared, to_nobody)
    assert (out.status, out.message, out.causes, better) == (found.status, found.message, (), None)


@pytest.mark.slow
def test_another_law_is_not_blamed_on_the_rig():
    """Friction that rises at once with speed, which the scene does not say: no quantity of the rig explains it."""
    logs = simulated(effects=(*MAIN, "direct_effect"), more=(("direct_strength", 0.02), ("direct_speed", 1e-4)))
    found, prepared = ended(scene(), logs)
    assert 1.05 < found.attempt.gate.chi2_per_sample < 1.0 + MORE and found.status is Status.MODEL_MISFIT
    out, better = explain(found, scene(), logs, prepared, to_nobody)
    assert better is None and "explains the misfit within the noise" not in out.message


def test_an_answer_that_leaves_out_a_log_names_no_cause(records):
    """All is as stated: the search did not come to an answer of all logs."""
    found, prepared = ended(scene(), records)
    alone = solve_from(prepared, [1], replace(found.unknowns, start=found.attempt.solved.theta))
    incomplete = replace(
        found, attempt=alone, status=Status.MODEL_MISFIT, message="log_2 does not stick-slip like this"
    )
    out, better = explain(incomplete, scene(), records, prepared, to_nobody)
    assert better is None and out.causes == () and out.status is Status.SOLVER_FAILED
    assert out.message.startswith("no answer of all logs was found") and "not as stated" not in out.message
