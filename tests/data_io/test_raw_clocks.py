"""Clocks as loggers leave them: each sibling is read as the plain file is, or refused with its cause."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_io import LogError, read_log
from tests.data_io.test_tables_as_people_keep_them import check, drawn

SIBLINGS = range(4)


def write(path: Path, unit: str, stamps: list[str], force: np.ndarray, load: np.ndarray) -> None:
    rows = "".join(f"{t},{f},{n}\n" for t, f, n in zip(stamps, force.tolist(), load.tolist(), strict=True))
    path.write_text(f"Time [{unit}],Fx [N],Fz [N]\n{rows}")


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_counter_that_begins_anew_goes_on(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed, rows=3000)
    bits, unit, per_second = [(16, "ms", 1e3), (32, "us", 1e6), (24, "us", 1e6), (32, "ms", 1e3)][seed % 4]
    counts = np.round(time * per_second).astype(np.int64)
    counts += 2**bits - int(random.integers(1, counts[-1]))  # it begins anew somewhere within
    write(tmp_path / "log.csv", unit, [str(count) for count in (counts % 2**bits).tolist()], force, load)
    check(tmp_path / "log.csv", time, force, load)
    scaled = [f"{count / per_second:.6f}" for count in (counts % 2**bits).tolist()]
    write(tmp_path / "scaled.csv", "s", scaled, force, load)
    check(tmp_path / "scaled.csv", time, force, load)


@pytest.mark.parametrize("length", [5.0, 60.0, 64.0])
def test_a_clock_that_restarts_with_each_block_is_no_counter(tmp_path: Path, length: float) -> None:
    """Negative control: nobody knows the pause between the blocks."""
    _, force, load, _ = drawn(0, rows=6000)
    time = np.arange(6000) / 50.0 % length
    write(tmp_path / "log.csv", "s", [f"{t:.3f}" for t in time.tolist()], force, load)
    with pytest.raises(LogError, match=r"restarts|falls"):
        read_log(tmp_path / "log.csv")


@pytest.mark.parametrize("seed", SIBLINGS)
def test_the_newest_row_may_stand_first(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed)
    begin = random.uniform(0.0, 1e4)
    write(tmp_path / "log.csv", "s", [f"{begin + t:.4f}" for t in time[::-1].tolist()], force[::-1], load[::-1])
    check(tmp_path / "log.csv", time, force, load)
    assert "newest_first" in {finding.code for finding in read_log(tmp_path / "log.csv").findings}


@pytest.mark.parametrize("seed", SIBLINGS)
def test_rows_that_were_never_written_are_none(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed)
    count, begin = int(random.integers(2, 400)), random.uniform(0.01, 100.0)
    stamps, none = [f"{begin + t:.4f}" for t in time.tolist()], ["0"] * count
    blank = np.zeros(count)
    unused = random.choice([0, -1])
    if seed % 2:
        args = none + stamps, np.r_[blank, force], np.r_[blank, load]
    else:  # buffers that were not filled; the forces in them may be of before
        args = stamps + [str(unused)] * count, np.r_[force, force[:count]], np.r_[load, load[:count]]
    write(tmp_path / "log.csv", "s", *args)
    check(tmp_path / "log.csv", time, force, load)


def test_a_log_may_begin_at_rest(tmp_path: Path) -> None:
    """Negative control: one row of zeros, and stamps of whole seconds that rows share."""
    time, force, load, _ = drawn(0)
    force[0] = load[0] = 0.0
    write(tmp_path / "log.csv", "s", [f"{t:.4f}" for t in time.tolist()], force, load)
    check(tmp_path / "log.csv", time, force, load)
    time = np.arange(3000) / 10.0
    _, force, load, _ = drawn(1, rows=3000)
    write(tmp_path / "whole.csv", "s", [f"{np.floor(t):.0f}" for t in time.tolist()], force, load)
    assert len(read_log(tmp_path / "whole.csv")) == 3000


@pytest.mark.parametrize("seed", SIBLINGS)
def test_six_significant_digits_are_a_rounded_clock(tmp_path: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    rate = float(random.choice([50.0, 100.0, 200.0, 1000.0]))
    time = np.arange(int(12 * rate)) / rate
    _, force, load, _ = drawn(seed, rows=time.size)
    begin = float(random.choice([3.0, 95.0, 123.4, 995.0, 1234.5]))  # at some of them the digits change within
    write(tmp_path / "log.csv", "s", [f"{begin + t:.6g}" for t in time.tolist()], force, load)
    record = read_log(tmp_path / "log.csv")
    assert len(record) == time.size
    np.testing.assert_allclose(record.time, time, atol=0.6 / rate if begin < 900 else 6e-3)
    assert np.median(np.diff(record.time)) == pytest.approx(1.0 / rate, rel=2e-3)


def test_a_header_may_hold_line_breaks_within_quotes(tmp_path: Path) -> None:
    time, force, load, _ = drawn(2)
    rows = "".join(f"{t:.4f},{f},{n}\n" for t, f, n in zip(time.tolist(), force, load, strict=True))
    heads = (
        '"Time\n[s]","Fx\n[N]","Fz\n[N]"\n',
        '"Time","Friction\r\nforce","Normal\r\nforce"\r\ns,N,N\r\n',
        'Disc of 5" and pin\nTime [s],"Friction force\nFx [N]",Fz [N]\n',
        'Operator,"A. Smith\nroom 4"\n"Elapsed\ntime\n(s)",Fx (N),"Load\n\n(N)"\n',
    )
    for number, head in enumerate(heads):
        (tmp_path / f"{number}.csv").write_text(head + rows, newline="")
        check(tmp_path / f"{number}.csv", time, force, load)


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("delimiter", [",", "\t", ";"])
def test_utf_16_without_its_mark_is_read(tmp_path: Path, encoding: str, delimiter: str) -> None:
    time, force, load, _ = drawn(3)
    rows = "".join(f"{t:.4f},{f},{n}\n" for t, f, n in zip(time.tolist(), force, load, strict=True))
    text = ("µ-Tribometer Nº 5\nTime [s],Fx [N],Fz [N]\n" + rows).replace(",", delimiter)
    (tmp_path / "log.csv").write_bytes(text.encode(encoding))
    check(tmp_path / "log.csv", time, force, load)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('{"t": [0, 1], "Fx": [1, 2]}', "JSON"),
        ('[\n {"t": 0, "Fx": 1},\n {"t": 1, "Fx": 2}\n]', "JSON"),
        ("[[0, 1, 2],\n [1, 1, 2]]", "JSON"),
        ('{"t": 0, "Fx": 1}\n{"t": 1, "Fx": 2}\n', "JSON"),
        ('{"columns": ["t", "Fx", "Fz"],\n "data": [[\n  0.0,\n 1.0,\n 2.0\n], [1.0,\n 1.0,\n 2.0]]}', "JSON"),
        ('<?xml version="1.0"?>\n<usi:tdm version="1.0">\n</usi:tdm>', "TDM of National Instruments"),
        ('<?xml version="1.0"?>\n<Workbook>\n<Row><Cell>1</Cell></Row></Workbook>', "XML"),
        ("<!DOCTYPE html>\n<html><table><tr><td>1</td></tr></table></html>", "web page"),
        ('# my scene\neffects = ["inertia"]\n[rig]\nmass = "1 kg"\n[[logs]]\npath = "a.csv"\n', "scene"),
    ],
)
def test_what_is_no_log_is_called_by_its_format(tmp_path: Path, text: str, name: str) -> None:
    (tmp_path / "log.txt").write_text(text)
    for options in ({}, {"columns": {"time": "1", "friction_force": "2"}}):
        with pytest.raises(LogError, match=f"the file is .*{name}"):
            read_log(tmp_path / "log.txt", **options)
