"""Closed forms over the whole of their ranges: right in 60 digits, NaN exactly where there is no answer, monotone."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from identify import amplitude, stability
from tests.support import closed_form_case as plain

FEW = settings(max_examples=60, deadline=None, derandomize=True)
LARGEST = mp.mpf("1e308")


def signed(least: float, most: float) -> st.SearchStrategy[float]:
    """Either sign, even in the exponent."""
    powers = st.floats(least, most).map(lambda e: 10.0**e)
    return st.one_of(powers, powers.map(lambda x: -x), st.just(0.0))


NEAR_ONE = st.builds(lambda side, x: side * (1 + x), st.sampled_from([-1.0, 1.0]), signed(-16, -1))
ALPHA = st.one_of(st.floats(-5, 50), NEAR_ONE, signed(-18, 0))
OVERSHOOT = st.one_of(signed(-6, 6), st.floats(-10, 10), st.floats(-1e6, 1e6))
INSIDE = st.one_of(st.floats(-0.999, 0.95), signed(-12, -0.1))


def relative(value: Any, exact: Any) -> float:
    if abs(exact) > LARGEST:
        return 0.0 if np.isinf(value) else np.inf
    return float(abs(mp.mpf(float(value)) / exact - 1)) if exact else abs(float(value))


def edge(alpha: float, nearness: float) -> float:
    """An overshoot that close to where the maximum of an aperiodic slip is lost."""
    root = np.sqrt(abs(alpha - 1)) * np.sqrt(abs(alpha + 1))
    return float((-1 / (alpha + root) if alpha > 0 else abs(alpha) + root) * (1 + nearness))


def check_maximum(alpha: float, overshoot: float) -> None:
    time, height = amplitude.slip_maximum(alpha, overshoot)
    log, exact = amplitude.log_amplitude(alpha, overshoot), plain.maximum(alpha, overshoot)
    if exact is None:
        assert np.isnan(time) and np.isnan(height) and np.isnan(log)
        return
    assert relative(time, exact[0]) < 2e-13
    assert abs(mp.mpf(float(log)) - exact[1]) < 3e-13 * (1 + abs(float(alpha * exact[0])))
    if exact[1] > -690:
        assert relative(height, mp.exp(exact[1])) < 2e-13 * (1 + abs(float(alpha * exact[0])))
    else:
        assert 0 <= height < 1e-299


@FEW
@given(ALPHA, OVERSHOOT)
@example(50.0, -0.01)
@example(1 - 1e-12, -1.5)
@example(-1.0, 1.0)
@example(1.0, -1.0)
def test_maximum(alpha: float, overshoot: float) -> None:
    check_maximum(alpha, overshoot)


@FEW
@given(st.one_of(st.floats(1.0001, 50), st.floats(-5, -1.0001)), signed(-13, -1))
def test_maximum_where_it_is_almost_lost(alpha: float, nearness: float) -> None:
    check_maximum(alpha, edge(alpha, nearness))


@FEW
@given(ALPHA, OVERSHOOT)
@example(-1 + 1e-13, 4.0)
@example(0.0, 0.0)
def test_slip(alpha: float, overshoot: float) -> None:
    found, expected = amplitude.slip(alpha, overshoot), plain.status(alpha, overshoot)
    assert found.status == expected == amplitude.slip_status(alpha, overshoot)
    if expected != "restick":
        assert all(np.isnan(getattr(found, name)) for name in amplitude.COLUMNS)
        return
    exact = plain.slip(alpha, overshoot)
    near_fold = 1e-6 * (2 * alpha + overshoot) > float(exact["acceleration"])
    for name in amplitude.COLUMNS:
        value = float(getattr(found, name))
        if name in ("acceleration", "elongation", "drop", "period") and abs(exact[name]) < 1e-14:
            assert abs(value) < 1e-14
        else:
            assert near_fold or relative(value, exact[name]) < 1e-11, name
    if not near_fold and np.isfinite(found.drop):
        assert relative(found.frequency, 1 / exact["period"]) < 1e-11
        assert relative(found.share_in_slip, exact["duration"] / exact["period"]) < 1e-11
        assert found.distance == found.period


@FEW
@given(st.floats(0.001, 0.999), signed(-11, -1))
def test_sticks_again_exactly_above_the_critical_loading(alpha: float, away: float) -> None:
    """Two roads to one boundary: the tangent point and the sign of the velocity at its maximum."""
    with np.errstate(over="ignore"):
        loading = stability.critical_loading(alpha) * (1 + away)
    if np.isfinite(loading) and abs(away) > 1e-10:
        overshoot = loading - 2 * alpha
        assert amplitude.slip_status(alpha, overshoot) == ("restick" if away > 0 else "steady")


@FEW
@given(st.floats(1e-300, 0.99999), st.integers(1, 4))
def test_critical_loading(alpha: float, n: int) -> None:
    log = stability.log_critical_loading(alpha, n)
    a = mp.mpf(alpha)
    w = mp.sqrt((1 - a) * (1 + a))
    b = a / w
    low, high = (2 * n - 1) * mp.pi, 2 * n * mp.pi  # of one monotone equation, halved
    for _ in range(plain.HALVINGS):
        psi = (low + high) / 2
        inside = mp.exp(b * psi) * (mp.cos(psi) - b * mp.sin(psi)) < 1
        low, high = (psi, high) if inside else (low, psi)
    if alpha > 1e-20:
        exact = b * low + mp.log(-mp.sin(low) / w)
        assert abs(log - exact) < 1e-13 * (1 + abs(exact))
    assert np.isnan(stability.critical_loading(-1 - alpha)) and stability.critical_loading(1 + alpha) == np.inf
    assert stability.critical_loading(-alpha) == 0


@FEW
@given(st.floats(0, 10), st.floats(-6, 6).map(lambda e: 10.0**e))
def test_critical_friction_and_frequency(zeta: float, tau_cr: float) -> None:
    z, T = 2 * mp.mpf(zeta), mp.mpf(tau_cr)
    printed = (mp.mpf(zeta) ** 2 * T + mp.mpf(zeta) * (1 + T**2)) / (1 + mp.mpf(zeta) * T)  # eq. (25) as it stands
    assert relative(stability.critical_friction(zeta, tau_cr), z * (1 + T * T / (1 + z * T))) < 1e-14
    assert relative(stability.critical_friction(zeta, tau_cr, form="printed"), printed) < 1e-14
    assert relative(stability.critical_frequency(zeta, tau_cr), 1 / mp.sqrt(1 + z * T)) < 1e-14


def test_monotone_where_theory_says_so() -> None:
    alpha = np.concatenate([np.linspace(-0.99, 0.99, 67), [1.0, 1.3, 5.0, 40.0], [-1.0, -1.4, -5.0]])[:, None]
    overshoot = np.geomspace(1e-3, 1e6, 400) - 2 * np.minimum(alpha, 0) + 2 * np.maximum(-1 - alpha, 0)
    time, height = amplitude.slip_maximum(alpha, overshoot)
    slip = amplitude.slip(alpha, overshoot)
    falls, rises = (time, slip.duration), (height, slip.drop, slip.peak_speed, slip.acceleration)
    for column, sign in [(c, -1) for c in falls] + [(c, 1) for c in rises]:
        steps = np.diff(column, axis=1)
        seen = np.isfinite(steps)
        # A number that has reached its limit to the last digit stands still.
        noise = 4e-16 * np.abs(column[:, 1:])
        assert np.sum(seen) > 10000 and np.all(sign * steps[seen] > -noise[seen])
    zeta, tau_cr = np.linspace(0, 10, 101)[:, None], np.geomspace(1e-6, 1e6, 120)
    limit, frequency = stability.critical_friction(zeta, tau_cr), stability.critical_frequency(zeta, tau_cr)
    assert np.all(np.diff(limit, axis=0) > 0) and np.all(np.diff(limit[1:], axis=1) >= 0)
    assert np.all(np.diff(frequency, axis=0) <= 0) and np.all(np.diff(frequency, axis=1) <= 0)
    share = stability.critical_friction(zeta[1:], tau_cr, form="printed") / limit[1:]
    assert np.all((share >= 0.5) & (share < 1))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_has_no_answer(bad: float) -> None:
    for pair in ((bad, 1.0), (0.1, bad)):
        slip = amplitude.slip(*pair)
        assert slip.status == "undefined" and np.isnan(slip.drop)
        assert np.isnan(amplitude.slip_end(*pair)[0])
    assert np.isnan(amplitude.slip_maximum(np.nan, 1.0)[0])


def test_named_refusals() -> None:
    with pytest.raises(ValueError, match="whole numbers from 1"):
        stability.critical_loading(0.1, 0)
    for call in (stability.critical_friction, stability.critical_frequency):
        with pytest.raises(ValueError, match="'derived' or 'printed'"):
            call(0.1, 1.0, "exact")  # type: ignore[arg-type]


def test_without_the_exact_difference_digits_are_lost() -> None:
    """Negative control: the distance to the edge as it is written, A - (|alpha| + kap), is wrong in the sixth digit."""
    alpha = 6.529205694998598
    overshoot = edge(alpha, -1e-10)
    root = np.sqrt(alpha**2 - 1)
    distance = overshoot + 1 / (alpha + root)
    naive = np.log1p(2 * root / distance) / (2 * root)
    exact = plain.maximum(alpha, overshoot)
    assert exact is not None
    assert relative(naive, exact[0]) > 1e-9
    assert relative(amplitude.slip_maximum(alpha, overshoot)[0], exact[0]) < 1e-13
