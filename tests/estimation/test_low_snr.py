"""Slips that the noise hides, and slips that come to rest by a hair: followed by the model, not as they were seen."""

from __future__ import annotations

import numpy as np
import pytest

from data_io import Record
from identify.effects import MAIN
from identify.logs.segment import segment
from identify.model.model import assemble
from identify.simulation.simulate import run
from tests.support.taken_logs import taken

NOISE = 5e-3
# Drive speed [m/s], duration [s], rate [Hz].
FAINT, FAST, FASTEST = (1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0)
# Slips of 7 mN at 0.1 mm/s.
HIDDEN = {"mu_s": 0.5729, "mu_k0": 0.5188, "delta_mu_k": -0.05276, "a": 408.2, "D": 1.134e-4, "t_cr": 0.4387}
HIDDEN_RIG = {"mass": 0.2148, "stiffness": 1436.0, "damping": 83.31}


def test_slips_that_hardly_exceed_the_noise_are_not_detected_and_the_log_is_followed() -> None:
    truth, random, records, slips = HIDDEN | HIDDEN_RIG, np.random.default_rng(3), [], []
    drives = (FAINT, FAST, FASTEST)
    for speed, duration, rate in drives:
        motion = run(assemble(MAIN), truth, speed, 1.0, duration)
        time = np.arange(round(duration * rate) + 1) / rate
        force = motion.sample(time)["force"] + NOISE * random.standard_normal(time.size)
        records.append(Record(time, np.ones(time.size), force))
        slips.append(int(motion.arrests.size))
    prepared, _ = taken(records, drives, HIDDEN, HIDDEN_RIG)
    assert [log.fit_mode.name for log in prepared] == ["continuous", "cycles", "cycles"]
    assert prepared[0].segmentation.count == 0 and slips[0] > 100
    # What lies between slips that were not seen holds them: lines through it would show twice the noise.
    assert prepared[0].segmentation.noise == pytest.approx(NOISE, rel=0.05)
    # A quarter of the noise, and every slip is seen.
    time, force = prepared[0].record.time, prepared[0].record.friction_force
    true = run(assemble(MAIN), HIDDEN | HIDDEN_RIG, FAINT[0], 1.0, FAINT[1]).sample(time)["force"]
    clear = segment(time, true + 0.25 * (force - true), half_period=prepared[0].rig.half_period)
    assert not clear.low_snr and abs(clear.count - slips[0]) <= 1
