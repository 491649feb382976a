"""Small inputs that asked for unbounded work end soon, in little memory, in one sentence (a sample of the study)."""

import time
from pathlib import Path

import pytest

from data_io import read_log
from data_io.text import is_number
from data_io.units import UnitError, kind_of, parse_quantity
from experiments.hostile_inputs import BOMBS, all_inputs, text
from experiments.run_hostile_inputs import ended, tried

CASES = Path(__file__).parents[1] / "cases"
SAMPLE = 60  # every so many-th input
QUICK = 1.0  # [s] of processor time; each took from ten seconds to minutes


@pytest.fixture(scope="module")
def idle(tmp_path_factory):
    """Peak memory of a process that reads a small log."""
    folder = tmp_path_factory.mktemp("idle")
    (folder / "good.csv").write_bytes(text("comma.csv"))
    ending = ended(["inspect", "good.csv"], folder)
    assert ending.code == 0
    return ending.memory


@pytest.mark.parametrize("hostile", list(all_inputs())[::SAMPLE], ids=lambda hostile: f"{hostile.name}, {hostile.file}")
def test_hostile_input_ends_soon_in_a_sentence(hostile, tmp_path, idle):
    assert tried(hostile, tmp_path, idle)[1] == ""


def timed(work):
    begun = time.process_time()
    work()
    return time.process_time() - begun


@pytest.mark.parametrize("unit", [*BOMBS.values(), "N^(9^9)", "(9)^99", "m^(99)^99^99", "N squared**99*9**999"])
def test_powers_that_grow_are_no_units(unit):
    assert timed(lambda: kind_of(unit)) < QUICK
    with pytest.raises(UnitError):
        parse_quantity(f"1 {unit}", "N")


@pytest.mark.parametrize("place", ["TOP", "BELOW", "ROWS", "END"])
@pytest.mark.parametrize("name", ["comma.csv", "cetr.txt", "pair.lvm"])
def test_forty_thousand_blank_lines_leave_the_numbers(tmp_path, name, place):
    path = tmp_path / name
    path.write_bytes(text(name, **{place: "\n" * 40_000}))
    read = []
    assert timed(lambda: read.append(read_log(path))) < QUICK
    assert read[0].friction_force.tolist() == [0.5, 0.52, 0.54, 0.53]
    assert read[0].normal_force.tolist() == [3.0, 3.01, 2.99, 3.0]


@pytest.mark.parametrize("token", ["7" * 100_000 + "x", "0." + "7" * 100_000 + ",", "0x" + "f" * 100_000])
def test_digits_without_end_that_are_no_number_are_looked_at_once(token):
    assert timed(lambda: is_number(token)) < QUICK
    assert not is_number(token)
