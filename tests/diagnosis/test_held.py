"""What was taken as exact, against the data: the score test against full fits, and answers that only look right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.study_problem import NAMES, RIG
from identify.base.outcome import Status
from identify.identification import find
from identify.scene import Scene
from tests.support.two_logs import drawn

LOGS = ((1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0))  # drive speed [m/s], duration [s], rate [Hz]


def _scene(**rig):
    logs = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, *_) in enumerate(LOGS, 1)]
    return Scene.from_document({"effects": [*NAMES], "rig": RIG | rig, "logs": logs}, Path())


def _found(scene, records):
    return find(scene, list(records))[1]


@pytest.mark.slow
def test_a_wrong_rig_that_friction_absorbs_is_named():
    """The misfit is noise; the slope of the cost along what was held tells. Truth from outside: a fit with it free."""
    name, factor = "mass", 1.05
    exact = {"tolerances": {"mass": 0, "stiffness": 0, "damping": 0}}
    wrong = Scene.from_document(_scene(**{name: factor * RIG[name]}).as_document() | exact, Path())
    found = _found(wrong, drawn(LOGS, seed=3))
    assert found.status is Status.MODEL_MISFIT
    assert found.message.startswith("the fit is better with ") and "the misfit is noise" in found.message
    assert f"a {name} of " in found.message and "instead of" in found.message
    freed = Scene.from_document(wrong.as_document() | {"parameters": {name: {"start": factor * RIG[name]}}}, Path())
    free = _found(freed, drawn(LOGS, seed=3))
    assert free.status is Status.CONVERGED
    said = found.held[name]
    costs = [each.attempt.solved.solution.cost for each in (found, free)]
    value = next(e.value for e in free.estimates if e.name == name)
    assert said.squared_distance == pytest.approx(2.0 * (costs[0] - costs[1]), rel=0.05)
    assert np.log(said.from_data / said.stated) == pytest.approx(np.log(value / said.stated), rel=0.1)


@pytest.mark.slow
def test_a_tolerance_that_the_data_contradict_is_told():
    """A small tolerance is contradicted, one that allows for the error is not; the data say the same of the mass."""
    said = []
    for tolerance in (0.002, 0.2):
        rig = {"value": f"{1.05 * RIG['mass']} kg", "tolerance": f"{100 * tolerance} %"}
        found = _found(_scene(mass=rig), drawn(LOGS, seed=3))
        told = found.held["mass"]
        said.append(told.from_data)
        error = told.standard_error / told.from_data
        expected = np.log(told.from_data / told.stated) ** 2 / (error**2 + tolerance**2)
        assert told.squared_distance == pytest.approx(expected)
        assert found.contradicted == (tolerance < 0.1)
    assert said == pytest.approx([RIG["mass"]] * 2, rel=0.02)
