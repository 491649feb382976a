"""Scenes: what a TOML file or a caller says arrives in SI; damping, bare numbers, overrides."""

import json
import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from identify import Scene, examples, simulate
from identify.base.errors import FitError
from identify.report.stored_result import read_document
from identify.scene import LogEntry

GOOD = """
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
[rig]
mass = { value = "200 g", tolerance = "2 %" }
stiffness = "1.47 N/mm"
damping = "147 N/m"
drive_speed = "0.1 mm/min"
[parameters]
mu_s = { start = 0.6 }
D = { start = "40 um", prior = { mean = "40 um", sd = "25 %" } }
a = { start = "0.5 s/mm", lower = 40, upper = "2000 s/m" }
t_cr = { fixed = "500 ms" }
[[logs]]
path = "slow.csv"
labels = { material = "UHMWPE", volunteer = 7 }
window = ["5 s", "1 min"]
exclude = [[10, 11], ["20 s", "21 s"]]
tare = "3 mN"
[[logs]]
path = "sub/fast.csv"
drive_speed = [[0, "1 mm/s"], ["30 s", 0]]
stiffness = "3 N/mm"
normal_force = "100 g"
step = 2
flip_sign = true
"""


@pytest.fixture
def scene_file(tmp_path):
    def write(text, old="", new=""):
        assert not old or old in text
        path = tmp_path / "pair.toml"
        path.write_text(text.replace(old, new) if old else text, encoding="utf-8")
        return path

    return write


def test_a_scene_is_printed_on_a_screen():
    scene = Scene.from_document(
        {
            "name": "pair",
            "effects": ["inertia", "hysteresis_damping"],
            "rig": {"mass": "0.2 kg", "stiffness": "1470 N/m", "zeta": 0.05, "drive_speed": "1 mm/s"},
            "parameters": {"mu_s": {"fixed": 0.6}},
        }
    )
    text = repr(scene)
    assert "rig: mass 0.2\xa0kg, stiffness 1470\xa0N/m, damping 147\xa0N/m" in text and "mu_s fixed" in text
    assert text.startswith("Scene pair: inertia, hysteresis_damping\n") and len(text.splitlines()) < 10
    many = replace(scene, name="<b>", logs=tuple(LogEntry(Path(f"<i>{k}.csv"), drive_speed=1e-3) for k in range(200)))
    assert len(repr(many).splitlines()) < 20 and "and 188 more logs" in repr(many)
    assert "&lt;b&gt;" in many._repr_html_() and not re.search("<[bi]>", many._repr_html_())


def test_quantities_arrive_in_si(scene_file):
    scene = Scene.from_toml(scene_file(GOOD))
    rig = scene.rig
    assert (rig.mass, rig.stiffness, rig.damping) == pytest.approx((0.2, 1470.0, 147.0), rel=1e-15)
    assert rig.drive_speed == pytest.approx(1e-4 / 60, rel=1e-15)
    assert rig.tolerances == {"mass": 0.02}
    assert rig.zeta == pytest.approx(0.05) and rig.half_period == pytest.approx(math.pi * math.sqrt(0.2 / 1470))
    assert scene.parameters["D"].prior_sd == pytest.approx(10e-6)
    assert (scene.parameters["a"].start, scene.parameters["a"].lower) == pytest.approx((500.0, 40.0))
    slow, fast = scene.logs
    assert slow.path.parent == fast.path.parent.parent and slow.path.is_absolute(), "beside the scene file"
    assert slow.window == (5.0, 60.0) and slow.exclude == ((10.0, 11.0), (20.0, 21.0)) and slow.tare == 3e-3
    assert slow.labels == {"material": "UHMWPE", "volunteer": "7"}
    assert fast.drive_speed == ((0.0, 1e-3), (30.0, 0.0)) and fast.step == 2 and fast.flip_sign is True
    assert fast.normal_force == pytest.approx(0.0980665 * 10, rel=1e-12), "g means gram-force where a force is expected"


def test_values_are_fixed_else_start_else_default(scene_file):
    scene = Scene.from_toml(scene_file(GOOD))
    values = scene.values()
    assert values["t_cr"] == 0.5 and values["mu_s"] == 0.6 and values["D"] == pytest.approx(40e-6)
    assert values["mu_k0"] == scene.model.parameter("mu_k0").default
    assert set(values) == set(scene.model.parameter_names)
    assert scene.values(scene.logs[1])["stiffness"] == 3000.0
    assert scene.rig_for(scene.logs[1]).mass == scene.rig.mass


def test_effects_that_are_off_stand_at_their_null(scene_file):
    text = GOOD.replace(', "velocity_weakening"', "").replace("a = {", "# a = {")
    scene = Scene.from_toml(scene_file(text))
    assert "delta_mu_k" not in scene.parameters
    assert scene.friction.delta_mu_k == 0.0 and scene.friction.mu_s == 0.6


@pytest.mark.parametrize(
    ("said", "zeta"),
    [
        ('damping = "147 N/m"', 0.05),
        ("zeta = 0.05", 0.05),
        ("loss_factor = 0.1", 0.05),
        # textbook: logarithmic decrement = 2 pi zeta / sqrt(1 - zeta^2)
        (f"log_decrement = {2 * math.pi * 0.05 / math.sqrt(1 - 0.05**2)!r}", 0.05),
    ],
)
def test_damping_in_any_of_its_forms(scene_file, said, zeta):
    scene = Scene.from_toml(scene_file(GOOD, 'damping = "147 N/m"', said))
    assert scene.rig.zeta == pytest.approx(zeta, rel=1e-14)
    fast = scene.rig_for(scene.logs[1])
    expected = 147.0 / 6000.0 if said.startswith("damping") else zeta  # a ratio follows the log's own stiffness
    assert fast.zeta == pytest.approx(expected, rel=1e-14)


