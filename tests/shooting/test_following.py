"""Motions followed along the data, against the true motion."""

import numpy as np
import pytest

from identify.effects import MAIN
from identify.logs.log_data import LogData
from identify.model.model import assemble
from identify.shooting.placing import Followed, follow
from identify.simulation.drive import NormalForce
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

MODEL = assemble(MAIN)


def logged(truth, speed, duration, rate, noise, seed=5, load=1.0, **believed) -> tuple[Trajectory, LogData]:
    """The true motion, and a log of it with noise; its base values are the truth but for what is believed."""
    motion = run(MODEL, truth, speed, load, duration)
    time = np.arange(int(duration * rate) + 1) / rate
    force = motion.sample(time)["force"] + noise * np.random.default_rng(seed).standard_normal(time.size)
    p = np.array([(truth | believed)[n] for n in MODEL.parameter_names])
    weight = np.full(time.size, noise**-2)
    return motion, LogData(time, force, weight, p, speed, NormalForce.of(load), 0.0, 0.0, duration)


def followed(log: LogData) -> Followed:
    motion = follow(MODEL, log, log.base, begins_sliding=False)
    assert motion is not None
    return motion


def ended(trajectory, by):
    """When stretches end so [s]."""
    return trajectory.until[trajectory.ending(by)]


PAIR = {"mu_s": 0.9904, "mu_k0": 0.8659, "delta_mu_k": -0.06065, "a": 1566.0, "D": 1.278e-5, "t_cr": 3.305}
PAIR |= {"mass": 0.2314, "stiffness": 746.7, "damping": 216.5}
# Slips of 6 mN in noise of 4.5 mN at 0.1 mm/s; slower than that the mass comes to rest twice, and slides on.
FAINT = {"mu_s": 0.6721, "mu_k0": 0.6122, "delta_mu_k": -0.1083, "a": 1491.0, "D": 1.184e-4, "t_cr": 0.03212}
FAINT |= {"mass": 0.1281, "stiffness": 1387.0, "damping": 291.7}
SLOW = 1.0e-4 / 60, 800.0, 20.0, 0.0045


@pytest.mark.parametrize("error", [-0.0013, 0.0013])
def test_an_onset_is_found_where_a_stick_rises_by_less_than_the_noise(error: float) -> None:
    """The stick rises by 0.06 of the noise from sample to sample: the highest one lies seconds before the slip."""
    motion, log = logged(PAIR, *SLOW, mu_s=PAIR["mu_s"] + error)
    first = ended(followed(log)[0], "onset")[0]
    assert abs(first - motion.onsets[0]) < 2.0 / SLOW[2]
    assert abs(error / (PAIR["stiffness"] * SLOW[0])) > 10.0 / SLOW[2]  # the parameters alone are a second off


def test_an_onset_is_not_moved_along_a_level_force() -> None:
    """Of a level force the highest sample lies minutes after the onset."""
    motion, log = logged(FAINT, *SLOW, seed=7)
    assert abs(float(log.time[np.argmax(log.force)]) - motion.onsets[0]) > 20.0
    found = followed(log)
    assert found[1] == SLOW[1]
    loading = FAINT["stiffness"] * SLOW[0]
    assert abs(ended(found[0], "onset")[0] - motion.onsets[0]) * loading < 0.1 * SLOW[3]
    assert abs(found[0].start[0]) * FAINT["stiffness"] < 0.1 * SLOW[3]  # it began unloaded


def test_a_rest_goes_on_under_a_load_that_varies() -> None:
    """A tremor of 0.5 % at 9 Hz: taken for a line until the stick ends, its slope made limits of twice the force."""
    truth = {"mu_s": 0.68, "mu_k0": 0.47, "delta_mu_k": -0.12, "a": 400.0, "D": 5e-5, "t_cr": 2.5}
    truth |= {"mass": 0.16, "stiffness": 1100.0, "damping": 110.0}
    knots = np.arange(0.0, 12.01, 0.005)
    load = 1.5 * (0.8 + 0.2 * np.exp(-knots / 10.0) + 0.005 * np.sin(2.0 * np.pi * 9.0 * knots))
    motion, log = logged(truth, 3e-4, 12.0, 500.0, 0.0045, 8, (knots, load))
    onsets = motion.onsets[np.append(True, np.diff(motion.onsets) > 0.5)]
    assert onsets.size > 4
    np.testing.assert_allclose(ended(followed(log)[0], "onset"), onsets, atol=0.02)


# At a drive speed of D/t_cr; after the first slip the mass rests for 3.5 ms, then for 12 ms, then for 17 ms.
BRIEF = {"mu_s": 0.5, "mu_k0": 0.42, "delta_mu_k": -0.15, "a": 100.0, "D": 3e-4, "t_cr": 0.3}
BRIEF |= {"mass": 0.25, "stiffness": 1800.0, "damping": 600.0}


@pytest.mark.parametrize(
    ("truth", "record", "slips", "within"),
    [(FAINT, (1e-4, 20.0, 500.0, 4.5e-3), 166, 0.06), (BRIEF, (1e-3, 5.0, 1000.0, 4e-3), 52, 2e-3)],
    ids=["slips below the noise", "rests of a few samples"],
)
def test_small_slips_are_followed_through(truth, record, slips, within) -> None:
    motion, log = logged(truth, *record)
    found = followed(log)
    arrests = ended(found[0], "arrest")
    assert found[1] == record[1] and motion.arrests.size == arrests.size == slips
    assert np.max(np.abs(arrests - motion.arrests)) < within


def test_a_first_stick_ends_before_the_force_is_highest() -> None:
    """A slow slip: the force is highest 30 ms after the mass has begun to move. How aged the contact was at the begin
    is told by the whole slip; with an onset at the peak the slips after it would rest by another time."""
    truth = {"mu_s": 0.4264, "mu_k0": 0.3415, "delta_mu_k": -0.05605, "a": 225.1, "D": 1.105e-4, "t_cr": 1.58}
    truth |= {"mass": 0.3509, "stiffness": 1528.0, "damping": 188.4}
    shares = []
    for seed in (2, 3, 4):
        motion, log = logged(truth, 1e-4, 5.0, 500.0, 0.0045, seed)
        assert float(log.time[np.argmax(motion.sample(log.time)["force"])]) - motion.onsets[0] > 0.02
        trajectory = followed(log)[0]
        slip, rest = trajectory.stretches[1:3]
        assert (slip.ended_by, rest.ended_by) == ("arrest", "onset") and MODEL.clamped is not None
        assert trajectory.start[MODEL.clamped] < 0.1  # it began fresh
        shares.append((rest.until - slip.until) / (motion.onsets[1] - motion.arrests[0]))
    assert np.median(shares) == pytest.approx(1.0, abs=0.2)
