"""What a log is expected to tell, against longer simulations and closed forms; `stickslip plan`."""

import json
from dataclasses import replace

import numpy as np
import pytest

from data_io import Record
from experiments.batch_trials import SCENE as PAIR
from experiments.study_problem import DEMO, NOISE, RIG
from identify import Scene, fit
from identify.base.document import as_json
from identify.bench.design import LogDesign, promised, simulated_log
from identify.bench.plan import Choices, driven, plan
from identify.cli import main as cli
from identify.effects import MAIN
from identify.estimation.covariance import inverse
from identify.logs.log_data import LogData
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.shooting.layout import BOUNDED_START_SD
from identify.simulation.drive import Drive, NormalForce
from identify.simulation.simulate import run
from tests.support.fake_fit import fit_of_a_scene, with_verdicts
from tests.support.finding import find

ALL = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")


def scene(free=("mu_s", "t_cr"), **rig):
    """All but some parameters are known."""
    parameters = {name: {"start": v} if name in free else {"fixed": v} for name, v in DEMO.items()}
    stated = {**RIG, "drive_speed": 1e-3, "normal_force": 1.0, "noise": 5e-3, **rig}
    effects = [*MAIN, "varying_normal_force"]
    return Scene.from_document({"effects": effects, "rig": stated, "parameters": parameters})


def simulated(design, free=("mu_s", "t_cr"), values=DEMO | RIG, longest=60.0):
    unknowns = from_scene(scene(free))
    base = unknowns.base({name: values[name] for name in RIG})
    theta = unknowns.theta(np.array([values[name] for name in unknowns.names]), base)
    return simulated_log(unknowns, theta, base, design, longest)


@pytest.fixture(scope="module")
def planned():
    return plan(scene(), (), Choices(speeds=(1e-3, 3e-3)))


def test_information_is_that_of_differences_of_the_simulator():
    """Over twelve cycles, of which some repeat the last one simulated; a part of a log informs as that part."""
    made, model = simulated(LogDesign(1e-3, 1.0), ALL), assemble((*MAIN, "varying_normal_force"))
    assert made.period > 0.0 and made.sticks.size < 12
    time, step, rate, variance = np.arange(0.0, made.duration(12.0), 5e-4), 1e-5, 1000.0, 25e-6

    def force(start, **changes):
        values = DEMO | RIG | changes
        return run(model, values, 1e-3, 1.0, time[-1], start=start, accuracy=1e-11).sample(time)["force"]

    columns = []
    for name in (name for name in model.parameter_names if name in ALL):
        up, down = (force({}, **{name: DEMO[name] * (1.0 + sign * step)}) for sign in (1.0, -1.0))
        columns.append((up - down) / (2.0 * step * (1.0 if name in ("a", "D", "t_cr") else DEMO[name])))
    columns += [(force({name: size}) - force({})) / size for name, size in (("elongation", 1e-9), ("gamma", 1e-5))]
    jacobian, f = np.stack(columns, axis=1), len(ALL)
    total = rate / variance * 5e-4 * jacobian.T @ jacobian
    total[-1, -1] += BOUNDED_START_SD**-2.0
    true = total[:f, :f] - total[:f, f:] @ np.linalg.solve(total[f:, f:], total[f:, :f])
    size = np.sqrt(np.outer(np.diag(true), np.diag(true)))
    # Between directions that hardly differ these tell nothing: a switch that passes a sample bends the difference.
    assert np.max(np.abs(made.information(rate, variance, 0.0, 12.0) - true) / size) < 0.01
    half, whole, exact, loose = (
        made.information(rate, variance, sd, cycles) for sd, cycles in ((1e-4, 0.5), (1e-4, 1), (0, 12), (1e-2, 12))
    )
    np.testing.assert_allclose(half, 0.5 * whole)
    # Slips whose loads repeat exactly would time every onset: a promise that no record keeps.
    known, open_ = (np.diag(np.linalg.inv(matrix)) for matrix in (exact, loose))
    assert np.max(open_ / known) > 3.0


def test_the_load_acts_as_all_coefficients_together():
    """Friction is load times a coefficient that is linear in these three: Euler's theorem on homogeneous functions."""
    names = [name for name in assemble((*MAIN, "varying_normal_force")).parameter_names if name in ALL]
    slopes = simulated(LogDesign(1e-4, 1.0), ALL).slopes
    by_theta, by_load = slopes[..., -len(names) - 1 : -1], slopes[..., -1]
    together = sum(DEMO[name] * by_theta[..., names.index(name)] for name in ("mu_s", "mu_k0", "delta_mu_k"))
    # Sensitivities are differences, and a force between nodes is a cubic.
    assert np.max(np.abs(by_load)) > 0.1 and np.max(np.abs(by_load - together)) < 1e-3 * np.max(np.abs(by_load))
    assert np.max(np.abs(by_load - 1.01 * together)) > 5e-3 * np.max(np.abs(by_load))


