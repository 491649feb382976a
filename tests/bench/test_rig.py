"""`stickslip rig`: what taps, pulls and added masses tell of a rig, known from the closed form of a damped swing."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from data_io import Record, write_csv
from experiments.rig_records import pulled, tapped
from identify import Scene, SceneError
from identify.base.errors import IdentifyError
from identify.bench.rig import Measured, calibrated, rig_toml, rings
from identify.bench.ringdown import ring_downs
from identify.cli import main as cli
from identify.effects import MAIN
from identify.logs.unknowns import from_scene

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
OMEGA, ZETA = np.sqrt(1470.0 / 0.2), 0.05


def swing(rate=500.0, noise=0.0, zeta=ZETA, frequency=OMEGA, seconds=3.0):
    """A ring-down as the closed form has it, at rest before it."""
    time = np.arange(int(seconds * rate)) / rate
    t = np.clip(time - 0.5, 0.0, None)
    force = np.exp(-zeta * frequency * t) * np.sin(frequency * np.sqrt(1 - zeta**2) * t) + 0.1 + 0.02 * time
    return time, force + noise * np.random.default_rng(0).standard_normal(time.size)


def test_a_damped_swing_is_found_to_the_last_digits():
    (tap,) = ring_downs(*swing(noise=1e-7))
    assert tap.frequency == pytest.approx(OMEGA, rel=1e-6) and tap.zeta == pytest.approx(ZETA, rel=1e-5)


def test_errors_are_those_of_repeats():
    """Over new noise, deviations over their errors scatter by one."""
    random, off = np.random.default_rng(1), []
    time, clean = swing(rate=200.0)
    for _ in range(50):
        (tap,) = ring_downs(time, clean + 0.01 * random.standard_normal(time.size))
        off.append((np.log(tap.frequency / OMEGA) / tap.frequency_error, np.log(tap.zeta / ZETA) / tap.zeta_error))
    assert np.all(np.abs(np.std(off, axis=0) - 1.0) < 0.3), np.std(off, axis=0)


def rubbed(random):
    """A ring-down in a guide that rubs, integrated numerically; zeta and the dry friction force [N]."""
    zeta, dry = float(np.exp(random.uniform(np.log(0.001), np.log(0.02)))), random.uniform(0.006, 0.04)

    def moves(_, state, way):
        return state[1], -(OMEGA**2) * (state[0] + way * dry) - 2 * zeta * OMEGA * state[1]

    def turns(_, state, way):
        return state[1] * way

    turns.terminal, turns.direction = True, -1
    rate, begin, state = random.choice([300.0, 500.0, 1000.0]), 0.0, np.array([random.choice([-1.0, 1.0]), 0.0])
    time = np.arange(int(4.0 * rate)) / rate
    force = np.full(time.size, 0.0)
    while begin < 4.0 and abs(state[0]) > dry:
        way, ends = -np.sign(state[0]), begin + 0.75 * 2 * np.pi / OMEGA
        start, options = [state[0], 1e-6 * way], {"rtol": 1e-8, "atol": 1e-10, "dense_output": True}
        half = solve_ivp(moves, (begin, ends), start, events=turns, args=(way,), max_step=0.02, **options)
        rows = (time >= begin) & (time <= half.t[-1])
        force[rows] = half.sol(time[rows])[0]
        begin, state = half.t[-1], half.y[:, -1]
    force[time > begin] = state[0]
    noise = random.uniform(0.0005, 0.005) * random.standard_normal(time.size + 100)
    before = np.arange(100) / rate
    return np.concatenate([before, time + 100 / rate]), np.concatenate([0.0 * before, force]) + noise, zeta, dry


def test_dry_friction_of_a_guide_is_told_apart_from_damping():
    """Over five random rigs the intervals hold the truth, and the friction is named."""
    random, inside = np.random.default_rng(7), []
    for _ in range(5):
        time, force, zeta, dry = rubbed(random)
        (tap,) = ring_downs(time, force)
        assert tap.dry == pytest.approx(dry, rel=0.1) and tap.frequency == pytest.approx(OMEGA, rel=2e-3)
        inside.append(abs(np.log(tap.zeta / zeta)) < 3.0 * tap.zeta_error)
        told = rings(Record(time, np.ones(time.size), force), "tap.csv")
        assert all("die along a straight line" in m.source for m in told)
        assert len(told) == (2 if tap.zeta_error < 1.0 else 1)
    assert sum(inside) >= 4, inside


def test_without_dry_friction_none_is_named():
    random, named = np.random.default_rng(8), 0
    for _ in range(25):
        time, force = swing(noise=0.0, zeta=float(np.exp(random.uniform(np.log(0.003), np.log(0.1)))))
        named += any(tap.dry for tap in ring_downs(time, force + 0.01 * random.standard_normal(time.size)))
    assert named <= 1


def test_a_lag_of_the_load_cell_changes_nothing_that_is_told():
    record = tapped(RIG, 0.01, 500.0, 0.003, np.random.default_rng(2))
    taps = ring_downs(record.time, record.friction_force)
    assert len(taps) == 3
    for tap in taps:
        assert tap.frequency == pytest.approx(OMEGA, rel=4 * tap.frequency_error)
        assert tap.zeta == pytest.approx(ZETA, rel=4 * tap.zeta_error)


def test_what_does_not_ring_down_is_no_tap_and_a_swing_of_few_samples_is_refused():
    time = np.arange(1200) / 300.0
    random = np.random.default_rng(3)
    assert ring_downs(time, random.standard_normal(time.size)) == []
    assert ring_downs(time, np.sin(OMEGA * time) + 0.01 * random.standard_normal(time.size)) == []  # goes on
    with pytest.raises(IdentifyError, match=r"3.3 samples per swing.*sample at 900 Hz or more"):
        ring_downs(*swing(rate=150.0, frequency=2 * np.pi * 45.0, zeta=0.01, noise=1e-3))


def test_mass_and_stiffness_follow_from_two_taps_one_with_a_known_mass():
    """k = added w0^2 w1^2/(w0^2 - w1^2), and the error of the added mass is that of both."""
    heavier = np.sqrt(1470.0 / 0.25)
    measured = [
        Measured("frequency", OMEGA, 1e-6, "bare"),
        Measured("frequency", heavier, 1e-6, "with 50 g", added=0.05),
        Measured("zeta", ZETA, 0.01, "bare"),
    ]
    rig = calibrated(measured, 0.01, 0.005)
    assert rig.mass.value == pytest.approx(0.2, rel=1e-6) and rig.stiffness.value == pytest.approx(1470.0, rel=1e-6)
    assert rig.mass.tolerance == pytest.approx(0.005, rel=1e-2) and rig.zeta.tolerance == pytest.approx(0.01)
    faster = Measured("frequency", 1.1 * OMEGA, 1e-4, "with 50 g", added=0.05)  # heavier, and yet
    assert calibrated([measured[0], faster], 0.01, 0.005).agreement.widening > 100.0
    alone = calibrated(measured[:1], 0.01, 0.005)
    assert alone.mass is None and alone.missing == ("mass", "stiffness", "zeta")


def test_the_skin_is_told_apart_in_series_and_records_that_disagree_widen_the_intervals():
    series = 1.0 / (1.0 / 1470.0 + 1.0 / 4400.0)
    measured = [
        Measured("stiffness", 1470.0, 1e-3, "block", by_speed=True),
        Measured("series", series, 1e-3, "skin", by_speed=True),
    ]
    rig = calibrated(measured, 0.0, 0.005)
    assert rig.skin_stiffness.value == pytest.approx(4400.0, rel=1e-5) and rig.agreement.widening == 1.0
    # An error of the speed is common to both sticks, and their difference knows it: the ratio k_skin/k does not move.
    loose = calibrated(measured, 0.01, 0.005)
    assert loose.skin_stiffness.tolerance == pytest.approx(np.hypot(rig.skin_stiffness.tolerance, 0.01), rel=0.05)
    off = calibrated([*measured, Measured("stiffness", 1600.0, 1e-3, "another block")], 0.0, 0.005)
    assert off.agreement.widening > 10.0 and "block" in off.agreement.worst


def test_taps_and_a_pull_become_the_priors_of_a_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(5)
    write_csv(tapped(RIG, 0.002, 500.0, 0.003, random), tmp_path / "tap.csv")
    write_csv(pulled(RIG, 0.002, 100.0, 0.003, random), tmp_path / "pull.csv")
    assert cli.main(["rig", "tap.csv", "pull.csv", "--out", "RIG.toml", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    document = {"effects": ["inertia", "hysteresis_damping"], "rig": "RIG.toml"}
    document["logs"] = [{"path": "a.csv", "drive_speed": "1 mm/s"}]
    rig = Scene.from_document(document, tmp_path).rig
    assert rig.tolerances["mass"] == pytest.approx(told["mass"]["tolerance"], rel=0.01)
    assert abs(np.log(rig.mass / 0.2)) < 3 * rig.tolerances["mass"] and 0.01 <= rig.tolerances["stiffness"] < 0.015
    assert rig.zeta == pytest.approx(ZETA, rel=4 * rig.tolerances["damping"])
    (tmp_path / "scene.toml").write_text('effects = ["inertia", "hysteresis_damping"]\nrig = "RIG.toml"\n')
    again = Scene.from_toml(tmp_path / "scene.toml", ["rig.drive_speed=1 mm/s", "rig.mass=0.3 kg"]).rig
    assert again.mass == 0.3 and again.stiffness == rig.stiffness
    assert cli.main(["rig", "tap.csv", "--out", "RIG.toml"]) == 2, "it may hold edits"
    with pytest.raises(SceneError, match="stickslip rig wrote"):
        Scene.from_document(document | {"rig": "no.toml"}, tmp_path)


def tied_scene(*others):
    """The scene of a rig that a pull tells, and other records."""
    measured = [
        Measured("zeta", ZETA, 0.02, "tap"),
        Measured("stiffness", 1470.0, 1e-5, "pull", by_speed=True),
        *others,
    ]
    text = rig_toml(calibrated(measured, 0.01, 0.005), measured)
    return Scene.from_document({"effects": [*MAIN], "rig": tomllib.loads(text) | {"drive_speed": 1e-3}})


def test_what_a_tap_ties_errs_together_in_the_priors():
    """Closed form: m = k/w^2 and h = 2 zeta k, each with the error of k; told as independent, the error that they share
    would count as three, and average out."""
    scene = tied_scene(Measured("frequency", OMEGA, 5e-4, "tap"))
    unknowns = from_scene(scene)
    rig = [unknowns.names.index(name) for name in ("stiffness", "mass", "damping")]
    covariance = np.linalg.inv(unknowns.prior_precision[np.ix_(rig, rig)])
    shared, frequency, zeta = 0.01**2, 5e-4**2, 0.02**2
    expected = shared + np.diag([0.0, 4.0 * frequency, zeta])
    np.testing.assert_allclose(covariance, expected, rtol=1e-3)
    np.testing.assert_allclose(unknowns.prior_deviation[rig] ** 2, np.diag(expected), rtol=1e-3)
    weighed = from_scene(tied_scene(Measured("mass", 0.2, 0.01, "scale")))  # nothing ties that to the stiffness
    assert weighed.prior_about[rig[1]] == -1 and weighed.prior_sd[rig[1]] == pytest.approx(0.01, rel=1e-3)
    again = Scene.from_document(scene.as_document())
    assert np.allclose(from_scene(again).prior_precision, unknowns.prior_precision)


def test_a_stick_on_skin_is_a_log_of_its_own_and_need_not_be_named_twice(tmp_path, capsys):
    """Against the stick on the block it tells the series: 1470 and 4400 N/m rise like 1102 N/m."""
    random = np.random.default_rng(4)
    for name, stiffness in (("block", 1470.0), ("skin", 1470.0 * 4400.0 / (1470.0 + 4400.0))):
        record = pulled({**RIG, "stiffness": stiffness}, 1e-3, 200.0, 2e-3, random)
        write_csv(replace(record, drive_speed=None), tmp_path / f"{name}.csv")
    block, skin, out = (str(tmp_path / name) for name in ("block.csv", "skin.csv", "RIG.toml"))
    assert cli.main(["rig", block, "--skin", skin, "--drive-speed", "0.1 mm/s", "--out", out]) == 0
    assert "skin in series" in capsys.readouterr().out and "skin_stiffness" in (tmp_path / "RIG.toml").read_text()
