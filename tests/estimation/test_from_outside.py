"""A friction law, a parameter searched by its logarithm, a model of noise and an estimator, all defined outside the
package."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from identify import Scene, fit
from identify.base.result import Status
from identify.estimation.covariance import Estimate
from identify.estimation.estimator import Estimated, EstimationTask
from identify.examples import FOLDER
from identify.report import write_report

ROOT = Path(__file__).resolve().parents[2]

FILM = """
import numpy as np
import identify.effects
from identify.effects.quantities import Effect, Importance, Parameter, Terms

class ViscousFilm(Effect):
    name = "viscous_film"
    says = "a fluid film adds friction in proportion to sliding speed"
    source = "Newton's law of viscosity"
    parameters = (Parameter("film_slope", "s/m", 1e-3, 1e3, 0.5, "b", "friction of the film per sliding speed"),)
    null = {"film_slope": 0.0}

    def terms(self, s):
        return Terms(excess=s.p.film_slope * s.v)

    def importance(self, p, normal_force, drive_speed):
        return Importance("b v", p["film_slope"] * drive_speed, "the film adds to the coefficient")

identify.effects.register(ViscousFilm())
from data_io import Record
from identify import Scene, fit, simulate

pair = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "a": 300.0, "D": 37.4e-6, "t_cr": 0.5, "film_slope": 0.5}
rig = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "drive_speed": 1e-3, "normal_force": 1.0, "noise": 2e-3}
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening", "viscous_film"]
parameters = {name: {"fixed": value} for name, value in pair.items()}
document = {"effects": effects, "rig": rig, "parameters": parameters}
time = np.arange(0.0, 2.0, 1e-3)
force = simulate(Scene.from_document(document), 2.0).sample(time)["force"]
record = Record(time, np.ones(time.size), force + 2e-3 * np.random.default_rng(1).standard_normal(time.size))
document["parameters"] |= {"film_slope": {"start": 1.0}, "mu_k0": {"start": 0.4}}
document["logs"] = [{"path": "none.csv"}]
found = fit(Scene.from_document(document), [record]).result
film = found["parameters"]["film_slope"]
print(found["status"], film["value"], *film["interval"], film["verdict"])

class Late(ViscousFilm):
    name = "late"

try:
    identify.effects.register(Late())
except identify.IdentifyError as error:
    print(error)
"""


def _run(script: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "STICKSLIP_COMPILE": "0"}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_law_with_a_logarithmic_parameter_is_fitted_and_one_that_comes_after_models_is_refused() -> None:
    fitted, late = _run(FILM).splitlines()
    assert "comes too late" in late
    status, value, low, high, verdict = fitted.split()
    assert status == "converged" and verdict in ("identified", "weak")
    assert float(low) < 0.5 < float(high) and abs(float(value) / 0.5 - 1.0) < 0.2


AVERAGED = """
import numpy as np
from identify.estimation import residual_autocorrelation as noise

def moving_average(residual):
    # white noise and a share of the sample before: one number, by the correlation of neighbours
    r = np.nanmean(residual[1:] * residual[:-1]) / np.nanmean(residual**2)
    if not 0.05 < r < 0.5:
        return noise.WHITE
    share = (1.0 - np.sqrt(1.0 - 4.0 * r**2)) / (2.0 * r)
    return noise.ArModel(-((-share) ** np.arange(1, 25)), 1.0 / (1.0 + share**2), estimated=1)

from data_io import Record
from dataclasses import replace
from tests.support.two_logs import drawn, scene, searched

random, logs = np.random.default_rng(3), []
for record in drawn(((1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0)), noise=0.0):
    new = 2e-2 * random.standard_normal(record.time.size + 1)
    logs.append(Record(record.time, record.normal_force, record.friction_force + new[1:] + 0.8 * new[:-1]))
attempt, _ = searched(scene(), logs)
before = attempt.noise
noise.register(moving_average)
for models in (before, replace(attempt).noise, [noise.noise_model(random.standard_normal(5000))]):
    print(max(m.estimated or 0 for m in models), *(m.inflation for m in models))
"""


def test_a_model_of_noise_is_taken_where_it_pays() -> None:
    """Of e + 0.8 e' the sum over all lags of the correlation is 1.8^2 / 1.64."""
    before, after, white = (list(map(float, line.split())) for line in _run(AVERAGED).splitlines())
    assert before[0] == 0.0 and after[0] == 1.0, "one number describes it as well as several"
    assert after[1:] == pytest.approx([1.8**2 / 1.64] * 2, rel=0.05)
    assert white == [0.0, 1.0]


class OnsetLevels:
    """Least squares on the classical features: the static coefficient is the mean of force over load at onset."""

    name = "onset_levels"

    def estimate(self, task: EstimationTask) -> Estimated:
        peaks = [
            log.segmentation.cycles.onset_force / log.data.mean_normal_force
            for log in task.logs
            if log.left_out is None
        ]
        levels = np.concatenate(peaks)
        if levels.size < 2:
            return Estimated(Status.NO_CYCLES, "no slips were seen; record slower", [])
        mean, error = float(np.mean(levels)), float(np.std(levels, ddof=1) / np.sqrt(levels.size))
        told = Estimate("mu_s", "", mean, error, mean - 2 * error, mean + 2 * error, "identified", "mean onset")
        curves = [np.full(log.record.time.size, mean * log.data.mean_normal_force) for log in task.logs]
        return Estimated(Status.CONVERGED, "the mean of all onsets", [told], ["mu_s"], np.array([[error**2]]), curves)


def test_an_estimator_of_ones_own_gives_a_result_and_a_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("identify.report.figures.pictures", lambda _: ())
    scene = Scene.from_toml(FOLDER / "pair.toml")
    found = fit(scene, estimator=OnsetLevels())
    assert found.result["estimator"] == "onset_levels" and found.result["status"] == "converged"
    told = found.result["parameters"]["mu_s"]
    # The truth of the example logs is mu_s 0.62, which onsets of unsaturated contacts stay below.
    assert 0.5 < told["interval"][0] < told["value"] < told["interval"][1] < 0.63
    assert found.result["correlation"]["standard_errors"] == [told["standard_error"]]
    drawn = found.logs[0]
    assert np.nanmedian(drawn.fitted_force / np.mean(drawn.normal_force)) == pytest.approx(told["value"], rel=1e-3)
    write_report(found, tmp_path)
    assert "onset_levels" in (tmp_path / "result.json").read_text(encoding="utf-8")


def test_an_estimator_that_finds_nothing_says_so() -> None:
    scene = Scene.from_toml(FOLDER / "pair.toml", ["effects=['inertia','hysteresis_damping']"])
    flat, random = np.arange(0.0, 2.0, 1e-3), np.random.default_rng(0)
    records = [Record(flat, np.ones(flat.size), 0.4 + 1e-3 * random.standard_normal(flat.size)) for _ in scene.logs]
    found = fit(scene, records, estimator=OnsetLevels())
    assert found.status is Status.NO_CYCLES and found.result["parameters"] != {}
