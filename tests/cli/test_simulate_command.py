"""`stickslip simulate`: what it takes of a fit, and what it says of a scene that gives no friction."""

import json

import pytest

from data_io import read_log
from identify.cli import main as cli
from identify.report.stored_result import as_json
from identify.scene import Scene
from identify.simulation.simulate import simulate
from tests.support.fake_fit import EFFECTS, RIG, TRUTH, fit_of_a_scene

SHORT = ["--duration", "2 s", "--rate", "1 kHz", "--out", "log.csv"]


@pytest.fixture
def stored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "result.json").write_text(as_json(fit_of_a_scene().result))
    return tmp_path / "result.json"


def test_a_fit_is_simulated_at_the_speed_of_one_of_its_logs(stored, capsys):
    assert cli.main(["simulate", "--result", str(stored), "--log", "3", *SHORT]) == 0
    said = capsys.readouterr().out
    assert said.startswith("the estimates of the fit, at 1 mm/s and 1 N (log 3, ")
    parameters = {name: {"fixed": value} for name, value in TRUTH.items()}
    scene = Scene.from_document({"effects": EFFECTS, "rig": {**RIG, "drive_speed": "1 mm/s"}, "parameters": parameters})
    record = read_log("log.csv")
    assert record.friction_force == pytest.approx(simulate(scene, 2.0).sample(record.time)["force"], abs=1e-6)


def test_what_is_set_stands_above_the_fit(stored, capsys):
    assert cli.main(["simulate", "--result", str(stored), "--set", "rig.drive_speed=2 mm/s", "--json", *SHORT]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["parameters"]["mu_s"] == 0.62 and read_log("log.csv").drive_speed == pytest.approx(0.002)


def test_a_scene_without_friction_says_which_default_it_takes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rig = 'mass = "0.2 kg"\nstiffness = "1470 N/m"\nzeta = 0.05\nnormal_force = "1 N"\ndrive_speed = "1 mm/s"\n'
    scene = f"effects = {json.dumps(EFFECTS)}\n[rig]\n{rig}[parameters]\nmu_s = {{ start = 0.7 }}\n"
    (tmp_path / "scene.toml").write_text(scene)
    assert cli.main(["simulate", "--scene", "scene.toml", *SHORT]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "documented defaults are taken: mu_k0 0.45, D 40 µm, t_cr 0.5 s, delta_mu_k −0.1, a 300 s/m" in said
    assert "mu_s 0.6" not in said


def test_a_log_that_the_fit_has_not_is_refused(stored, capsys):
    assert cli.main(["simulate", "--result", str(stored), "--log", "7", *SHORT]) == 2
    assert "log 7 was asked for; this fit has 4" in capsys.readouterr().err
