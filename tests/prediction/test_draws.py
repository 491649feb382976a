"""Intervals of predictions: those of an independent Monte Carlo, open where something is not identifiable."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "experiments"))

import run_skew_study as study

from identify import Scene
from identify.base.document import to_dict
from identify.prediction.axes import Site
from identify.prediction.draws import LEAST_DRAWS, Draws
from identify.prediction.predict import ends_of, predict, predictions
from identify.prediction.sources import stated
from identify.prediction.windows import speed_windows
from tests.support.maps_case import DEMO, SITE

MODEL, PAIR = SITE.model, DEMO | {"normal_force": 1.0}
NAMES = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
KNOWN = np.diag(np.array([0.002, 0.002, 0.002, 5.0, 1e-6, 0.02]) ** 2)


def known_to(pair, share, names=study.NAMES):
    """Covariance where every quantity is known to a share, friction coefficients to a fifth of it."""
    sizes = [abs(pair[name]) * (0.2 if name in study.LINEAR else 1.0) for name in names]
    return np.diag(np.square(share * np.array(sizes)))


def drawn(names, covariance, count=400, seed=0, speed=1e-3):
    """Draws of the pair at a drive speed."""
    return Draws.of(Site(MODEL, DEMO, speed, 1.0, covariance=covariance, names=tuple(names)), count, seed)


def asked(speed, covariance=None, names=NAMES, /, draws=50, **changes):
    return to_dict(predict(Site(MODEL, DEMO | changes, speed, 1.0, covariance=covariance, names=tuple(names)), draws))


@pytest.mark.slow
@pytest.mark.parametrize("share, off", [(0.1, 0.01), (0.8, 0.1)])
def test_ends_of_draws_are_those_of_their_own_windows(share, off):
    """Of pairs far from the estimate too."""
    draws = drawn(study.NAMES, known_to(PAIR, share), 10)
    windows = speed_windows(MODEL, draws.settings)
    (part,) = windows[0].sticking
    ends = (ends_of([(draws, part, True)])[0] * part.high)[1:]
    own = np.array([each.end for each in windows[1:]])
    assert np.ptp(np.log(own)) > 2.0 * share
    assert np.max(np.abs(np.log(ends / own))) < off


def test_too_few_draws_with_an_answer_leave_the_interval_open():
    draws = drawn(["mu_s"], np.array([[1e-6]]), 200)
    found = draws.number(np.where(np.arange(201) < LEAST_DRAWS, 1.0, np.nan), "", "")
    assert found.interval == (None, None) and f"only {LEAST_DRAWS - 1} of 200 draws" in found.reason


def test_draws_have_the_covariance_and_are_possible():
    names = (*NAMES, "drive_speed")
    matrix = np.diag([(0.02 * abs((DEMO | {"drive_speed": 1e-2})[n])) ** 2 for n in names])
    matrix[0, 1] = matrix[1, 0] = 0.8 * np.sqrt(matrix[0, 0] * matrix[1, 1])
    found = drawn(names, matrix, 20000, 1, speed=1e-2)
    sizes = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    assert found.refused == 0
    np.testing.assert_allclose(np.cov([found.column(n) for n in names]) / sizes, matrix / sizes, atol=0.04)
    broad = drawn(("mu_s", "mu_k0"), np.diag([0.2**2, 0.2**2]), 2000)
    static, kinetic = broad.column("mu_s"), broad.column("mu_k0")
    assert 100 < broad.refused < 1500 and np.all(static > kinetic) and np.all(kinetic > 0.13)


def test_every_number_has_an_interval_and_the_document_is_json():
    names = (*NAMES, "mass", "damping")
    document = asked(2e-5, np.diag([(0.01 * DEMO[n]) ** 2 for n in names]), names)
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    entries = [document["stability"]["sliding"]["friction_force"], document["stability"]["critical_speed"]]
    for part in ("amplitude", "groups", "closed_forms"):
        entries += [e for e in document[part].values() if isinstance(e, dict) and e["value"] is not None]
    for entry in entries:
        assert entry["interval"] is None or entry["interval"][0] < entry["value"] < entry["interval"][1], entry
    fixed = [n for n in document["groups"] if document["groups"][n]["interval"] is None]
    assert fixed == [] and asked(1e-4)["amplitude"]["drop"]["interval"] is None


def test_points_of_one_pair_together_get_the_answers_they_get_alone():
    known = {"covariance": KNOWN, "names": NAMES}
    points = [Site(MODEL, DEMO, v, load, **known) for v, load in ((1e-3, 0.937), (5e-3, 0.940))]
    together, alone = (predictions(part)[-1].stability.critical_speed for part in (points, points[1:]))
    assert together.value == pytest.approx(alone.value, rel=1e-4)
    assert together.interval == pytest.approx(alone.interval, rel=1e-3)


def test_what_follows_from_an_unknown_parameter_is_open_and_says_why():
    unknown = KNOWN.copy()
    unknown[4, 4] = np.nan
    document = asked(1e-3, unknown)
    # A D twenty times as large moves the end of stick-slip by 0.9 %: that keeps its interval.
    end, far = document["stability"]["critical_speed"], asked(1e-3, D=20.0 * DEMO["D"])["stability"]["critical_speed"]
    assert end["interval"][0] < far["value"] < min(end["interval"][1], 1.01 * end["value"])
    for entry in (document["stability"]["sliding"]["growth_rate"], document["amplitude"]["drop"]):
        assert entry["value"] is not None and entry["interval"] == [None, None] and "D" in entry["reason"]
    assert "D, on which it depends, is not identifiable" in document["amplitude"]["text"]


def test_a_ridge_between_parameters_opens_what_lies_along_it_only():
    """Two parameters unknown, their sum known: what needs the sum alone keeps its interval."""
    ridge = np.diag([0.0, 1e6, 1e6]) + 1e-6 * np.eye(3)
    ridge[1, 2] = ridge[2, 1] = -1e6
    draws = drawn(("mu_s", "mu_k0", "delta_mu_k"), ridge)
    static, slow, fall = (draws.column(name) for name in ("mu_s", "mu_k0", "delta_mu_k"))
    assert "mu_k0 and delta_mu_k" in draws.number(slow + 0.5 * fall, "", "").reason
    assert not draws.number(slow + fall, "", "").reason
    closed = draws.number(static, "", "")
    assert closed.interval[0] == pytest.approx(DEMO["mu_s"] - 1.96e-3, rel=2e-4) and not closed.reason


SCENE = """
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
[rig]
mass = { value = "0.2 kg", tolerance = "2 %" }
stiffness = "1470 N/m"
damping = "147 N/m"
drive_speed = { value = "1 mm/s", tolerance = "1 %" }
normal_force = "1 N"
[parameters]
mu_s = { prior = { mean = 0.6, sd = 0.02 } }
"""


def test_stated_tolerances_are_a_covariance(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    scene = Scene.from_toml(path)
    assert stated(scene, scene.values(None), 1e-3) == pytest.approx({"mass": 0.004, "drive_speed": 1e-5, "mu_s": 0.02})
