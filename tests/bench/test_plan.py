"""`stickslip plan`: one core for what to record next; its information is that of closed forms and of the simulator."""

import csv
import json

import numpy as np
import pytest

from experiments.study_problem import DEMO, RIG
from identify import Scene
from identify.base.errors import IdentifyError
from identify.bench.designs import base_of
from identify.bench.plan import Choices, plan
from identify.bench.plan_words import said, step_table, verdict
from identify.bench.rehearsal import Design, rehearse
from identify.cli import main as cli
from identify.effects import MAIN
from identify.logs.unknowns import from_scene

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
    return plan(scene(), (), Choices(speeds=(1e-3,), holds=(0.2, 1.0, 5.0)))


def test_holds_tell_the_ageing_that_one_speed_leaves_open(planned):
    """At one speed every stick lasts as long: strength and its growth in time go together. Holds part them."""
    (log,) = planned.logs
    assert log.design.holds == pytest.approx((0.2, 1.0, 5.0)) and set(log.tells) == {"mu_s", "t_cr"}
    assert all(planned.then[i] < 0.2 for i in planned.knowledge.wanted)
    steady = plan(scene(), (), Choices(speeds=(5e-3,), holds=(1e-3,), budget=65.0))
    at = planned.knowledge.names.index("t_cr")
    assert steady.then[at] > 3.0 * planned.then[at]


def test_a_log_of_many_cycles_counts_its_first_stick_once():
    """The first stick starts from a fresh contact; those after it are alike, and add in proportion."""
    made = rehearsed(Design(1e-3, 1.0))
    told = [made.information(1000.0, 25e-6, 1e-4, times) for times in (1.0, 2.0, 3.0, 8.0)]
    np.testing.assert_allclose(told[2] - told[1], told[1] - told[0], rtol=1e-9)
    assert np.all(np.diag(told[3]) < 8.0 * np.diag(told[0])) and np.all(np.diag(told[3]) > np.diag(told[1]))
    np.testing.assert_allclose(made.information(1000.0, 25e-6, 1e-4, 0.5), 0.5 * told[0])


def test_the_drop_and_its_slopes_are_those_of_the_simulator():
    """Of a quasi-static slip without ageing the drop is twice the step of friction; with more mu_s it grows by two."""
    made = rehearsed(Design(1e-4, 1.0), free=("mu_s", "mu_k0"))
    more = rehearsed(Design(1e-4, 2.0), free=("mu_s", "mu_k0"))
    assert 0.25 < made.drop < 2.0 * 0.32 and more.drop > 1.5 * made.drop
    assert 0.5 < made.drop_slopes[0] < 2.5 and made.drop_slopes[1] < 0.0


def test_a_softer_spring_is_rehearsed_with_the_damping_ratio_kept():
    unknowns = from_scene(scene())
    base = unknowns.base(RIG)
    softer = dict(zip(unknowns.names, base_of(unknowns, base, Design(1e-3, 1.0, 735.0)).tolist(), strict=True))
    assert softer["stiffness"] == 735.0 and softer["damping"] == pytest.approx(73.5) and softer["mass"] == 0.2
    soft, stiff = rehearsed(Design(1e-3, 1.0, 735.0)), rehearsed(Design(1e-3, 1.0))
    assert soft.duration / soft.slips > 1.5 * stiff.duration / stiff.slips


def test_the_price_of_a_wrong_stiffness_is_that_of_the_friction_level(planned):
    """All forces before a slip are mu_s N: a wrong mass does not move mu_s in slow sticks as it moves nothing else."""
    assert set(planned.price) == {"mass", "stiffness", "damping", "drive_speed"}
    assert all(np.all(np.isfinite(shift)) and np.all(shift >= 0.0) for shift in planned.price.values())
    text = said(planned)
    assert "the price of a wrong rig" in text and "holds of 0.2, 1 and 5 s between runs at 1 mm/s" in text
    assert (verdict(0.1), verdict(0.5), verdict(5.0)) == ("identified", "weak", "not identifiable")


def test_the_table_holds_every_step(planned):
    rows = list(csv.DictReader(step_table(planned).splitlines()))
    holds = [float(row["duration_s"]) for row in rows if row["what"] == "hold"]
    assert holds == pytest.approx(list(planned.logs[0].design.holds) * planned.logs[0].times)
    total = sum(float(row["duration_s"]) for row in rows)
    assert total == pytest.approx(planned.logs[0].duration, rel=1e-2)
    assert {float(row["drive_speed_mm_per_s"]) for row in rows} == {0.0, 1.0}


def test_the_command_plans_and_says_what_is_wrong(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rig = 'mass = "0.2 kg"\nstiffness = "1470 N/m"\ndamping = "147 N/m"\ndrive_speed = "1 mm/s"\nnormal_force = "1 N"\n'
    free = "".join(f"{n} = {{ fixed = {v} }}\n" for n, v in DEMO.items() if n not in ("mu_s", "t_cr"))
    text = f"effects = {json.dumps(EFFECTS)}\n[rig]\n{rig}[parameters]\nmu_s = {{ start = 0.62 }}\nt_cr = {{ start = 0.5 }}\n"
    (tmp_path / "pair.toml").write_text(text + free)
    options = ["--speed", "1 mm/s", "--hold", "0.2 s,1 s,5 s", "--out", "steps.csv", "--json"]
    assert cli.main(["plan", "pair.toml", *options]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["verdicts"] == {"mu_s": "identified", "t_cr": "identified"}
    assert document["now"]["t_cr"] is None and document["then"]["t_cr"] < 0.2
    assert (tmp_path / "steps.csv").read_text().startswith("log,step,drive_speed_mm_per_s")
    for wrong, words in ((["--for", "a"], "a is not searched"), (["--speed", "-1 mm/s"], "positive")):
        assert cli.main(["plan", "pair.toml", *wrong]) == 2
        assert words in capsys.readouterr().err
    with pytest.raises(IdentifyError, match="slips with the values of this scene"):
        plan(scene(stiffness=1e6), (), Choices(speeds=(1e-2,), holds=(1.0,)))
