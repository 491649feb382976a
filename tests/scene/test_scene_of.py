"""What a caller of the package may give for a scene, and friction that does not age."""

import json

import pytest

from identify import Scene, simulate
from identify.base.errors import FitError
from identify.report.stored_result import read_document
from tests.scene.test_scene import GOOD


def test_a_scene_is_taken_as_it_is_by_its_path_and_from_its_tables(tmp_path):
    (tmp_path / "good.toml").write_text(GOOD)
    scene = Scene.from_toml(tmp_path / "good.toml")
    assert Scene.of(scene) is scene
    assert Scene.of(str(tmp_path / "good.toml")) == scene == Scene.of(tmp_path / "good.toml")
    assert Scene.of(scene.as_document()).rig == scene.rig


def test_static_friction_may_be_no_higher_than_kinetic_and_then_nothing_slips():
    start = {"mu_s": 0.4, "mu_k0": 0.4, "delta_mu_k": 0.0, "a": 250.0, "D": 6e-5, "t_cr": 0.4}
    document = {
        "effects": ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"],
        "rig": {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "drive_speed": 5e-4, "normal_force": 2.0},
        "parameters": {name: {"start": value} for name, value in start.items()},
    }
    motion = simulate(Scene.from_document(document), 3.0)
    assert motion.sample([2.0, 2.9])["force"] == pytest.approx([0.8, 0.8], rel=1e-3)


def test_a_result_of_another_schema_is_refused(tmp_path):
    (tmp_path / "result.json").write_text(json.dumps({"schema": 99, "status": "converged"}))
    with pytest.raises(FitError, match="its schema is 99; expected 1"):
        read_document(tmp_path / "result.json")
