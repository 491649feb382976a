"""The classical table against figures known from the equations or put into the record by hand."""

import json

import numpy as np
import pytest

from data_io import Record
from data_io.record import Step
from identify.base.document import to_document
from identify.cli.logs import StatedRig, inspection, replicates
from identify.logs.classical import DEFINITIONS, table_of
from identify.logs.recorded_drive import strokes
from identify.logs.regime import Known, look
from tests.logs.test_segment import HALF_PERIOD, NOISE, PAIR
from tests.support import oracle


def saw_tooth(cycles=12, per_stick=400, low=0.4, high=0.6, noise=0.002, load=2.0, seed=0):
    """Coefficients rise from low to high in per_stick samples of 1 ms and fall within 8; preceded by loading to 0.7."""
    cycle = np.concatenate([np.linspace(low, high, per_stick), np.linspace(high, low, 10)[1:-1]])
    parts = [np.linspace(0, 0.7, 800), np.linspace(0.7, low, 10)[1:-1], np.tile(cycle, cycles)]
    ratio = np.concatenate([*parts, np.linspace(low, high, per_stick)[: per_stick // 2]])
    time = np.arange(ratio.size) / 1000
    force = load * (ratio + noise * np.random.default_rng(seed).standard_normal(ratio.size))
    return Record(time, np.full(ratio.size, load), force)


def table(record, drive, half_period=0.0):
    return table_of(record, look(record, drive, Known(half_period=half_period)), 1000.0)


def only_row(table):
    json.dumps(to_document(table), allow_nan=False)
    (row,) = table.rows
    return row


def test_figures_of_a_saw_tooth():
    row = only_row(table(saw_tooth(), 1e-3))
    slope = 2.0 * 0.2 / 0.399
    assert row["cycles"] == 13
    assert row["first_breakaway_coefficient"] == pytest.approx(0.7, abs=0.005)
    assert row["static_peak_coefficient"] == pytest.approx(0.6, abs=0.004)
    assert row["static_peak_coefficient_sd"] < 0.004
    assert row["slip_middle_coefficient"] == pytest.approx((12 * 0.5 + 0.55) / 13, abs=0.004)
    assert row["drop_N"] == pytest.approx(0.4, abs=0.01) and row["drop_sd_N"] < 0.01, "the first, 0.6 N, is no scatter"
    assert row["static_rest_s"] == pytest.approx(0.399, abs=0.005)
    assert row["kinetic_mean_coefficient"] == pytest.approx(0.497, abs=0.004)
    assert row["stick_slope_N_per_s"] == pytest.approx(slope, rel=0.01)
    assert row["stick_stiffness_N_per_m"] == pytest.approx(slope / 1e-3, rel=0.01)
    assert row["stick_stiffness_deviation_percent"] == pytest.approx(100 * (slope / 1.0 - 1), abs=1.5)
    assert row["frequency_Hz"] == pytest.approx(1 / 0.408, rel=0.003)
    assert row["normal_force_N"] == 2.0
    assert row["normal_force_drift_percent"] == 0.0
    assert (row["stick_slip_percent"], row["sliding_percent"]) == (100.0, 0.0)
    assert row["noise_N"] == pytest.approx(0.004, rel=0.1)


def test_every_figure_is_defined_and_every_gap_has_a_reason():
    rng = np.random.default_rng(1)
    records = [
        saw_tooth(),
        saw_tooth(cycles=0),
        Record(np.arange(3) / 10, np.ones(3), np.array([0.1, 0.2, 0.1])),
        Record(np.arange(500) / 10, np.zeros(500), rng.standard_normal(500)),
        Record(np.arange(500) / 10, np.ones(500), 0.5 + 0.01 * rng.standard_normal(500)),
        Record(np.arange(500) / 10, np.ones(500), np.full(500, 0.5)),
    ]
    for record in records:
        for speed in (None, 0.0, 1e-3):
            made = table(record, speed)
            json.dumps(to_document(made), allow_nan=False)
            assert set(DEFINITIONS) <= set(made.rows[0])
            for row, reasons in zip(made.rows, made.reasons, strict=True):
                assert {key for key, value in row.items() if value is None} == set(reasons)
                assert not [text for text in reasons.values() if text == "not a finite number"]


def test_steady_sliding_after_loading():
    run = oracle.simulate(PAIR | {"delta_mu_k": 0.0}, 2e-2, 1.0, 1.0)
    time, force = oracle.noisy_log(run, 1.0, 2000, NOISE, seed=3)
    row = only_row(table(Record(time, np.ones(time.size), force), 2e-2, HALF_PERIOD))
    assert row["cycles"] == 0
    assert row["kinetic_mean_coefficient"] == row["sliding_mean_coefficient"]
    assert row["kinetic_mean_coefficient"] == pytest.approx(PAIR["mu_k0"], abs=0.01)
    assert row["first_breakaway_coefficient"] == pytest.approx(np.max(force), abs=0.02)
    assert row["drop_N"] is row["frequency_Hz"] is row["static_peak_coefficient"] is None
    assert row["sliding_percent"] > 90
    assert row["stick_slip_percent"] == 0.0
    assert row["stick_stiffness_N_per_m"] == pytest.approx(1470.0, rel=0.03)


def test_strokes_of_a_reciprocating_log():
    programme = ((0.0, 1e-3), (3.0, -1e-3), (6.0, 1e-3))
    run = oracle.simulate(PAIR, programme, 1.0, 9.0)
    time, force = oracle.noisy_log(run, 9.0, 1000, NOISE, seed=0)
    record = Record(time, np.ones(time.size), force)
    for drive in (programme, None):
        rows = table(record, drive, HALF_PERIOD).rows
        assert [row["direction"] for row in rows] == [1, -1, 1]
        assert [row["stroke"] for row in rows] == [1, 2, 3]
        assert sum(row["cycles"] for row in rows) == run.onsets.size
        drops = [row["drop_N"] for row in rows]
        np.testing.assert_allclose(drops, np.mean(drops), rtol=0.06)
        if drive is not None:
            stiffness = [row["stick_stiffness_N_per_m"] for row in rows]
            np.testing.assert_allclose(stiffness, 1470.0, rtol=0.02)
    one = table(Record(time, np.ones(time.size), np.abs(force)), None).rows
    assert len(one) == 1  # without the sign there is nothing to tell strokes by


def test_steps_and_speeds_have_rows_of_their_own():
    record = saw_tooth()
    n = record.time.size
    steps = (Step(1, 1, 0, n // 2), Step(1, 2, n // 2, n))
    split = Record(record.time, record.normal_force, record.friction_force, steps=steps)
    rows = table(split, 1e-3).rows
    assert [(row["step"], row["stroke"]) for row in rows] == [(1, 1), (2, 1)]
    assert rows[0]["cycles"] + rows[1]["cycles"] in (12, 13)
    assert rows[1]["first_breakaway_coefficient"] is None
    parts = strokes(record, ((0.0, 1e-3), (2.0, 2e-3)))
    assert [part.speed for part in parts] == [1e-3, 2e-3]
    assert parts[0].stop == parts[1].start == 2000


def test_gaps_and_drift_of_the_load():
    record = saw_tooth()
    force, load = record.friction_force.copy(), np.linspace(2.0, 1.8, record.time.size)
    force[700:704] = np.nan
    load[1500] = np.nan
    row = only_row(table(Record(record.time, load, force * load / 2.0), 1e-3))
    assert row["static_peak_coefficient"] == pytest.approx(0.6, abs=0.005)
    assert row["normal_force_drift_percent"] == pytest.approx(100 * -0.9 * 0.2 / 1.9, abs=0.05)
    assert row["samples"] >= record.time.size - 8


def test_sign_in_the_file_changes_the_direction_only():
    record = saw_tooth()
    mirrored = Record(record.time, record.normal_force, -record.friction_force)
    row = only_row(table(record, 1e-3))
    other = only_row(table(mirrored, 1e-3))
    assert (row.pop("direction"), other.pop("direction")) == (1, -1)
    assert row == pytest.approx(other)


def test_figures_of_standards_follow_from_their_definitions():
    record = saw_tooth(noise=0.0)
    row = only_row(table(record, 1e-3))
    mean = float(np.mean(record.friction_force[800:]))
    assert row["stick_slip_index"] == pytest.approx(0.4 / (2.0 * mean), rel=0.01)
    assert row["static_over_kinetic"] == pytest.approx(0.6 / (mean / 2.0), rel=0.01)
    assert row["slips_per_mm"] == pytest.approx(1 / 0.408, rel=0.01)
    assert row["jump_length_m"] == pytest.approx(0.4 / 1000.0, rel=0.01)
    assert row["kinetic_travel_m"] == pytest.approx(1e-3 * (record.time[-1] - 0.799), rel=0.01)
    assert only_row(table(record, None))["slips_per_mm"] is only_row(table(record, None))["kinetic_travel_m"] is None


def test_replicates_have_a_mean_and_a_standard_deviation():
    levels = np.random.default_rng(20).normal(0.6, 0.015, 20)
    logs = [
        inspection(f"{i}.csv", saw_tooth(high=high, seed=i), StatedRig(1000.0, 1e-3)) for i, high in enumerate(levels)
    ]
    mean, sd = replicates(logs)["static_peak_coefficient"]
    assert mean == pytest.approx(levels.mean(), abs=0.004) and sd == pytest.approx(levels.std(ddof=1), abs=0.003)
    each = [seen.classical.rows[0] for seen in logs]
    for name, (mean, sd) in replicates(logs).items():
        figures = np.array([row[name] for row in each])
        assert (mean, sd) == pytest.approx((np.mean(figures), np.std(figures, ddof=1)), rel=1e-12)
    other = inspection("slow.csv", saw_tooth(), StatedRig(1000.0, 2e-3))
    assert not replicates([*logs, other]) and not replicates(logs[:1])
