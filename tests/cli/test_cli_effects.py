"""Effects on the command line: simulated, asked about, left out, refused in one sentence."""

import json
import tomllib
from pathlib import Path

import pytest

from identify import examples
from identify.effects import ALL, MAIN, NAMES
from identify.scene import Scene
from tests.support.command import refused, stickslip

pytestmark = pytest.mark.usefixtures("no_cost")

RIG = """
[rig]
mass = "0.2 kg"
stiffness = "1470 N/m"
zeta = 0.05
drive_speed = "2 mm/s"
normal_force = "1 N"
"""


def beside_the_others(name):
    effect = next(e for e in ALL if e.name == name)
    rivals = [e.name for e in ALL if e.role and e.role == effect.role]
    return [n for n in NAMES if n == name or (n in (*MAIN, *effect.needs) and n not in rivals)]


@pytest.fixture
def scene_file(folder):
    def write(effects, more="", top=""):
        said = json.dumps(effects) if effects != "auto" else '"auto"'
        Path("s.toml").write_text(f"effects = {said}\n{top}\n{RIG}\n{more}", encoding="utf-8")
        return "s.toml"

    return write


@pytest.mark.parametrize("name", [n for n in NAMES if n != "inertia"])
def test_every_effect_is_simulated_and_says_so_in_the_log(name, scene_file, capsys):
    from data_io import read_log

    path = scene_file(beside_the_others(name))
    code, _, err = stickslip(capsys, "simulate", "--scene", path, "--duration", "1", "--rate", "200", "--out", "a.csv")
    assert code == 0, err
    told = read_log("a.csv").metadata
    assert name in told["effects"].split(", ")
    values = json.loads(told["parameters_SI"])
    again = Scene.from_document(json.loads(told["scene_SI"]))
    assert again.values() == values == Scene.from_toml(path).values()
    assert told["rate_Hz"] == 200.0 and told["duration_s"] == 1.0 and told["version"]


def test_a_log_says_the_same_in_both_formats(scene_file, capsys):
    from data_io import read_log

    path = scene_file([*MAIN, "skin_compliance"])
    for out in ("a.csv", "a.h5"):
        assert stickslip(capsys, "simulate", "--scene", path, "--duration", "1", "--rate", "50", "--out", out)[0] == 0
    text, binary = read_log("a.csv").metadata, read_log("a.h5").metadata
    for key in ("effects", "parameters_SI", "scene_SI", "duration_s", "rate_Hz", "noise_N", "seed"):
        assert text[key] == binary[key]


SIMULATE = ["--duration", "1", "--rate", "50", "--out", "a.csv"]


def test_wrong_scenes_end_in_one_sentence(scene_file, capsys):
    for effects, top, more, words in (
        (["inertia", "skin_complience"], "", "", "did you mean 'skin_compliance'"),
        ([*MAIN, "linear_weakening"], "", "", "laws of the same thing (velocity law)"),
        (["inertia", "sensor_second_lag"], "", "", "needs the effect sensor_lag"),
        (["inertia", "power_law"], "", "[parameters]\nlowest_speed = '5 mm/s'", "power_law was measured from 0.005"),
        (["inertia"], "extrapolate = ['power_law']", "", "not among the effects"),
        (MAIN, "", "[parameters]\nlag_time = { start = 1 }", "belongs to the effect sensor_lag"),
    ):
        path = scene_file(list(effects) if effects != "auto" else effects, more, top)
        assert words in refused(capsys, "simulate", "--scene", path, *SIMULATE)


@pytest.mark.slow
def test_extrapolation_is_allowed_where_the_scene_says_so(scene_file, capsys):
    more = "[parameters]\nlowest_speed = '5 mm/s'"
    path = scene_file(["inertia", "power_law"], more, "extrapolate = ['power_law']")
    assert stickslip(capsys, "simulate", "--scene", path, *SIMULATE)[0] == 0
    assert stickslip(capsys, "amplitude", "--scene", path)[0] == 0
    path = scene_file(["inertia", "power_law"])
    assert "1e-06 m/s" in refused(capsys, "amplitude", "--scene", path, "--at", "drive_speed=1 um/s")


