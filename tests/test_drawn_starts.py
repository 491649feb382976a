"""Where all the data's own starts lie in a valley that no motion follows, starts by lot find the other one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from taken_logs import taken

from experiments.run_recovery_study import Study
from experiments.study_problem import SPEEDS
from identify.base.outcome import Status
from identify.estimation import search as room
from identify.estimation.attempt import Attempt, Clock
from identify.estimation.starts import drawn_starts, starts_of
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns

FACTOR = 3.0  # on t_cr: from closer than that the truth is found


@pytest.fixture(scope="module")
def pair() -> tuple[list[Prepared], Unknowns]:
    """A pair with mu_k0 = 0.65 of which the features look like contacts that age for seconds with mu_k0 = 0.96."""
    case = Study("wide").case(44)[0]
    return taken(case.records, SPEEDS, case.truth, case.rig)


def astray(unknowns: Unknowns, theta: np.ndarray) -> float:
    """The factor by which t_cr is off."""
    at = unknowns.names.index("t_cr")
    return float(np.exp(abs(theta[at] - unknowns.start[at])))


@pytest.fixture(scope="module")
def lost(pair: tuple[list[Prepared], Unknowns]) -> list[np.ndarray]:
    """The own starts that lie in the other valley; whether all do is a matter of rounding, and of the machine."""
    _, unknowns = pair
    own = starts_of(*pair, "data", 0, False, np.inf, Clock())
    there = [theta for theta in own if astray(unknowns, theta) > 20.0]
    assert there
    return there


def test_starts_by_lot_come_near_where_the_own_ones_do_not(
    pair: tuple[list[Prepared], Unknowns], lost: list[np.ndarray]
) -> None:
    logs, unknowns = pair
    found = list(drawn_starts(logs, unknowns, 0, lost, Clock()))
    assert astray(unknowns, found[0]) < FACTOR
    again = list(drawn_starts(logs, unknowns, 0, [*lost, found[0]], Clock()))
    assert all(np.any(np.abs(found[0] - theta) > 0.0) for theta in again)
    assert len(again) < len(found), "what is like a lost one is lost"


@pytest.mark.parametrize("drawn", [2, 0])
def test_the_search_goes_on_with_them_where_all_others_wander_off(
    pair: tuple[list[Prepared], Unknowns], lost: list[np.ndarray], monkeypatch: pytest.MonkeyPatch, drawn: int
) -> None:
    """A solver that finds its way from near the truth alone stands for the true one, which gets lost more slowly."""
    logs, unknowns = pair
    really, asked = room.solve_from, list[float]()

    def near_only(
        prepared: list[Prepared], chosen: list[int], unknowns_: Unknowns, clock: Clock, *more: Any, **how: Any
    ) -> Attempt | None:
        asked.append(astray(unknowns, unknowns_.start))
        if asked[-1] < FACTOR:
            return really(prepared, chosen, unknowns_, clock, *more, **how)
        gone = really(prepared, chosen, unknowns, clock, hopeless=0.0)
        assert gone is not None
        solved = replace(gone.solved, solution=replace(gone.solved.solution, success=False))
        return replace(gone, solved=solved, gate=replace(gone.gate, status=Status.MODEL_MISFIT))

    monkeypatch.setattr(room, "starts_of", lambda *_given: iter(lost))
    monkeypatch.setattr(room, "solve_from", near_only)
    monkeypatch.setattr(room, "from_some", lambda *_given: None)
    monkeypatch.setattr(room, "solve_held", lambda *_given: None)
    monkeypatch.setattr(room, "DRAWN", drawn)
    found, _ = room.search(logs, unknowns)
    assert found is not None and (found.gate.status is Status.CONVERGED) == bool(drawn)
    assert min(asked[: min(1 + room.FURTHER, len(lost))]) > 20.0
