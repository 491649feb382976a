"""Where the solver wanders off from every start, what the logs do not tell is held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.study_problem import DEMO, scene_of, simulated_case
from identify.base.outcome import Status
from identify.estimation import search as room
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene


@pytest.mark.parametrize("held", [True, False])
def test_a_search_that_wanders_off_starts_again_with_what_is_not_told_held(monkeypatch, held):
    case = simulated_case(DEMO, 1)
    scene = scene_of(case)
    scene, records = replace(scene, logs=scene.logs[2:3]), case.records[2:3]
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    solve_from, solve_by_continuation, tried = room.solve_from, room.solve_by_continuation, list[np.ndarray]()

    def wandering(*given):
        """As a solver does on a ridge: no answer, though the start was placed."""
        found = solve_from(*given)
        solved = replace(found.solved, solution=replace(found.solved.solution, success=False))
        return replace(found, solved=solved, gate=replace(found.gate, status=Status.MODEL_MISFIT, chi2_per_sample=9.0))

    def holding(prepared, chosen, unknowns):
        tried.append(unknowns.start)
        return solve_by_continuation(prepared, chosen, unknowns) if held else None

    monkeypatch.setattr(room, "solve_from", wandering)
    monkeypatch.setattr(room, "solve_by_continuation", holding)
    found, _ = room.search(room.SearchProblem(logs, unknowns))
    assert found is not None and (found.gate.status is Status.CONVERGED) == held
    assert len(tried) == 1 if held else len(tried) > 1  # the first way that is found is taken
