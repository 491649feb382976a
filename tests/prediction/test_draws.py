"""Intervals of predictions: those of an independent Monte Carlo, also where answers follow the parameters in curves."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "experiments"))

import run_skew_study as study
from brute_force_lanes import Lanes

from identify.base.document import to_dict
from identify.model.model import assemble
from identify.prediction.draws import LEAST_DRAWS, Draws, OperatingPoint
from identify.prediction.predict import DrawAnswers, map_of, predict, solution_set
from identify.prediction.windows import speed_windows

MODEL = assemble(study.EFFECTS)
PAIR = {
    "mass": 0.2,
    "stiffness": 1470.0,
    "damping": 147.0,
    "mu_s": 0.62,
    "mu_k0": 0.43,
    "delta_mu_k": -0.13,
    "a": 300.0,
    "D": 37.4e-6,
    "t_cr": 0.5,
    "normal_force": 1.0,
}


def known_to(pair, share):
    """Covariance where every quantity is known to a share, friction coefficients to a fifth of it."""
    sizes = [abs(pair[name]) * (0.2 if name in study.LINEAR else 1.0) for name in study.NAMES]
    return np.diag(np.square(share * np.array(sizes)))


def case(pair, speed, share):
    """The answer at a drive speed [m/s] where everything is known to a share."""
    covariance = known_to(pair, share)
    document = to_dict(predict(MODEL, pair, speed, pair["normal_force"], covariance, study.NAMES))
    return study.Case(pair, speed, covariance, document)


def just_below_the_end(pair):
    """Where the drop follows what is left to the end like its root."""
    return 0.97 * to_dict(predict(MODEL, pair, 1e-3, pair["normal_force"]))["stability"]["critical_speed"]["value"]


PAIRS = {
    "demo": PAIR,
    "soft": PAIR | {"stiffness": 900.0, "damping": 120.0, "mu_k0": 0.46},
    "load": PAIR | {"normal_force": 2.0},
}


@cache
def skewed(name):
    return case(PAIRS[name], just_below_the_end(PAIRS[name]), 0.06)


@pytest.fixture
def skew():
    return skewed("demo")


@pytest.mark.parametrize("names", [("demo",), pytest.param(("soft", "load"), marks=pytest.mark.slow)])
def test_skew_intervals_are_those_of_an_independent_monte_carlo(names):
    scenes = [skewed(name) for name in names]
    rng = np.random.default_rng(2)
    pairs = [study.drawn(scene, 130, rng) for scene in scenes]
    place = np.repeat(np.arange(len(scenes)), [len(each) for each in pairs])
    speeds = np.array([scenes[i].speed for i in place])
    sticks, course = study.begun(Lanes.of([pair for each in pairs for pair in each], speeds), 12)
    for i, scene in enumerate(scenes):
        for name, values in (("drop", course.drop), ("period", course.period)):
            _, (low, high) = scene.interval(name)
            simulated = values[sticks & (place == i)]
            # 130 draws tell a share of 95 % to 2 %; the ends are quantiles of 200.
            assert 0.88 <= np.mean((simulated >= low) & (simulated <= high)) <= 0.998
        # Negative control: a straight line has other ends, as the drop goes like the root of what is left to the end.
        value = scene.document["amplitude"]["drop"]["value"]
        low, high = scene.interval("drop")[1]
        assert not 0.8 < (high / value - 1.0) / (1.0 - low / value) < 1.25


def test_ends_of_draws_are_those_of_their_own_windows():
    """Of pairs far from the estimate, and of the outer draws, which are closed in on; orders of the rest are kept."""
    names, covariance = study.NAMES, known_to(PAIR, 0.1)
    model_map = map_of(MODEL, OperatingPoint(PAIR, 1e-3, 1.0))
    answer = solution_set(model_map, 1e-3)
    draws = Draws.of(MODEL, PAIR | {"drive_speed": 1e-3}, names, covariance, 24)
    (part,) = answer.windows.sticking
    ends = DrawAnswers(draws, answer).limit(part, True)
    own = np.array([speed_windows(MODEL, w).end for w in draws.settings])
    assert np.ptp(np.log(own)) > 0.2
    assert np.min(ends) == pytest.approx(np.min(own), rel=2e-3) and np.max(ends) == pytest.approx(np.max(own), rel=2e-3)
    assert np.max(np.abs(np.log(ends / own))) < 0.1


def test_too_few_draws_with_an_answer_leave_the_interval_open():
    draws = Draws.of(MODEL, PAIR | {"drive_speed": 1e-3}, ("mu_s",), np.array([[1e-6]]), 200)
    values = np.full(200, np.nan)
    values[: LEAST_DRAWS - 1] = 1.0
    found = draws.interval(values, 1.0)
    assert found.low is None and f"only {LEAST_DRAWS - 1} of 200 draws" in found.reason


def test_forces_of_either_sign_have_ends_in_order():
    entry = case(PAIR | {"damping": 20.0}, 1e-3, 0.005).document["amplitude"]["arrest_force"]
    assert entry["interval"][0] < entry["value"] < entry["interval"][1]
