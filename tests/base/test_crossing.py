"""The first zero of a function: none is stepped over, however short its stay below."""

from __future__ import annotations

import numpy as np
import pytest

from identify.base.errors import SimulationError
from identify.base.roots import Course, first_zero


def test_a_straight_line() -> None:
    assert first_zero(Course(lambda t: 1.0 - 0.25 * t), 100.0) == pytest.approx(4.0, rel=1e-15)
    assert first_zero(Course(lambda t: 1.0 - 0.25 * t), 3.9) is None


@pytest.mark.parametrize("depth", [1e-3, 1e-8, 1e-12])
def test_a_smooth_dip_that_hardly_reaches_zero_is_found(depth: float) -> None:
    # exp(2 - t) + t - 3 is zero at its minimum, t = 2.
    shifted = lambda t: np.exp(2.0 - t) + t - 3.0 - depth  # noqa: E731
    found = first_zero(Course(shifted), 50.0)
    assert found == pytest.approx(2.0 - np.sqrt(2.0 * depth), abs=depth + 1e-7)
    assert first_zero(Course(lambda t: shifted(t) + 2.0 * depth), 50.0) is None


@pytest.mark.parametrize("frequency", [10.0, 1e3, 1e4])
def test_the_first_touch_of_a_vibration_on_a_ramp_is_found(frequency: float) -> None:
    """1 - t + B sin(w t) with w B >> 1 first touches zero near the end of the last trough before t = 1 - B."""
    swing, omega = 1e-2, 2.0 * np.pi * frequency
    function = lambda t: 1.0 - t - swing * np.sin(omega * t)  # noqa: E731
    found = first_zero(Course(function, 1.0 / frequency), 5.0, [Course(lambda t: 1.0 - t - swing)])
    assert found is not None
    fine = np.arange(0.97, 1.02, 1e-3 / frequency)
    below = fine[np.argmax(function(fine) <= 0.0)]
    assert 0.0 <= below - found <= 1e-3 / frequency
    assert abs(function(np.array(found))) < 1e-11


def test_a_scan_that_would_not_end_is_refused() -> None:
    with pytest.raises(SimulationError, match="too many to look at"):
        first_zero(Course(lambda t: 1.0 + 0.0 * t, 1e-3), 1e6, [Course(lambda t: -0.2 + 0.0 * t)])


def _two_vibrations(limit: float) -> tuple[Course, list[Course], list[int]]:
    """1 - t - slow - fast vibration; bounds without any, with the slow one; counts of the times looked at."""
    slow, fast, looked = 2.0 * np.pi * 37.0, 2.0 * np.pi * 11e3, [0]

    def course(shares: tuple[float, float], less: float, period: float) -> Course:
        def at(t: np.ndarray) -> np.ndarray:
            looked[0] += t.size
            return 1.0 - t / limit - 0.1 * shares[0] * np.sin(slow * t) - 0.05 * shares[1] * np.sin(fast * t) - less

        return Course(at, period)

    whole = course((1.0, 1.0), 0.0, 1 / 11e3)
    return whole, [course((0.0, 0.0), 0.15, np.inf), course((1.0, 0.0), 0.05, 1 / 37.0)], looked


@pytest.mark.parametrize("limit", [0.3, 3.0, 5.3])
def test_bounds_with_more_and_more_of_the_vibrations_lead_to_the_same_zero_sooner(limit: float) -> None:
    whole, below, looked = _two_vibrations(limit)
    found = first_zero(whole, limit, below)
    fewer = looked[0]
    fine = np.arange(0.7 * limit, limit, 1e-3 / 11e3) if limit < 1.0 else np.arange(found - 0.1, found + 1e-6, 1e-8)
    first = fine[np.argmax(whole.at(fine) <= 0.0)]
    assert found is not None
    assert 0.0 <= first - found <= 1e-3 / 11e3
    looked[0] = 0
    assert first_zero(whole, limit, below[:1]) == pytest.approx(found, rel=1e-14)
    assert looked[0] > 3 * fewer  # without the bound in between


def test_a_bound_that_is_none_hides_the_first_zero() -> None:
    whole, below, _ = _two_vibrations(3.0)
    wrong = Course(lambda t: below[0].at(t) + 0.1)
    found, late = first_zero(whole, 3.0, below), first_zero(whole, 3.0, [wrong])
    assert found is not None and late is not None
    assert late > found + 1e-3
