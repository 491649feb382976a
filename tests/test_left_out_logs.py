"""An answer that leaves out a log with plenty of cycles is none, whoever met it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from experiments.record_kinds import FAST, SLOW, Kind
from experiments.study_problem import DEMO, RIG
from identify import identification
from identify.outcome import Status
from identify.search.attempt import Attempt, Clock, solve_from
from identify.telling import to_nobody


def test_a_better_answer_of_fewer_logs_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Met while the cause of a misfit is looked for, it fits what it takes: of the other log it says nothing."""
    scene, records = Kind("two speeds", (SLOW, FAST), (), DEMO, RIG).made(0)
    prepared, findings = identification.find(scene, records, clock=Clock(), progress=to_nobody)
    assert findings.status is Status.CONVERGED and findings.attempt is not None
    at_answer = replace(findings.unknowns, start=findings.attempt.solved.theta)
    alone = solve_from(prepared, [0], at_answer, Clock())
    assert alone is not None and alone.logs == (0,)
    met: list[Attempt | None] = [alone, None]
    monkeypatch.setattr(identification, "looked_into", lambda found, *_: (found, met.pop(0)))
    _, refused = identification.find(scene, records, clock=Clock(), progress=to_nobody)
    assert not met and refused.status is Status.MODEL_MISFIT
    assert "does not stick-slip as log_2.csv does" in refused.message
