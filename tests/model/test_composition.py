"""The estimator takes whatever model the effects compose: fewer effects, or one more, without an edit anywhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, RIG
from identify.base.outcome import Status
from identify.identification import find
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run

SPEEDS = ((1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0))
NOISE = 5e-3


def _fitted(names: tuple[str, ...], truth: dict[str, float], seed: int):
    model, random = assemble(names), np.random.default_rng(seed)
    records = []
    for speed, duration, rate in SPEEDS:
        motion = run(model, {n: (truth | RIG)[n] for n in model.parameter_names}, speed, 1.0, duration)
        times = np.arange(round(duration * rate)) / rate
        force = motion.sample(times)["force"] + NOISE * random.standard_normal(times.size)
        records.append(Record(times, np.ones(times.size), force))
    document = {
        "effects": list(names),
        "rig": dict(RIG),
        "logs": [{"path": f"{speed}.csv", "drive_speed": speed} for speed, _, _ in SPEEDS],
    }
    return find(Scene.from_document(document, Path()), records, progress=lambda _stage, _share: None)[1]


def _assert_found(found, truth: dict[str, float], names: tuple[str, ...]) -> None:
    assert found.status is Status.CONVERGED, found.message
    estimates = {e.name: e for e in found.estimates}
    for name in names:
        estimate = estimates[name]
        assert estimate.verdict == "identified", estimate
        assert estimate.value == pytest.approx(truth[name], abs=4 * estimate.standard_error)


def test_a_model_without_ageing_is_fitted_with_its_own_parameters_only():
    found = _fitted(("inertia", "hysteresis_damping", "velocity_weakening"), DEMO, 1)
    assert {"D", "t_cr"}.isdisjoint(e.name for e in found.estimates)
    _assert_found(found, DEMO, ("mu_s", "mu_k0", "delta_mu_k", "a"))
