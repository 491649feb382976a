"""Gaps of a clock: rows that a disk lost, pauses of the recording, packets that were stamped when they were read."""

from __future__ import annotations

import re

import numpy as np
import pytest

from data_io import Record
from data_io.quality import assess
from identify.logs.classical import classical_table

SIBLINGS = range(4)


def saw_tooth(time: np.ndarray, period: float, random: np.random.Generator) -> np.ndarray:
    """Friction force [N] of even stick-slip between 0.4 and 1.2 N with 2 mN of noise."""
    phase = (time / period) % 1.0
    rise = np.where(phase < 0.95, 0.4 + 0.8 * phase / 0.95, 0.8 + 0.4 * np.cos(np.pi * (phase - 0.95) / 0.05))
    return rise + 0.002 * random.standard_normal(time.size)


def logged(time: np.ndarray, force: np.ndarray) -> Record:
    return Record(time - time[0], np.full(time.size, 2.0), force)


def codes(record: Record) -> dict[str, str]:
    return {finding.code: finding.message for finding in assess(record).findings}


@pytest.mark.parametrize("seed", SIBLINGS)
def test_packets_are_told_with_the_rate_of_their_rows(seed: int) -> None:
    random = np.random.default_rng(seed)
    rate, period = float(random.choice([100.0, 200.0, 500.0, 1000.0])), random.uniform(0.4, 1.0)
    even = np.arange(int(12.0 * rate)) / rate
    sizes = np.full(even.size, random.integers(10, 60)) if seed % 2 else random.integers(20, 50, even.size)
    ends = np.cumsum(sizes)
    packet = np.searchsorted(ends, np.arange(even.size), side="right")
    last = np.minimum(ends[packet], even.size) - 1
    first = last - sizes[packet] + 1
    late = 0.1 * random.random(packet[-1] + 1)[packet] / rate  # the loop reads them a little later
    stamps = even[last] + late + (np.arange(even.size) - first) * 0.05 / rate
    record = logged(stamps, saw_tooth(even, period, random))
    told = codes(record)
    assert "dropouts" not in told and "pauses" not in told
    stated = float(re.search(r'--rate "([\d.]+) Hz"', told["packets"])[1])
    assert stated == pytest.approx(rate, rel=0.02)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_pause_parts_a_log_and_no_row_is_lost(seed: int) -> None:
    random = np.random.default_rng(seed)
    rate, period = float(random.choice([100.0, 200.0, 500.0])), random.uniform(0.4, 1.0)
    time = np.arange(int(12.0 * rate)) / rate
    force = saw_tooth(time, period, random)
    count = int(random.integers(1, 4))
    for place in random.choice(np.arange(1, 6), count, replace=False) * time.size // 6:
        time[place:] += random.uniform(1.0, 300.0)
    record = logged(time, force)
    told = codes(record)
    assert f"pauses {count} time(s)" in told["pauses"] and "dropouts" not in told
    rows = classical_table(record, drive_speed=None).rows
    assert len(rows) == count + 1
    frequencies = [row["frequency_Hz"] for row in rows if row["cycles"] > 2]
    assert frequencies == pytest.approx([1.0 / period] * len(frequencies), rel=0.02)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_rows_that_a_disk_lost_are_neither(seed: int) -> None:
    """Negative control: many gaps, and the force goes on without them."""
    random = np.random.default_rng(seed)
    even = np.arange(6000) / 500.0
    lost = np.zeros(even.size, dtype=bool)
    for place in random.choice(np.arange(1, 100), 40, replace=False) * 60:
        lost[place : place + random.integers(8, 50)] = True
    force = saw_tooth(even, random.uniform(0.3, 0.5), random)
    told = codes(logged(even[~lost], force[~lost]))
    assert "dropouts" in told and "pauses" not in told and "packets" not in told


def test_bursts_of_a_logger_are_no_packets() -> None:
    """Negative control: even bursts with true stamps, between which the force went on unseen."""
    random = np.random.default_rng(0)
    time = (np.arange(60)[:, None] * 0.731 + np.arange(40) / 1000.0).ravel()
    told = codes(logged(time, saw_tooth(time, 0.5, random)))
    assert "packets" not in told and "dropouts" in told
