"""Onsets of a followed motion, moved onto the data."""

from dataclasses import replace

import numpy as np
import pytest

from identify.effects import MAIN
from identify.logs.log_data import LogData
from identify.model.model import assemble
from identify.shooting import following
from identify.shooting.following import Along, follow
from identify.simulation.drive import NormalForce
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

MODEL = assemble(MAIN)
PAIR = {"mu_s": 0.9904, "mu_k0": 0.8659, "delta_mu_k": -0.06065, "a": 1566.0, "D": 1.278e-5, "t_cr": 3.305}
RIG = {"mass": 0.2314, "stiffness": 746.7, "damping": 216.5}
SPEED, DURATION, RATE, NOISE = 1.0e-4 / 60, 800.0, 20.0, 0.0045


@pytest.mark.parametrize("error", [-0.0013, 0.0013])
def test_an_onset_is_found_where_a_stick_rises_by_less_than_the_noise(error: float) -> None:
    """The stick rises by 0.06 of the noise from sample to sample: the highest one lies seconds before the slip."""
    truth = PAIR | RIG
    motion = run(MODEL, truth, SPEED, 1.0, DURATION)
    onset = next(p.start + p.duration for p in motion.phases if p.ended_by is not None and p.mode == "stick")
    time = np.arange(int(DURATION * RATE) + 1) / RATE
    force = motion.sample(time)["force"] + NOISE * np.random.default_rng(5).standard_normal(time.size)
    believed = truth | {"mu_s": truth["mu_s"] + error}
    p = np.array([believed[n] for n in MODEL.parameter_names])
    weight = np.full(time.size, NOISE**-2)
    log = LogData(time, force, weight, p, SPEED, NormalForce.of(1.0), 0.0, 0.0, DURATION)
    found = follow(MODEL, log, p, begins_sliding=False)
    assert found is not None
    first = next(s for s in found.trajectory.stretches if s.ended_by == "onset")
    assert abs(first.until - onset) < 2.0 / RATE
    believed_onset = onset + error / (RIG["stiffness"] * SPEED)
    assert abs(first.until - believed_onset) > 10.0 / RATE  # the parameters alone are a second off


def test_an_onset_that_follows_a_rest_of_no_length_stays_where_it_is_expected() -> None:
    """As where a drive that starts again meets a contact at its limit; with some room the data move it."""
    time = np.arange(2001) / 1000.0
    force = np.where(time < 1.1, time, 1.1 - 2.0 * (time - 1.1))
    p = np.array([(PAIR | RIG)[n] for n in MODEL.parameter_names])
    log = LogData(time, force, np.full(time.size, 1e6), p, SPEED, NormalForce.of(1.0), 0.0, 0.0, 2.0)
    data = following.DataSide(log, 0.05, ())
    wave = following.SlipWaveform(np.array([0.0, 0.4]), np.array([1.1, 0.3]), 1.0)
    assert data.placed(0.0, 1.08, wave, 0.0) == 1.08
    assert data.placed(0.0, 1.08, wave, 1.0) == pytest.approx(1.1, abs=0.01)


# Slips of 6 mN that the noise hides at 0.1 mm/s; slower than that the mass comes to rest twice, and slides on.
FAINT = {"mu_s": 0.6721, "mu_k0": 0.6122, "delta_mu_k": -0.1083, "a": 1491.0, "D": 1.184e-4, "t_cr": 0.03212}
FAINT_RIG = {"mass": 0.1281, "stiffness": 1387.0, "damping": 291.7}


def faint(speed: float, duration: float, rate: float) -> tuple[Trajectory, LogData]:
    """The true motion, and a log of it with noise."""
    truth = FAINT | FAINT_RIG
    motion = run(MODEL, truth, speed, 1.0, duration)
    time = np.arange(int(duration * rate) + 1) / rate
    force = motion.sample(time)["force"] + NOISE * np.random.default_rng(7).standard_normal(time.size)
    p = np.array([truth[n] for n in MODEL.parameter_names])
    weight = np.full(time.size, NOISE**-2)
    return motion, LogData(time, force, weight, p, speed, NormalForce.of(1.0), 0.0, 0.0, duration)


