"""The log to add: a log that is asked for tells what it is to tell, by a fit after really adding it."""

from dataclasses import replace

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, NOISE, RIG
from identify import Scene
from identify.bench.design import LogDesign, simulated_log
from identify.bench.next_log import next_logs
from identify.bench.plan import driven
from identify.effects import MAIN
from identify.estimation.covariance import inverse
from identify.identification import find
from identify.logs.log_data import LogData
from identify.model.model import assemble
from identify.simulation.drive import Drive, NormalForce
from identify.simulation.simulate import run


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
    """The findings from logs of (speed, duration, rate)."""
    records = [recorded(pair, *log, seed) for seed, log in enumerate(logs, 1)]
    made = scene(pair, free, [speed for speed, _, _ in logs])
    return find(made, records, progress=lambda _stage, _share: None)[1]


def estimate(found, name):
    return next(e for e in found.estimates if e.name == name)


# What is free, the pair, and a log that does not tell it: slips of seven samples, and sticks that end too soon.
UNSEEN = ("a", "delta_mu_k"), DEMO, (1e-4, 9.0, 100.0)
TOO_SHORT = ("t_cr", "mu_s"), DEMO | {"t_cr": 2.0}, (1e-3, 2.0, 500.0)


@pytest.mark.parametrize(("free", "pair", "log"), [UNSEEN, pytest.param(*TOO_SHORT, marks=pytest.mark.slow)])
def test_the_log_that_is_asked_for_tells_what_it_is_to_tell(free, pair, log):
    """The fit of both logs knows of the simulator's sensitivities nothing: its covariance is that of the shooting."""
    name = free[0]
    before = found_in(pair, free, [log])
    assert estimate(before, name).verdict in ("weak", "not identifiable")
    (asked,) = next_logs(before)
    assert name in asked.expected
    after = found_in(pair, free, [log, (asked.drive_speed, asked.duration, asked.sampling_rate)])
    told = estimate(after, name)
    assert told.verdict == "identified" and told.lower < pair[name] < told.upper
    assert 0.5 * (told.upper - told.lower) / told.value < asked.expected[name]


def test_simulated_logs_promise_what_the_fit_of_these_logs_knows():
    """At the answer, for all six parameters: the covariance of the fit knows nothing of the simulator."""
    found = found_in(DEMO, tuple(DEMO), [(1e-4, 10.0, 500.0), (2e-3, 2.0, 1000.0)])
    total = found.unknowns.prior_precision[np.ix_(found.unknowns.free, found.unknowns.free)]
    for log in found.attempt.fitted_logs:
        data, seconds = log.data, log.data.end - log.data.begin
        design, theta = LogDesign(data.drive_speed, log.mean_load), found.attempt.solved.theta
        made = simulated_log(found.unknowns, theta, data.base, design, seconds)
        cycles = made.count(seconds)
        total = total + made.information(1.0 / data.interval, data.noise**2, data.normal_force_sd, cycles)
    ratio = np.sqrt(np.diag(found.sure.allowed.white) / np.diag(inverse(total)))
    assert np.all(ratio > 0.8) and np.all(ratio < 1.15), ratio


def test_speeds_of_a_programme_count_for_as_long_as_they_were_driven():
    data = LogData(*(np.arange(3.0),) * 3, np.ones(1), 1e-3, NormalForce.of(1.0), 0.0, 0.5, 9.0)
    assert driven(data) == [(1e-3, 8.5)]
    programme = Drive.of(((0.0, 1e-3), (2.0, 0.0), (3.0, -5e-3), (9.5, 1e-2)))
    assert driven(replace(data, programme=programme)) == [(1e-3, 1.5), (5e-3, 6.0)]
