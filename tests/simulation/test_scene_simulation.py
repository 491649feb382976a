"""Simulations of scenes: every effect runs, starts settled, follows the load or its mean, keeps to measured ranges."""

import numpy as np
import pytest

from identify import simulate
from identify.effects import ALL, MAIN, NAMES
from identify.scene import Scene
from identify.simulation.drive import NormalForce

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "drive_speed": 0.002, "normal_force": 1.0}


def scene_of(effects, **tables):
    rig = RIG | tables.pop("rig", {})
    return Scene.from_document({"effects": list(effects), "rig": rig, **tables})


def beside_the_others(name):
    """The paper's effects with this one, in place of its rivals."""
    effect = next(e for e in ALL if e.name == name)
    rivals = [e.name for e in ALL if e.role and e.role == effect.role]
    return tuple(n for n in NAMES if n == name or (n in (*MAIN, *effect.needs) and n not in rivals))


@pytest.mark.parametrize("name", ["skin_compliance", "sensor_lag", "force_sensor", "excitation"])
@pytest.mark.parametrize("elongation", [0.0, 1e-4])
def test_a_simulation_starts_settled(name, elongation):
    """With the drive at rest nothing moves of itself, and the load cell shows what the elongation means."""
    scene = scene_of(
        beside_the_others(name),
        rig={"drive_speed": 0.0},
        initial={"elongation": elongation},
        parameters={"excitation_amplitude": {"fixed": 0.0}} if name == "excitation" else {},
    )
    values = scene.values()
    stiffness = values["stiffness"]
    if name == "skin_compliance":  # two springs in series
        stiffness = 1.0 / (1.0 / values["stiffness"] + 1.0 / values["skin_stiffness"])
    samples = simulate(scene, 0.5).sample(np.linspace(0.0, 0.5, 51))
    assert samples["force"] == pytest.approx(stiffness * elongation, rel=1e-9, abs=1e-12)
    assert samples["elongation"] == pytest.approx(elongation, rel=1e-12)
    if name == "skin_compliance":
        expected = stiffness * elongation / values["skin_stiffness"]
        assert samples["skin_deformation"] == pytest.approx(expected, rel=1e-9, abs=1e-15)
    if name == "sensor_lag":
        assert samples["lagged_force"] == pytest.approx(stiffness * elongation, rel=1e-9, abs=1e-12)


def test_the_course_of_the_load_or_its_mean():
    course = ([0.0, 1.0, 3.0], [1.0, 0.8, 1.2])
    mean = (0.9 * 1.0 + 0.9 * 1.0) / 2.0  # trapezoids over the first two seconds: 0.9 then (0.8 + 1.0)/2
    off = simulate(scene_of(MAIN), 2.0, normal_force=course)
    level = simulate(scene_of(MAIN), 2.0, normal_force=mean)
    on = simulate(scene_of((*MAIN, "varying_normal_force")), 2.0, normal_force=course)
    times = np.linspace(0.0, 2.0, 101)
    assert off.onsets == pytest.approx(level.onsets, rel=1e-12)
    assert off.sample(times)["normal_force"] == pytest.approx(mean)
    assert on.sample(times)["normal_force"] == pytest.approx(np.interp(times, *course))
    assert np.max(np.abs(on.onsets[:5] - level.onsets[:5])) > 1e-3


def test_the_mean_of_a_course_is_exact():
    force = NormalForce.of((np.array([0.0, 1.0, 4.0]), np.array([1.0, 3.0, 2.0])))
    fine = np.linspace(0.5, 3.7, 200_001)
    assert force.mean(0.5, 3.7) == pytest.approx(np.trapezoid(force.at(fine), fine) / 3.2, rel=1e-9)
    assert force.mean(-1.0, 0.0) == 1.0 and NormalForce.of(0.7).mean(0.0, 3.0) == 0.7
