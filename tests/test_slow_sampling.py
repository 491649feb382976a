"""Logs whose slips fall between two samples: the event times of a slip are found by its levels, not by its samples."""

from __future__ import annotations

import numpy as np

from experiments.run_recovery_study import Study, fit_case
from identify import passes


def test_events_settle_within_the_slip_where_samples_lie_farther_apart(monkeypatch):
    case, _, _ = Study("usual", rate=0.25).case(28)  # its slowest log at 5 Hz, slips of 35 ms
    found = fit_case(case, None, "data")
    assert found.recovered and max(abs(error) for error in found.errors.values()) < 0.05, found.message
    monkeypatch.setattr(passes, "OF_A_SLIP", np.inf)  # negative control: half a sample is three slips here,
    monkeypatch.setattr(passes, "AT_BOUND", np.inf)  # and an event that goes as far as it can has not arrived
    hasty = fit_case(case, None, "data")
    assert not hasty.recovered and "normal force is off" in hasty.message
