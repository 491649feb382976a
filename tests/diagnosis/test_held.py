"""What was taken as exact, against the data: the score test against full fits, and answers that only look right."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, NAMES, RIG
from identify.base.outcome import Status
from identify.diagnosis import findings as held
from identify.diagnosis import second_look
from identify.diagnosis.diagnosis import Doubt, diagnose
from identify.diagnosis.findings import Findings, against_data
from identify.estimation.residual_autocorrelation import MORE
from identify.estimation.search import SearchProblem, search
from identify.identification import find
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
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
def test_a_wrong_rig_that_friction_absorbs_is_named(monkeypatch):
    """The misfit is noise; the slope of the cost along what was held tells. Truth from outside: a fit with it free."""
    name, factor = "mass", 1.05
    wrong = _scene(**{name: factor * RIG[name]})
    found = _found(wrong, _records(3))
    assert found.status is Status.MODEL_MISFIT
    assert "the misfit is noise, and yet the data ask for" in found.message
    assert f"a {name} of " in found.message and "instead of" in found.message
    freed = Scene.from_document(wrong.as_document() | {"parameters": {name: {"start": factor * RIG[name]}}}, Path())
    free = _found(freed, _records(3))
    assert free.status is Status.CONVERGED
    said = next(h for h in found.held if h.name == name)
    assert said.squared == pytest.approx(_chi_squared(found) - _chi_squared(free), rel=0.05)
    assert np.log(said.said / said.stated) == pytest.approx(np.log(_values(free)[name] / said.stated), rel=0.1)
    monkeypatch.setattr(held, "CLEAR", np.inf)  # negative control: as it was
    silent = _found(wrong, _records(3))
    assert silent.status is Status.CONVERGED
    off = {e.name: abs(e.value / DEMO[e.name] - 1.0) for e in silent.estimates if e.verdict == "identified"}
    assert max(off.values()) > 0.15, "identified, and wrong"


def test_a_small_error_of_the_rig_is_measured_to_first_order():
    """Half a per cent of the mass: the score says what a fit with the mass free says, to a tenth of its error."""
    found = _found(_scene(mass=1.005 * RIG["mass"]), _records(5))
    assert found.status is Status.CONVERGED
    document = _scene().as_document() | {"parameters": {"mass": {"start": RIG["mass"]}}}
    free = _found(Scene.from_document(document, Path()), _records(5))
    said = next(h for h in found.held if h.name == "mass")
    place = [free.unknowns.names[i] for i in np.flatnonzero(free.unknowns.free)].index("mass")
    error = float(np.sqrt(free.sure.white[place, place]))
    assert said.said == pytest.approx(_values(free)["mass"], rel=0.1 * error)
    assert said.error == pytest.approx(error, rel=0.05)


def test_a_right_rig_is_not_contradicted():
    far = []
    for seed in range(2):
        found = _plain(seed)
        assert found.status is Status.CONVERGED and "the data ask for" not in found.message
        assert [h.name for h in found.held] == ["mass", "stiffness", "damping"]
        far += [h.squared for h in found.held]
    assert 0.2 < np.mean(far) < 2.5, "squared distances of one degree of freedom each"


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


@pytest.mark.slow
def test_an_effect_the_scene_lacks_is_named():
    """So small a misfit would pass as noise with a memory, but that the cycles have it in common."""
    scene = _scene()
    records = list(_records(3, ("direct_effect",), (("direct_strength", 0.02), ("direct_speed", 1e-4))))
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    attempt, _ = search(SearchProblem(logs, unknowns, thorough=False))
    assert 1.05 < attempt.gate.chi2_per_sample < 1.0 + MORE
    assert attempt.gate.status is Status.MODEL_MISFIT
    assert "direct_effect" in diagnose(scene, records, logs, unknowns, attempt).sentence


def test_noise_with_a_memory_widens_what_is_said():
    found = _plain(0)
    theta = found.attempt.solved.theta
    white, memory = (against_data(found.information, theta, RIG, m, tolerances={}) for m in (1.0, 4.0))
    for plain, wide in zip(white, memory, strict=True):
        assert wide == replace(plain, error=2.0 * plain.error, squared=plain.squared / 4.0)


def test_logs_that_contradict_each_other_are_asked_what_would_reconcile_them(monkeypatch):
    refused = Findings(
        Status.MODEL_MISFIT,
        "log_3 contradicts the others",
        None,
        SimpleNamespace(gate=SimpleNamespace(possible_causes="")),
    )
    lag = Doubt("a lag of the force sensor of 5 ms", 326.0, 0.032, "D")
    monkeypatch.setattr(second_look, "hum", lambda _attempt: "")
    monkeypatch.setattr(second_look, "diagnose", lambda *_: None)
    monkeypatch.setattr(second_look, "doubt", lambda *_, anew, **_more: lag if anew else None)
    found, better = second_look.looked_into(refused, _scene(), [], [], lambda *_: None)
    assert found.status is Status.MODEL_MISFIT and better is None
    assert found.message.startswith("log_3 contradicts the others; the data ask for a lag of the force sensor of 5 ms")
