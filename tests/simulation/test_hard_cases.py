"""The table of hard cases and random scenes, each against a truth from outside or refused by name."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.energy import balance
from experiments.hard_cases import CASES
from experiments.hard_scenes import HardCase, Scene
from identify.base.errors import SceneError, SimulationError
from tests.support import oracle

GREEN = [case for case in CASES if case.truth is not None]
REFUSED = [case for case in CASES if case.truth is None]


@pytest.mark.parametrize(
    "case",
    [pytest.param(c, marks=[pytest.mark.slow] * (c.name == "a v = 1e-06")) for c in GREEN],  # 5 s of its own
    ids=lambda case: case.name,
)
def test_the_case_is_green_and_a_spring_slightly_too_stiff_is_not(case: HardCase) -> None:
    error, spoilt = case.errors(0.0, 1e-3)
    assert error <= case.tolerance
    assert spoilt > 10.0 * case.tolerance or case.scene.drive == 0.0


@pytest.mark.parametrize("case", REFUSED, ids=lambda case: case.name)
def test_the_case_is_refused_with_its_sentence(case: HardCase) -> None:
    with pytest.raises((SimulationError, SceneError), match=case.refusal):
        case.scene.run()


def _random_scene(seed: int) -> tuple[Scene, tuple[tuple[float, float], ...]]:
    """Pair, rig, drive and load of wide ranges, some cycles long, the drive reversed or changed in some."""
    random = np.random.default_rng([2026, seed])
    wide = {"mass": (1e-2, 2.0), "stiffness": (1e2, 1e5), "D": (1e-6, 1e-3), "t_cr": (1e-2, 1e2), "a": (1.0, 1e4)}
    v = {name: float(np.exp(random.uniform(*np.log(ends)))) for name, ends in wide.items()}
    v["mu_s"] = float(random.uniform(0.1, 3.0))
    v["mu_k0"] = v["mu_s"] * float(random.uniform(0.1, 0.95))
    v["delta_mu_k"] = v["mu_k0"] * float(random.uniform(-0.9, 0.3))
    v["damping"] = 2.0 * v["stiffness"] * float(np.exp(random.uniform(*np.log((1e-4, 1.0)))))
    speed, load = (float(np.exp(random.uniform(*np.log(ends)))) for ends in ((1e-5, 1e-1), (0.1, 100.0)))
    loading, natural = v["mu_s"] * load / (v["stiffness"] * speed), (v["mass"] / v["stiffness"]) ** 0.5
    duration = loading + min(3.0 * loading, 300.0 * natural)
    drive: tuple[tuple[float, float], ...] = ((0.0, speed),)
    if random.random() < 0.3:
        drive += ((duration * float(random.uniform(0.3, 0.9)), speed * float(random.choice([-1.0, 0.3, 5.0]))),)
    return Scene(v, drive, duration, ((0.0, load), (duration, load * float(random.uniform(0.5, 1.5))))), drive


@pytest.mark.parametrize("seed", range(15))
def test_a_random_scene_keeps_its_energy_and_switches_as_an_independent_integrator_does(seed: int) -> None:
    scene, drive = _random_scene(seed)
    ours, truth = scene.run(), oracle.simulate(scene.values, drive, scene.force, scene.duration, rtol=1e-11)
    assert balance(ours, scene.values).error < 1e-5
    # Where a slip turns round without a rest before it, the integrator counts an onset; ours does not.
    for found, known in ((ours.onsets, np.setdiff1d(truth.onsets, truth.arrests)), (ours.arrests, truth.arrests)):
        until = 0.999 * scene.duration
        np.testing.assert_allclose(found[found < until], known[known < until], rtol=0.0, atol=1e-6 * scene.duration)
