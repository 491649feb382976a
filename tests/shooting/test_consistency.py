"""What a motion takes for granted, and what stands for nothing in it."""

import numpy as np
import pytest

from identify.estimation.goodness_of_fit import inconsistency
from identify.model.model import SPEED
from identify.shooting.shooting_trajectory import ShootingTrajectory
from tests.support import shooting_case as case

UNKNOWNS = case.search_space(case.PAIR, case.FRICTION)
LOG = case.simulated(case.PAIR, *case.MIDDLE)
DATA = case.log_data(LOG, UNKNOWNS)


def motion(*, wears: bool, slip: float, after: float) -> ShootingTrajectory:
    """Two slips alike, whose slowest node before and after the wear has these speeds [m/s]."""
    nodes = np.zeros((2, 9, 3))
    nodes[:, :, 0] = np.linspace(4e-4, 2.5e-4, 9)
    nodes[:, 1:-1, SPEED] = 5e-3
    nodes[:, :, 2] = np.linspace(1.0, 0.1, 9)
    later = nodes.copy()
    nodes[1, 4, SPEED], later[1, 4, SPEED] = slip, after
    onset = np.array([0.5, 0.8])
    wear = onset + 0.02 if wears else np.full(2, np.nan)
    return ShootingTrajectory.train(nodes[0, 0], onset, wear, onset + 0.05, nodes, later, np.empty(0))


def said(trajectory: ShootingTrajectory) -> str | None:
    return inconsistency([DATA], [trajectory], UNKNOWNS, UNKNOWNS.start, ["log"])


@pytest.mark.parametrize("wears", [False, True])
def test_a_slip_that_runs_backwards_is_named(wears: bool) -> None:
    assert said(motion(wears=wears, slip=5e-3, after=5e-3)) is None
    assert "cycle 2: at this answer the slip runs backwards" in str(said(motion(wears=True, slip=5e-3, after=-1e-4)))
    assert "cycle 2" in str(said(motion(wears=wears, slip=-1e-4, after=5e-3)))
