"""Where a settled cycle leads astray, the last search goes on with what the levels of the data suggest."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from experiments.in_vivo import twin
from identify.base.outcome import Status
from identify.estimation import search as room
from identify.estimation.attempt import Attempt, Clock, solve_from
from identify.estimation.starts import own_starts, ranked, suggested_starts
from identify.logs.prepare import Prepared, prepare
from identify.logs.unknowns import Unknowns, from_scene
from identify.shooting.vibration import tuned

NUMBER, RATE = 26, 1000.0  # the same finger at 500 Hz was answered, at 1000 Hz no start led anywhere
Finger = tuple[list[Prepared], Unknowns, Unknowns]


@pytest.fixture(scope="module")
def finger() -> Finger:
    """Two logs of friction that drifts by 6 % in a grip that trembles; contacts age for 9.6 s. The search as the scene
    has it, and from the truth."""
    made = twin(NUMBER)
    scene = made.scene()
    unknowns = from_scene(scene)
    prepared = [prepare(scene, *of_log, unknowns) for of_log in zip(scene.logs, made.records(RATE), strict=True)]
    prepared, unknowns = tuned(prepared, unknowns)
    truth = unknowns.theta(np.array([made.truth[name] for name in unknowns.names]), prepared[0].data.base)
    return prepared, unknowns, replace(unknowns, start=truth)


def test_features_of_a_settled_cycle_know_nothing_of_a_contact_that_ages_on(finger: Finger) -> None:
    logs, unknowns, true = finger
    at = unknowns.names.index("t_cr")
    assert all(theta[at] < true.start[at] - np.log(8.0) for theta in own_starts(logs, unknowns))


@pytest.mark.parametrize("last", [True, False])
def test_the_last_search_goes_on_with_what_the_levels_suggest(
    finger: Finger, monkeypatch: pytest.MonkeyPatch, last: bool
) -> None:
    """Which of the suggestions the solver comes back from is a matter of luck: here it is the third, at the truth."""
    logs, unknowns, true = finger
    right = solve_from(logs, [0, 1], true, Clock())
    assert right is not None and right.gate.status is Status.CONVERGED
    lost = replace(right, gate=replace(right.gate, status=Status.MODEL_MISFIT))
    lost = replace(lost, solved=replace(lost.solved, solution=replace(lost.solved.solution, success=False)))
    asked: list[np.ndarray] = []

    def solve_or_hold(_prepared: Any, _chosen: Any, at: Unknowns, _clock: Clock) -> Attempt:
        asked.append(at.start)
        return right if len(asked) == 3 else lost

    monkeypatch.setattr(room, "solve_from", lambda *_given, **_how: lost)
    monkeypatch.setattr(room, "from_some", lambda *_given: None)
    monkeypatch.setattr(room, "solve_held", lambda *_given: None)
    monkeypatch.setattr(room, "solve_or_hold", solve_or_hold)
    found, _ = room.search(logs, unknowns, last=last)
    assert found is not None and (found.gate.status is Status.CONVERGED) == last
    expected = [start.theta for start in ranked(logs, unknowns, suggested_starts(logs, unknowns))][: 3 * last]
    assert len(asked) == len(expected)
    assert all(np.array_equal(one, other) for one, other in zip(asked, expected, strict=True))
    assert room.search(logs, unknowns, sources="user", last=last)[0].gate.status is not Status.CONVERGED  # type: ignore[union-attr]
    assert len(asked) == len(expected), "from a user's start alone nothing of the data's own is tried"