def test_document_rebuilds_the_scene(scene_file):
    scene = Scene.from_toml(scene_file(GOOD))
    document = json.loads(json.dumps(scene.as_document(), allow_nan=False))
    assert Scene.from_document(document) == scene
    assert Scene.from_document(document, "/elsewhere").logs == scene.logs, "log paths in a document are absolute"
    schema = Draft202012Validator(Scene.json_schema())
    for valid in (document, tomllib.loads(GOOD), {**document, "effects": "auto", "rig": "rig.toml"}):
        assert not list(schema.iter_errors(valid))
    for wrong in ({"effect": []}, {"rig": {"mas": 1}}, {"logs": [{"path": 1}]}, {"effects": ["inertie"]}):
        assert not schema.is_valid(document | wrong)
    document["rig"]["mass"]["value"] = 0.3
    assert Scene.from_document(document) != scene


def test_overrides(scene_file):
    path = scene_file(GOOD)
    scene = Scene.from_toml(path, ['rig.mass="0.3 kg"', "logs.2.step=3", "parameters.mu_s.start=0.7", "rig.noise=5 mN"])
    assert (scene.rig.mass, scene.logs[1].step, scene.parameters["mu_s"].start) == (0.3, 3, 0.7)
    assert scene.rig.noise == pytest.approx(5e-3)
    assert scene.rig.tolerances == {}, "an override replaces all that stood there"


def test_choosing_logs(scene_file, tmp_path):
    scene = Scene.from_toml(scene_file(GOOD))
    assert scene.choose([]) == scene
    assert scene.choose([tmp_path / "sub" / "fast.csv"]).logs == scene.logs[1:]
    assert scene.choose(["slow.csv"]).logs == scene.logs[:1], "by file name"
    (tmp_path / "new.csv").touch()
    added = scene.choose([tmp_path / "new.csv"], LogEntry(Path(), step=4)).logs
    assert added == (LogEntry(tmp_path / "new.csv", step=4),)
    assert scene.rig_for(added[0]) == scene.rig


def test_a_log_listed_step_by_step_is_chosen_with_all_its_steps(scene_file):
    scene = Scene.from_toml(scene_file(GOOD + '[[logs]]\npath = "sub/fast.csv"\nstep = 4\nrun = 2\n'))
    for name in ("fast.csv", scene.logs[1].path):
        assert [(entry.step, entry.run) for entry in scene.choose([name]).logs] == [(2, None), (4, 2)]


def test_example_scenes_say_what_was_simulated():
    truth = json.loads(examples.TRUTH.read_text(encoding="utf-8"))
    for path in (examples.SCENE, examples.SCENE_AT_50_HZ, examples.SCENE_UNEVEN):
        scene = Scene.from_toml(path)
        assert {name: getattr(scene.rig, name) for name in truth["rig"]} == truth["rig"]
        for log in scene.logs:
            assert log.path.is_file() and log.drive_speed == pytest.approx(truth["logs"][log.path.name]["drive_speed"])
    assert len(Scene.from_toml(examples.SCENE).logs) == 4


EFFECTS = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
RIG = {"mass": "0.2 kg", "stiffness": "1470 N/m", "damping": "147 N/m", "drive_speed": "1 mm/s"}


def scene(rig=None, **more):
    return Scene.from_document({"effects": EFFECTS, "rig": {**RIG, **(rig or {})}, **more})


def test_the_unit_settles_it_and_sound_bare_numbers_stand(tmp_path):
    path = tmp_path / "scene.toml"
    rig = "mass = 0.2\nstiffness = 1470\nzeta = 0.05\ndrive_speed = 0.001\n"
    text = f"effects = {EFFECTS!r}\n[rig]\n{rig}".replace("'", '"')
    path.write_text(text)
    assert Scene.from_toml(path).rig.mass == 0.2
    path.write_text(text.replace("mass = 0.2", 'mass = "180 kg"').replace("= 0.001", '= "0.1 m/s"'))
    assert Scene.from_toml(path).rig.mass == 180.0
    assert Scene.from_document(Scene.from_toml(path).as_document()).rig.drive_speed == 0.1, "a stored scene is bare"


def test_a_scene_is_taken_as_it_is_by_its_path_and_from_its_tables(scene_file):
    path = scene_file(GOOD)
    scene = Scene.from_toml(path)
    assert Scene.of(scene) is scene and Scene.of(str(path)) == scene == Scene.of(path)
    assert Scene.of(scene.as_document()).rig == scene.rig


def test_static_friction_may_be_no_higher_than_kinetic_and_then_nothing_slips():
    start = {"mu_s": 0.4, "mu_k0": 0.4, "delta_mu_k": 0.0, "a": 250.0, "D": 6e-5, "t_cr": 0.4}
    motion = simulate(scene({"normal_force": "2 N"}, parameters={name: {"start": v} for name, v in start.items()}), 3.0)
    assert motion.sample([2.0, 2.9])["force"] == pytest.approx([0.8, 0.8], rel=1e-3)


def test_a_result_of_another_schema_is_refused(tmp_path):
    (tmp_path / "result.json").write_text(json.dumps({"schema": 99, "status": "converged"}))
    with pytest.raises(FitError, match="its schema is 99; expected 1"):
        read_document(tmp_path / "result.json")
