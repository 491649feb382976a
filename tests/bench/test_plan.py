"""`stickslip plan`: where its values come from, what it asks for, and how it says so."""

import csv
import json
import tomllib

import numpy as np
import pytest

from experiments.study_problem import DEMO
from identify import Scene
from identify.bench.plan import Choices, plan
from identify.bench.plan_words import plan_text, shown_half, stated_drives, step_table, verdict
from identify.cli import main as cli
from identify.report.stored_result import as_json
from identify.simulation.drive import Drive
from tests.bench.test_design import scene
from tests.support.fake_fit import failed, fit_of_a_scene, with_verdicts


@pytest.fixture(scope="module")
def planned():
    """At 20 mm/s and this load the mass slides on: without holds a log shows one peak."""
    return plan(scene(), (), Choices(speeds=(2e-2,), holds=(0.2, 1.0, 5.0)))


def test_intervals_are_ranges_where_they_differ():
    halves = [np.array(h) for h in ([0.081, 0.0812], [0.05, 0.2], [0.05, 9.0], [9.0, 1e9])]
    assert [shown_half(h) for h in halves] == ["± 8.1 %", "± 5 to 20 %", "± 5 % to open", "open"]
    assert (verdict(0.1), verdict(0.5), verdict(5.0)) == ("identified", "weak", "not identifiable")


def test_the_table_holds_every_step(planned):
    rows = list(csv.DictReader(step_table(planned).splitlines()))
    holds = [float(row["duration_s"]) for row in rows if row["what"] == "hold"]
    assert holds == pytest.approx([hold for log in planned.logs for hold in log.design.holds * log.times])
    total = sum(float(row["duration_s"]) for row in rows)
    assert total == pytest.approx(sum(log.duration for log in planned.logs), rel=1e-2)
    assert {float(row["drive_speed_mm_per_s"]) for row in rows} == {0.0, 20.0}
    assert "holds of 0.2, 1 and 5 s between runs at 20 mm/s" in plan_text(planned)


def test_the_drives_that_are_said_are_those_of_the_table(planned):
    """A scene takes the lines as they stand, and its programme has the steps of the table."""
    rows = list(csv.DictReader(step_table(planned).splitlines()))
    for number, line in enumerate(stated_drives(planned).splitlines(), 1):
        document = scene().as_document() | {"logs": [{"path": "log.csv", **tomllib.loads(line)}]}
        document["rig"].pop("drive_speed")
        steps = [row for row in rows if row["log"] == str(number)]
        drive = Drive.of(Scene.from_document(document).logs[0].drive_speed)
        assert list(drive.speeds) == pytest.approx([1e-3 * float(row["drive_speed_mm_per_s"]) for row in steps])
        lasts = [float(row["duration_s"]) for row in steps]
        assert list(drive.starts) == pytest.approx([sum(lasts[:i]) for i in range(len(lasts))], abs=1e-4)


SCENE = """
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening", "varying_normal_force"]
[rig]
mass = "0.2 kg"
stiffness = "1470 N/m"
damping = "147 N/m"
drive_speed = "1 mm/s"
normal_force = "1 N"
[parameters]
"""


