"""A log with thousands of slips that the noise hides joins others by the level of its force, and by nothing else."""

from __future__ import annotations

import pytest

from experiments.study_problem import SPEEDS, recovery_case
from identify.base.outcome import Status
from identify.estimation.attempt import place_on, solve_from
from identify.estimation.search import join
from identify.logs import prepare as preparing
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting import following
from tests.support.taken_logs import taken

SLOWEST, CYCLING = 0, [2, 3]  # of the four logs: 5,250 slips of 0.2 mN in noise of 5 mN; 23 and 14 that show


def case(number: int = 121) -> tuple[list[Prepared], Unknowns]:
    drawn = recovery_case("wide", number)
    return taken(drawn.records, SPEEDS, drawn.truth, drawn.rig)


def test_the_log_joins_by_its_level(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its steady end is a smaller share of it than a record is judged by."""
    monkeypatch.setattr(preparing, "LEAST_SHARE", 0.0)
    prepared, unknowns = case()
    known = solve_from(prepared, CYCLING, unknowns)
    assert known is not None and known.gate.status is Status.CONVERGED
    found = join(known, prepared, [SLOWEST], unknowns)
    assert found.gate.status is Status.CONVERGED and found.log_numbers == (SLOWEST, *CYCLING)
    assert found.fitted_logs[0].fit_mode.name == "sliding" and found.solved.trajectories[0].arrests == 0


def test_followed_it_would_claim_slips_that_nobody_saw(monkeypatch: pytest.MonkeyPatch) -> None:
    prepared, unknowns = case()
    assert place_on(prepared, [SLOWEST], unknowns) == []
    monkeypatch.setattr(following, "SHOWN", 0.0)
    [(_, cut, trajectory)] = place_on(prepared, [SLOWEST], unknowns)
    assert trajectory.arrests > 100 and cut.data.end < 0.5 * prepared[SLOWEST].data.end


@pytest.mark.slow
def test_a_train_of_slips_that_show_together_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of 251 slips stands out by two standard deviations, and this log alone tells t_cr."""
    prepared, unknowns = case(15)
    [(_, _, trajectory)] = place_on(prepared, [1], unknowns)
    assert trajectory.arrests == 251
    monkeypatch.setattr(following, "MOST_STRETCHES", 400)  # not to the end
    [(_, _, trajectory)] = place_on(prepared, [1], unknowns)
    assert 100 < trajectory.arrests < 251
