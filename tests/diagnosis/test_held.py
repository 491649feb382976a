"""What was taken as exact, against the data: the score test against full fits, and answers that only look right."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, NAMES, RIG
from identify.base.outcome import Status
from identify.identification import find
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run

NORMAL_FORCE, NOISE = 1.0, 5e-3
LOGS = ((1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0))  # drive speed [m/s], duration [s], rate [Hz]


@lru_cache(maxsize=4)
def _records(seed, effects=(), more=()):
    """From rest, with these effects more than a scene will know of."""
    random, model, out = np.random.default_rng(seed), assemble((*NAMES, *effects)), []
    values = {p.name: p.default for p in model.parameters} | DEMO | RIG | dict(more)
    values = {p.name: values[p.name] for p in model.parameters}
    for speed, duration, rate in LOGS:
        times = np.arange(round(duration * rate) + 1) / rate
        force = run(model, values, speed, NORMAL_FORCE, duration).sample(times)["force"]
        noise = NOISE * random.standard_normal(times.size)
        out.append(Record(times, np.full(times.size, NORMAL_FORCE), force + noise))
    return tuple(out)


def _scene(effects=(), **rig):
    logs = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, *_) in enumerate(LOGS, 1)]
    return Scene.from_document({"effects": [*NAMES, *effects], "rig": RIG | rig, "logs": logs}, Path())


def _found(scene, records):
    return find(scene, list(records), progress=lambda _stage, _share: None)[1]


@lru_cache(maxsize=2)
def _plain(seed):
    return _found(_scene(), _records(seed))


def _values(found):
    return {e.name: e.value for e in found.estimates}


def _chi_squared(found):
    return 2.0 * found.attempt.solved.solution.cost


@pytest.mark.slow
def test_a_wrong_rig_that_friction_absorbs_is_named():
    """The misfit is noise; the slope of the cost along what was held tells. Truth from outside: a fit with it free."""
    name, factor = "mass", 1.05
    exact = {"tolerances": {"mass": 0, "stiffness": 0, "damping": 0}}
    wrong = Scene.from_document(_scene(**{name: factor * RIG[name]}).as_document() | exact, Path())
    found = _found(wrong, _records(3))
    assert found.status is Status.MODEL_MISFIT
    assert found.message.startswith("the data ask for ") and "the misfit is noise" in found.message
    assert f"a {name} of " in found.message and "instead of" in found.message
    freed = Scene.from_document(wrong.as_document() | {"parameters": {name: {"start": factor * RIG[name]}}}, Path())
    free = _found(freed, _records(3))
    assert free.status is Status.CONVERGED
    said = next(h for h in found.held if h.name == name)
    assert said.squared == pytest.approx(_chi_squared(found) - _chi_squared(free), rel=0.05)
    assert np.log(said.said / said.stated) == pytest.approx(np.log(_values(free)[name] / said.stated), rel=0.1)


def test_a_right_rig_is_not_contradicted():
    far = []
    for seed in range(2):
        found = _plain(seed)
        assert found.status is Status.CONVERGED and "the data ask for" not in found.message
        assert [h.name for h in found.held] == ["mass", "stiffness", "damping"]
        far += [h.squared for h in found.held]
    assert 0.2 < np.mean(far) < 2.5, "squared distances of one degree of freedom each"


@pytest.mark.slow
def test_a_tolerance_that_the_data_contradict_is_told():
    """A small tolerance is contradicted, one that allows for the error is not; the data say the same of the mass."""
    said = []
    for tolerance in (0.002, 0.2):
        rig = {"value": f"{1.05 * RIG['mass']} kg", "tolerance": f"{100 * tolerance} %"}
        found = _found(_scene(mass=rig), _records(3))
        told = next(h for h in found.held if h.name == "mass")
        said.append(told.said)
        expected = np.log(told.said / told.stated) ** 2 / (told.error**2 + tolerance**2)
        assert told.squared == pytest.approx(expected)
        assert told.contradicted == (tolerance < 0.1)
    assert said == pytest.approx([RIG["mass"]] * 2, rel=0.02)
