"""An answer that an event holds which can go no farther, and the better one beyond it."""

from __future__ import annotations

import pytest
from taken_logs import error, taken

from experiments.run_recovery_study import Study
from experiments.study_problem import SPEEDS
from identify.examination import letting_go
from identify.examination.hanging import hanging
from identify.examination.letting_go import let_go
from identify.outcome import Status
from identify.preparation.unknowns import Unknowns
from identify.search.attempt import Attempt, Clock, solve_from

NAMES = ["slowest", "slow", "fast", "fastest"]


@pytest.fixture(scope="module")
def held() -> tuple[Attempt, Unknowns]:
    """The answer to four logs from the truth: where the noise has one onset, the contact of the fast log re-ages for a
    moment in mid-slide after it, which in truth it does not."""
    case = Study("wide").case(9)[0]
    prepared, unknowns = taken(case.records, SPEEDS, case.truth, case.rig)
    found = solve_from(prepared, [0, 1, 2, 3], unknowns, Clock())
    assert found is not None
    return found, unknowns


def test_the_answer_beyond_an_event_that_vanishes_is_found(held: tuple[Attempt, Unknowns]) -> None:
    found, unknowns = held
    said = hanging(found.solved, NAMES)
    assert found.gate.status is Status.CONVERGED and said is not None and said.startswith("fast: ")
    beyond = let_go(found, unknowns)
    assert beyond is not None and beyond.gate.status is Status.CONVERGED and beyond.logs == found.logs
    assert hanging(beyond.solved, NAMES) is None
    assert len(beyond.solved.guesses[2].tail) == len(found.solved.guesses[2].tail) - 2
    assert beyond.excess < found.excess - 20.0
    assert error(beyond, unknowns, "a") < 0.02 < 0.1 < error(found, unknowns, "a")
    assert let_go(beyond, unknowns) is None


def test_an_answer_is_let_go_only_for_one_that_fits_better(
    held: tuple[Attempt, Unknowns], monkeypatch: pytest.MonkeyPatch
) -> None:
    found, unknowns = held
    monkeypatch.setattr(letting_go, "BETTER", 1e3)
    assert let_go(found, unknowns) is None
    monkeypatch.setattr(letting_go, "BETTER", 2.0)
    monkeypatch.setattr(letting_go, "FARTHER", (0.0,))  # followed where it is, it is the same motion
    assert let_go(found, unknowns) is None
