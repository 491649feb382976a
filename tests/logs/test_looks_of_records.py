"""What records of one kind look like, drawn by lot: lift-off, wiring, lost zero, swings, hum, wear, changing loads.

Each kind stands for files that people have reported; what is right is known from how each is drawn.
"""

from __future__ import annotations

import os

import numpy as np
import pytest

from data_io import Record
from identify.logs.classical import table_of
from identify.logs.judgement import RecordPart, judge
from identify.logs.regime import Regime, joined, look

SIBLINGS = range(int(os.environ.get("SIBLINGS", "4")))


def seen(time, force, load):
    """Regime, the first row of the classical table, and the codes of the findings, of a log without a known rig."""
    record = Record(time - time[0], np.broadcast_to(load, time.shape).astype(float), force)
    whole = look(record, None)
    found = joined([(s.start, v.phases) for s, v in zip(whole.strokes, whole.verdicts, strict=True)], len(record))
    judgement = judge(record, [RecordPart(record.time, force, found, load=record.normal_force)])
    return whole.regime, table_of(record, whole).rows[0], {finding.code: finding for finding in judgement.findings}


def saw_tooth(random):
    """Time [s] and force [N] of some twenty even sticks and slips, and the number of cycles."""
    rate, period = random.choice([200.0, 500.0]), random.uniform(0.4, 0.9)
    low = random.uniform(0.5, 1.0)
    drop, slip = random.uniform(0.15, 0.35) * low, random.uniform(0.04, 0.08)
    time = np.arange(int(20.4 * period * rate)) / rate
    phase = (time / period) % 1.0
    rise = 1.0 - slip
    shape = np.where(phase < rise, phase / rise, 0.5 * (1.0 + np.cos(np.pi * (phase - rise) / slip)))
    noise = random.uniform(0.002, 0.01) * drop
    return time, low + drop * shape + noise * random.standard_normal(time.size), 20


@pytest.mark.parametrize("seed", SIBLINGS)
def test_rows_that_lift_off_take_no_part_in_a_ratio(seed):
    random = np.random.default_rng(seed)
    time, load, mu = np.arange(3000) / 500.0, random.uniform(0.5, 5.0), random.uniform(0.1, 0.9)
    pressed = (time % random.uniform(1.5, 2.5)) < 1.2
    normal = np.where(pressed, load, 0.0) + 1e-3 * load * random.standard_normal(time.size)
    force = mu * np.where(pressed, load, 0.0) + 2e-3 * load * random.standard_normal(time.size)
    _, row, codes = seen(time, force, normal)
    expected = float(np.mean(force[pressed] / normal[pressed]))
    assert row["kinetic_mean_coefficient"] == pytest.approx(expected, rel=1e-3) and "unloaded_rows" in codes


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_saw_tooth_upside_down_is_said_to_be_one(seed):
    random = np.random.default_rng(seed)
    time, force, count = saw_tooth(random)
    regime, _, codes = seen(time, random.uniform(2.0, 4.0) - force, 2.0)
    assert regime is Regime.SLIDING and f"{count} times" in codes["upside_down"].message
    regime, _, codes = seen(time, force, 2.0)  # negative control: the right way up
    assert regime is not Regime.SLIDING and "upside_down" not in codes


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_force_without_its_mean_is_stick_slip_whose_zero_was_lost(seed):
    time, force, count = saw_tooth(np.random.default_rng(seed))
    regime, row, codes = seen(time, force - np.mean(force), 2.0)
    assert regime is Regime.STICK_SLIP and abs(row["cycles"] - count) <= 1 and "zero_lost" in codes
    assert "zero_lost" not in seen(time, force, 2.0)[2]


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_swing_without_slips_is_no_quiet_sliding(seed):
    random = np.random.default_rng(seed)
    time, low = np.arange(3200) / 200.0, random.uniform(0.8, 2.0)
    swing = np.sin(2 * np.pi * low * time) + 0.7 * np.sin(4 * np.pi * low * time + random.uniform(0.0, 6.0))
    force = 2.0 + random.uniform(0.2, 0.5) * swing + 2e-3 * random.standard_normal(time.size)
    regime, _, codes = seen(time, force, 5.0)
    assert regime is Regime.SLIDING and "swings" in codes
    level = 2.0 + 2e-3 * random.standard_normal(time.size)
    assert "swings" not in seen(time, level, 5.0)[2]


@pytest.mark.parametrize("seed", SIBLINGS)
def test_slow_wear_is_a_trend_of_sliding_and_no_stick(seed):
    random = np.random.default_rng(seed)
    time = np.arange(2500) / 12.5
    begin, end, until = random.uniform(0.08, 0.12), random.uniform(0.14, 0.17), random.uniform(120.0, 190.0)
    force = 30.0 * np.interp(time, [0.0, until], [begin, end]) + 0.06 * random.standard_normal(time.size)
    regime, row, codes = seen(time, force, 30.0)
    assert regime is Regime.SLIDING and "friction_drift" in codes
    assert row["kinetic_mean_coefficient"] == pytest.approx(float(np.mean(force)) / 30.0, rel=1e-3)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_the_regime_under_a_changing_load_is_that_of_the_coefficient(seed):
    random = np.random.default_rng(seed)
    time = np.arange(3000) / 500.0
    low, high, place = random.uniform(0.3, 1.0), random.uniform(4.0, 9.0), time / 6.0
    cam = 0.5 + 0.3 * np.sin(2 * np.pi * round(high) * place)
    ways = place, 1.0 - place, place > 0.6 * low, cam  # scratches, a step
    load = low + (high - low) * ways[seed % 4]
    mu = random.uniform(0.2, 0.8)
    force = load * (mu + 0.005 * mu * random.standard_normal(time.size))
    regime, row, _ = seen(time, force, load)
    assert regime is Regime.SLIDING and row["kinetic_mean_coefficient"] == pytest.approx(mu, rel=2e-3)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_hum_of_the_mains_is_no_stick_slip(seed):
    random = np.random.default_rng(seed)
    mains, time = random.choice([50.0, 60.0, 100.0, 120.0]), np.arange(3500) / 1000.0
    hum = 0.04 * np.sin(2 * np.pi * mains * time + random.uniform(0.0, 6.0))
    force = 0.8 + hum + 3e-3 * random.standard_normal(time.size)
    regime, row, _ = seen(time, force, 2.0)
    assert regime is Regime.SLIDING and row["kinetic_mean_coefficient"] == pytest.approx(0.4, rel=2e-3)
    assert row["rhythm_Hz"] == pytest.approx(mains, rel=5e-3)
    other = 0.8 + 0.04 * np.sin(2 * np.pi * 37.0 * time) + 3e-3 * random.standard_normal(time.size)
    assert seen(time, other, 2.0)[0] is Regime.NEAR_HARMONIC  # negative control: a rhythm of its own
