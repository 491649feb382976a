"""Answers from other starts, where a vibrating drive leaves the misfit many optima. The truth is the simulation."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from experiments.effect_draws import NOISE, RIG, draw
from experiments.study_problem import DEMO, scene_of, simulated_case
from identify.base.outcome import Status
from identify.diagnosis.fitted import Fitted, fit_model
from identify.estimation import multistart as room
from identify.scene import Scene

VIBRATING = 59  # record of that study whose first answer, from the data alone, is wrong


def _values(fitted: Fitted) -> dict[str, float]:
    assert fitted.attempt is not None
    values = fitted.unknowns.values(fitted.attempt.solved.theta, fitted.unknowns.base(RIG))
    return dict(zip(fitted.unknowns.names, values.tolist(), strict=True))


@lru_cache
def _first() -> Fitted:
    """The answer of the generating model from the data alone."""
    effects, _, records, _ = draw(VIBRATING)
    logs = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, speed in enumerate((1e-4, 1e-3), 1)]
    scene = Scene.from_document({"effects": [*effects], "rig": RIG | {"noise": NOISE}, "logs": logs}, ".")
    return fit_model(scene, records, thorough=False)


@pytest.mark.slow
def test_other_starts_lead_to_the_answer_that_the_first_one_misses():
    _, truth, _, _ = draw(VIBRATING)
    first = _first()
    assert first.attempt is not None and first.attempt.gate.status is Status.CONVERGED  # nothing tells that it is wrong
    assert abs(_values(first)["mu_k0"] / truth["mu_k0"] - 1.0) > 0.3
    found = room.multistart_around(first.attempt, first.prepared, first.unknowns)
    assert found.excess < first.excess - 100.0
    values = _values(replace(first, attempt=found))
    for name, within in {"mu_s": 0.01, "mu_k0": 0.2, "D": 0.1, "t_cr": 0.1, "delta_mu_k": 0.15}.items():
        assert abs(values[name] / truth[name] - 1.0) < within, name


def test_where_nothing_vibrates_the_answer_stands():
    case = simulated_case(DEMO, 1)
    scene = scene_of(case)
    scene, records = replace(scene, logs=scene.logs[2:3]), case.records[2:3]
    first = fit_model(scene, records, thorough=False)
    assert np.isfinite(first.excess)
    assert room.multistart_around(first.attempt, first.prepared, first.unknowns) is first.attempt


@pytest.mark.slow
def test_starts_lie_around_a_neighbour_where_there_is_no_answer(monkeypatch):
    first = _first()
    assert first.attempt is not None
    tried: list[np.ndarray] = []
    monkeypatch.setattr(room, "solve_from", lambda _prepared, _logs, unknowns, *_, **__: tried.append(unknowns.start))
    solved = first.attempt.solved
    lost = replace(solved.solution, success=False, constraint_violation=1.0)
    failed = replace(first.attempt, solved=replace(solved, solution=lost))
    a = first.unknowns.names.index("a")
    here, there = solved.theta, solved.theta.copy()
    there[a] += 3.0  # friction that weakens twenty times as fast
    for attempt, centre in ((failed, there), (first.attempt, here)):
        tried.clear()
        assert room.multistart_around(attempt, first.prepared, first.unknowns, around=there) is attempt
        near = [abs(start[a] - centre[a]) for start in tried[-len(room.NEAR) :]]
        assert len(near) == len(room.NEAR) and float(np.median(near)) < 0.5
