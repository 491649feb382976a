"""Logs whose sticks differ in strength agree also where single logs hardly tell how the contact ages."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from data_io import Record
from experiments.brute_force import Pair
from experiments.scattered_records import forces
from identify import Scene, fit
from identify.estimation import agreement

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_further_logs")]

RIG = {"mass": 0.12, "stiffness": 1500.0, "damping": 90.0}
TRUTH = {"mu_s": 0.62, "mu_k0": 0.38, "delta_mu_k": -0.08, "a": 200.0, "D": 30e-6, "t_cr": 0.4}
LOGS = ((2e-4, 60.0, 250.0), (1e-3, 30.0, 500.0), (5e-3, 10.0, 1000.0))  # drive speed [m/s], duration [s], rate [Hz]
LOAD, NOISE, SCATTER = 2.0, 4e-3, 0.013


@pytest.fixture(scope="module")
def fitted():
    """The result of a fit of a pair whose sticks differ by 1.3 %, and the pulls of its logs."""
    random, records = np.random.default_rng(1), []
    for speed, duration, rate in LOGS:
        times = np.arange(round(duration * rate) + 1) / rate
        force = forces(Pair.of(TRUTH | RIG, LOAD), speed, times, SCATTER, random)
        noisy = force + NOISE * random.standard_normal(times.size)
        records.append(Record(times, np.full(times.size, LOAD), noisy))
    effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
    logs = [{"path": f"{i}.csv", "drive_speed": speed} for i, (speed, _, _) in enumerate(LOGS, 1)]
    seen = []
    with pytest.MonkeyPatch.context() as patch:
        plain = agreement.log_scores

        def noted(*asked):
            seen[:] = plain(*asked)
            return seen

        patch.setattr(agreement, "log_scores", noted)
        scene = Scene.from_document({"effects": effects, "rig": RIG, "logs": logs}, Path())
        return fit(scene, records).result, list(seen)


def test_a_log_is_not_blamed_for_strengths_that_differ(fitted):
    result, _ = fitted
    assert result["status"] == "converged", result["message"]
    for name, true in TRUTH.items():
        told = result["parameters"][name]
        assert abs(told["value"] - true) < 3.0 * told["standard_error"], name


def test_pulls_are_those_of_noise_once_the_strengths_are_integrated_out(fitted):
    _, found = fitted
    assert all(pull.squared < 20.0 for pull in found)  # 60 to 80 where each strength is taken at its likeliest
