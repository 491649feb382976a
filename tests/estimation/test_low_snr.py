"""Slips that the noise hides, and slips that come to rest by a hair: followed by the model, not as they were seen."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from data_io import Record
from identify.effects import MAIN
from identify.logs.prepare import Prepared
from identify.logs.segment import segment
from identify.logs.unknowns import Unknowns
from identify.model.model import assemble
from identify.simulation.simulate import run
from tests.support.taken_logs import taken

NOISE = 5e-3
# Slow, middle, fast: drive speed [m/s], duration [s], rate [Hz].
SLOW, FAINT, FAST, FASTEST = (1e-4 / 60, 800.0, 20.0), (1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0)
# Slips of 7 mN at 0.1 mm/s.
HIDDEN = {"mu_s": 0.5729, "mu_k0": 0.5188, "delta_mu_k": -0.05276, "a": 408.2, "D": 1.134e-4, "t_cr": 0.4387}
HIDDEN_RIG = {"mass": 0.2148, "stiffness": 1436.0, "damping": 83.31}
# Rests of 0.6 ms between slips of 70 ms at 1 mm/s.


@lru_cache(maxsize=4)
def logs(
    pair: tuple[tuple[str, float], ...], rig: tuple[tuple[str, float], ...], drives: tuple[tuple[float, ...], ...]
) -> tuple[list[Prepared], Unknowns, tuple[int, ...]]:
    """Noisy logs of a pair as the fit takes them, the search started at the truth, and how many slips each has."""
    truth, random, records, slips = dict(pair) | dict(rig), np.random.default_rng(3), [], []
    for speed, duration, rate in drives:
        motion = run(assemble(MAIN), truth, speed, 1.0, duration)
        time = np.arange(round(duration * rate) + 1) / rate
        force = motion.sample(time)["force"] + NOISE * random.standard_normal(time.size)
        records.append(Record(time, np.ones(time.size), force))
        slips.append(int(motion.arrests.size))
    return (*taken(records, drives, dict(pair), dict(rig)), tuple(slips))


def hidden() -> tuple[list[Prepared], Unknowns, tuple[int, ...]]:
    return logs(tuple(HIDDEN.items()), tuple(HIDDEN_RIG.items()), (FAINT, FAST, FASTEST))


def test_slips_that_hardly_exceed_the_noise_are_not_detected_and_the_log_is_followed() -> None:
    prepared, _, slips = hidden()
    assert [log.fit_mode.name for log in prepared] == ["continuous", "cycles", "cycles"]
    assert prepared[0].segmentation.count == 0 and slips[0] > 100
    # What lies between slips that were not seen holds them: lines through it would show twice the noise.
    assert prepared[0].segmentation.noise == pytest.approx(NOISE, rel=0.05)
    # A quarter of the noise, and every slip is seen.
    time, force = prepared[0].record.time, prepared[0].record.friction_force
    true = run(assemble(MAIN), HIDDEN | HIDDEN_RIG, FAINT[0], 1.0, FAINT[1]).sample(time)["force"]
    clear = segment(time, true + 0.25 * (force - true), half_period=prepared[0].rig.half_period)
    assert not clear.low_snr and abs(clear.count - slips[0]) <= 1


# A start from which these logs and the fastest, solved cycle by cycle, come to an answer that is off by 14 % in a.
