"""Energy: the work of the drive is stored, or lost in the dampers and in the contact."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.energy import balance
from experiments.hard_scenes import PAIR
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

SKIN = {"skin_stiffness": 4400.0, "skin_retardation": 2e-3}
SHAKEN = {"excitation_amplitude": 2e-6, "excitation_frequency": 40.0, "excitation_phase": 0.3}
STROKES = ((0.0, 1e-3), (0.9, -2e-3), (2.0, 1e-3))
SAGGING = ((0.0, 1.0, 3.0), (1.0, 0.7, 1.2))


def _run(effects: tuple[str, ...], drive: object = 1e-3, load: object = 1.0, **more: object) -> Trajectory:
    model, values = assemble(effects), PAIR | SKIN | SHAKEN
    return run(model, {n: values[n] for n in model.parameter_names}, drive, load, 3.0, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("accuracy", [1e-6, 1e-10])
@pytest.mark.parametrize(
    ("more", "drive", "load"),
    [((), 1e-3, 1.0), ((), STROKES, 1.0), ((), 1e-3, SAGGING), (("skin_compliance", "excitation"), 1e-3, 1.0)],
    ids=["steady", "strokes", "sagging load", "skin and vibration"],
)
def test_energy_balances_to_the_accuracy(more: tuple[str, ...], drive: object, load: object, accuracy: float) -> None:
    found = balance(_run((*MAIN, *more), drive, load, accuracy=accuracy), PAIR | SKIN | SHAKEN if more else PAIR)
    assert found.contact > 0.1 * found.turnover
    assert found.error < accuracy


def test_a_damper_that_is_slightly_off_does_not_balance() -> None:
    motion = _run(MAIN)
    wrong = balance(motion, PAIR | {"damping": PAIR["damping"] * 1.001})
    assert wrong.error > 1e-6


def test_the_contact_takes_what_the_law_of_friction_says() -> None:
    """The friction power, from the law written here: F_n [mu_k(v) + (mu_s - mu_k(v)) gamma] v (eqs. 5, 6)."""
    motion = _run(MAIN, accuracy=1e-10)
    lost = 0.0
    points, weights = np.polynomial.legendre.leggauss(8)
    for phase in motion.phases:
        if phase.mode == "stick":
            continue
        half = 0.5 * np.diff(phase.t)[:, None]
        times = phase.start + (phase.t[:-1, None] + half * (1.0 + points)).ravel()
        s = motion.sample(times)
        kinetic = PAIR["mu_k0"] - PAIR["delta_mu_k"] * np.expm1(-PAIR["a"] * s["sliding_speed"])
        power = (kinetic + (PAIR["mu_s"] - kinetic) * s["gamma"]) * s["sliding_speed"]
        lost += float(power @ (half * weights).ravel())
    found = balance(motion, PAIR)
    assert found.contact == pytest.approx(lost, rel=1e-9)