def test_a_log_in_which_the_spring_pulls_the_mass_back_is_none_to_ask_for():
    pair = {"mu_s": 0.4053, "mu_k0": 0.1612, "delta_mu_k": -0.07649, "a": 606.2, "D": 39.93e-6, "t_cr": 0.4138}
    rig = {"mass": 0.2006, "stiffness": 1901.0, "damping": 158.9}
    made = []
    for damping in (rig["damping"], 3 * rig["damping"]):  # with more of it the mass stops before the spring is loose
        values = pair | rig | {"damping": damping}
        motion = run(assemble(MAIN), values, 1e-4, 1.0, 20.0)
        made.append((motion.arrests.size - motion.onsets.size, simulated(LogDesign(1e-4, 1.0), ALL, values, 20.0)))
    assert made[0][0] > 0 and made[0][1] is None
    assert made[1][0] <= 0 and made[1][1] is not None


def test_errors_of_rig_and_sensors_are_lowered_by_no_log(planned):
    known = replace(planned.knowledge, systematic=np.array([0.0, 0.05**2]))
    exact, more = (k.halves(1e9 * np.array([np.eye(2)] * 4)) for k in (planned.knowledge, known))
    assert np.all(exact < 1e-3) and np.allclose(more[:, 1], np.expm1(1.96 * 0.05), rtol=1e-3)


def recorded(pair, speed, duration, rate, seed):
    """A log from rest with a fresh contact, with white noise."""
    time = np.arange(int(duration * rate) + 1) / rate
    force = run(assemble(MAIN), pair | RIG, speed, 1.0, duration).sample(time)["force"]
    noise = NOISE * np.random.default_rng(seed).standard_normal(time.size)
    return Record(time, np.ones(time.size), force + noise)


def with_logs(pair, free, logs):
    """A scene of logs of (speed, duration, rate) in which all but some parameters are known; their records."""
    parameters = {n: {"start": 1.2 * pair[n]} if n in free else {"fixed": pair[n]} for n in pair}
    entries = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, _, _) in enumerate(logs)]
    stated = {"effects": [*MAIN, "varying_normal_force"], "rig": dict(RIG), "logs": entries, "parameters": parameters}
    return Scene.from_document(stated), [recorded(pair, *log, seed) for seed, log in enumerate(logs, 1)]


# What is free, the pair, and a log that does not show it: slips of seven samples, and sticks that end too soon.
UNSEEN = ("a", "delta_mu_k"), DEMO, (1e-4, 9.0, 100.0)
TOO_SHORT = ("t_cr", "mu_s"), DEMO | {"t_cr": 2.0}, (1e-3, 2.0, 500.0)


@pytest.mark.parametrize(("free", "pair", "log"), [UNSEEN, pytest.param(*TOO_SHORT, marks=pytest.mark.slow)])
def test_the_planned_log_identifies_what_it_is_to_identify(free, pair, log, no_predictions):
    """The fit of both logs knows nothing of the simulator's sensitivities: its covariance is that of the shooting."""
    before = fit(*with_logs(pair, free, [log]), time_limit=300).typed
    assert before.parameters[free[0]].verdict in ("weak", "not identifiable")
    made = plan(with_logs(pair, free, [log])[0], (), Choices(targets=free), before).logs
    more = [(each.design.speed, each.duration, each.rate) for each in made]
    after = fit(*with_logs(pair, free, [log, *more]), time_limit=300).typed.parameters[free[0]]
    low, high = after.interval_rig_exact  # a plan knows of no errors of rig and sensors that no log has shown yet
    names = [name for name in DEMO if name in free]
    assert low < pair[free[0]] < high
    assert 0.5 * (high - low) / after.value < promised(made[-1].halves)[names.index(free[0])] < 0.2


def test_simulated_logs_promise_what_the_fit_of_these_logs_knows():
    """At the answer, for all six parameters: the covariance of the fit knows nothing of the simulator."""
    made = with_logs(DEMO, tuple(DEMO), [(1e-4, 10.0, 500.0), (2e-3, 2.0, 1000.0)])
    findings = find(*made, progress=lambda _stage, _share: None)[1]
    unknowns, theta = findings.unknowns, findings.attempt.solved.theta
    total = unknowns.prior_precision[np.ix_(unknowns.free, unknowns.free)]
    for log in findings.attempt.fitted_logs:
        data, seconds = log.data, log.data.end - log.data.begin
        trial = simulated_log(unknowns, theta, data.base, LogDesign(data.drive_speed, log.mean_load), seconds)
        cycles = trial.count(seconds)
        total = total + trial.information(1.0 / data.interval, data.noise**2, data.normal_force_sd, cycles)
    ratio = np.sqrt(np.diag(findings.sure.allowed.white) / np.diag(inverse(total)))
    assert np.all(ratio > 0.8) and np.all(ratio < 1.15), ratio


def test_speeds_of_a_programme_count_for_as_long_as_they_were_driven():
    data = LogData(*(np.arange(3.0),) * 3, np.ones(1), 1e-3, NormalForce.of(1.0), 0.0, 0.5, 9.0)
    assert driven(data) == [(1e-3, 8.5)]
    programme = Drive.of(((0.0, 1e-3), (2.0, 0.0), (3.0, -5e-3), (9.5, 1e-2)))
    assert driven(replace(data, programme=programme)) == [(1e-3, 1.5), (5e-3, 6.0)]


