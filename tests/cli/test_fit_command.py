"""`stickslip fit`, `demo` and `verify`: what they leave, what they say, and with which code they end."""

import copy
import json
import re
from pathlib import Path

import pytest

import identify.report
from identify import examples, identification
from identify.base.result import Result
from identify.cli import fit as fit_group
from identify.cli import main as cli
from tests.support.command import refused, stickslip
from tests.support.fake_fit import failed, fake_fit

RIG = ["--set", "rig.drive_speed=1 mm/s", "--set", "rig.normal_force=1 N"]


def write(name, text):
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return name


def simulated(capsys, path, *more):
    arguments = ["simulate", "--scene", examples.SCENE, *RIG, "--duration", "2", "--rate", "500", "--out", path, *more]
    code, out, err = stickslip(capsys, *arguments)
    assert code == 0, err
    return out


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The result folder of a fit of two example logs."""
    out = tmp_path_factory.mktemp("fit") / "Prüfstand 1"
    logs = ["1_mm_per_s.txt.gz", "0.1_mm_per_s.txt.gz"]
    assert cli.main(["fit", *logs, "--scene", str(examples.SCENE), "--out", str(out)]) == 0
    return out


def test_a_fit_leaves_its_folder_and_finds_the_truth(fitted):
    names = {item.name for item in fitted.iterdir()}
    assert names == {"result.json", "report.html", "result.h5", "figures", "classical.csv", "parameters.tex"}
    result = json.loads((fitted / "result.json").read_text())
    truth = json.loads(examples.TRUTH.read_text())["parameters"]
    for name, value in truth.items():
        entry = result["parameters"][name]
        assert entry["verdict"] == "identified" and abs(entry["value"] - value) < 4 * entry["standard_error"]


def test_a_report_unfolds_to_two_pages(fitted):
    page = (fitted / "report.html").read_text(encoding="utf-8")
    page = re.sub(r"<(script|style|svg)[\s\S]*?</\1>", "", page)
    whole, folded = page, r"<details(?![^>]* open)(?:(?!<details)[\s\S])*?</details>"
    while page != (page := re.sub(folded, "", page)):
        pass
    unfolded, everything = (len(re.sub(r"<[^>]+>", " ", text).split()) for text in (page, whole))
    assert unfolded < 1000 < 2000 < everything, "two logs: 1,200 words are the limit for four"
    assert "stick-slip ends above" in page and "Data quality" not in page.split("</nav>")[1]


def test_a_stored_fit_is_verified(fitted, folder, capsys):
    code, words, _ = stickslip(capsys, "verify", fitted / "result.json")
    assert code == 0 and "reproduced" in words
    stored = json.loads((fitted / "result.json").read_text())
    stored["parameters"]["mu_s"]["value"] *= 1.01
    stored["parameters"]["a"]["verdict"] = "weak"
    code, words, _ = stickslip(capsys, "verify", write("changed.json", json.dumps(stored)))
    assert code == 3 and "mu_s was" in words and "a was called weak" in words
    stored["logs"][0]["sha256"] = "0"
    assert "has changed" in refused(capsys, "verify", write("other.json", json.dumps(stored)))
    assert "no result" in refused(capsys, "verify", write("none.json", "{}"))


def test_calculators_carry_the_uncertainty_of_a_fit(fitted, folder, capsys):
    code, out, _ = stickslip(capsys, "amplitude", "--result", fitted / "result.json", "--json")
    drop = json.loads(out)["points"][1]["amplitude"]["drop"]
    assert code == 0 and drop["interval"][0] < drop["value"] < drop["interval"][1]
    assert drop["value"] == pytest.approx(0.523, rel=0.03), "as measured at 0.1 mm/s"


def test_a_point_that_no_log_tested_is_called_extrapolated(fitted, capsys):
    at = ["--at", "drive_speed=0.5 m/s", "stiffness=3 N/mm", "--json"]
    code, out, _ = stickslip(capsys, "stability", "--result", fitted / "result.json", *at)
    sentence = json.loads(out)["points"][0]["extrapolated"]
    assert code == 0 and "drive speed of 500 mm/s" in sentence and "stiffness" in sentence


def test_a_scene_that_lists_no_log_is_told_so(folder, capsys):
    rig = 'effects = ["inertia"]\n[rig]\nmass = 0.2\nstiffness = 1470\n'
    moving = write("moving.toml", f'{rig}drive_speed = "1 mm/s"\n')
    assert refused(capsys, "fit", "--scene", moving).startswith("moving.toml lists no log and none was given; name a")
    assert "there is no such log" in refused(capsys, "fit", "--scene", moving, "--set", 'logs=[{path="slow.csv"}]')
    assert "no drive speed" in refused(capsys, "fit", write("slow.csv", ""), "--scene", write("rig.toml", rig))


def test_a_folder_without_logs_in_the_place_of_a_log_is_called_one(folder, capsys):
    (folder / "slow.csv").mkdir()
    scene = write("pair.toml", 'effects = ["inertia"]\n[rig]\nmass = 0.2\nstiffness = 1470\ndrive_speed = 1e-3\n')
    for more in (["slow.csv"], ["--set", 'logs=[{path="slow.csv"}]']):
        assert refused(capsys, "fit", *more, "--scene", scene).startswith("slow.csv is a folder that holds no log")


def test_a_log_without_cycles_is_reported_with_exit_code_3(folder, capsys):
    slow = ["--set", "rig.drive_speed=0.1 mm/s"]  # two seconds of it only load the spring
    simulated(capsys, "load.csv", *slow, "--noise", "5 mN")
    code, out, _ = stickslip(capsys, "fit", "load.csv", "--scene", examples.SCENE, *slow, "--out", "load", "--json")
    result = json.loads(out)
    assert code == 3 and result["status"] == "no_cycles" and "load.csv" in result["message"]
    assert len(Path("load/classical.csv").read_text().splitlines()) == 2 and Path("load/report.html").exists()


def test_a_log_that_slides_says_what_it_holds_and_leaves_a_report(folder, capsys, no_further_logs):
    fast = ["--set", "rig.drive_speed=50 mm/s"]
    simulated(capsys, "slide.csv", *fast, "--noise", "5 mN")
    entry = ["fit", "slide.csv", "--scene", examples.SCENE, *fast, "--out", "slide", "--json"]
    code, out, _ = stickslip(capsys, *entry)
    result = json.loads(out)
    assert code == 0 and result["status"] == "converged", result["message"]
    assert {found["verdict"] for found in result["parameters"].values()} <= {"not identifiable", "weak"}
    assert Path("slide/report.html").exists() and Path("slide/figures").exists()


def _entry(value, error, interval, verdict):
    return {"value": value, "standard_error": error, "interval": interval, "verdict": verdict}


STORED = {
    "status": "converged",
    "message": "",
    "parameters": {
        "mu_s": _entry(0.6, 0.001, [0.598, 0.602], "identified"),
        "t_cr": _entry(2.0, None, [None, 3.0], "not identifiable"),
        "a": _entry(500.0, None, [None, None], "fixed"),
    },
}


def _compared(**changed):
    again = copy.deepcopy(STORED)
    for name, entry in changed.items():
        again["parameters"][name] |= entry
    return fit_group.compare(Result.from_dict(STORED), Result.from_dict(again))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"t_cr": {"interval": [None, None]}}, "the upper end of t_cr was 3 and is open now"),
        ({"t_cr": {"interval": [0.1, 3.0]}}, "the lower end of t_cr was open and is 0.1 now"),
        ({"t_cr": {"interval": [None, 300.0]}}, "the upper end of t_cr was 3 and is 300 now"),
        ({"mu_s": {"value": 0.61}}, "mu_s was 0.6 and is 0.61 now"),
        ({"a": {"value": 501.0}}, "a was 500 and is 501 now"),
    ],
)
def test_what_differs_is_said(changed, said):
    assert _compared(**changed) == [said]


def test_between_its_ends_a_value_that_nothing_tells_may_lie_anywhere():
    assert not _compared(t_cr={"value": 1.0, "interval": [None, 3.01]})
    assert not _compared(mu_s={"value": 0.600001, "interval": [0.0, 1.0]}), "a value with an error has it for its ends"


@pytest.mark.parametrize("good", [True, False])
def test_the_exit_code_of_the_demo_is_that_of_its_fit(monkeypatch, tmp_path, capsys, good):
    fit = fake_fit()
    found = fit if good else failed(fit, "model_misfit", "the model does not fit")
    monkeypatch.setattr(identification, "fit", lambda *_, **__: found)
    monkeypatch.setattr(identify.report, "write_report", lambda *_: None)
    assert cli.main(["demo", "--out", str(tmp_path / "demo"), "--json"]) == (0 if good else 3)
    assert json.loads(capsys.readouterr().out)["status"] == found.status.value
