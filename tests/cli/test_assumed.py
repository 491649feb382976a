"""What calculators say of values that nobody measured."""

from __future__ import annotations

import json

from identify.cli.main import main

SCENE = """
name = "new-pair"
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
[rig]
mass = "0.2 kg"
stiffness = "1470 N/m"
damping = "147 N/m"
drive_speed = "1 mm/s"
normal_force = "1 N"
[parameters]
mu_s = { fixed = 0.62 }
mu_k0 = { fixed = 0.43 }
delta_mu_k = { fixed = -0.13 }
D = { start = "37.4 um" }
"""


def run(capsys, *arguments):
    code = main(["stability", *arguments])
    return code, capsys.readouterr().out


def test_assumed_values_are_named_and_give_ranges(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE, encoding="utf-8")
    code, text = run(capsys, "--scene", str(scene))
    words = " ".join(text.split())
    assert code == 0 and words.startswith("Stated: mu_s, mu_k0, ") and "assumed: " in words.split(".")[0]
    assert "Over the ranges of what is assumed stick-slip ends above a drive speed: " in words
    assert "ends above a drive speed of" not in words and "Probability of stick-slip at 1 mm/s and 1 N" in words
    document = json.loads(run(capsys, "--scene", str(scene), "--json")[1])
    assert sorted(document["assumed"]) == ["a", "t_cr"] and "existing_result" not in document
    end = document["points"][0]["stability"]["critical_speed"]
    assert end["interval"][1] > 1.5 * end["interval"][0]


def test_a_result_beside_the_scene_is_offered_and_stated_values_are_no_guess(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE + 'a = { fixed = "300 s/m" }\nt_cr = { fixed = "0.5 s" }\n', encoding="utf-8")
    (tmp_path / "stickslip-new-pair").mkdir()
    (tmp_path / "stickslip-new-pair" / "result.json").write_text("{}", encoding="utf-8")
    document = json.loads(run(capsys, "--scene", str(scene), "--json")[1])
    assert document["assumed"] == [] and document["existing_result"].endswith("stickslip-new-pair/result.json")
    words = " ".join(run(capsys, "--scene", str(scene), "--at", "a=200 s/m")[1].split())
    assert "A fit of this scene stands beside it: --result" in words and "assumed" not in words
    assert "Stick-slip ends above a drive speed of" in words