SCENE = (
    PAIR.replace("]", ', "varying_normal_force"]', 1) + 'drive_speed = "1 mm/s"\nnormal_force = "1 N"\n[parameters]\n'
)


@pytest.fixture
def ask(tmp_path, monkeypatch, capsys):
    """The document of `stickslip plan` in a folder of its own, at one drive speed."""
    monkeypatch.chdir(tmp_path)

    def document(source, *options):
        assert cli.main(["plan", source, "--speed", "1 mm/s", *options, "--json"]) in (0, 3)
        return json.loads(capsys.readouterr().out)

    return document


def test_what_is_assumed_is_named_and_the_answer_is_a_range(tmp_path, ask, capsys):
    fixed = "".join(f"{n} = {{ fixed = {v} }}\n" for n, v in DEMO.items() if n not in ("mu_s", "t_cr"))
    (tmp_path / "pair.toml").write_text(SCENE + fixed + "mu_s = { start = 0.62 }\n")
    document = ask("pair.toml", "--out", "steps.csv")
    assert document["verdicts"] == {"mu_s": "identified", "t_cr": "identified"} and document["assumed"] == ["t_cr"]
    assert document["now"]["t_cr"] is None and document["then"]["t_cr"] < 0.2
    low, high = document["ranges"]["then"]["t_cr"]
    assert low < 0.8 * high and (tmp_path / "steps.csv").read_text().startswith("log,drive_speed_mm_per_s")
    for wrong, words in ((["--for", "a"], "a is not searched"), (["--speed", "-1 mm/s"], "positive number")):
        assert cli.main(["plan", "pair.toml", *wrong]) == 2
        assert words in capsys.readouterr().err


def test_holds_are_proposed_where_sticks_are_too_short_for_the_creep_time(tmp_path, ask):
    fixed = "".join(f"{n} = {{ fixed = {v} }}\n" for n, v in DEMO.items() if n not in ("mu_s", "t_cr"))
    starts = "mu_s = {{ start = 0.62 }}\nt_cr = {{ start = {} }}\n"
    (tmp_path / "pair.toml").write_text(SCENE + fixed + starts.format(20))
    options = ("--set", "rig.noise=0.02", "--budget", "4 min")
    told, without = ask("pair.toml", *options), ask("pair.toml", *options, "--no-holds")
    assert without["holds"] is None and without["then"]["t_cr"] is None, "sticks of a third of a second leave it open"
    assert told["holds"]["seconds"] == [6.0, 20.0, 60.0] and told["verdicts"]["t_cr"] in ("weak", "identified")
    seconds = np.array(told["holds"]["seconds"])
    fresh = np.exp(-seconds / 20.0)  # static coefficient after a hold: by mu_s, and by the logarithm of t_cr
    slopes = np.stack([1.0 - fresh, -(0.62 - DEMO["mu_k0"]) * fresh * seconds / 20.0])
    by_numpy = np.linalg.inv(slopes @ slopes.T / (0.02**2 + (1e-3 * 0.62) ** 2))
    low, high = told["ranges"]["then"]["t_cr"]
    assert low <= np.expm1(1.96 * np.sqrt(by_numpy[1, 1])) * 1.05 and high < 2.0
    (tmp_path / "short.toml").write_text(SCENE + fixed + starts.format(0.5))
    assert ask("short.toml")["holds"] is None, "sticks show it"


@pytest.mark.parametrize("open_", [False, True])
def test_a_fit_is_planned_from_its_estimates_at_the_load_of_its_logs(tmp_path, ask, open_):
    """What is not identifiable has no standard error: it is as open as before, and the plan is for just that."""
    fit = with_verdicts(fit_of_a_scene()) if open_ else fit_of_a_scene()
    logs = [log | {"normal_force_N": 0.5} for log in fit.result["logs"]]
    (tmp_path / "result.json").write_text(as_json(fit.result | {"logs": logs}))
    document = ask("result.json")
    assert document["status"] in ("done", "nothing_to_add") and document["now"]["mu_s"] is not None
    assert (document["now"]["a"] is None or document["now"]["a"] > 1.0) == open_
    assert {log["normal_force"] for log in document["logs"]} <= {0.5} and (document["logs"] or not open_)


def test_one_speed_is_repeated_where_each_stands_in_one_log(tmp_path, ask):
    result = fit_of_a_scene().result

    def told(**tolerances):
        scene = result["provenance"]["scene"] | ({"tolerances": tolerances} if tolerances else {})
        provenance = result["provenance"] | {"scene": Scene.from_document(scene).as_document()}
        (tmp_path / "result.json").write_text(as_json(result | {"provenance": provenance}))
        return ask("result.json")

    first = told()
    assert "a" in first["measured"] and first["assumed"] == []
    assert [log["repeats"] for log in first["logs"]][:1] == [True]
    assert first["logs"][0]["drive"] in [abs(log["drive_speed_m_per_s"]) for log in result["logs"]]
    assert not any(log["repeats"] for log in told(specimen=0)["logs"])
