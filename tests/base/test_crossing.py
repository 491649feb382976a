"""The first zero of a function: none is stepped over, however short its stay below."""

from __future__ import annotations

import numpy as np
import pytest

from identify.base.errors import SimulationError
from identify.base.roots import first_zero


def test_a_straight_line() -> None:
    assert first_zero(lambda t: 1.0 - 0.25 * t, 100.0) == pytest.approx(4.0, rel=1e-15)
    assert first_zero(lambda t: 1.0 - 0.25 * t, 3.9) is None


@pytest.mark.parametrize("depth", [1e-3, 1e-8, 1e-12])
def test_a_smooth_dip_that_hardly_reaches_zero_is_found(depth: float) -> None:
    # exp(2 - t) + t - 3 is zero at its minimum, t = 2.
    shifted = lambda t: np.exp(2.0 - t) + t - 3.0 - depth  # noqa: E731
    found = first_zero(shifted, 50.0)
    assert found == pytest.approx(2.0 - np.sqrt(2.0 * depth), abs=depth + 1e-7)
    assert first_zero(lambda t: shifted(t) + 2.0 * depth, 50.0) is None


@pytest.mark.parametrize("frequency", [10.0, 1e3, 1e4])
def test_the_first_touch_of_a_vibration_on_a_ramp_is_found(frequency: float) -> None:
    """1 - t + B sin(w t) with w B >> 1 first touches zero near the end of the last trough before t = 1 - B."""
    swing, omega = 1e-2, 2.0 * np.pi * frequency
    function = lambda t: 1.0 - t - swing * np.sin(omega * t)  # noqa: E731
    found = first_zero(function, 5.0, 1.0 / frequency, lambda t: 1.0 - t - swing)
    assert found is not None
    fine = np.arange(0.97, 1.02, 1e-3 / frequency)
    below = fine[np.argmax(function(fine) <= 0.0)]
    assert 0.0 <= below - found <= 1e-3 / frequency
    assert abs(function(np.array(found))) < 1e-11


def test_a_scan_that_would_not_end_is_refused() -> None:
    with pytest.raises(SimulationError, match="too many to look at"):
        first_zero(lambda t: 1.0 + 0.0 * t, 1e6, 1e-3, lambda t: -0.2 + 0.0 * t)


def test_a_bound_leads_to_the_same_zero_sooner_and_one_that_is_none_hides_it() -> None:
    """1 - t - slow - fast vibration."""
    looked = [0]

    def margin(t: np.ndarray) -> np.ndarray:
        looked[0] += t.size
        return 1.0 - t / 3.0 - 0.1 * np.sin(2 * np.pi * 37.0 * t) - 0.05 * np.sin(2 * np.pi * 2e3 * t)

    period = 1 / 2e3
    zero = first_zero(margin, 3.0, period, lambda t: 1.0 - t / 3.0 - 0.15)
    fewer = looked[0]
    assert zero is not None
    fine = np.arange(zero - 0.1, zero + 1e-6, 1e-7)
    assert 0.0 <= fine[np.argmax(margin(fine) <= 0.0)] - zero <= 1e-3 / 2e3
    looked[0] = 0
    assert first_zero(margin, 3.0, period) == pytest.approx(zero, rel=1e-14)
    assert looked[0] > 3 * fewer
    late = first_zero(margin, 3.0, period, lambda t: 1.0 - t / 3.0 - 0.05)
    assert late is not None and late > zero + 1e-3
