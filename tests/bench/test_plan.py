"""`stickslip plan`: one core for what to record next; its information is that of closed forms and of the simulator."""

import csv
import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from experiments.study_problem import DEMO, RIG
from identify import Scene
from identify.bench import rehearsal
from identify.bench.designs import MOST_SLIPS, Rehearsals, base_of, choose
from identify.bench.plan import Choices, plan, with_holds
from identify.bench.plan_words import said, shown_half, stated_drives, step_table, verdict
from identify.bench.rehearsal import LogDesign, rehearse
from identify.cli import main as cli
from identify.effects import MAIN
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.report.stored_result import as_json
from identify.shooting.transcription import BOUNDED_START_SD
from identify.simulation.drive import Drive
from identify.simulation.simulate import run
from tests.support.fake_fit import fit_of_a_scene, with_verdicts

EFFECTS = [*MAIN, "varying_normal_force"]


def scene(free=("mu_s", "t_cr"), **rig):
    """All but some parameters are known."""
    parameters = {name: {"start": v} if name in free else {"fixed": v} for name, v in DEMO.items()}
    stated = {**RIG, "drive_speed": 1e-3, "normal_force": 1.0, "noise": 5e-3, **rig}
    return Scene.from_document({"effects": EFFECTS, "rig": stated, "parameters": parameters})


def rehearsed(design, free=("mu_s", "t_cr")):
    unknowns = from_scene(scene(free))
    base = unknowns.base(RIG)
    theta = unknowns.theta(np.array([(DEMO | RIG)[name] for name in unknowns.names]), base)
    return rehearse(unknowns, theta, base_of(unknowns, base, design), design, 2.0 * 0.19 / 1470.0, 60.0)


@pytest.fixture(scope="module")
def planned():
    """At 20 mm/s and this load the mass slides on: without holds a log shows one peak."""
    return plan(scene(), (), Choices(speeds=(2e-2,), holds=(0.2, 1.0, 5.0)))


def test_holds_tell_the_ageing_that_one_peak_leaves_open(planned):
    (log,) = (log for log in planned.logs if log.design.holds)
    assert log.design.holds == pytest.approx((0.2, 1.0, 5.0)) and "t_cr" in log.tells
    assert all(planned.then[i] < 0.2 for i in planned.knowledge.wanted)
    assert planned.now[planned.knowledge.names.index("t_cr")] > 10.0


def test_a_long_log_tells_what_its_simulation_to_the_end_does(monkeypatch):
    """A shared period makes many slips tell more than as many logs of few; a part of a log tells that part."""
    free = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
    made = rehearsed(LogDesign(1e-3, 1.0), free)
    assert made.again is not None and made.again.since > 0
    monkeypatch.setattr(rehearsal, "CYCLES", 24)
    whole = rehearsed(LogDesign(1e-3, 1.0), free)
    assert whole.slips == 24
    times = whole.duration / made.duration
    for load_sd in (0.0, 1e-4, 1e-2):
        sd, true, as_often = (
            np.sqrt(np.diag(np.linalg.inv(told)))
            for told in (
                made.information(1000.0, 25e-6, load_sd, times),
                whole.information(1000.0, 25e-6, load_sd),
                times * made.information(1000.0, 25e-6, load_sd),
            )
        )
        np.testing.assert_allclose(sd, true, rtol=0.03)
        assert np.max(np.abs(as_often / true - 1.0)) > 0.05
    np.testing.assert_allclose(made.information(1000.0, 25e-6, 1e-4, 0.5), 0.5 * made.information(1000.0, 25e-6, 1e-4))


def test_the_contact_at_the_start_is_as_open_as_a_fit_takes_it_to_be():
    """What the first stick tells hangs on how fresh the contact was, of which a fit knows a little."""
    made = rehearsed(LogDesign(1e-3, 1.0))
    assert made.start_sd.tolist() == [np.inf, BOUNDED_START_SD]
    open_, known = (replace(made, start_sd=np.array([np.inf, sd])) for sd in (np.inf, 1e-9))
    told = [np.linalg.inv(log.information(50.0, 1.0, 0.0))[1, 1] for log in (known, made, open_)]
    assert 1.2 * told[0] < told[1] < told[2] / 1.2


def test_the_drive_stops_where_no_slip_is_near(planned):
    """A slip in which the drive stops tells little, and is another one where the pair is a little different."""
    design = with_holds(planned.knowledge, LogDesign(3e-3, 1.0), (1.0, 3.0, 10.0))
    assert design.holds == pytest.approx((1.0, 3.0, 10.0))
    drive = [*design.drive, (design.duration, 0.0)]
    for number in range(1, len(drive), 2):
        stop, restart = drive[number][0], drive[number - 1][0]
        seen = run(assemble(MAIN), DEMO | RIG, tuple(drive[:number]), 1.0, stop + 1.0)  # as if it ran on
        arrest = float(seen.arrests[seen.arrests < stop][-1])
        onset = float(seen.onsets[seen.onsets > arrest][0])
        assert arrest > restart and min(stop - arrest, onset - stop) > 0.2 * (onset - arrest)


