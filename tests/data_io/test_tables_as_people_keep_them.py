"""Tables as people keep them: units row by row, statistics below the rows, a channel that is sampled slower."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_io import LogError, read_log

SIBLINGS = range(20)


def drawn(seed: int, rows: int = 600) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.random.Generator]:
    """Time [s] at a rate drawn by lot, friction and normal force [N], as many digits as a file holds."""
    random = np.random.default_rng(seed)
    time = np.arange(rows) / random.choice([100.0, 200.0, 500.0])
    force = random.uniform(0.3, 1.5) + 0.1 * random.random() * np.sin(7.0 * time) + 0.01 * random.standard_normal(rows)
    return time, np.round(force, 4), np.round(2.0 + 0.002 * random.standard_normal(rows), 4), random


def check(path: Path, time: np.ndarray, force: np.ndarray, load: np.ndarray) -> None:
    """The log holds these numbers."""
    record = read_log(path)
    np.testing.assert_allclose(record.time, time - time[0], atol=2e-6)
    np.testing.assert_allclose(record.friction_force, force, atol=1e-9)
    np.testing.assert_allclose(record.normal_force, load, atol=1e-9)


UNITS = {"N": 1.0, "mN": 1e3, "cN": 1e2, "kN": 1e-3}


def in_units(force: np.ndarray, random: np.random.Generator) -> list[tuple[str, str]]:
    """Each number in a unit drawn by lot, as a meter that changes its range writes it."""
    units = random.choice(list(UNITS), force.size) if random.random() < 0.5 else np.where(force < 1.0, "mN", "N")
    return [(f"{f * UNITS[unit]:.10g}", str(unit)) for f, unit in zip(force.tolist(), units, strict=True)]


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_column_of_units_tells_the_unit_of_each_row(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed, rows=3000)
    delimiter = random.choice([",", ";", "\t"])
    name = random.choice(["Unit", "Fx unit", "Einheit", "[]"])
    both = seed % 2
    heads = ["Time [s]", "Fx", name, *(("Fz", "Unit") if both else ("Fz [N]",))]
    lines = [delimiter.join(heads)]
    loads = in_units(load, random) if both else [(str(n),) for n in load.tolist()]
    forces = in_units(force, random)
    for t, f, n in zip(time.tolist(), forces, loads, strict=True):
        lines.append(delimiter.join((f"{t:.4f}", *f, *n)))
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    check(tmp_path / "log.csv", time, force, load)
    if len({unit for _, unit in forces}) > 1:
        with pytest.raises(LogError, match="leave the unit out"):
            read_log(tmp_path / "log.csv", units={"friction_force": "N"})


def test_units_whose_column_is_not_clear_are_asked_for(tmp_path: Path) -> None:
    time, force, load, random = drawn(0)
    rows = [f"{t:.4f},{f[0]},{n},{f[1]}" for t, f, n in zip(time, in_units(force, random), load, strict=True)]
    (tmp_path / "two.csv").write_text("Time [s],Fx,Fz,Unit\n" + "\n".join(rows) + "\n")
    (tmp_path / "said.csv").write_text("Time [s],Fz [N],Fx [N],Unit\n" + "\n".join(rows) + "\n")
    for name in ("two.csv", "said.csv"):
        with pytest.raises(LogError, match="not clear"):
            read_log(tmp_path / name, units={"friction_force": "N", "normal_force": "N"})


def test_cells_with_their_unit_are_read_in_it_whatever_stands_first_in_a_later_block(tmp_path: Path) -> None:
    time, force, load, random = drawn(1, rows=20_000)
    cells = [" ".join(cell) for cell in in_units(force, random)]
    rows = [f"{t:.4f},{f},{n}" for t, f, n in zip(time, cells, load, strict=True)]
    (tmp_path / "log.csv").write_text("Time [s],Fx,Fz [N]\n" + "\n".join(rows) + "\n")
    check(tmp_path / "log.csv", time, force, load)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_statistics_below_the_rows_are_no_rows(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed, rows=int(np.random.default_rng(seed).integers(100, 4000)))
    delimiter = random.choice([",", ";", "\t"])
    words = random.choice(["Mean", "Mittelwert", "Std. dev.", "Max", "σ", "average", "N", "Min:"], 3, replace=False)
    numbered = seed % 3 == 0
    rows = [f"{t:.4f},{f},{n}" for t, f, n in zip(time, force, load, strict=True)]
    lines = [("No,Time [s]," if numbered else "Time [s],") + "Fx [N],Fz [N]"]
    lines += [f"{i},{row}" for i, row in enumerate(rows, 1)] if numbered else rows
    lines += random.choice(["", "Statistics"], 1).tolist() if seed % 2 else []
    for word in words.tolist():
        values = [f"{random.uniform(0.0, 3.0):.4f}" for _ in range(3 if numbered else 2)]
        lines.append(",".join((word, *values)))
    text = "\n".join(line.replace(",", delimiter) for line in lines) + ("\n" if seed % 4 else "")
    (tmp_path / "log.csv").write_text(text)
    check(tmp_path / "log.csv", time, force, load)
    record = read_log(tmp_path / "log.csv")
    assert "footer" in record.metadata or any(f.code == "statistics_below" for f in record.findings)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_channel_with_blanks_between_its_values_is_paired_by_time(tmp_path: Path, seed: int) -> None:
    """The load in every so many-th row, or both forces by turns: between its samples it is a straight line."""
    time, force, load, random = drawn(seed, rows=2000)
    every, first = int(random.integers(2, 60)), int(random.integers(0, 2))
    turns = seed % 4 == 0
    every = 2 if turns else every
    loaded = np.arange(time.size) % every == first
    rubbed = ~loaded if turns else np.ones(time.size, dtype=bool)
    blank = random.choice(["", "NaN", "-"])
    lines = ["Time [s],Fx [N],Fz [N]"]
    for i, t in enumerate(time.tolist()):
        lines.append(f"{t:.4f},{force[i] if rubbed[i] else blank},{load[i] if loaded[i] else blank}")
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    known = time[loaded]
    rows = rubbed & (time >= known[0]) & (time <= known[-1])
    check(tmp_path / "log.csv", time[rows], force[rows], np.interp(time[rows], known, load[loaded]))


def test_a_slow_friction_force_is_the_clock(tmp_path: Path) -> None:
    time, force, load, _ = drawn(0)
    slow = np.arange(time.size) % 5 == 0
    rows = [f"{t:.4f},{f if s else ''},{n}" for t, f, n, s in zip(time, force, load, slow, strict=True)]
    (tmp_path / "log.csv").write_text("Time [s],Fx [N],Fz [N]\n" + "\n".join(rows) + "\n")
    check(tmp_path / "log.csv", time[slow], force[slow], load[slow])


def test_a_slow_channel_that_stops_for_a_while_is_no_load(tmp_path: Path) -> None:
    time, force, load, _ = drawn(0, rows=2000)
    there = (np.arange(time.size) % 10 == 0) & ((time < time[700]) | (time > time[1300]))
    rows = [f"{t:.4f},{f},{n if s else ''}" for t, f, n, s in zip(time, force, load, there, strict=True)]
    (tmp_path / "log.csv").write_text("Time [s],Fx [N],Fz [N]\n" + "\n".join(rows) + "\n")
    with pytest.raises(LogError, match="normal force holds no number in rows"):
        read_log(tmp_path / "log.csv")
