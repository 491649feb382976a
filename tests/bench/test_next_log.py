"""The log that would tell: a rehearsal knows what a fit of the log knows, and a log that is asked for tells what it is
to tell."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, NOISE, RIG, SPEEDS, scene_of, simulated_case
from identify import Scene, fit, identification
from identify.base.result import NextLogResult
from identify.bench import next_log as choosing
from identify.bench import next_log as words
from identify.bench import rehearsal
from identify.bench.designs import SAFE, driven
from identify.bench.next_log import Advice, next_logs
from identify.bench.rehearsal import LogDesign, rehearse
from identify.effects import MAIN
from identify.identification import find
from identify.logs.log_data import LogData
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.simulation.drive import Drive, NormalForce
from identify.simulation.simulate import run


@pytest.fixture(scope="module")
def four_logs():
    case = simulated_case(DEMO, 17)
    _, found = find(scene_of(case), case.records, progress=lambda _stage, _share: None)
    return found


def recorded(pair, speed, duration, rate, seed):
    """A log from rest with a fresh contact, with white noise."""
    time = np.arange(int(duration * rate) + 1) / rate
    force = run(assemble(MAIN), pair | RIG, speed, 1.0, duration).sample(time)["force"]
    noise = NOISE * np.random.default_rng(seed).standard_normal(time.size)
    return Record(time, np.ones(time.size), force + noise)


def scene(pair, free, speeds):
    """All but some parameters are known."""
    parameters = {n: {"start": 1.2 * pair[n]} if n in free else {"fixed": pair[n]} for n in pair}
    logs = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, speed in enumerate(speeds)]
    effects = [*MAIN, "varying_normal_force"]
    return Scene.from_document({"effects": effects, "rig": dict(RIG), "logs": logs, "parameters": parameters})


def found_in(pair, free, logs):
    """The findings from logs of (speed, duration, rate), and their records."""
    records = [recorded(pair, *log, seed) for seed, log in enumerate(logs, 1)]
    made = scene(pair, free, [speed for speed, _, _ in logs])
    return find(made, records, progress=lambda _stage, _share: None)[1]


def estimate(found, name):
    return next(e for e in found.estimates if e.name == name)


# What is free, the pair, and a log that does not tell it: slips of seven samples, and sticks that end too soon.
UNSEEN = ("a", "delta_mu_k"), DEMO, (1e-4, 9.0, 100.0)
TOO_SHORT = ("t_cr", "mu_s"), DEMO | {"t_cr": 2.0}, (1e-3, 2.0, 500.0)


@pytest.fixture(scope="module")
def unseen():
    free, pair, log = UNSEEN
    return found_in(pair, free, [log])


def rehearsed(found, *, load_sd: float | None = None) -> np.ndarray:
    """Standard errors (f,) that rehearsals of the fitted logs promise."""
    total = np.zeros((6, 6))
    for log in found.attempt.fitted_logs:
        data, seconds = log.data, log.data.end - log.data.begin
        theta = found.attempt.solved.theta
        made = rehearse(found.unknowns, theta, data.base, LogDesign(data.drive_speed, log.mean_load), 1e-4, seconds)
        known = data.normal_force_sd if load_sd is None else load_sd
        total += seconds / made.duration * made.information(1.0 / data.interval, data.noise**2, known)
    return np.sqrt(np.diag(np.linalg.inv(total)))


def test_rehearsals_promise_what_the_fit_of_the_logs_knows(four_logs):
    """The covariance of the fit comes from the shooting, and knows nothing of the simulator that rehearses."""
    told = np.sqrt(np.diag(four_logs.sure.white))
    ratio = told / rehearsed(four_logs)
    assert np.all(ratio > 0.8) and np.all(ratio < 1.15), ratio
    # Slips whose loads repeat exactly would time every onset: a promise that no record keeps.
    assert np.max(told / rehearsed(four_logs, load_sd=0.0)) > 1.7


def test_what_a_rehearsal_promises_does_not_hang_on_the_step_of_its_differences(monkeypatch):
    """Short slips with a contact that re-ages in the last 0.1 ms of each: what two logs hardly tell together."""
    pair = {"mu_s": 0.64, "mu_k0": 0.473, "delta_mu_k": -0.103, "a": 107.5, "D": 15.8e-6, "t_cr": 0.146}
    unknowns = from_scene(scene(pair, tuple(pair), [1e-3]))
    base = unknowns.base(RIG)
    theta = unknowns.theta(np.array([(pair | RIG)[name] for name in unknowns.names]), base)

    def errors(step):
        monkeypatch.setattr(rehearsal, "STEP", step)
        made = [rehearse(unknowns, theta, base, LogDesign(speed, 1.0), 2e-4, 60.0) for speed in (1e-3, 1e-4)]
        total = sum(one.information(500.0, NOISE**2, 1e-4) for one in made)
        return np.sqrt(np.diag(np.linalg.inv(total)))

    fine, coarse = errors(1e-6), errors(1e-4)
    np.testing.assert_allclose(coarse, fine, rtol=0.01)
    monkeypatch.setattr(rehearsal, "_same_moments", lambda _seen, _other, times, *_: times)
    assert np.max(fine / errors(1e-4)) > 3.0, "compared at fixed times it hangs on the step, and promises too much"


def test_slopes_of_a_rehearsal_are_those_of_the_closed_forms():
    """Of a stick, in which the force rises as k v t: one cycle shifts by what the friction at its ends shifts."""
    case = simulated_case(DEMO, 17)
    unknowns = from_scene(scene_of(case))
    base = unknowns.base(RIG)
    theta = unknowns.theta(np.array([(DEMO | RIG)[name] for name in unknowns.names]), base)
    speed = SPEEDS[1][0]
    made = rehearse(unknowns, theta, base, LogDesign(speed, 1.0), 1e-4, 20.0)
    names = [unknowns.names[i] for i in np.flatnonzero(unknowns.free)]
    at = names.index("mu_s")
    gram = made.slopes.T @ (made.slopes * made.weights[:, None])
    heavier = made.shared
    # The load acts as mu_s and mu_k0 do together, each by its share: F_onset = (mu_k0 + (mu_s - mu_k0) gamma) N.
    loads = gram[heavier:, heavier:].sum()
    both = [at, names.index("mu_k0"), names.index("delta_mu_k")]
    share = np.array([DEMO["mu_s"], DEMO["mu_k0"], DEMO["delta_mu_k"]])
    together = share @ gram[np.ix_(both, both)] @ share
    assert loads == pytest.approx(together, rel=1e-3)
    assert gram[at, at] != pytest.approx(together, rel=0.1)


def test_a_log_in_which_the_spring_pulls_the_mass_back_is_none_to_ask_for():
    pair = {"mu_s": 0.4053, "mu_k0": 0.1612, "delta_mu_k": -0.07649, "a": 606.2, "D": 39.93e-6, "t_cr": 0.4138}
    rig = {"mass": 0.2006, "stiffness": 1901.0, "damping": 158.9}
    unknowns = from_scene(scene_of(simulated_case(DEMO, 1)))
    made = []
    for damping in (rig["damping"], 3 * rig["damping"]):  # with more of it the mass stops before the spring is loose
        values = pair | rig | {"damping": damping}
        base = unknowns.base(rig | {"damping": damping})
        theta = unknowns.theta(np.array([values[name] for name in unknowns.names]), base)
        motion = run(assemble(MAIN), values, 1e-4, 1.0, 20.0)
        told = rehearse(unknowns, theta, base, LogDesign(1e-4, 1.0), 3e-4, 20.0)
        made.append((motion.arrests.size - motion.onsets.size, told))
    assert made[0][0] > 0 and made[0][1] is None
    assert made[1][0] <= 0 and made[1][1] is not None


def test_nothing_is_asked_for_where_all_is_identified(four_logs):
    assert next_logs(four_logs) is None


@pytest.mark.parametrize(("free", "pair", "log"), [pytest.param(*UNSEEN, marks=pytest.mark.slow), TOO_SHORT])
def test_the_log_that_is_asked_for_tells_what_it_is_to_tell(free, pair, log):
    (name, *_) = free
    before = found_in(pair, free, [log])
    assert estimate(before, name).verdict in ("weak", "not identifiable")
    advice = next_logs(before)
    (asked,) = advice.logs
    assert name in asked.expected and not advice.untold
    after = found_in(pair, free, [log, (asked.drive_speed, asked.duration, asked.sampling_rate)])
    told = estimate(after, name)
    assert told.verdict == "identified" and told.lower < pair[name] < told.upper
    assert 0.5 * (told.upper - told.lower) / told.value < 1.2 * asked.expected[name]


@pytest.mark.slow
def test_another_log_like_the_first_would_not_have_told(unseen):
    free, pair, log = UNSEEN
    (asked,) = next_logs(unseen).logs
    assert asked.duration < log[1]
    assert estimate(found_in(pair, free, [log, log]), "a").verdict == "not identifiable"


@pytest.mark.slow
def test_a_log_of_many_cycles_is_asked_for_where_few_would_not_do(unseen, monkeypatch):
    (short,) = next_logs(unseen).logs
    monkeypatch.setattr(choosing, "_price", lambda *_: 40.0)
    longer = next_logs(unseen).logs
    assert sum(log.duration for log in longer) > 2.0 * short.duration
    assert sum(log.slips for log in longer) > short.slips
    assert all(log.expected["a"] <= SAFE * 0.2 for log in longer), "each of them is needed"
    monkeypatch.setattr(choosing, "_price", lambda *_: 1e9)
    nothing = next_logs(unseen)
    assert nothing.logs == () and nothing.untold == ("a",)


def test_speeds_of_a_programme_count_for_as_long_as_they_were_driven():
    data = LogData(*(np.arange(3.0),) * 3, np.ones(1), 1e-3, NormalForce.of(1.0), 0.0, 0.5, 9.0)
    assert driven(data) == [(1e-3, 8.5)]
    programme = Drive.of(((0.0, 1e-3), (2.0, 0.0), (3.0, -5e-3), (9.5, 1e-2)))
    assert driven(replace(data, programme=programme)) == [(1e-3, 1.5), (5e-3, 6.0)]


@pytest.fixture(scope="module")
def advice(unseen):
    return next_logs(unseen)


def test_reasons_and_the_result_name_the_log(unseen, advice, monkeypatch):
    """The fit itself and its advice are those of the fixtures: made twice, they are the same."""
    free, pair, log = UNSEEN
    monkeypatch.setattr(identification, "plain_or_uneven", lambda *_: (unseen.attempt.fitted_logs, unseen))
    monkeypatch.setattr(identification, "next_logs", lambda found: advice if found.attempt is unseen.attempt else None)
    reason = estimate(words.advised(unseen, advice), "a").reason
    assert reason.startswith("slips hold at most 7 samples, so their shape is not seen: add a log of 2.8 s at 1 mm/s")
    assert "and 1 N, sampled at 1000 Hz, which is expected to tell it to 5 %" in reason
    (entry,) = map(asdict, advice.logs)
    assert set(entry) == {"drive_speed", "normal_force", "duration", "sampling_rate", "slips", "expected"}
    result = fit(scene(pair, free, [log[0]]), [recorded(pair, *log, 1)]).result
    assert result["next_logs"] == [entry] and result["parameters"]["a"]["reason"] == reason


def test_what_no_log_would_tell_is_said(unseen):
    said = words.advised(unseen, Advice((), ("a",), 60.0))
    words_of_a = "; as far as these logs tell, none of up to 60 s at one speed, this load and on this rig would tell it"
    assert words_of_a in estimate(said, "a").reason
    assert not any("none of up to" in e.reason for e in said.estimates if e.name != "a")
    # Beside a log that tells another parameter it is too soon to say so.
    other = NextLogResult(0.02, 1.0, 60.0, 500.0, 3, {"D": 0.004})
    assert estimate(words.advised(unseen, Advice((other,), ("a",), 60.0)), "a") == estimate(unseen, "a")
    assert (
        "which is expected to tell it to 1 %" in estimate(words.advised(unseen, Advice((other,), (), 60.0)), "D").reason
    )


def test_a_reason_that_is_no_hint_keeps_its_words(unseen):
    own = [replace(e, reason="its own") if e.name == "a" else e for e in unseen.estimates]
    log = NextLogResult(0.02, 1.5, 99.0, 5000.0, 3, {"a": 0.15})
    kept = words.advised(replace(unseen, sure=replace(unseen.sure, estimates=own)), Advice((log,), (), 60.0))
    assert estimate(kept, "a").reason == (
        "its own; add a log of 99 s at 20 mm/s and 1.5 N, sampled at 5000 Hz, which is expected to tell it to 15 %"
    )
