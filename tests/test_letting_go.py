"""An answer that an event holds which can go no farther, and the better one beyond it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from taken_logs import error, taken

from experiments.run_recovery_study import Study
from experiments.study_problem import SPEEDS
from identify.base.outcome import Status
from identify.estimation import active_events as letting_go
from identify.estimation import certainty
from identify.estimation.active_events import hanging, let_go
from identify.estimation.attempt import Attempt, Clock, resolve, solve_from
from identify.logs.unknowns import Unknowns
from identify.shooting import placing as first_state
from identify.shooting.accuracy import DEFAULT_OPTIONS

NAMES = ["slowest", "slow", "fast", "fastest"]


@pytest.fixture(scope="module")
def held() -> tuple[Attempt, Unknowns]:
    """The answer to four logs from the truth: where the noise has one onset, the contact of the fast log re-ages for a
    moment in mid-slide after it, which in truth it does not. Followed with first onsets where the force is highest."""
    case = Study("wide").case(9)[0]
    prepared, unknowns = taken(case.records, SPEEDS, case.truth, case.rig)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(first_state, "aged_until_seen", lambda along, x, *_: x[along.model.clamped])
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


def test_an_answer_that_only_finer_steps_show_to_be_held_is_let_go(
    held: tuple[Attempt, Unknowns], monkeypatch: pytest.MonkeyPatch
) -> None:
    found, unknowns = held
    coarse = replace(found)  # what finer steps make of it is the answer that is held
    made = []

    def finer(attempt: Attempt, *_: object) -> tuple[Attempt, None, dict[str, float]]:
        made.append(attempt)
        return (found if attempt is coarse else attempt), None, {}

    monkeypatch.setattr(certainty, "fine_enough", finer)
    beyond = certainty._with_fine_steps(coarse, unknowns, DEFAULT_OPTIONS)[0]
    assert beyond.excess < found.excess - 20.0 and hanging(beyond.solved, NAMES) is None
    assert made == [coarse, beyond], "its steps are fine enough as well"
    monkeypatch.setattr(certainty, "let_go", lambda *_: None)
    assert certainty._with_fine_steps(coarse, unknowns, DEFAULT_OPTIONS)[0] is found


def test_a_slide_that_is_cut_short_is_followed_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stick of the slowest log ends in sliding; half a second too early and steady at once, it can only stay there
    though every phase is of the right kind."""
    case = Study("wide").case(114)[0]
    some = [0, 2, 3]
    names = [NAMES[i] for i in some]
    prepared, unknowns = taken([case.records[i] for i in some], [SPEEDS[i] for i in some], case.truth, case.rig)
    right = solve_from(prepared, [0, 1, 2], unknowns, Clock())
    assert right is not None and hanging(right.solved, names) is None
    rest, slide, *after = right.solved.guesses[0].tail
    assert (rest.ended_by, slide.ended_by) == ("onset", "time")
    early = rest.until - 0.5
    brief = (replace(rest, until=early), replace(slide, until=early + 1e-3), *after)
    cut = replace(right.solved.guesses[0], tail=brief)
    wrong = replace(right, solved=replace(right.solved, guesses=[cut, *right.solved.guesses[1:]]))
    found = resolve(wrong, replace(unknowns, start=right.solved.theta))
    assert found.gate.status is Status.CONVERGED and hanging(found.solved, names) is not None
    beyond = let_go(found, unknowns)
    assert beyond is not None and hanging(beyond.solved, names) is None
    assert beyond.excess < found.excess - 5.0
    monkeypatch.setattr(letting_go, "followed_anew", lambda *args: None)
    assert let_go(found, unknowns) is None
