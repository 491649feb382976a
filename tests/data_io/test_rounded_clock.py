"""An even clock that was written with too few digits is even again; any other clock is left as it is."""

import h5py
import numpy as np
import pytest

from data_io import LogError
from data_io import read_log as read
from data_io.clock import evened
from data_io.quality import assess


@pytest.mark.parametrize("rounding", [np.round, np.floor])
@pytest.mark.parametrize("rate", [800.0, 730.0, 999.0, 333.0])
def test_a_rounded_clock_is_even_again(rounding, rate) -> None:  # type: ignore[no-untyped-def]
    true = np.arange(3000) / rate
    time, (finding,) = evened(rounding(true * 1000.0) / 1000.0)
    assert np.ptp(time - true) < 4e-4, "but for a shift of the whole clock; the stamps are off by 1e-3"
    assert finding.code == "clock_rounded" and "rounded to 0.001 s" in finding.message


@pytest.mark.parametrize(("fault", "code"), [("repeated", "repeated_time"), ("lost", "dropouts")])
def test_one_row_lost_or_repeated_is_no_rounding(tmp_path, fault, code):
    """One odd interval among eighty fits a clock of 0.6 % another rate as well; it is said, and the rate stays."""
    rows = [f"{0.0127 + 0.02 * i:.4f},{0.5 + 0.01 * (i % 7):.4f},2.0" for i in range(83)]
    rows[40:41] = [rows[40], rows[40]] if fault == "repeated" else []
    path = tmp_path / "log.csv"
    path.write_text("T [s],Fx [N],Fz [N]\n" + "\n".join(rows) + "\n")
    record = read(path)
    findings = {finding.code for finding in (*record.findings, *assess(record).findings)}
    assert code in findings and "clock_rounded" not in findings
    assert np.diff(record.time).min() == pytest.approx(0.02) and np.isclose(np.diff(record.time), 0.02).sum() >= 80


@pytest.mark.parametrize("start", [20.0, 5000.0, 90000.0])
@pytest.mark.parametrize("rate", [2000.0, 4096.0, 1234.5])
def test_single_precision_is_even_again(start, rate):
    true = start + np.arange(8001) / rate
    time, findings = evened(true.astype(np.float32).astype(np.float64))
    step = float(np.spacing(np.float32(start)))
    if step < 0.1 / rate:
        assert not findings, "finer than matters"
        return
    assert np.ptp(time - true) < 0.1 / rate and findings[0].code == "clock_rounded"


@pytest.mark.parametrize("tick", [1 / 64, 1 / 60, 0.015625, 0.01, 1.0])
@pytest.mark.parametrize("ticks", [0.13, 0.7, 1.28, 2.5])
@pytest.mark.parametrize("decimals", [6, 9])
def test_ticks_of_a_timer_are_even_again(tick, ticks, decimals):
    """Windows timers tick 64 times, screens 60 times a second; a row gets the tick before it."""
    true = np.arange(2000) * ticks * tick
    stamps = np.round(np.floor(true / tick + 1e-9) * tick, decimals)
    time, findings = evened(stamps)
    assert np.ptp(time - true) < 0.5 * tick and [f.code for f in findings] == ["clock_rounded"]
    assert np.diff(time).min() > 0


def test_clocks_that_jitter_have_gaps_or_are_even_stay():
    random = np.random.default_rng(1)
    even = np.arange(3000) / 100.0
    for stamps in (
        even,
        even + random.uniform(-0.004, 0.004, 3000),
        np.sort(random.choice(even, 1500, replace=False)),
        np.delete(np.floor(even * 64) / 64, slice(1000, 1200)),
        np.concatenate([even[:100], even[100:200] + 5.0]),
    ):
        same, findings = evened(stamps)
        assert same is stamps and findings == []


def test_files_with_such_clocks(tmp_path):
    force = 0.5 + 0.1 * (np.arange(2000) % 40) / 40
    true = 5000.0 + np.arange(2000) / 2000.0
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values, unit in (("time", true, "s"), ("Fx", force, "N"), ("Fz", np.ones(2000), "N")):
            file.create_dataset(name, data=values.astype(np.float32)).attrs["units"] = unit
    record = read(tmp_path / "a.h5")
    assert np.ptp(np.diff(record.time)) < 1e-9 and 1 / record.time[1] == pytest.approx(2000.0, rel=1e-3)
    rows = "".join(f"{np.floor(i / 100 * 64) / 64:.6f},{force[i]:.4f},1\n" for i in range(2000))
    (tmp_path / "b.csv").write_text("Time [s],Fx [N],Fz [N]\n" + rows)
    record = read(tmp_path / "b.csv")
    assert len(record) == 2000 and 1 / record.time[1] == pytest.approx(100.0, rel=1e-3)
    rows = "".join(f"{12 + i // 10}\t{force[i]:.4f}\t1\n" for i in range(600))
    (tmp_path / "c.txt").write_text("Time [s]\tFx [N]\tFz [N]\n" + rows)
    record = read(tmp_path / "c.txt")
    assert len(record) == 600 and 1 / record.time[1] == pytest.approx(10.0, rel=2e-3)


def test_rows_that_share_stamps_at_random_are_refused(tmp_path):
    stamps = np.sort(np.random.default_rng(2).integers(0, 300, 600)) / 10.0
    rows = "".join(f"{t:.1f},{i % 7}.5,1\n" for i, t in enumerate(stamps))
    (tmp_path / "a.csv").write_text("Time [s],Fx [N],Fz [N]\n" + rows)
    with pytest.raises(LogError, match="repeats itself"):
        read(tmp_path / "a.csv")
