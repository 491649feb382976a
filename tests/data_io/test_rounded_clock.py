"""An even clock that was written with too few digits is even again; any other clock is left as it is."""

from pathlib import Path

import numpy as np
import pytest

from data_io import clock
from data_io import read_log as read
from data_io.clock import evened
from data_io.quality import assess
from data_io.record import BLOCK

EVEN = np.arange(4000) / 800.0


@pytest.mark.parametrize("rounding", [np.round, np.floor])
@pytest.mark.parametrize("rate", [800.0, 730.0, 999.0, 333.0])
def test_a_rounded_clock_is_even_again(rounding, rate) -> None:  # type: ignore[no-untyped-def]
    true = np.arange(3000) / rate
    time, (finding,) = evened(rounding(true * 1000.0) / 1000.0)
    assert np.ptp(time - true) < 4e-4, "but for a shift of the whole clock; the stamps are off by 1e-3"
    assert finding.code == "clock_rounded" and "rounded to 0.001 s" in finding.message


def test_other_clocks_are_left_alone() -> None:
    random = np.random.default_rng(1)
    lost = np.delete(EVEN, slice(1000, 1010))
    jittering = EVEN + random.uniform(-0.4, 0.4, EVEN.size) / 800.0
    for time in (EVEN, np.round(jittering, 5), np.round(lost, 3), np.round(EVEN * 8.0, 3), np.round(EVEN, 3)[:40]):
        same, findings = evened(time)
        assert same is time and findings == []


def test_a_file_with_few_digits_is_read_with_its_even_clock_and_says_so(tmp_path: Path) -> None:
    rows = "\n".join(f"{t:.3f},1.0,{0.3 + 0.1 * (i % 7):.3f}" for i, t in enumerate(EVEN))
    (tmp_path / "a.csv").write_text(f"Time,Fz,Fx\ns,N,N\n{rows}\n")
    record = read(tmp_path / "a.csv")
    assert np.ptp(np.diff(record.time)) < 1e-9
    assert "clock_rounded" in [finding.code for finding in record.findings]


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


def test_an_odd_interval_anywhere_in_a_long_clock_is_seen() -> None:
    """Intervals are made block by block: none between two blocks is lost."""
    rows = 3 * BLOCK + 7
    for place in (1, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, rows - 1):
        time = np.arange(rows) / 1000.0
        time[place:] += 0.25
        assert clock._spread(time) == np.ptp(np.diff(time))
    assert clock._spread(np.arange(rows) * 0.5) == 0.0
