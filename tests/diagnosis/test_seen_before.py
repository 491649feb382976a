"""A refusal says what the look at the logs before the fit has found: clipping, a lag, exchanged columns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, RIG, SPEEDS, simulated_case
from identify import Scene
from identify.base.outcome import Status
from identify.base.progress import to_nobody
from identify.diagnosis.explain import explain
from identify.diagnosis.findings import Findings
from identify.effects import MAIN
from identify.logs.judgement import suspicions
from identify.logs.prepare import prepare
from identify.logs.segment import segment
from identify.logs.unknowns import from_scene

PLACE = 2  # the log at 1 mm/s


@pytest.fixture(scope="module")
def good() -> Record:
    return simulated_case(DEMO, 5).records[PLACE]


def refused(record: Record) -> str:
    """The sentence of a misfit of this log that nothing explains."""
    logs = [{"path": "log.csv", "drive_speed": SPEEDS[PLACE][0]}]
    scene = Scene.from_document({"effects": list(MAIN), "rig": RIG, "logs": logs})
    unknowns = from_scene(scene)
    prepared = [prepare(scene, scene.logs[0], record, unknowns)]
    misfit: Any = Findings(Status.MODEL_MISFIT, "it misfits", unknowns)
    found, better = explain(misfit, scene, [record], prepared, to_nobody)
    assert found.status is Status.MODEL_MISFIT and better is None
    return found.message


def test_a_sensor_at_its_end_is_named_beside_the_misfit(good: Record) -> None:
    top = np.quantile(good.friction_force, 0.97)
    said = refused(Record(good.time, good.normal_force, np.minimum(good.friction_force, top)))
    assert said.startswith("it misfits")
    assert "before the fit this was seen: log.csv: the friction force stays at its highest value" in said


def test_exchanged_columns_are_named_whatever_else_a_fit_makes_of_them(good: Record) -> None:
    saw = (good.time % 0.5) / 0.5  # a load control that hunts by a hundredth, which looks as if it slipped
    load = good.normal_force + 0.02 * np.minimum(saw / 0.95, (1.0 - saw) / 0.05)
    load += 1e-3 * np.random.default_rng(1).standard_normal(load.size)
    said = refused(Record(good.time, good.friction_force, load))
    assert "normal force and friction force look swapped in log.csv" in said
    assert 'columns = { normal_force = "…", friction_force = "…" }' in said


def test_a_load_that_ripples_beside_friction_that_rests_and_slides_is_not_exchanged() -> None:
    """Slide, hold, slide: friction without a slip, whose load wanders by a few hundredths."""
    time, noise = np.arange(40_000) / 1000.0, np.random.default_rng(2).standard_normal((2, 40_000))
    friction = 0.3 + 0.2 * (1.0 - np.exp(-time / 10.0)) + 2e-3 * noise[0]
    saw = (time % 3.0) / 3.0
    load = 1.0 + 0.04 * np.minimum(saw / 0.98, (1.0 - saw) / 0.02) + 2e-3 * noise[1]
    seen = [segment(time, friction)]
    assert segment(time, load).count >= 3 and seen[0].count == 0, "the load looks as if it slipped"
    assert "forces_swapped" not in [f.code for f in suspicions(Record(time, load, friction), seen)]
    still = Record(time, load, 0.4 + 2e-3 * noise[0])
    assert "forces_swapped" in [f.code for f in suspicions(still, [segment(time, still.friction_force)])]
