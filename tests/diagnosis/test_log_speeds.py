"""A drive speed that is stated wrongly for one log is told from one that is wrong for all, and from a missed slip."""

import re
from dataclasses import replace

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, RIG, SPEEDS, simulated_case
from identify import Scene
from identify.base.outcome import Status
from identify.diagnosis import diagnosis
from identify.diagnosis.diagnosis import FARTHEST, STEP, diagnose, refined
from identify.diagnosis.fitted import Fitted
from identify.diagnosis.hypotheses import GROSS, log_speeds
from identify.effects import MAIN
from identify.estimation.search import SearchProblem, search
from identify.logs.parting import PART, name_of_recording, recordings
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene

pytestmark = pytest.mark.usefixtures("no_further_logs")

LOGS = (2, 3)  # 1 and 5 mm/s: soon fitted
MISFITS = (1.0, 1.0)
WRONG = 1.05


@pytest.fixture(scope="module")
def records():
    made = simulated_case(DEMO, 17).records
    return [made[i] for i in LOGS]


def _scene(*times):
    """The scene with each drive speed stated so many times what it was."""
    logs = [
        {"path": f"log_{i}.csv", "drive_speed": factor * SPEEDS[i][0]} for i, factor in zip(LOGS, times, strict=True)
    ]
    return Scene.from_document({"effects": list(MAIN), "rig": RIG, "logs": logs})


def _prepared(scene, records):
    unknowns = from_scene(scene)
    return [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]


def _possible_causes(scene, records, misfits=MISFITS):
    return [hypothesis.logs for hypothesis in log_speeds(scene, _prepared(scene, records), misfits)]


def _diagnosed(scene, records):
    """The gate of what the data's own start ends in, and what is said of it: a whole fit would try others first."""
    logs, unknowns = _prepared(scene, records), from_scene(scene)
    attempt, _ = search(SearchProblem(logs, unknowns, thorough=False))
    return attempt.gate, diagnose(scene, records, logs, unknowns, attempt)


def test_a_wrong_speed_of_one_log_is_named_with_the_log_and_the_right_one(records, monkeypatch):
    drive = tuple(each for each in GROSS if each.parameter == "drive_speed")  # the rest takes a fit each
    monkeypatch.setattr(diagnosis, "GROSS", drive)
    monkeypatch.setattr(diagnosis, "SLIGHT", drive)
    gate, cause = _diagnosed(_scene(1.0, WRONG), records)
    assert gate.status is not Status.CONVERGED
    assert cause is not None and cause.better is None
    told = re.search(r"a drive speed of log_3.csv (\S+) times the stated one", cause.sentence)
    assert told is not None and float(told[1]) == pytest.approx(1 / WRONG, abs=0.0015)
    assert "mm/s instead of 5.25 mm/s" in cause.sentence and "explains the misfit within the noise" in cause.sentence
    assert "in all logs" not in cause.sentence


def test_the_log_whose_sticks_rise_otherwise_is_suspected(records):
    assert _possible_causes(_scene(WRONG, 1.0), records) == [(0,)]
    assert _possible_causes(_scene(1.0, 1 / WRONG), records) == [(1,)]


def test_no_log_is_suspected_where_all_are_right_or_all_are_wrong_alike(records):
    assert _possible_causes(_scene(1.0, 1.0), records) == []
    assert _possible_causes(_scene(WRONG, WRONG), records) == []
    assert _possible_causes(_scene(1.0, 1.01), records) == [], "what sticks cannot tell from noise"


def test_the_log_that_misfits_most_is_suspected_first(records):
    scene = _scene(WRONG, 1 / WRONG)
    assert _possible_causes(scene, records, (1.0, 9.0)) == [(1,), (0,)]
    assert _possible_causes(scene, records, (9.0, 1.0)) == [(0,), (1,)]


def test_a_single_log_is_not_told_from_all(records):
    scene = _scene(WRONG, 1.0)
    alone = replace(scene, logs=scene.logs[:1])
    assert _possible_causes(alone, records[:1], (1.0,)) == []


@pytest.mark.slow
def test_a_missed_slip_stays_a_missed_slip(records):
    time, force = records[1].time, records[1].friction_force.copy()
    inside = (time > 1.0) & (time < 1.08)
    force[inside] = np.interp(time[inside], time[~inside], force[~inside])
    hidden = [records[0], Record(time, records[1].normal_force, force)]
    scene = _scene(1.0, 1.0)
    assert _possible_causes(scene, hidden) == []
    gate, cause = _diagnosed(scene, hidden)
    assert "perhaps a slip was missed or invented" in gate.possible_causes and cause is None


def test_parts_of_one_log_have_one_speed(records):
    scene = _scene(WRONG, 1.0)
    whole, other = scene.logs
    parts = tuple(replace(whole, labels={PART: str(i)}) for i in (1, 2))
    parted = replace(scene, logs=(*parts, other))
    assert recordings(parted) == [[0, 1], [2]]
    assert [name_of_recording(parted, some) for some in recordings(parted)] == ["log_2.csv", "log_3.csv"]
    (hypothesis,) = log_speeds(parted, _prepared(parted, [records[0], *records]), (1.0, 1.0, 1.0))
    freed = hypothesis.freed(parted, [])
    assert hypothesis.logs == (0, 1) and freed.logs[0].drive_speed == freed.logs[1].drive_speed
    assert freed.logs[2] == other


def _at(scene, excess):
    return Fitted(scene, from_scene(scene), (), None, excess)


@pytest.mark.parametrize(("off", "asked"), [(0.004, 0.004), (-0.012, -0.012), (0.2, FARTHEST * STEP)])
def test_the_value_is_taken_where_the_misfit_is_least(off, asked):
    drive = next(hypothesis for hypothesis in GROSS if hypothesis.parameter == "drive_speed")
    scene, tried = _scene(1.0, 1.0), []
    right = (1.0 + off) * scene.logs[0].drive_speed

    def fit(_near, freed):
        tried.append(freed)
        return _at(freed, 1e6 * (freed.logs[0].drive_speed / right - 1.0) ** 2)

    best = refined(drive, fit(None, scene), fit)
    assert best.scene.logs[0].drive_speed / scene.logs[0].drive_speed - 1.0 == pytest.approx(asked, abs=1e-9)
    assert len(tried) == 4, "three more fits"
    astray = refined(drive, _at(scene, 1.0), lambda _near, freed: _at(freed, np.inf))
    assert astray.scene is scene
    mass = next(hypothesis for hypothesis in GROSS if hypothesis.parameter == "mass")
    assert refined(mass, _at(scene, 1.0), fit).scene is scene and len(tried) == 4
