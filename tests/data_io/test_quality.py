"""The quality gate finds what was put in, names it, and is silent about a clean record."""

from pathlib import Path

import numpy as np
import pytest

from data_io import Record, Step, read_log
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


def test_a_clean_record_is_good():
    quality = assess(record())
    assert quality.verdict == "accept" and not quality.findings
    assert quality.sampling.rate == pytest.approx(500) and quality.load.mean == pytest.approx(1, rel=1e-3)


def test_dropouts_are_counted():
    time = np.delete(np.arange(N + 7) / 500, [100, 101, 102, 500, 900, 901, 1500])
    sampling = assess(record(time)).sampling
    assert (sampling.dropouts, sampling.missing) == (4, 7) and sampling.longest_gap == pytest.approx(4 / 500)
    assert not sampling.switches and "dropouts" in codes(assess(record(time)))


def test_the_rate_of_a_clock_of_whole_milliseconds_is_that_of_its_span():
    time = np.floor(12.5 * np.arange(N)) / 1000  # steps of 12 and 13 ms
    assert assess(record(time)).sampling.rate == pytest.approx(80.0, rel=1e-3)
    gapped = np.delete(time, np.arange(400, 420))
    assert assess(record(gapped)).sampling.rate == pytest.approx(80.0, rel=1e-3), "a dropout is no slow clock"


def test_a_rate_switch_is_located():
    time = np.r_[np.arange(500) / 10, 50 + np.arange(N - 500) / 1000]
    (switch,) = assess(record(time)).sampling.switches
    assert switch.time == pytest.approx(50, abs=0.2)
    assert switch.before == pytest.approx(10) and switch.after == pytest.approx(1000)


def test_jitter_is_measured():
    rng = np.random.default_rng(6)
    quality = assess(record(np.r_[0, np.cumsum(0.002 * (1 + 0.1 * rng.standard_normal(N - 1)).clip(0.5, 1.4))]))
    assert quality.sampling.jitter == pytest.approx(0.1, rel=0.1) and "jitter" in codes(quality)
    assert not quality.sampling.switches


def test_a_pause_between_steps_is_no_dropout():
    time = np.r_[np.arange(1000) / 500, 60 + np.arange(1000) / 500]
    steps = (Step(1, 1, 0, 1000), Step(1, 2, 1000, 2000))
    assert not assess(record(time, steps=steps)).findings
    assert codes(assess(record(time))) == {"pauses"}


def test_a_sensor_at_its_end_is_seen_and_a_plain_plateau_is_not():
    clipped = np.minimum(record().friction_force, 0.62)
    assert "friction_clipped" in codes(assess(record(friction_force=clipped)))
    stairs = np.round(saw_tooth(np.arange(N) / 500), 2)  # a coarse sensor dwells on every level alike
    assert "friction_clipped" not in codes(assess(record(friction_force=stairs)))


def test_a_coarse_sensor_is_named():
    quality = assess(record(friction_force=np.round(record().friction_force / 0.02) * 0.02))
    assert "friction_coarse" in codes(quality) and quality.signal.resolution == pytest.approx(0.02)


def test_what_a_short_ramp_rises_in_a_row_is_no_step_of_its_sensor():
    """A ramp of few rows is called coarse only where its values repeat and lie on a grid."""
    for rows in (20, 30, 38):
        time = np.arange(rows) / 50
        noise = np.random.default_rng(rows).normal(0, 4e-3, rows)
        fine = np.round(1.47 * time + noise, 5)
        quality = assess(record(time, friction_force=fine))
        assert "friction_coarse" not in codes(quality) and quality.signal.resolution == 0
        even = assess(record(time, friction_force=1.47 * time))
        assert "friction_coarse" not in codes(even), "without noise all differences are alike, and none is a step"
        coarse = assess(record(time, friction_force=np.round(np.round(fine / 0.08) * 0.08, 5)))
        assert "friction_coarse" in codes(coarse) and coarse.signal.resolution == pytest.approx(0.08)


def test_the_step_is_found_through_the_rounding_of_the_file_and_none_among_uneven_levels():
    force = record().friction_force
    counts = np.round(force / 0.0123)
    assert assess(record(friction_force=np.round(counts * 0.0123, 3))).signal.resolution == pytest.approx(
        0.0123, rel=0.02
    )
    uneven = np.sort(np.random.default_rng(2).uniform(force.min(), force.max(), 20))
    held = uneven[np.clip(np.searchsorted(uneven, force), 0, 19)]
    assert assess(record(friction_force=held)).signal.resolution == 0


def test_drift_ripple_and_unloaded_rows_of_the_load():
    time = np.arange(N) / 500
    drift = assess(record(normal_force=1 - 0.2 * time / time[-1]))
    assert drift.load.drift == pytest.approx(-0.2, rel=0.15) and codes(drift) == {"load_drift"}
    ripple = assess(record(normal_force=1 + 0.1 * np.sqrt(2) * np.sin(2 * np.pi * 5 * time)))
    assert ripple.load.ripple == pytest.approx(0.1, rel=0.02) and "load_ripple" in codes(ripple)
    late = np.where(time < 0.4, 0.0, 1.0)
    assert "unloaded_rows" in codes(assess(record(normal_force=late)))


def test_the_coefficient_of_the_file_is_checked():
    friction = record().friction_force
    told = np.abs(friction / record().normal_force)
    assert "coefficient_disagrees" not in codes(assess(record(channels={"COF": told})))
    quality = assess(record(channels={"COF": told * 1.2}))
    assert quality.coefficient_error == pytest.approx(0.2) and "coefficient_disagrees" in codes(quality)


def test_measured_records_are_good():
    if not MEASURED.is_dir():
        pytest.skip("the measured paper-on-paper records are not on this machine")
    for path in sorted(MEASURED.glob("*.csv")):
        quality = assess(read_log(path))
        assert quality.verdict == "accept" and quality.sampling.rate == pytest.approx(2000)
        assert codes(quality) == {"normal_force_not_measured"}
