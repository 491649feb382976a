"""The quality gate finds what was put in, names it, and is silent about a clean record."""

from pathlib import Path

import numpy as np
import pytest

from data_io import Record, Step
from data_io.quality import assess

MEASURED = Path(__file__).resolve().parents[3] / "shared" / "data" / "paper_on_paper"
N = 2000


def saw_tooth(time):
    return 0.5 + 0.2 * ((3 * time) % 1.0)


def record(time=None, **changes):
    time = np.arange(N) / 500 if time is None else time
    noise = np.random.default_rng(5).normal(0, 1e-3, (2, time.size))
    values = {"time": time, "normal_force": 1 + noise[0], "friction_force": saw_tooth(time) + noise[1], **changes}
    return Record(**values)


def codes(quality):
    return {finding.code for finding in quality.findings}


def resolution(force):
    return assess(record(friction_force=force)).figures["resolution"][0]


def test_the_rate_of_a_clock_of_whole_milliseconds_is_that_of_its_span():
    time = np.floor(12.5 * np.arange(N)) / 1000  # steps of 12 and 13 ms
    assert assess(record(time)).sampling.rate == pytest.approx(80.0, rel=1e-3)
    gapped = np.delete(time, np.arange(400, 420))
    assert assess(record(gapped)).sampling.rate == pytest.approx(80.0, rel=1e-3), "a dropout is no slow clock"


def test_a_pause_between_steps_is_no_dropout():
    time = np.r_[np.arange(1000) / 500, 60 + np.arange(1000) / 500]
    steps = (Step(1, 1, 0, 1000), Step(1, 2, 1000, 2000))
    assert not assess(record(time, steps=steps)).findings
    assert codes(assess(record(time))) == {"pauses"}


def test_the_step_is_found_through_the_rounding_of_the_file_and_none_among_uneven_levels():
    force = record().friction_force
    counts = np.round(force / 0.0123)
    assert resolution(np.round(counts * 0.0123, 3)) == pytest.approx(0.0123, rel=0.02)
    uneven = np.sort(np.random.default_rng(2).uniform(force.min(), force.max(), 20))
    held = uneven[np.clip(np.searchsorted(uneven, force), 0, 19)]
    assert resolution(held) == 0
