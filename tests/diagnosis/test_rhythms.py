"""Rhythms found in stick phases, and what a fit makes of them, against the numbers the logs were simulated with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.study_problem import RIG
from identify.base.result import Status
from identify.diagnosis.fitted import fit_model
from identify.effects import MAIN
from identify.logs.vibration import rhythms
from identify.scene import Scene
from tests.support.two_logs import drawn, prepared

VIBRATION = {"excitation_amplitude": 3e-6, "excitation_frequency": 31.0, "excitation_phase": 0.4}
LOGS = ((1e-4, 20.0, 500.0), (1e-3, 3.0, 1000.0))


def _scene(effects, **more):
    logs = [{"path": f"{i}.csv", "drive_speed": speed} for i, (speed, *_) in enumerate(LOGS)]
    return Scene.from_document({"effects": list(effects), "rig": RIG, "logs": logs} | more, Path())


@pytest.fixture(scope="module")
def vibrating():
    return drawn(LOGS, VIBRATION, (*MAIN, "excitation"), seed=3)


def test_a_vibration_of_the_drive_is_found_in_the_sticks(vibrating):
    (line,), left = rhythms(prepared(_scene(MAIN), vibrating)[0])
    assert line.frequency == pytest.approx(31.0, abs=0.05)
    # spring and damper carry the motion: |k + i omega c|
    omega, c = 2 * np.pi * 31.0, 147.0 * np.sqrt(0.2 / 1470.0)
    assert line.amplitude == pytest.approx(3e-6 * abs(1470.0 + 1j * omega * c) * np.ones(2), rel=0.1)
    assert np.all(left < 1.1)


def test_what_follows_the_last_slip_is_no_stick(vibrating):
    """A record whose stick-slip ends slides on, and its level may wander."""
    stated, (record,) = _scene(MAIN, logs=[{"path": "1.csv", "drive_speed": 1e-3}]), drawn(LOGS[1:], seed=3)
    last = prepared(stated, [record])[0][0].segmentation.cycles.arrest[-3]
    force = np.where(record.time > last, 0.5 + 0.02 * np.sin(12.0 * record.time), record.friction_force)
    assert rhythms(prepared(stated, [replace(record, friction_force=force)])[0])[0] == ()


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
    [
        pytest.param("skin_compliance", "skin_stiffness", 4400.0, marks=pytest.mark.slow),
        ("sensor_lag", "lag_time", 3e-3),
    ],
)
def test_what_bends_the_sticks_is_fitted(effect, name, value):
    values = _values(fit_model(_scene((*MAIN, effect)), drawn(LOGS, {name: value}, (*MAIN, effect), seed=3)))
    assert values[name] == pytest.approx(value, rel=0.05)
    assert values["mu_s"] == pytest.approx(0.62, abs=3e-3)
