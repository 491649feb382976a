"""What is drawn of a fit is what was fitted."""

from dataclasses import replace

import numpy as np
import pytest

from identify.base.outcome import SlipDetail
from identify.report.reconstruct import AS_FITTED, as_fitted

TIME = np.arange(0.0, 0.2, 0.01)


def slip(delay=0.0):
    """A slip of 60 ms from 0.05 s on, seen by the samples around it."""
    fine = np.linspace(0.03, 0.15, 400)
    force = 1.0 - 0.5 * np.clip((fine - 0.05 - delay) / 0.06, 0.0, 1.0)
    none = np.full(fine.size, np.nan)
    return SlipDetail(1, fine, force, none, none, none, none, np.flatnonzero((TIME > 0.03) & (TIME < 0.15)))


def fitted():
    made = slip()
    return np.where((TIME > 0.03) & (TIME < 0.15), np.interp(TIME, made.time, made.force), np.nan)


@pytest.mark.parametrize(
    ("delay", "drawn"), [(0.0, True), (0.9 * AS_FITTED * 0.06, True), (1.1 * AS_FITTED * 0.06, False)]
)
def test_a_slip_is_drawn_where_the_fit_has_it(delay, drawn):
    assert as_fitted(slip(delay), TIME, fitted()) == drawn


def test_samples_without_a_fit_do_not_count():
    nowhere = np.full(TIME.size, np.nan)
    assert as_fitted(replace(slip(0.03), cycle=2), TIME, nowhere)
