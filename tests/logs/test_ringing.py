"""The mass that the ringing within slips tells, in the classical table: of an example whose mass is known."""

import json

import pytest

from data_io import Record, read_log
from identify.base.result import ClassicalTable, LogResult
from identify.examples import FOLDER, TRUTH
from identify.logs.classical import classical_table
from identify.report.report_tables import classical_pages

MASS = json.loads(TRUTH.read_text())["rig"]["mass"]


def only_row(record, **known):
    (row,) = classical_table(record, **known).rows
    return row


@pytest.mark.parametrize("slower", [1.0, 2.0])
def test_the_mass_of_a_log_that_rings(slower):
    """A record played at half the speed rings at half the frequency: its mass is fourfold."""
    record = read_log(FOLDER / "5_mm_per_s.txt.gz")
    record = Record(record.time * slower, record.normal_force, record.friction_force)
    row = only_row(record, drive_speed=5e-3 / slower, stiffness=1470.0)
    assert row["ringing_mass_from_kg"] < MASS * slower**2 < row["ringing_mass_to_kg"]
    assert row["ringing_mass_kg"] == pytest.approx(MASS * slower**2, rel=0.05)
    assert row["ringing_stiffness_N_per_m"] == 1470.0
    (page,) = classical_pages([LogResult(classical=ClassicalTable((row,)))])
    assert {"ringing", "ringing mass"} <= {line[0].shown for line in page.rows}


def test_without_a_stated_stiffness_that_of_the_sticks_is_taken_and_said():
    record = read_log(FOLDER / "5_mm_per_s.txt.gz")
    row = only_row(record, drive_speed=5e-3)
    assert row["ringing_stiffness_N_per_m"] == row["stick_stiffness_N_per_m"]
    unknown = classical_table(record, drive_speed=None)
    assert unknown.rows[0]["ringing_Hz"] == row["ringing_Hz"] and unknown.rows[0]["ringing_mass_kg"] is None
    assert "drive speed" in unknown.reasons[0]["ringing_mass_kg"]


def test_slips_too_slow_to_ring_tell_no_mass_and_say_why():
    table = classical_table(read_log(FOLDER / "0.1_mm_per_s.txt.gz"), drive_speed=1e-4, stiffness=1470.0)
    assert table.rows[0]["ringing_mass_kg"] is None
    assert "too slow" in table.reasons[0]["ringing_mass_kg"]
