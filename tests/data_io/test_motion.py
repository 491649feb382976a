"""How the drive moved: programmes written into a position column are told back; a wrong statement is seen."""

import numpy as np
import pytest

from data_io import LogError, Record
from data_io.drive import check_drive, motion_of

RATE = 200.0


def moved(programme, noise=0.0, seed=1, **more):
    """A record whose channel X [m] follows (duration [s], speed [m/s]) pieces; the force follows the direction."""
    time = np.arange(0, sum(duration for duration, _ in programme), 1 / RATE)
    edges = np.cumsum([0.0, *(duration for duration, _ in programme)])
    speed = np.array([s for _, s in programme])[
        np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(programme) - 1)
    ]
    x = np.interp(time, edges, np.cumsum([0.0, *(d * s for d, s in programme)]))
    x = x + noise * np.random.default_rng(seed).standard_normal(time.size)
    return Record(
        time=time, normal_force=np.full(time.size, 2.0), friction_force=np.sign(speed) + 0.01 * np.sin(time),
        channels={"Z": np.full(time.size, 1e-6), "X": x, **more}, channel_units={"Z": "m", "X": "m"},
    )  # fmt: skip


PROGRAMMES = {
    "one speed": [(20, 1e-4)],
    "to and fro": [(5, 1e-3), (5, -1e-3), (5, 1e-3), (5, -1e-3)],
    "move, rest, move": [(10, 2e-3), (5, 0.0), (10, 2e-3)],
    "a step of the speed": [(10, 1e-3), (10, 3e-3)],
    "three speeds and a rest": [(8, 1e-3), (8, 2e-3), (6, 0.0), (8, 5e-3)],
    "unequal strokes": [(9, 1e-3), (3, -3e-3), (9, 1e-3)],
}


@pytest.mark.parametrize("noise", [0.0, 2e-6])
@pytest.mark.parametrize("name", PROGRAMMES)
def test_a_programme_is_told_back(name, noise):
    programme = PROGRAMMES[name]
    motion = motion_of(moved(programme, noise))
    assert motion.column == "X"
    starts = np.cumsum([0.0, *(duration for duration, _ in programme[:-1])])
    assert [start for start, _ in motion.programme] == pytest.approx(starts, abs=0.05)
    assert [speed for _, speed in motion.programme] == pytest.approx([s for _, s in programme], rel=0.01, abs=1e-12)


def test_what_does_not_move_tells_nothing():
    assert motion_of(moved([(10, 0.0)])) is None
    record = moved([(10, 0.0)])
    assert check_drive(record, 1.0) == []
    with pytest.raises(LogError, match="no column 'Y'"):
        motion_of(record, "Y")


def test_a_wrong_statement_of_the_drive_is_seen_and_a_right_one_is_not():
    record = moved(PROGRAMMES["move, rest, move"], 1e-6)
    assert check_drive(record, 2e-3) == [] and check_drive(record, 2.08e-3) == []
    assert check_drive(record, 2.2e-3)[0].code == "drive_speed_disagrees"
    assert check_drive(record, [(0.0, 2e-3), (10.0, 0.0), (15.0, 2e-3)]) == []
    assert check_drive(record, [(0.0, 2e-3), (10.0, 0.0), (15.0, 1e-3)])[0].code == "drive_speed_disagrees"
    assert check_drive(moved(PROGRAMMES["to and fro"]), -1e-3) == []
