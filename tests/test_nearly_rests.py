"""Where a motion hardly differs from another one, the covariance holds the answers of both."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from taken_logs import taken

from experiments.run_recovery_study import FIVE, Study
from experiments.study_problem import FIFTH, SPEEDS
from identify.base.outcome import Status
from identify.estimation import examined
from identify.estimation.attempt import Attempt, Clock, solve_from
from identify.estimation.examined import Examined, Question, examine, information_at
from identify.estimation.nearly_rests import neighbours
from identify.estimation.sequence import modes_of
from identify.logs.unknowns import Unknowns
from identify.shooting.accuracy import DEFAULT_OPTIONS

FAST = 2  # the first of the logs that are fitted: at 1, 5 and 20 mm/s
CLOSE, FAR = 22.5, 40.0


@lru_cache(maxsize=1)
def answer() -> tuple[Attempt, Unknowns, np.ndarray]:
    """The answer, and the true theta (n_p,): pair 94 rests for 2 ms before its last slip at 20 mm/s, or does not."""
    case, _, _ = Study(FIVE).case(94)
    drives = [*SPEEDS, FIFTH][FAST:]
    logs, unknowns = taken(list(case.records[FAST:]), drives, case.truth, case.rig)
    found = solve_from(logs, list(range(len(logs))), unknowns, Clock())
    assert found is not None and found.gate.status is Status.CONVERGED
    return found, unknowns, unknowns.start


def seen() -> Examined:
    """What an examination sees of the answer."""
    found, unknowns, _ = answer()
    question = Question(
        unknowns, found.prepared[0].data.base, DEFAULT_OPTIONS, lambda _t: {}, 0.0, 0, lambda _s, _h: None
    )
    return examine(found, information_at(found, unknowns), question)


def distance(view: Examined) -> float:
    """Joint distance of the truth from the answer, squared."""
    _, unknowns, truth = answer()
    off = (view.attempt.solved.theta - truth)[unknowns.free]
    return float(off @ np.linalg.solve(view.view.covariance, off))


def test_the_answer_with_one_rest_more_is_met() -> None:
    found, unknowns, _ = answer()
    noise = examined.allowed(found, information_at(found, unknowns), 0.0).noise
    beside = neighbours(found, unknowns, noise)
    assert beside
    for other in beside:
        assert modes_of(other.solved.guesses[-1]) != modes_of(found.solved.guesses[-1])
        assert 2.0 * (other.solved.solution.cost - found.solved.solution.cost) < CLOSE


def test_the_covariance_holds_the_truth_beyond_it() -> None:
    assert distance(seen()) < CLOSE


def test_without_it_the_truth_is_far_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(examined, "neighbours", lambda *_: [])
    assert distance(seen()) > FAR


def test_an_answer_that_is_no_near_thing_has_none_beside() -> None:
    case, _, _ = Study("usual").case(1)
    logs, unknowns = taken(list(case.records[FAST:]), list(SPEEDS[FAST:]), case.truth, case.rig)
    found = solve_from(logs, [0, 1], unknowns, Clock())
    assert found is not None and found.gate.status is Status.CONVERGED
    noise = examined.allowed(found, information_at(found, unknowns), 0.0).noise
    assert neighbours(found, unknowns, noise) == []
