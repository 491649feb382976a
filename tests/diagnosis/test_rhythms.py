"""Rhythms found in stick phases, and what a fit makes of them, against the numbers the logs were simulated with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from identify.base.outcome import Status
from identify.diagnosis.fitted import fit_model
from identify.effects import MAIN
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.logs.vibration import rhythms
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run

PAIR = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "a": 300.0, "D": 37.4e-6, "t_cr": 0.5}
RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
VIBRATION = {"excitation_amplitude": 3e-6, "excitation_frequency": 31.0, "excitation_phase": 0.4}
LOGS = ((1e-4, 20.0, 500.0), (1e-3, 3.0, 1000.0))


def _logs(effects, more=None, noise=5e-3):
    model, random = assemble(effects), np.random.default_rng(3)
    values = {q.name: (PAIR | RIG | (more or {})).get(q.name, q.default) for q in model.parameters}
    records = []
    for speed, duration, rate in LOGS:
        times = np.arange(round(duration * rate)) / rate
        force = run(model, values, speed, 1.0, duration).sample(times)["force"]
        records.append(Record(times, np.ones(times.size), force + noise * random.standard_normal(times.size)))
    return records


def _scene(effects, **more):
    logs = [{"path": f"{i}.csv", "drive_speed": speed} for i, (speed, *_) in enumerate(LOGS)]
    return Scene.from_document({"effects": list(effects), "rig": RIG, "logs": logs} | more, Path())


def _prepared(records):
    scene = _scene(MAIN)
    unknowns = from_scene(scene)
    return [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]


@pytest.fixture(scope="module")
def vibrating():
    return _logs((*MAIN, "excitation"), VIBRATION)


def test_a_vibration_of_the_drive_is_found_in_the_sticks(vibrating):
    (line,), left = rhythms(_prepared(vibrating))
    assert line.frequency == pytest.approx(31.0, abs=0.05)
    # spring and damper carry the motion: |k + i omega c|
    omega, c = 2 * np.pi * 31.0, 147.0 * np.sqrt(0.2 / 1470.0)
    assert line.amplitude == pytest.approx(3e-6 * abs(1470.0 + 1j * omega * c) * np.ones(2), rel=0.1)
    assert np.all(left < 1.1)


def _values(fitted):
    attempt = fitted.attempt
    assert attempt is not None and attempt.gate.status is Status.CONVERGED, attempt
    values = fitted.unknowns.values(attempt.solved.theta, attempt.fitted_logs[0].data.base)
    return dict(zip(fitted.unknowns.names, values.tolist(), strict=True))


def test_a_fit_finds_the_vibration_under_which_the_mass_sticks_and_slips(vibrating):
    fast = [{"path": "1.csv", "drive_speed": LOGS[1][0]}]
    values = _values(fit_model(_scene((*MAIN, "excitation"), logs=fast), vibrating[1:]))
    assert values["excitation_amplitude"] == pytest.approx(3e-6, rel=0.05)
    assert values["excitation_frequency"] == pytest.approx(31.0, abs=0.02)
    plain = fit_model(_scene(MAIN, logs=fast), vibrating[1:])  # without the effect the data object
    assert plain.attempt is None or plain.attempt.gate.status is not Status.CONVERGED


@pytest.mark.parametrize(
    ("effect", "name", "value"),
    [("skin_compliance", "skin_stiffness", 4400.0), ("sensor_lag", "lag_time", 3e-3)],
)
def test_what_bends_the_sticks_is_fitted(effect, name, value):
    values = _values(fit_model(_scene((*MAIN, effect)), _logs((*MAIN, effect), {name: value})))
    assert values[name] == pytest.approx(value, rel=0.05)
    assert values["mu_s"] == pytest.approx(0.62, abs=3e-3)
