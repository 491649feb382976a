"""Answers of which a few of many cycles misfit: their logs are followed by the model instead of as they were seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data_io import Record
from experiments.run_recovery_study import Study
from experiments.study_problem import SPEEDS
from identify.base.outcome import Status
from identify.estimation import search
from identify.estimation.attempt import Clock, solve_from
from tests.support.taken_logs import error, taken


@pytest.mark.slow
def test_first_slips_that_rest_otherwise_than_they_look_are_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """After its first slip, which finds the oldest contact, the mass rests so briefly that the next slips look like
    parts of it: with an event too few there, not even the true parameters lead to an answer."""
    case = Study("wide").case(114)[0]
    first = case.records[1]
    early = first.time <= 4.0
    begin = Record(first.time[early], first.normal_force[early], first.friction_force[early])
    records = [case.records[0], begin, *case.records[2:]]
    prepared, unknowns = taken(records, SPEEDS, case.truth, case.rig)
    refused = solve_from(prepared, [0, 1, 2, 3], unknowns, Clock())
    assert refused is not None and refused.gate.status is Status.WRONG_EVENT_COUNT
    state = search._Progressing(search.SearchProblem(prepared, unknowns), list(refused.logs), [0, 1, 2, 3])
    found = search._resimulated(state, prepared, unknowns, refused)
    assert found is not None and found.gate.status is Status.CONVERGED and found.logs == refused.logs
    assert found.prepared[1].manner.name == "course" and prepared[1].manner.name == "cycles"
    assert error(found, unknowns, "t_cr") < 0.1 and error(found, unknowns, "D") < 0.1
    # Where many misfit the law is wrong, not how some slips come to rest.
    bad = replace(refused, gate=replace(refused.gate, z=np.full(refused.gate.z.size, 50.0)))
    assert search._resimulated(state, prepared, unknowns, bad) is None
    monkeypatch.setattr(search, "FEW", 0.0)
    assert search._resimulated(state, prepared, unknowns, refused) is None
