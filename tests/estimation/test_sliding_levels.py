"""What logs that slide hold, in a sentence: one level per speed, with an error that knows of noise with a memory."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.record_kinds import MILD, STIFF, Kind, Log
from identify import fit
from identify.estimation.hints import WHITE, hints, levels, steady, what_is_held
from identify.estimation.residual_autocorrelation import colour
from identify.logs.log_data import LogData
from identify.shooting.shooting_trajectory import ShootingTrajectory, Stretch
from identify.simulation.drive import Drive, NormalForce
from tests.support import shooting_case as case

pytestmark = pytest.mark.usefixtures("no_further_logs")

NONE = np.empty(0)
RATE, LOAD, NOISE = 500.0, 2.0, 5e-3


def _motion(*stretches):
    """Of stretches given as kind and end."""
    made = [Stretch(kind, until, "time", np.zeros((2, 3))) for kind, until in stretches]
    return ShootingTrajectory.of(np.zeros(3), made, NONE)


def _log(parts, noise, load_sd=0.0):
    """Friction coefficients at speeds [mm/s], each for ten seconds; noise (n,) [N]."""
    time = np.arange(round(10.0 * len(parts) * RATE)) / RATE
    force = LOAD * np.repeat([mu for mu, _ in parts], round(10.0 * RATE)) + noise
    drive = Drive.of(tuple((10.0 * i, 1e-3 * speed) for i, (_, speed) in enumerate(parts)))
    end = 10.0 * len(parts)
    base, load = np.ones(6), NormalForce.of(LOAD)
    data = LogData(
        time, force, np.full(time.size, NOISE**-2), base, drive.speeds[0], load, load_sd, 0.0, end, programme=drive
    )
    return SimpleNamespace(rests_on="", name="log_1.csv", data=data)


def _white(count, seed=0):
    return NOISE * np.random.default_rng(seed).standard_normal(count)


def _said(log, trajectory, noise=WHITE):
    return what_is_held([log], [trajectory], [noise])


def test_steps_of_the_speed_hold_one_level_each():
    """Their mean, at the last speed, is the friction of nothing."""
    log = _log([(0.6, 1.0), (0.4, 2.0)], _white(10000))
    trajectory = _motion(("slip", 0.5), ("steady", 4.0), ("steady", 10.0), ("slip", 10.5), ("steady_worn", 20.0))
    assert steady(log.data, trajectory) == [(0.5, 10.0, 1e-3), (10.5, 20.0, 2e-3)]
    one, two = levels(log.data, trajectory)
    assert (one.coefficient, two.coefficient) == (pytest.approx(0.6, abs=2e-4), pytest.approx(0.4, abs=2e-4))
    assert one.error == pytest.approx(NOISE / LOAD / np.sqrt(4750.0), rel=0.05), "the step is no scatter"
    said = _said(log, trajectory)
    assert "0.6 ± 7e-05 at 1 mm/s (log_1.csv) and 0.4 ± 7e-05 at 2 mm/s (log_1.csv), and how it follows a step" in said
    assert "nothing else" not in said and said.startswith("sliding throughout") and "sticks and slips" in said


def test_one_speed_holds_a_level_and_nothing_else():
    log = _log([(0.6, 0.001)], _white(5000))
    said = _said(log, _motion(("slip", 1.0), ("steady", 5.0), ("steady", 10.0)))
    assert "the friction coefficient, 0.6 ± 7e-05 at 0.06 mm/min (log_1.csv), and nothing else" in said


def test_two_logs_of_one_speed_each_know_of_no_step():
    logs = [_log([(mu, speed)], _white(5000)) for mu, speed in ((0.6, 1.0), (0.4, 2.0))]
    said = what_is_held(logs, [_motion(("steady", 10.0))] * 2, [WHITE] * 2)
    assert "at 1 mm/s" in said and "at 2 mm/s" in said
    assert "step of the speed" not in said and "nothing else" not in said


def test_without_a_steady_stretch_nothing_is_said():
    log = _log([(0.6, 1.0)], _white(5000))
    assert _said(log, _motion(("slip", 10.0))) == ""


def test_a_log_that_ends_in_a_hold_does_not_slide_throughout():
    log = _log([(0.6, 1.0), (0.6, 0.0)], _white(10000))
    said = _said(log, _motion(("steady", 10.0), ("slip", 10.5), ("rest", 20.0)))
    assert said.startswith("sliding, with no stick that ends: ") and "at 1 mm/s" in said


def test_the_error_of_a_level_is_its_scatter_over_many_draws():
    """Of noise with a memory it is four times what its number of samples says."""
    trajectory, means, errors = _motion(("steady", 10.0)), [], []
    for seed in range(60):
        new, noise = _white(5000, seed), np.zeros(5000)
        for i in range(1, noise.size):
            noise[i] = 0.9 * noise[i - 1] + np.sqrt(0.19) * new[i]
        (level,) = levels(_log([(0.6, 1.0)], noise).data, trajectory, colour(noise))
        means.append(level.coefficient)
        errors.append(level.error)
    assert np.mean(errors) == pytest.approx(np.sqrt(19.0) * NOISE / LOAD / np.sqrt(5000.0), rel=0.15)
    assert np.std(means) == pytest.approx(np.mean(errors), rel=0.3)


def test_a_load_known_badly_counts():
    (level,) = levels(_log([(0.6, 1.0)], _white(5000), load_sd=0.02).data, _motion(("steady", 10.0)))
    assert level.error == pytest.approx(0.6 * 0.01, rel=0.01)


def test_many_levels_are_not_told_one_by_one():
    parts = [(0.6, 1.0 + i) for i in range(9)]
    log = _log(parts, _white(45000))
    said = _said(log, _motion(*(("steady", 10.0 * (i + 1)) for i in range(9))))
    assert said.count("±") == 6 and " and 3 more, and how" in said


def test_hints_name_every_speed_of_a_slide():
    log = _log([(0.6, 1.0), (0.4, 2.0)], _white(10000))
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    told = hints([log], [_motion(("steady", 10.0), ("steady", 20.0))], unknowns, np.zeros(len(unknowns.names)))
    assert "at their speeds (1 mm/s and 2 mm/s) and little more" in str(told["mu_k0"])
    alone = hints([log], [_motion(("slip", 10.0), ("steady", 20.0))], unknowns, np.zeros(len(unknowns.names)))
    assert "at its speed (2 mm/s) and no more" in str(alone["mu_k0"])


def test_a_fit_of_a_slide_with_a_step_says_what_the_law_is_at_both_speeds():
    stated = ((0.0, 2e-2), (1.0, 1e-2))
    log = Log(((0.0, 2e-2), (3.0, 1e-2)), 5.0, 1000.0, begins=2.0, said=stated)
    result = fit(*Kind("", (log,), (log,), MILD, STIFF).made(1)).result
    assert result["status"] == "converged" and "nothing else" not in result["message"]
    told = re.findall(r"([\d.]+) ± ([\d.e-]+) at (\d+) mm/s", result["message"])
    assert [speed for *_, speed in told] == ["20", "10"]
    for level, twice, speed in told:
        law = MILD["mu_k0"] - MILD["delta_mu_k"] * np.expm1(-MILD["a"] * 1e-3 * float(speed))
        assert abs(float(level) - law) < 2.0 * float(twice)
