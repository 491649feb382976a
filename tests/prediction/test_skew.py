"""Intervals where answers follow the parameters in a curve: those of an independent Monte Carlo, nothing else shown."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "experiments"))

import run_skew_study as study
from brute_force_lanes import Lanes

from identify.base.document import from_document, to_dict
from identify.model.model import assemble
from identify.prediction.cycle import CycleMap
from identify.prediction.intervals import LEAST_DRAWS, OperatingPoint, sampled
from identify.prediction.point_prediction import PointPrediction
from identify.prediction.predict import predict, predictions
from identify.prediction.probability import prediction_certainty
from identify.prediction.windows import speed_windows
from identify.prediction.wording import amplitude_text

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


def point_of(scene):
    return OperatingPoint(scene.pair, scene.speed, scene.pair["normal_force"], scene.covariance)


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
            entry, (low, high) = scene.interval(name)
            assert entry["interval_from"] == "draws"
            simulated = values[sticks & (place == i)]
            # 130 draws tell a share of 95 % to 2 %; the ends are quantiles of 200.
            assert 0.88 <= np.mean((simulated >= low) & (simulated <= high)) <= 0.998
        # Negative control: the straight line has other ends.
        (line,) = [to_dict(answer) for answer in predictions(MODEL, [point_of(scene)], study.NAMES, draws=False)]
        assert line["amplitude"]["drop"]["interval"][1] > 1.15 * scene.interval("drop")[1][1]


def test_the_straight_line_is_not_shown_where_draws_are(skew):
    assert "Intervals are those of draws" in amplitude_text(from_document(PointPrediction, skew.document))
    found = to_dict(
        prediction_certainty(MODEL, OperatingPoint(PAIR, skew.speed, 1.0, skew.covariance), study.NAMES, draws=120)
    )
    assert found["quantities"]["drop"]["alike"] is False and found["quantities"]["drop"]["linear"] is None
    assert "95 % of the draws of the drop lie from" in found["text"] and "take the draws" not in found["text"]


def test_what_is_known_well_keeps_its_line():
    document = case(PAIR, 1e-3, 0.01).document
    entries = [document["amplitude"]["drop"], document["amplitude"]["period"], document["stability"]["critical_speed"]]
    assert all(entry["interval"][0] is not None and "interval_from" not in entry for entry in entries)
    assert "draws" not in document["text"]


def test_the_limit_of_another_pair_is_that_of_its_own_windows():
    """By the fold of its branch, far from the estimate; a limit that only followed the straight line would be off."""
    scene = study.Case(PAIR, 1e-3, known_to(PAIR, 0.2), {})
    limit = speed_windows(CycleMap(MODEL, 1.0, np.array([PAIR[name] for name in MODEL.parameter_names]))).end
    off = []
    for pair in study.drawn(scene, 4, np.random.default_rng(3)):
        map_ = CycleMap(MODEL, 1.0, np.array([pair[name] for name in MODEL.parameter_names]))
        own = speed_windows(map_).end.speed
        assert limit.of(map_) == pytest.approx(own, rel=2e-3)
        moved = map_.setting(1.0) - limit.orbit.cycle.setting
        off.append(abs(np.log(own / limit.speed) - limit.slopes[:-1] @ moved[:-1] / limit.speed))
    assert max(off) > 0.05


def test_too_few_draws_with_an_answer_leave_the_interval_open():
    values = np.full(200, np.nan)
    values[: LEAST_DRAWS - 1] = 1.0
    assert sampled(values).low is None and f"only {LEAST_DRAWS - 1} of 200 draws" in sampled(values).reason


def test_forces_of_either_sign_have_ends_in_order():
    entry = case(PAIR | {"damping": 20.0}, 1e-3, 0.005).document["amplitude"]["arrest_force"]
    assert entry["interval"][0] < entry["value"] < entry["interval"][1]
