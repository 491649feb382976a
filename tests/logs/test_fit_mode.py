"""How a log moves, told from records drawn by hand."""

from dataclasses import replace

import numpy as np
import pytest

from identify.logs.fit_mode import FitMode, ForceRecord, fit_mode_of, steady_since
from identify.logs.segment import SLIDING, segment
from identify.simulation.drive import Drive

NOISE, RATE, LOADING = 0.0045, 20.0, 0.00125  # N, Hz, N/s: a slow drive on a soft rig
HALF_PERIOD = 0.05


def fit_mode(after: float, rises: float, seed: int) -> tuple[FitMode, float | None]:
    """Of a ramp to 1 N, a fall to 0.7 N within two samples, and then `after` seconds that rise by `rises` N/s; and
    since when it looks level."""
    ramp = np.arange(0.0, 1.0 / LOADING, 1.0 / RATE) * LOADING
    rest = 0.7 + rises * np.arange(0.0, after, 1.0 / RATE)
    force = np.concatenate([ramp, [0.85], rest])
    force += NOISE * np.random.default_rng(seed).standard_normal(force.size)
    time = np.arange(force.size) / RATE
    found = segment(time, force, half_period=HALF_PERIOD, noise=NOISE)
    record = ForceRecord(time, force, np.ones(time.size), NOISE, HALF_PERIOD, Drive.of(1.67e-6))
    told = fit_mode_of(record, found, found.cycles.fall, 750.0)
    return told, steady_since(time, force, NOISE, HALF_PERIOD)


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_a_slow_log_that_ends_in_the_stick_after_a_slip_does_not_slide(seed: int) -> None:
    """Four seconds after a slip of 0.3 N a stick that is loaded for four minutes looks level."""
    told, level_since = fit_mode(4.0, LOADING, seed)
    assert told.name == "continuous" and level_since is not None and told.steady_since is None


@pytest.mark.parametrize("after", [8.0, 60.0])
def test_a_level_force_slides_where_a_stick_would_be_seen_to_rise(after: float) -> None:
    settled = fit_mode(after, 0.0, 4)[0].steady_since
    assert settled == pytest.approx(1.0 / LOADING, abs=1.0)


def test_what_is_too_short_to_be_told_from_a_stick_is_not_called_sliding() -> None:
    told, level_since = fit_mode(1.5, 0.0, 4)
    assert level_since is not None and told.steady_since is None


def slide_hold_slide(drive: Drive, first: float) -> tuple[np.ndarray, np.ndarray]:
    """Of a sliding level of 0.65 N, 0.3 N in the holds, and a first rise from `first` in 12 ms, which swings after."""
    time = np.arange(0.0, 26.0, 1e-3)
    force = np.where([drive.at(t) > 0.0 for t in time], 0.65, 0.3)
    swing = 0.65 - (0.65 - first) * np.cos(time / 8e-3) * np.exp(-time / 0.04)
    force = np.where(time < 0.5, swing, force)
    return time, force + NOISE * np.random.default_rng(3).standard_normal(time.size)


@pytest.mark.parametrize(("first", "slides"), [(0.15, False), (0.0, False), (0.65, True)])
def test_a_fast_drive_is_through_its_first_rise_in_a_few_samples(first: float, slides: bool) -> None:
    """The holds are the most of this record, and the rise is a thousandth of it."""
    drive = Drive.of(((0.0, 0.02), (2.0, 0.0), (6.0, 0.02), (7.5, 0.0), (24.0, 0.02)))
    time, force = slide_hold_slide(drive, first)
    found = segment(time, force, half_period=0.026, noise=NOISE)
    found = replace(found, phase=np.full_like(found.phase, SLIDING))  # too short a stick to be seen as one
    record = ForceRecord(time, force, np.ones(time.size), NOISE, 0.026, drive)
    told = fit_mode_of(record, found, found.cycles.fall, 1470.0)
    assert told.name == "continuous" and told.begins_sliding == slides