def test_no_log_is_planned_that_a_fit_cannot_follow(planned):
    """Chosen again, a log becomes longer: of thousands of slips, in eight minutes, a fit at its limit knew nothing."""
    before = planned.knowledge
    known = replace(before, variance=1.0, places=before.places[:1], known=before.known[:1])
    for design in (LogDesign(3e-3, 1.0), LogDesign(1e-4, 1.0)):
        (log,) = choose(Rehearsals(known), [design], 3600.0, 60.0, 6)
        assert log.times > 6 and log.slips <= MOST_SLIPS and log.duration <= known.longest


def test_a_promise_holds_at_most_places_and_not_at_every_second_one():
    """Before any test the pair may be another one: what is told at half of the places only is not told."""
    made = plan(scene(), (), Choices(speeds=(2e-2,), holds=(0.2, 1.0, 5.0))).knowledge
    precisions = np.array([np.diag([1e6, 1e6]) if place < 4 else np.diag([1e6, 1.0]) for place in range(6)])
    assert made.places.shape[0] == 6 and set(made.told(precisions)) == {"mu_s"}
    precisions[4] = precisions[0]
    assert set(made.told(precisions)) == {"mu_s", "t_cr"}


def test_the_drop_and_its_slopes_are_those_of_the_simulator():
    """Of a quasi-static slip without ageing the drop is twice the step of friction; with more mu_s it grows by two."""
    made = rehearsed(LogDesign(1e-4, 1.0), free=("mu_s", "mu_k0"))
    more = rehearsed(LogDesign(1e-4, 2.0), free=("mu_s", "mu_k0"))
    assert 0.25 < made.drop < 2.0 * 0.32 and more.drop > 1.5 * made.drop
    assert 0.5 < made.drop_slopes[0] < 2.5 and made.drop_slopes[1] < 0.0


def test_a_softer_spring_is_rehearsed_with_the_damping_ratio_kept():
    unknowns = from_scene(scene())
    base = unknowns.base(RIG)
    softer = dict(zip(unknowns.names, base_of(unknowns, base, LogDesign(1e-3, 1.0, 735.0)).tolist(), strict=True))
    assert softer["stiffness"] == 735.0 and softer["damping"] == pytest.approx(73.5) and softer["mass"] == 0.2
    soft, stiff = rehearsed(LogDesign(1e-3, 1.0, 735.0)), rehearsed(LogDesign(1e-3, 1.0))
    assert soft.duration / soft.slips > 1.5 * stiff.duration / stiff.slips


def test_the_price_of_a_wrong_rig_and_the_logs_are_said(planned):
    assert set(planned.price) == {"mass", "stiffness", "damping", "drive_speed"}
    assert all(np.all(np.isfinite(shift)) and np.all(shift >= 0.0) for shift in planned.price.values())
    text = said(planned)
    assert "the price of a wrong rig" in text and "holds of 0.2, 1 and 5 s between runs at 20 mm/s" in text
    known = said(replace(planned, tolerances={"mass": 0.01, "stiffness": 0.01, "damping": 0.01}))
    assert "taken as exact (the drive speed) nothing needs a record first" in " ".join(known.split())
    assert (shown_half(1.93), shown_half(0.0022), shown_half(5.0)) == ("± 190 %", "± 0.22 %", "not told")
    assert (verdict(0.1), verdict(0.5), verdict(5.0)) == ("identified", "weak", "not identifiable")


def test_the_table_holds_every_step(planned):
    rows = list(csv.DictReader(step_table(planned).splitlines()))
    holds = [float(row["duration_s"]) for row in rows if row["what"] == "hold"]
    assert holds == pytest.approx([hold for log in planned.logs for hold in log.design.holds * log.times])
    total = sum(float(row["duration_s"]) for row in rows)
    assert total == pytest.approx(sum(log.duration for log in planned.logs), rel=1e-2)
    assert {float(row["drive_speed_mm_per_s"]) for row in rows} == {0.0, 20.0}


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


def test_the_command_plans_and_says_what_is_wrong(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rig = 'mass = "0.2 kg"\nstiffness = "1470 N/m"\ndamping = "147 N/m"\ndrive_speed = "1 mm/s"\nnormal_force = "1 N"\n'
    free = "".join(f"{n} = {{ fixed = {v} }}\n" for n, v in DEMO.items() if n not in ("mu_s", "t_cr"))
    free += "mu_s = { start = 0.62 }\nt_cr = { start = 0.5 }\n"
    (tmp_path / "pair.toml").write_text(f"effects = {json.dumps(EFFECTS)}\n[rig]\n{rig}[parameters]\n{free}")
    options = ["--speed", "20 mm/s", "--hold", "0.2 s,1 s,5 s", "--out", "steps.csv", "--json"]
    assert cli.main(["plan", "pair.toml", *options]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["verdicts"] == {"mu_s": "identified", "t_cr": "identified"}
    assert document["now"]["t_cr"] is None and document["then"]["t_cr"] < 0.2
    assert (tmp_path / "steps.csv").read_text().startswith("log,step,drive_speed_mm_per_s")
    for wrong, words in ((["--for", "a"], "a is not searched"), (["--speed", "-1 mm/s"], "above zero")):
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
