"""Runs of true values, and what a drive does within a window."""

import numpy as np

from data_io.arrays import longest_run, true_runs
from identify.simulation.drive import Drive


def test_runs_begin_and_stop_where_the_flags_change():
    assert true_runs([True, True, False, False, True]).tolist() == [[0, 2], [4, 5]]
    assert true_runs(np.zeros(3, bool)).tolist() == [] and true_runs([]).shape == (0, 2)
    assert (longest_run([False, True, True, False, True]), longest_run([]), longest_run([False])) == (2, 0, 0)


def test_a_drive_within_a_window_begins_with_what_holds_there():
    drive = Drive.of(((0.0, 1e-3), (2.0, 0.0), (3.0, -2e-3)))
    assert drive.changes(2.0, 3.5) == [3.0]  # the ends do not count
    assert drive.within(2.0, 3.5) == [(2.0, 0.0), (3.0, -2e-3)]
    assert drive.within(-1.0, 2.5)[0] == (-1.0, 1e-3)
    assert drive.within(2.5, 2.75) == [(2.5, 0.0)]