def test_the_first_line_says_what_is_assumed_and_the_answer_is_a_range(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fixed = "".join(f"{n} = {{ fixed = {v} }}\n" for n, v in DEMO.items() if n not in ("mu_s", "t_cr"))
    (tmp_path / "pair.toml").write_text(SCENE + fixed + "mu_s = { start = 0.62 }\n")
    options = ["--speed", "20 mm/s", "--hold", "0.2 s,1 s,5 s", "--out", "steps.csv"]
    assert cli.main(["plan", "pair.toml", *options]) == 0
    first, *_, table = " ".join(capsys.readouterr().out.split()).partition(". ")
    assert first.startswith("Stated: ") and "assumed: t_cr (built-in values, over their usual ranges)" in first
    assert " to " in table
    assert cli.main(["plan", "pair.toml", *options, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["verdicts"] == {"mu_s": "identified", "t_cr": "identified"} and document["assumed"] == ["t_cr"]
    assert document["now"]["t_cr"] is None and document["then"]["t_cr"] < 0.2
    low, high = document["ranges"]["then"]["t_cr"]
    assert low < 0.8 * high
    assert (tmp_path / "steps.csv").read_text().startswith("log,step,drive_speed_mm_per_s")
    for wrong, words in ((["--for", "a"], "a is not searched"), (["--speed", "-1 mm/s"], "positive number")):
        assert cli.main(["plan", "pair.toml", *wrong]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.parametrize("untold", [False, True])
def test_a_fit_is_planned_from_its_estimates_at_the_load_of_its_logs(tmp_path, capsys, untold):
    """What a fit does not tell has no standard error: it is as open as before, and the plan is for just that."""
    fit = with_verdicts(fit_of_a_scene()) if untold else fit_of_a_scene()
    logs = [log | {"normal_force_N": 0.5} for log in fit.result["logs"]]
    (tmp_path / "result.json").write_text(as_json(fit.result | {"logs": logs}))
    assert cli.main(["plan", str(tmp_path / "result.json"), "--speed", "1 mm/s", "--hold", "1 s", "--json"]) in (0, 3)
    document = json.loads(capsys.readouterr().out)
    assert document["status"] in ("done", "nothing_to_add") and document["now"]["mu_s"] is not None
    assert (document["now"]["a"] is None or document["now"]["a"] > 1.0) == untold
    assert {log["normal_force"] for log in document["logs"]} <= {0.5} and (document["logs"] or not untold)


def listed(result):
    """The [[logs]] of a result, as a scene lists them."""
    logs = result["provenance"]["scene"]["logs"]
    return "".join(f'[[logs]]\npath = "{log["path"]}"\ndrive_speed = {log["drive_speed"]}\n' for log in logs)


def test_a_fit_of_the_scene_takes_the_place_of_its_values_and_one_speed_is_repeated(tmp_path, monkeypatch, capsys):
    """Each of its speeds stands in one log: the plan asks for one more log at one of these, and only then."""
    monkeypatch.chdir(tmp_path)
    result = fit_of_a_scene().result
    logs = listed(result)
    (tmp_path / "pair.toml").write_text(SCENE.replace("[parameters]", "") + logs)
    fitted = Scene.from_toml(tmp_path / "pair.toml")
    folder = tmp_path / f"stickslip-{fitted.name}"
    folder.mkdir()

    def told(specimen=""):
        (tmp_path / "pair.toml").write_text(SCENE.replace("[parameters]", specimen) + logs)
        same = Scene.from_toml(tmp_path / "pair.toml").as_document()
        provenance = result["provenance"] | {"scene": same}
        (folder / "result.json").write_text(as_json(result | {"provenance": provenance}))
        assert cli.main(["plan", "pair.toml", "--speed", "1 mm/s", "--hold", "1 s", "--json"]) in (0, 3)
        return json.loads(capsys.readouterr().out)

    first = told()
    assert first["source"].startswith("From the fit of this scene in ") and "a" in first["measured"]
    assert first["assumed"] == [] and [log["repeats"] for log in first["logs"]][:1] == [True]
    speeds = [abs(log["drive_speed_m_per_s"]) for log in result["logs"]]
    assert first["logs"][0]["drive"] in speeds and len(set(speeds)) == len(speeds) > 1
    assert not any(log["repeats"] for log in told("[tolerances]\nspecimen = 0\n")["logs"])


@pytest.mark.parametrize(("good", "why"), [(True, "another state of this scene; plan"), (False, "did not converge")])
def test_a_fit_that_does_not_stand_for_the_scene_is_offered_not_used(tmp_path, monkeypatch, capsys, good, why):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pair.toml").write_text(SCENE)
    folder = tmp_path / "stickslip-pair"
    folder.mkdir()
    fit = fit_of_a_scene() if good else failed(fit_of_a_scene(), "model_misfit", "the model does not fit")
    (folder / "result.json").write_text(as_json(fit.result))
    assert cli.main(["plan", "pair.toml", "--speed", "1 mm/s", "--hold", "1 s", "--json"]) in (0, 3)
    document = json.loads(capsys.readouterr().out)
    assert why in document["source"] and document["existing_result"].endswith("result.json")
    assert document["measured"] == [] and "a" in document["assumed"]


def test_a_fit_that_chose_its_effects_stands_for_its_scene(tmp_path, monkeypatch, capsys):
    """The scene leaves the effects open and names one parameter; the fit lists effects and all their parameters."""
    monkeypatch.chdir(tmp_path)
    text = SCENE.replace(SCENE[SCENE.index("effects") : SCENE.index("[rig]")], 'effects = "auto"\n')
    result = fit_of_a_scene().result
    (tmp_path / "pair.toml").write_text(text + "mu_s = { start = 0.6 }\n" + listed(result))
    chosen = Scene.from_toml(tmp_path / "pair.toml").with_effects(result["provenance"]["scene"]["effects"])
    (tmp_path / "stickslip-pair").mkdir()
    provenance = result["provenance"] | {"scene": chosen.as_document()}
    (tmp_path / "stickslip-pair" / "result.json").write_text(as_json(result | {"provenance": provenance}))
    assert cli.main(["plan", "pair.toml", "--speed", "1 mm/s", "--hold", "1 s", "--json"]) in (0, 3)
    assert json.loads(capsys.readouterr().out)["source"].startswith("From the fit of this scene in ")
