"""An answer that leaves out a log with plenty of cycles is none, whoever met it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from data_io import Record
from experiments.record_kinds import FAST, SLOW, Kind
from experiments.study_problem import DEMO, RIG
from identify import answering, identification
from identify.base.outcome import Status
from identify.base.progress import Progress, to_nobody
from identify.diagnosis.findings import Findings
from identify.estimation import examined
from identify.estimation.attempt import Attempt, solve_from
from identify.logs.prepare import Prepared
from identify.scene import Scene


def test_a_better_answer_of_fewer_logs_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Met while the cause of a misfit is looked for, it fits what it takes: of the other log it says nothing."""
    scene, records = Kind("two speeds", (SLOW, FAST), (), DEMO, RIG).made(0)
    met: list[Attempt] = []

    def of_one_log(
        found: Findings, _scene: Scene, _read: Sequence[Record], prepared: list[Prepared], _told: Progress
    ) -> tuple[Findings, Attempt | None]:
        """At the right answer of both, the answer of the first log alone is met; at that, nothing."""
        if met:
            return found, None
        assert found.status is Status.CONVERGED and found.attempt is not None and found.attempt.log_numbers == (0, 1)
        alone = solve_from(prepared, [0], replace(found.unknowns, start=found.attempt.solved.theta))
        assert alone is not None and alone.log_numbers == (0,)
        met.append(alone)
        return found, alone

    monkeypatch.setattr(answering, "looked_into", of_one_log)
    monkeypatch.setattr(examined, "lowest_optimum", lambda attempt, *_: (attempt, []))  # how sure it is plays no part
    _, refused = identification.find(scene, records, progress=to_nobody)
    assert met and refused.status is Status.MODEL_MISFIT
    assert "does not stick-slip as log_2.csv does" in refused.message
