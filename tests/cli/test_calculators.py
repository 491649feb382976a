"""`stability`, `amplitude` and effects on the command line: asked about, left out, refused in one sentence."""

import json
import re
import shlex
from pathlib import Path

import pytest

from experiments.batch_trials import SCENE as PAIR
from identify.base.document import as_json
from tests.support.command import refused, stickslip
from tests.support.fake_fit import fit_of_a_scene

SCENE = f"""name = "new-pair"
{PAIR}drive_speed = "1 mm/s"
normal_force = "1 N"
[parameters]
mu_s = {{ fixed = 0.62 }}
mu_k0 = {{ fixed = 0.43 }}
delta_mu_k = {{ fixed = -0.13 }}
D = {{ start = "37.4 um" }}
"""


def test_calculators_refuse_what_never_repeats(folder, capsys):
    path, more = "s.toml", '"velocity_weakening", "excitation", "friction_heterogeneity", "skin_compliance"]'
    Path(path).write_text(SCENE.replace('"velocity_weakening"]', more), encoding="utf-8")
    sentence = refused(capsys, "stability", "--scene", path)
    assert "no cycle is like the one before" in sentence and "--without excitation" in sentence
    sentence = refused(capsys, "amplitude", "--scene", path, "--without", "excitation")
    assert "friction_heterogeneity no cycle is like the one before" in sentence
    assert "did you mean" in refused(capsys, "amplitude", "--scene", path, "--without", "occlusion")


def stability(capsys, scene, *arguments):
    """The document of one run, and the words beside it."""
    code, out, words = stickslip(capsys, "stability", "--scene", scene, *arguments, "--json")
    assert code == 0
    return json.loads(out), " ".join(words.split())


def test_assumed_values_are_named_and_give_ranges(folder, capsys):
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    document, words = stability(capsys, "scene.toml")
    assert "assumed: " in words and "Over the ranges of what is assumed" in words
    assert sorted(document["assumed"]) == ["a", "t_cr"] and "existing_result" not in document
    end = document["points"][0]["stability"]["critical_speed"]
    assert end["interval"][1] > 1.5 * end["interval"][0]


def test_a_result_beside_the_scene_is_offered_and_stated_values_are_no_guess(folder, capsys):
    given = SCENE + 'a = { fixed = "300 s/m" }\nt_cr = { fixed = "0.5 s" }\n'
    (folder / "scene.toml").write_text(given, encoding="utf-8")
    (folder / "stickslip-new-pair").mkdir()
    (folder / "stickslip-new-pair" / "result.json").write_text("{}", encoding="utf-8")
    at = ["--at", "drive_speed=2 mm/s", "normal_force=1 N", "--at", "stiffness=2 N/mm"]  # in one option, or in several
    document, words = stability(capsys, "scene.toml", *at)
    (point,) = document["points"]
    assert point["operating_point"]["drive_speed"]["value"] == 0.002
    assert point["groups"]["omega_n"]["value"] == pytest.approx((2000 / 0.2) ** 0.5)
    assert document["assumed"] == [] and document["existing_result"].endswith("stickslip-new-pair/result.json")
    assert "--result" in words and "assumed" not in words


def test_the_commands_of_the_page_from_the_bench_to_the_part_run(folder, capsys):
    page = (Path(__file__).resolve().parents[2] / "docs" / "part.md").read_text(encoding="utf-8")
    (folder / "stickslip-pair").mkdir()
    (folder / "stickslip-pair" / "result.json").write_text(as_json(fit_of_a_scene().result), encoding="utf-8")
    commands = re.findall(r"```sh\n(.*?)```", page, re.DOTALL)[0].splitlines()
    assert len(commands) == 2
    for command in commands:
        code, out, _ = stickslip(capsys, *shlex.split(command)[1:])
        words = " ".join(out.split())
        assert code == 0 and "Extrapolated: the logs did not test" in words and "800 N/m" in words
        assert "95 %" in words
