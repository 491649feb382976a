"""Measured records: friction that differs from cycle to cycle is noticed, said, and described cycle by cycle."""

import pytest

from experiments.run_measured_records import RECORDS, main
from experiments.study_problem import DEMO, scene_of, simulated_case
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene


@pytest.mark.skipif(not RECORDS.is_dir(), reason="the measured records are not beside this checkout")
def test_a_measured_record_ends_with_numbers_and_the_reason(capsys):
    statuses = main(fast=True)
    said = capsys.readouterr().out
    assert set(statuses.values()) == {"converged"}
    assert "by the uneven estimator" in said and "differs from cycle to cycle" in said


def test_cycles_that_are_alike_show_no_scatter():
    case = simulated_case(DEMO, 3)
    scene = scene_of(case)
    unknowns = from_scene(scene)
    scatter = [prepare(scene, *pair, unknowns).scatter for pair in zip(scene.logs, case.records, strict=True)]
    assert max(scatter) < 0.02
