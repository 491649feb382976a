"""How well an answer is known: what the time limit leaves of it."""

import numpy as np
import pytest

from experiments.record_kinds import DEMO, FAST, RIG, SLOW, Kind
from identify.base.budget import time_limit
from identify.base.outcome import Status
from identify.base.quantiles import NORMAL
from identify.estimation.certainty import Question, certainty
from identify.estimation.covariance import information_at
from identify.estimation.search import SearchProblem, search
from identify.estimation.strategies import tracing
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.shooting.accuracy import DEFAULT_OPTIONS


@pytest.fixture(scope="module")
def answer():
    """An answer to one log at one speed, which determines D and t_cr poorly, and its unknowns."""
    scene, records = Kind("", (SLOW, FAST), (SLOW, FAST), DEMO, RIG).made(1)
    unknowns = from_scene(scene)
    prepared = [prepare(scene, scene.logs[0], records[0], unknowns)]
    attempt, _ = search(SearchProblem(prepared, unknowns))
    assert attempt is not None and attempt.gate.status is Status.CONVERGED
    return attempt, unknowns


def test_an_answer_in_hand_is_given_with_the_intervals_of_its_covariance_when_the_time_is_up(answer):
    attempt, unknowns = answer
    base = attempt.fitted_logs[0].data.base
    with tracing() as trace, time_limit(0.0):
        known = certainty(attempt, Question(unknowns, base, DEFAULT_OPTIONS, 0.0, 0, lambda *_: None))
    assert known.attempt.gate.status is Status.CONVERGED and not (known.profiles and known.profiles.ends)
    assert trace.not_tried, "and what was left out is named"
    solved = known.attempt.solved
    covariance = information_at(solved, unknowns).covariance()
    for i, sd in zip(np.flatnonzero(unknowns.free), np.sqrt(np.diag(covariance)), strict=True):
        estimate = next(e for e in known.estimates if e.name == unknowns.names[i])
        if estimate.verdict == "not identifiable":
            continue
        ends = unknowns.values(solved.theta + NORMAL * sd * np.eye(unknowns.free.size)[i], base)[i]
        assert estimate.upper == pytest.approx(ends, rel=1e-6), estimate.name
    assert any(e.verdict != "identified" for e in known.estimates), "time was needed"
