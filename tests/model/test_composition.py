"""The estimator takes whatever model the effects compose: fewer effects, or one more, without an edit anywhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import identify.effects
import identify.model.model
import identify.scene.parameters
import identify.scene.parts
import identify.scene.scene
from data_io import Record
from experiments.study_problem import DEMO, RIG
from identify.base.outcome import Status
from identify.effects import MAIN
from identify.effects.quantities import Effect, Parameter, Situation, Terms
from identify.identification import find
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run

SPEEDS = ((1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0))
NOISE = 5e-3


class ViscousContact(Effect):
    """A fluid film: friction that rises in proportion to the sliding speed."""

    name = "viscous_contact"
    source = "test"
    parameters = (Parameter("viscosity", "s/m", -100.0, 100.0, 0.0, "b", "slope of friction", "linear", 3.0),)
    null = {"viscosity": 0.0}

    def terms(self, s: Situation) -> Terms:
        return Terms(kinetic=s.p.viscosity * s.v)


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


def test_one_more_effect_reaches_simulation_and_fit_by_being_listed(monkeypatch):
    effects = (*identify.effects.ALL, ViscousContact())
    names = (*MAIN, ViscousContact.name)
    tables = (identify.scene.scene, identify.scene.parameters, identify.scene.parts)
    for module in (identify.effects, identify.model.model, *tables):
        monkeypatch.setattr(module, "ALL", effects, raising=False)
        monkeypatch.setattr(module, "NAMES", tuple(e.name for e in effects), raising=False)
    truth = DEMO | {"viscosity": 3.0}
    model = assemble(names)
    plain = assemble(MAIN)
    with_it, without = (
        run(m, {n: (truth | RIG)[n] for n in m.parameter_names}, 1e-3, 1.0, 1.0).onsets for m in (model, plain)
    )
    assert abs(with_it[-1] - without[with_it.size - 1]) > 1e-3
    found = _fitted(names, truth, 2)
    _assert_found(found, truth, ("mu_s", "mu_k0", "D", "t_cr"))
    viscosity = next(e for e in found.estimates if e.name == "viscosity")
    assert viscosity.value == pytest.approx(3.0, abs=4 * (viscosity.standard_error or 0.5))
