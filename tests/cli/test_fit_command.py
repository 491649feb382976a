"""`stickslip fit`, `demo` and `verify`: what they leave, what they say, and with which code they end."""

import json
from pathlib import Path

import pytest

from identify import examples
from identify.base.result import Result
from identify.cli import main as cli
from identify.cli.fit import compare
from tests.cli.test_every_subset import scene_text
from tests.support.command import refused, simulated, stickslip
from tests.support.fake_fit import failed, fake_fit


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The result folder of a fit of a simulated log, of which the two friction levels are searched."""
    place, names = tmp_path_factory.mktemp("Prüfstand 1"), ("inertia", "contact_ageing", "velocity_weakening")
    scene, log, out = (str(place / name) for name in ("scene.toml", "log.csv", "out"))
    Path(scene).write_text(scene_text(names), encoding="utf-8")
    simulation = ["--duration", "1.5 s", "--rate", "1 kHz", "--noise", "5 mN", "--out", log]
    assert cli.main(["simulate", "--scene", scene, *simulation]) == 0
    assert cli.main(["fit", "--scene", scene, "--out", out]) == 0
    return Path(out)


def test_a_fit_leaves_its_folder_and_finds_the_truth(fitted):
    names = {item.name for item in fitted.iterdir()}
    assert names == {"result.json", "report.html", "result.h5", "figures", "classical.csv", "parameters.tex"}
    result = json.loads((fitted / "result.json").read_text())
    for name, value in (("mu_s", 0.5), ("mu_k0", 0.35)):
        entry = result["parameters"][name]
        assert entry["verdict"] == "identified" and abs(entry["value"] - value) < 4 * entry["standard_error"]


def test_a_stored_fit_is_verified(fitted, folder, capsys):
    code, words, _ = stickslip(capsys, "verify", fitted / "result.json")
    assert code == 0 and "reproduced" in words
    stored = json.loads((fitted / "result.json").read_text())
    before = Result.from_dict(stored)
    stored["parameters"]["mu_s"]["value"] *= 1.01
    stored["parameters"]["a"]["verdict"] = "weak"
    differences = compare(Result.from_dict(stored), before)
    assert len(differences) == 2 and "mu_s was" in differences[0] and "a was called weak" in differences[1]
    stored["logs"][0]["sha256"] = "0"
    Path("other.json").write_text(json.dumps(stored), encoding="utf-8")
    assert "has changed" in refused(capsys, "verify", "other.json")


def test_a_log_without_cycles_is_reported_with_exit_code_3(folder, capsys):
    slow = ["--set", "rig.drive_speed=0.1 mm/s"]  # two seconds of it only load the spring
    simulated(capsys, "load.csv", *slow, "--noise", "5 mN")
    code, out, _ = stickslip(capsys, "fit", "load.csv", "--scene", examples.SCENE, *slow, "--out", "load", "--json")
    result = json.loads(out)
    assert code == 3 and result["status"] == "no_cycles" and "load.csv" in result["message"]
    assert len(Path("load/classical.csv").read_text().splitlines()) == 2 and Path("load/report.html").exists()


@pytest.mark.parametrize("good", [True, False])
def test_the_exit_code_of_the_demo_is_that_of_its_fit(monkeypatch, tmp_path, capsys, good):
    fit = fake_fit()
    found = fit if good else failed(fit, "model_misfit", "the model does not fit")
    monkeypatch.setattr("identify.cli.fit.fit", lambda *_, **__: found)
    monkeypatch.setattr("identify.cli.fit.write_report", lambda *_: None)
    assert cli.main(["demo", "--out", str(tmp_path / "demo"), "--json"]) == (0 if good else 3)
    assert json.loads(capsys.readouterr().out)["status"] == found.status.value