LIVE = {"mu_s": 0.68, "mu_k0": 0.47, "delta_mu_k": -0.12, "a": 400.0, "D": 5e-5, "t_cr": 2.5}
LIVE_RIG = {"mass": 0.16, "stiffness": 1100.0, "damping": 110.0}


@pytest.mark.parametrize("line_by_line", [True, False])
def test_a_rest_goes_on_under_a_load_that_trembles(line_by_line: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tremor of 0.5 % at 9 Hz: taken for a line until the stick ends, its slope made grips of twice the force."""
    truth, speed, duration, rate = LIVE | LIVE_RIG, 3e-4, 12.0, 500.0
    knots = np.arange(0.0, duration + 0.01, 0.005)
    grip = 1.5 * (0.8 + 0.2 * np.exp(-knots / 10.0) + 0.005 * np.sin(2.0 * np.pi * 9.0 * knots))
    load = NormalForce.of((knots, grip))
    motion = run(MODEL, truth, speed, load, duration)
    time = np.arange(int(duration * rate) + 1) / rate
    force = motion.sample(time)["force"] + NOISE * np.random.default_rng(8).standard_normal(time.size)
    p = np.array([truth[n] for n in MODEL.parameter_names])
    log = LogData(time, force, np.full(time.size, NOISE**-2), p, speed, load, 0.0, 0.0, duration)
    begun = np.array([ph.start for ph in motion.phases if ph.mode != "stick"])
    begun = begun[np.append(True, np.diff(begun) > 0.5)]  # a slip is made of several phases
    if not line_by_line:
        monkeypatch.setattr(Along, "_quiet", lambda *_given: None)
        monkeypatch.setattr(following, "bisect_right", lambda times, _t: len(times))  # no knot comes after
    found = follow(MODEL, log, p, begins_sliding=False)
    assert found is not None and begun.size > 4
    onsets = found.trajectory.when("onset")
    right = onsets.size == begun.size and bool(np.max(np.abs(onsets - begun)) < 0.02)
    assert right == line_by_line
    if right:  # under the least load of many knots, or from each to the next: the same
        monkeypatch.setattr(Along, "_quiet", lambda *_given: None)
        again = follow(MODEL, log, p, begins_sliding=False)
        assert again is not None
        np.testing.assert_allclose(onsets, again.trajectory.when("onset"), atol=1e-9)


def test_an_onset_is_not_moved_along_a_level_force() -> None:
    """Of a level force the highest sample lies minutes after the onset, and what is level says nothing of a stick."""
    motion, log = faint(SPEED, DURATION, RATE)
    onset = next(p.start + p.duration for p in motion.phases if p.ended_by is not None and p.mode == "stick")
    assert abs(float(log.time[np.argmax(log.force)]) - onset) > 20.0
    found = follow(MODEL, log, log.base, begins_sliding=False)
    assert found is not None and found.end == DURATION
    first = next(s for s in found.trajectory.stretches if s.ended_by == "onset")
    loading = FAINT_RIG["stiffness"] * SPEED
    assert abs(first.until - onset) * loading < 0.1 * NOISE
    assert abs(found.trajectory.start[0]) * FAINT_RIG["stiffness"] < 0.1 * NOISE  # it began unloaded


def test_hundreds_of_slips_below_the_noise_are_followed() -> None:
    motion, log = faint(1e-4, 20.0, 500.0)
    found = follow(MODEL, log, log.base, begins_sliding=False)
    assert found is not None
    arrests = found.trajectory.when("arrest")
    assert arrests.size == motion.arrests.size == 166
    period = float(np.median(np.diff(motion.arrests)))
    assert np.max(np.abs(arrests - motion.arrests)) < 0.5 * period


def test_an_onset_that_the_noise_hides_stays_where_it_is_expected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of some hundred places noise alone makes one the best: without a limit to that, onsets scatter about twice as
    far."""
    motion, log = faint(SPEED, DURATION, RATE)
    onset = next(p.start + p.duration for p in motion.phases if p.ended_by is not None and p.mode == "stick")
    clean = motion.sample(log.time)["force"]

    def scatter() -> float:
        errors = []
        for seed in range(6):
            noise = NOISE * np.random.default_rng(seed).standard_normal(log.time.size)
            found = follow(MODEL, replace(log, force=clean + noise), log.base, begins_sliding=False)
            assert found is not None
            errors.append(found.trajectory.when("onset")[0] - onset)
        return float(np.sqrt(np.mean(np.square(errors))))

    limited = scatter()
    monkeypatch.setattr(following, "BY_CHANCE", 0.0)
    assert limited < 0.7 * scatter()


# Slips of 0.2 mN, two samples each, that come five thousand times after four minutes of loading.
UNSEEN = {"mu_s": 0.4018, "mu_k0": 0.3429, "delta_mu_k": -0.1123, "a": 61.69, "D": 9.827e-5, "t_cr": 0.03144}
UNSEEN_RIG = {"mass": 0.1238, "stiffness": 1019.8, "damping": 109.58}


@pytest.mark.slow
def test_slips_that_the_noise_hides_are_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """To follow some of them would end the log after a number of slips that is made up, and tell the fit its period."""
    p = np.array([(UNSEEN | UNSEEN_RIG)[n] for n in MODEL.parameter_names])
    time = np.arange(int(DURATION * RATE) + 1) / RATE
    load = np.minimum(UNSEEN_RIG["stiffness"] * SPEED * time, UNSEEN["mu_s"])
    force = load + NOISE * np.random.default_rng(3).standard_normal(time.size)
    log = LogData(time, force, np.full(time.size, NOISE**-2), p, SPEED, NormalForce.of(1.0), 0.0, 0.0, DURATION)
    assert follow(MODEL, log, p, begins_sliding=False) is None
    quiet = replace(log, weight=1e10 * log.weight)
    assert quiet.noise == pytest.approx(1e-5 * NOISE)
    seen = follow(MODEL, quiet, p, begins_sliding=False)
    assert seen is not None and seen.trajectory.arrests > 100
    monkeypatch.setattr(following, "SHOWN", 0.0)
    monkeypatch.setattr(following, "SURE", 0.0)
    counted = follow(MODEL, log, p, begins_sliding=False)
    assert counted is not None and counted.end < 0.5 * DURATION  # as many as are followed at most


# A slow slip: the force is highest 30 ms after the mass has begun to move, and the next rests last 20 ms.
SLOW = {"mu_s": 0.4264, "mu_k0": 0.3415, "delta_mu_k": -0.05605, "a": 225.1, "D": 1.105e-4, "t_cr": 1.58}
SLOW_RIG = {"mass": 0.3509, "stiffness": 1528.0, "damping": 188.4}


def test_a_first_stick_ends_before_the_force_is_highest(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the contact had aged by at the begin is told by the whole slip: with an onset at the peak, the slips after
    it, which find a younger contact, rest by another time, or not at all."""
    truth = SLOW | SLOW_RIG
    motion = run(MODEL, truth, 1e-4, 1.0, 5.0)
    time = np.arange(int(5.0 * 500.0) + 1) / 500.0
    force = motion.sample(time)["force"] + NOISE * np.random.default_rng(2).standard_normal(time.size)
    p = np.array([truth[n] for n in MODEL.parameter_names])
    log = LogData(time, force, np.full(time.size, NOISE**-2), p, 1e-4, NormalForce.of(1.0), 0.0, 0.0, 5.0)
    first, *rests = [(s.start + s.duration, s.duration) for s in motion.phases if s.mode == "stick"]
    assert float(time[np.argmax(motion.sample(time)["force"])]) - first[0] > 0.02

    def followed() -> tuple[float, float]:
        """How aged the contact is at the begin, and how long the mass rests after the first slip, over the truth."""
        found = follow(MODEL, log, p, begins_sliding=False)
        assert found is not None and MODEL.clamped is not None
        slip, rest = found.trajectory.stretches[1:3]
        assert (slip.ended_by, rest.ended_by) == ("arrest", "onset")
        return float(found.trajectory.start[MODEL.clamped]), (rest.until - slip.until) / rests[0][1]

    aged, share = followed()
    assert aged < 0.1 and share == pytest.approx(1.0, abs=0.2)  # it began fresh
    monkeypatch.setattr(following, "aged_until_seen", lambda along, x, *_: x[MODEL.clamped])
    aged, share = followed()
    assert aged > 0.15 and share < 0.5


# At a drive speed of D/t_cr; after the first slip the mass rests for 3.5 ms, then for 12 ms, then for 17 ms.
BRIEF = {"mu_s": 0.5, "mu_k0": 0.42, "delta_mu_k": -0.15, "a": 100.0, "D": 3e-4, "t_cr": 0.3}
BRIEF_RIG = {"mass": 0.25, "stiffness": 1800.0, "damping": 600.0}


def test_rests_of_a_few_samples_are_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = BRIEF | BRIEF_RIG
    motion = run(MODEL, truth, 1e-3, 1.0, 5.0)
    time = np.arange(5001) / 1000.0
    force = motion.sample(time)["force"] + 4e-3 * np.random.default_rng(4).standard_normal(time.size)
    p = np.array([truth[n] for n in MODEL.parameter_names])
    log = LogData(time, force, np.full(time.size, 4e-3**-2), p, 1e-3, NormalForce.of(1.0), 0.0, 0.0, 5.0)

    def arrests() -> np.ndarray:
        found = follow(MODEL, log, p, begins_sliding=False)
        assert found is not None
        return found.trajectory.when("arrest")

    assert arrests().size == motion.arrests.size == 52
    assert np.max(np.abs(arrests() - motion.arrests)) < 2e-3
    monkeypatch.setattr(following, "aged_until_seen", lambda along, x, *_: x[MODEL.clamped])
    assert arrests().size < 51  # the first slips are taken for one


# Slips of 4.4 mN in noise of 5 mN, 25 samples each, after one of 140 mN; they rest for 6 of 50 ms.
TRAIN = {"mu_s": 0.959, "mu_k0": 0.8458, "delta_mu_k": -0.04465, "a": 40.58, "D": 9.015e-6, "t_cr": 3.806}
TRAIN_RIG = {"mass": 0.1551, "stiffness": 2518.0, "damping": 131.6}


@pytest.mark.parametrize("wrong", [pytest.param(1.0, marks=pytest.mark.slow), 1.5])
def test_slips_that_only_show_together_are_followed_through(wrong: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is placed by the noise; that each follows the one before keeps their number, at a wrong t_cr too."""
    truth = TRAIN | TRAIN_RIG
    motion = run(MODEL, truth, 1e-4, 1.0, 14.0)
    time = np.arange(7001) / 500.0
    force = motion.sample(time)["force"] + 5e-3 * np.random.default_rng(5).standard_normal(time.size)
    p = np.array([(truth | {"t_cr": wrong * truth["t_cr"]})[n] for n in MODEL.parameter_names])
    log = LogData(time, force, np.full(time.size, 5e-3**-2), p, 1e-4, NormalForce.of(1.0), 0.0, 0.0, 14.0)

    def arrests() -> np.ndarray:
        found = follow(MODEL, log, p, begins_sliding=False)
        assert found is not None and found.end == 14.0
        return found.trajectory.when("arrest")

    assert motion.arrests.size == 200
    through = arrests()
    assert through.size == motion.arrests.size
    assert np.max(np.abs(through - motion.arrests)) < 0.025  # half a cycle
    monkeypatch.setattr(following, "UNSURE", np.inf)
    assert arrests().size < motion.arrests.size
