"""Logs that contradict each other: against linear regressions solved apart, and in fits that only look right."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from experiments.study_problem import DEMO, NAMES, RIG
from identify.base.result import Status
from identify.estimation.influence import scores_of
from identify.scene import Scene
from tests.support.finding import find
from tests.support.two_logs import drawn

LOGS = ((1e-4, 12.0, 200.0), (1e-3, 2.0, 500.0), (5e-3, 0.8, 1000.0))  # drive speed [m/s], duration [s], rate [Hz]
OTHER = 1.3  # times the characteristic speed parameter a in the second log


def _regressions(random, truths):
    """Designs and observations of noise 1; the second design knows nothing of the third parameter."""
    designs = [random.standard_normal((count, 3)) for count in (40, 25, 60)]
    designs[1][:, 2] = 0.0
    return designs, [x @ truth + random.standard_normal(len(x)) for x, truth in zip(designs, truths, strict=True)]


def _pulls(designs, seen):
    """The pulls, and the common answer with its covariance."""
    covariance = np.linalg.inv(sum(x.T @ x for x in designs))
    answer = covariance @ sum(x.T @ y for x, y in zip(designs, seen, strict=True))
    moves = np.stack([covariance @ x.T @ (y - x @ answer) for x, y in zip(designs, seen, strict=True)])
    spreads = np.stack([covariance @ x.T @ x @ covariance for x in designs])
    return scores_of(moves, spreads), answer


def test_a_pull_is_the_distance_between_a_log_alone_and_the_others_alone():
    truth = np.array([1.0, -2.0, 0.5])
    designs, seen = _regressions(np.random.default_rng(1), [truth] * 3)
    found, answer = _pulls(designs, seen)
    assert [pull.freedom for pull in found] == [3, 2, 3]
    for number in range(3):
        others = [i for i in range(3) if i != number]
        x, y = np.vstack([designs[i] for i in others]), np.concatenate([seen[i] for i in others])
        mine = np.arange(found[number].freedom)  # what this log tells; the rest of its design is nought
        own = designs[number][:, mine]
        alone, apart = (np.linalg.lstsq(a, b, rcond=None)[0][mine] for a, b in ((own, seen[number]), (x, y)))
        spread = np.linalg.inv(own.T @ own) + np.linalg.inv(x.T @ x)[np.ix_(mine, mine)]
        assert found[number].squared == pytest.approx((alone - apart) @ np.linalg.solve(spread, alone - apart))
        assert found[number].shift == pytest.approx(np.linalg.lstsq(x, y, rcond=None)[0] - answer)


def test_pulls_of_logs_that_agree_are_chi_squared_and_those_of_a_stranger_are_not():
    random, truth = np.random.default_rng(2), np.array([1.0, -2.0, 0.5])
    drawn = [_pulls(*_regressions(random, [truth] * 3))[0] for _ in range(400)]
    for number, freedom in enumerate((3, 2, 3)):
        squared = np.array([pull[number].squared for pull in drawn])
        assert np.mean(squared) == pytest.approx(freedom, abs=4 * np.sqrt(2 * freedom / squared.size))
        assert 0.9 < np.mean(squared < chi2.ppf(0.95, freedom)) < 0.98
        assert not any(pull[number].contradicts for pull in drawn)
    stranger = _pulls(*_regressions(random, [truth, truth, truth + 2.0]))[0]
    assert stranger[2].contradicts and not any(pull[1].contradicts for pull in drawn)


@lru_cache(maxsize=2)
def _records(factor):
    return [
        drawn([log], {"a": times * DEMO["a"]}, NAMES, seed=i)[0]
        for i, (times, log) in enumerate(zip((1.0, factor, 1.0), LOGS, strict=True))
    ]


def _found(factor, **parameters):
    logs = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, *_) in enumerate(LOGS, 1)]
    document = {"effects": [*NAMES, "varying_normal_force"], "rig": dict(RIG), "logs": logs}
    scene = Scene.from_document(document | ({"parameters": parameters} if parameters else {}), Path())
    _, found = find(scene, _records(factor))
    return found


def test_logs_of_one_pair_agree():
    assert _found(1.0).status is Status.CONVERGED


def test_logs_are_not_blamed_for_what_the_user_says_beside_them():
    # Of bounds: tests/estimation/test_sharing.py.
    prior = {"prior": {"mean": 0.6 * DEMO["a"], "sd": 0.02 * DEMO["a"]}}
    assert "contradicts the other logs" not in _found(1.0, a=prior).message
