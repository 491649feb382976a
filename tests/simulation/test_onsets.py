"""Onsets under a vibrating drive, and what is refused before them."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.hard_scenes import PAIR
from identify.base.errors import SimulationError
from identify.model.model import assemble
from identify.simulation.plan import swing
from identify.simulation.simulate import run


@pytest.mark.parametrize("names", [("excitation",), ("excitation", "finger_motion", "skin_compliance", "sensor_lag")])
def test_the_bound_of_the_breakaway_margin_is_one(names: tuple[str, ...]) -> None:
    """The margin from the functions of the model, against the bound by which the end of a rest is found."""
    model = assemble(("inertia", "hysteresis_damping", "contact_ageing", *names))
    values = {"excitation_amplitude": 3e-5, "excitation_frequency": 12.0, "tremor_amplitude": -2e-5}
    p = np.array([values.get(q.name, q.default) for q in model.parameters])
    x = np.array([1e-4 if s.name == "elongation" else 0.0 for s in model.states])
    t = np.random.default_rng(3).uniform(0.0, 3.0, 400)
    u = np.stack([0.0 * t + 2e-4, 0.0 * t + 1.0, 0.0 * t + 1.0, 0.7 + t])
    rested = model.rest(x, p, u, t[None, :])
    grip = np.array(model.grip(rested, p, u)).ravel()
    margin = grip - np.abs(np.array(model.driving_force(rested, p, u)).ravel())
    calm, force = grip - np.abs(np.array(model.calm_force(x, p, u, t[None, :])).ravel()), swing(model, p)[1]
    assert np.all(calm - force <= margin)
    assert np.any(calm - 0.5 * force > margin)  # half of it would be none


def test_a_vibration_without_a_phase_is_refused_and_one_that_does_not_move_is_not() -> None:
    model = assemble(("inertia", "excitation"))
    values = {n: PAIR.get(n, model.parameter(n).default) for n in model.parameter_names}
    values |= {"excitation_amplitude": 1e-6, "excitation_frequency": 1e3}
    with pytest.raises(SimulationError, match="no digits are left of the phase"):
        run(model, values, 0.0, 1.0, 1e9)
    assert run(model, values, 0.0, 1.0, 1e7).onsets.size == 0
    assert run(model, values | {"excitation_amplitude": 0.0}, 0.0, 1.0, 1e9).onsets.size == 0