def test_calculators_refuse_what_never_repeats_and_leave_it_out_where_asked(scene_file, capsys):
    path = scene_file([*MAIN, "excitation", "friction_heterogeneity", "skin_compliance"])
    sentence = refused(capsys, "stability", "--scene", path)
    assert "the effect excitation changes with time" in sentence and "--without excitation" in sentence
    sentence = refused(capsys, "amplitude", "--scene", path, "--without", "excitation")
    assert "friction_heterogeneity deals every stick its own friction" in sentence
    asked = ["--without", "excitation", "--without", "friction_heterogeneity"]
    code, out, _ = stickslip(capsys, "amplitude", "--scene", path, *asked, "--json")
    document = json.loads(out)["points"][0]
    assert code == 0 and document["closed_forms"]["ignores"] == ["skin_compliance"]
    assert "not among the effects" in refused(capsys, "amplitude", "--scene", path, "--without", "occlusion")


def test_effects_left_open_are_chosen_by_the_numbers(scene_file, capsys):
    path = scene_file("auto", "[parameters]\nskin_stiffness = { start = '4 kN/m' }\nlag_time = { start = '1 us' }")
    code, out, _ = stickslip(capsys, "simulate", "--scene", path, *SIMULATE, "--json")
    effects = json.loads(out)["effects"]
    assert code == 0 and effects["chosen"] == "auto"
    assert "skin_compliance" in effects["names"] and "sensor_lag" not in effects["names"]
    reasons = {reason["effect"]: reason for reason in effects["reasons"]}
    assert reasons["skin_compliance"]["error"] > 0.01 > reasons["sensor_lag"]["error"]
    assert stickslip(capsys, "amplitude", "--scene", path)[0] == 0


def test_parameters_of_any_effect_set_the_operating_point(scene_file, capsys):
    path = scene_file([*MAIN, "skin_compliance"])
    drops = []
    for stiffness in ("4400 N/m", "1 kN/m"):
        asked = ["amplitude", "--scene", path, "--at", f"skin_stiffness={stiffness}", "--json"]
        code, out, err = stickslip(capsys, *asked)
        assert code == 0, err
        drops.append(json.loads(out)["points"][0]["amplitude"]["period"]["value"])
    assert drops[1] > 1.2 * drops[0], "softer skin, longer sticks"
    assert "did you mean 'skin_stiffness'" in refused(capsys, "amplitude", "--scene", path, "--at", "skin_stifness=1")


@pytest.mark.slow
def test_a_fit_says_which_effects_it_took_and_why(folder, capsys):
    logs = ["1_mm_per_s.txt.gz", "5_mm_per_s.txt.gz"]
    code, out, err = stickslip(capsys, "fit", *logs, "--scene", examples.SCENE, "--out", "r", "--json")
    assert code == 0, err
    effects = json.loads(out)["effects"]
    assert effects["names"] == [*MAIN, "varying_normal_force"] and effects["chosen"] == "listed"
    assert [reason["effect"] for reason in effects["reasons"]] == effects["names"]
    assert all(reason["kept"] and reason["sentence"] for reason in effects["reasons"])
    assert all(reason["value"] is not None for reason in effects["reasons"] if reason["effect"] in MAIN)
    page = Path("r/report.html").read_text(encoding="utf-8")
    assert "Effects: which and why" in page and "contact ageing" in page
    assert "Listed in the scene. Where numbers stand" in page


def test_a_drafted_scene_follows_the_measured_load(folder, capsys):
    log = examples.FOLDER / "0.1_mm_per_s.txt.gz"
    assert stickslip(capsys, "scene", log, "--out", "draft.toml")[0] == 0
    effects = tomllib.loads(Path("draft.toml").read_text(encoding="utf-8"))["effects"]
    assert effects == [*MAIN, "varying_normal_force"]
    assert all(
        "varying_normal_force" in Scene.from_toml(path).effects for path in (examples.SCENE, examples.SCENE_AT_50_HZ)
    )
