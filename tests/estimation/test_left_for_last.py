"""A log in which slips are seen is not left out before it was looked at together with all the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.run_recovery_study import FIVE, Study
from experiments.study_problem import FIFTH, SPEEDS
from identify.base.outcome import Status
from identify.estimation import search as room
from identify.estimation.attempt import Attempt, solve_from
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from tests.support.taken_logs import taken

LAST = 2  # of the logs: at 20 mm/s, the way to sliding after four slips


@pytest.fixture(scope="module")
def pair() -> tuple[list[Prepared], Unknowns, Attempt]:
    """Three logs, and the answer of all: a fit of the first two leaves open `a`, at which the third cannot join."""
    case, _, _ = Study(FIVE).case(94)
    logs, unknowns = taken(list(case.records[2:]), [*SPEEDS, FIFTH][2:], case.truth, case.rig)
    found = solve_from(logs, [0, 1, LAST], unknowns)
    assert found is not None and found.gate.status is Status.CONVERGED
    return logs, unknowns, found


def searched(
    pair: tuple[list[Prepared], Unknowns, Attempt], patch: pytest.MonkeyPatch
) -> tuple[list[list[int]], Attempt, dict[int, str]]:
    """From which logs the search starts, one after the other, where the last joins no answer of the others."""
    logs, unknowns, found = pair
    asked: list[list[int]] = []

    def without(_logs: list[Prepared], first: list[int], *_: object) -> Attempt:
        asked.append(first)
        return found if LAST in first else replace(found, log_numbers=(0, 1))

    patch.setattr(room, "_from_logs", without)
    best, left_out = room.search(room.SearchProblem(logs, unknowns))
    assert best is not None
    return asked, best, left_out


def test_it_is_looked_at_with_all_others(
    pair: tuple[list[Prepared], Unknowns, Attempt], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, best, left_out = searched(pair, monkeypatch)
    assert asked[0] == [0, 1] and asked[-1] == [0, 1, LAST]
    assert best.log_numbers == (0, 1, LAST) and left_out == {}


def test_one_without_slips_is_left_out_at_once(
    pair: tuple[list[Prepared], Unknowns, Attempt], monkeypatch: pytest.MonkeyPatch
) -> None:
    logs, unknowns, found = pair
    still = [*logs[:LAST], replace(logs[LAST], falls=np.empty(0))]
    asked, best, left_out = searched((still, unknowns, found), monkeypatch)
    assert asked == [[0, 1]] and best.log_numbers == (0, 1)
    assert list(left_out) == [LAST] and "left out" in left_out[LAST]
