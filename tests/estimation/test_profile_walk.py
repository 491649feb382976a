"""The ends of a profile on made-up likelihoods: where the solver fails on the way, and where it does not."""

from types import SimpleNamespace

import numpy as np
import pytest

from identify.estimation import profile as profile_side
from identify.estimation.profile import CRITICAL, walk_one_way

STEP = 0.2  # mu_s - mu_k0 of the answer


class Line:
    """A line whose likelihood is a parabola of one coefficient, a wall beyond `cliff`, and between `first` and `last`
    nothing that the solver settles on."""

    def __init__(self, sd: float, cliff: float = np.inf, first: float = np.inf, last: float = np.inf) -> None:
        open_ = np.full(2, np.inf)
        self.unknowns = SimpleNamespace(
            names=["mu_s", "mu_k0"], logarithmic=[False, False], lower=-open_, upper=open_, walls=np.zeros((2, 2), bool)
        )
        self.best = SimpleNamespace(theta=np.array([0.5, 0.5 - STEP]))
        self._sd, self._cliff, self._gap = sd, cliff, (first, last)

    def point(self, _near, index, value):
        off = value - self.best.theta[index]
        theta = self.best.theta.copy()
        theta[index] = value
        return None if self._gap[0] < off < self._gap[1] else SimpleNamespace(theta=theta)

    def loss_root(self, point):
        off = point.theta[0] - self.best.theta[0]
        return abs(off) / self._sd + (20.0 if off >= self._cliff else 0.0)


def side(line: Line):
    return walk_one_way(line, 0, 1.0, line._sd, line.best, 1.0).side


@pytest.mark.parametrize("sd", [1e-4, 3e-3, 0.02])
def test_a_parabola_ends_where_the_data_object(sd):
    found = side(Line(sd))
    assert found.end == pytest.approx(0.5 + sd * np.sqrt(CRITICAL), rel=1e-6) and not found.failed


def test_a_wall_that_the_solver_cannot_come_near_is_an_end_on_its_far_side():
    # the data hardly object up to 0.012; the solver fails just before the wall
    found = side(Line(sd=0.01, cliff=0.0135, first=0.0125, last=0.0135))
    assert not found.failed
    assert 0.5 + 0.012 < found.end < 0.5 + 0.021


def test_where_nothing_beyond_was_solved_the_side_stays_open():
    found = side(Line(0.01, first=0.012))
    assert found.end is None and found.failed


class Winding(Line):
    """A ridge so winding that the solver follows it for the short step only, and loses it in every longer one."""

    def __init__(self, sd: float, stride: float) -> None:
        super().__init__(sd)
        self.stride = stride

    def point(self, near, index, value):
        return None if abs(value - near.theta[index]) > self.stride else super().point(near, index, value)


def test_a_walk_is_given_up_after_failures_in_a_row_not_after_as_many_on_the_way():
    sd = 0.02
    found = side(Winding(sd, stride=0.35 * sd * np.sqrt(CRITICAL)))
    assert not found.failed and found.end == pytest.approx(0.5 + sd * np.sqrt(CRITICAL), rel=1e-6)
    lost = side(Winding(sd, stride=1e-5 * sd))
    assert lost.failed and lost.end is None


@pytest.mark.parametrize("leap", [profile_side.LEAP, 0.1])
def test_past_a_stretch_on_which_the_solver_fails_the_walk_leaps_once(leap, monkeypatch):
    """A stiffness known to 1e-4: its interval was open, as the solver fails at 2.5e-3 from a point beyond its end."""
    sd = 1e-5

    class Narrow(Line):
        def point(self, near, index, value):
            return None if abs(value - self.best.theta[index]) > 20.0 * sd else super().point(near, index, value)

    monkeypatch.setattr(profile_side, "LEAP", leap)
    found = side(Narrow(sd, first=0.5 * sd, last=5.0 * sd))
    assert found.failed == (leap < 1.0)
    if leap > 1.0:
        assert 0.5 + 5.0 * sd < found.end < 0.5 + 8.0 * sd
