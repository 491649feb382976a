"""Windows of drive speed: the same whatever speed is asked at, those of plain simulation, never against themselves."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "experiments"))

import brute_force
import run_window_study as study
from brute_force import Lanes, onsets, simulate

from identify.base.document import to_dict
from identify.model.model import assemble
from identify.prediction.axes import Site
from identify.prediction.predict import predict
from identify.prediction.windows import speed_windows
from identify.scene import Scene
from identify.simulation.sliding import growth_rates
from tests.support.maps_case import DEMO, SITE

CASES = Path(__file__).parent / "cases"
PAIR = study.random_pairs(1, seed=3)[0]


def pair_of(name: str) -> dict[str, float]:
    """Values of a scene of the cases."""
    scene = Scene.from_toml(CASES / name)
    return {**scene.values(), "normal_force": scene.rig.normal_force}


def ask(pair: dict[str, float], speed: float) -> dict:
    """The answer at a drive speed [m/s]."""
    return to_dict(predict(Site(assemble(study.EFFECTS), pair, speed, pair["normal_force"])))


WINDOW, FLIP = pair_of("window_of_stickslip.toml"), pair_of("flip_end_of_stickslip.toml")


@pytest.mark.parametrize(
    ("pair", "speeds"),
    [
        (WINDOW, (0.379164e-3, 0.62e-3, 0.9e-3, 2e-3)),
        (FLIP, (2.6684923e-3, 0.1, 0.3)),
        (PAIR, tuple(np.geomspace(*study.speed_span(PAIR), 3))),
    ],
    ids=["window", "flip", "random"],
)
def test_windows_do_not_depend_on_the_speed_asked_at(pair, speeds):
    answers = [ask(pair, float(speed)) for speed in speeds]
    assert all(study.alike(answers[0], other) for other in answers[1:])
    assert [study.contradiction(document) for document in answers] == [""] * len(answers)


def test_a_window_with_two_ends_is_that_of_a_simulation():
    """Stick-slip that has begun goes on inside and stops outside; from rest too."""
    ((low, high),) = [
        (part["from"]["value"], part["to"]["value"]) for part in ask(WINDOW, 2e-3)["stability"]["stick_slip_between"]
    ]
    assert low == pytest.approx(0.6250e-3, rel=2e-3) and high == pytest.approx(1.036e-3, rel=2e-3)
    pair, begun = brute_force.Pair(WINDOW, WINDOW["normal_force"]), None
    for inside, outside in ((1.003 * low, 0.997 * low), (0.997 * high, 1.003 * high)):
        begun = brute_force.settled(pair, inside)
        assert begun is not None
        assert brute_force.settled(pair, outside, begun.end) is None


def test_stick_slip_out_of_reach_from_a_rested_contact_is_found():
    """The contact has to be almost renewed: simulated from rest the mass slides, from a renewed contact it sticks."""
    pair = {
        "mass": 0.02134, "stiffness": 1857.0, "damping": 31.3, "a": 58.25, "D": 65.5e-6, "t_cr": 0.2226,
        "normal_force": 0.116, "mu_s": 0.6732, "mu_k0": 0.3551, "delta_mu_k": 0.04821,
    }  # fmt: skip
    lanes = Lanes.of([pair] * 3, np.array([0.3e-3, 0.42e-3, 0.6e-3]))
    rested = simulate(lanes, np.stack([np.zeros(3), np.ones(3)]), 12)
    renewed = simulate(lanes, onsets(lanes, np.full(3, 0.02)), 12)
    assert rested.slides.tolist() == [True, True, True] and renewed.slides.tolist() == [True, False, True]
    document = ask(pair, 0.6e-3)
    said = [study.said_at(document, float(speed)) for speed in lanes.drive]
    assert said == ["never sticks", "bistable", "never sticks"]


def test_irregular_motion_has_an_end_too():
    document = ask(FLIP, 2.6684923e-3)
    assert document["stability"]["outcome"] == "sticks irregularly"
    end = document["stability"]["critical_speed"]["value"]
    pair = brute_force.Pair(FLIP, FLIP["normal_force"])
    begun = brute_force.settled(pair, 0.99 * end)
    assert begun is not None and brute_force.settled(pair, 1.01 * end, begun.end) is None
    assert "no stick-slip" not in document["text"]


def test_sliding_is_unstable_until_its_damping_vanishes():
    """Above v_cr: c = -dmu_k a exp(-a v) F_n."""
    damper = DEMO["damping"] * np.sqrt(DEMO["mass"] / DEMO["stiffness"])
    exact = np.log(-DEMO["delta_mu_k"] * DEMO["a"] / damper) / DEMO["a"]
    (found,) = speed_windows(SITE.model, SITE.setting[None])
    assert found.unstable == ((found.searched[0], pytest.approx(exact, rel=1e-8)),)


def test_sliding_that_is_unstable_between_two_nodes_only_is_seen():
    """Growth rates at many speeds, of a pair whose sliding is unstable over a sixth of the logarithm."""
    model, pair = assemble(study.EFFECTS), study.random_pairs(8, seed=50)[7]
    w = np.array([pair[name] for name in (*model.parameter_names, "normal_force")] + [1.0])
    ((low, high),) = speed_windows(model, w[None])[0].unstable
    speeds = np.geomspace(0.5 * low, 2.0 * high, 2000)
    grows = growth_rates(model, np.column_stack([np.tile(w[:-1], (2000, 1)), speeds])) >= 0.0
    assert high < 1.2 * low and np.array_equal(grows, (low < speeds) & (speeds < high))


def test_the_reader_of_contradictions_sees_them():
    """Negative control."""
    document = ask(WINDOW, 0.9e-3)
    denied = document | {"text": document["text"] + " No stick-slip was found at any drive speed."}
    assert "no stick-slip" in study.contradiction(denied)
    slides = document | {"stability": document["stability"] | {"outcome": "never sticks"}}
    assert "whose window says bistable" in study.contradiction(slides)
