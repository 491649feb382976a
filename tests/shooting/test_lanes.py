"""Slips of many lanes at once: as the independent integrator has them, and the same however many steps a call takes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from identify.shooting import batch as lanes
from identify.shooting import batch as sliding_lanes
from identify.shooting.features import Waves
from tests.support import shooting_case as case

PER_HALF_PERIOD = 60
MODEL = case.MODEL


@pytest.fixture(autouse=True)
def _functions_of_their_own():
    sliding_lanes._stride.cache_clear()
    yield
    sliding_lanes._stride.cache_clear()


def _given(n=60, seed=4):
    """Pairs far apart, at the onset of their slips: states (n, 3), parameters (n, 9), inputs (n, 4)."""
    random = np.random.default_rng(seed)
    truth = case.PAIR | case.RIG
    p = np.array([truth[name] for name in MODEL.parameter_names]) * np.exp(0.5 * random.standard_normal((n, 9)))
    u = np.column_stack([np.exp(random.uniform(-9, -4, n)), np.full(n, 1.0), np.ones(n), np.zeros(n)])
    time, at_onset = lanes.stick(MODEL, np.column_stack([np.zeros((n, 2)), np.full(n, 0.5)]), p, u)
    return at_onset[np.isfinite(time)], p[np.isfinite(time)], u[np.isfinite(time)]


def _slips(x, p, u, stride, monkeypatch):
    monkeypatch.setattr(sliding_lanes, "STRIDE", stride)
    sliding_lanes._stride.cache_clear()
    return sliding_lanes.slip(MODEL, x, p, u, PER_HALF_PERIOD)


def test_slips_end_when_those_of_the_independent_integrator_do():
    for speed in (case.SLOW, case.MIDDLE, case.FAST):
        truth = case.simulated(case.PAIR, *speed).truth
        n = min(truth.arrests.size, truth.wear_times.size)
        x = truth.onset_states[:n]
        p = np.tile([(case.PAIR | case.RIG)[name] for name in MODEL.parameter_names], (n, 1))
        u = np.tile([speed[0], case.LOAD, 1.0, 0.0], (n, 1))
        slips = sliding_lanes.slip(MODEL, x, p, u, PER_HALF_PERIOD)
        assert np.all(slips.rested)
        np.testing.assert_allclose(slips.arrest, (truth.arrests - truth.onsets[: truth.arrests.size])[:n], rtol=2e-3)
        np.testing.assert_allclose(slips.wear, truth.wear_times[:n] - truth.onsets[:n], rtol=2e-3)
        size = case.LOAD / case.RIG["stiffness"]
        np.testing.assert_allclose(slips.at_arrest[:, 0], truth.arrest_states[:n, 0], atol=2e-3 * size)


@pytest.mark.parametrize("stride", [3, 8])
def test_slips_are_the_same_however_many_steps_a_call_takes(stride, monkeypatch):
    x, p, u = _given()
    one, many = (_slips(x, p, u, n, monkeypatch) for n in (1, stride))
    assert np.ptp(one.arrest[one.rested] / one.h[one.rested]) > 2 * stride, "they end in different calls"
    assert 0 < np.count_nonzero(np.isfinite(one.wear)) < x.shape[0]
    for name in ("h", "states", "rates", "wear", "arrest", "at_wear", "at_arrest"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name), err_msg=name)


def test_a_lane_at_rest_stays_where_it_is():
    slips = sliding_lanes.slip(MODEL, *_given(), PER_HALF_PERIOD)
    for i in np.flatnonzero(slips.rested):
        after = int(np.ceil(slips.arrest[i] / slips.h[i]))
        np.testing.assert_array_equal(
            slips.states[after:, i], np.tile(slips.states[-1, i], (len(slips.states) - after, 1))
        )
        assert slips.states[-1, i, 1] <= 0.0


@pytest.mark.parametrize("stride", [1, 8])
def test_a_lane_that_is_lost_does_not_rest_and_disturbs_no_other(stride, monkeypatch):
    x, p, u = _given()
    whole = _slips(x, p, u, stride, monkeypatch)
    lost = int(np.flatnonzero(whole.rested)[3])
    p[lost, MODEL.parameter_names.index("mu_k0")] = np.nan
    slips = _slips(x, p, u, stride, monkeypatch)
    others = np.arange(x.shape[0]) != lost
    assert not slips.rested[lost]
    np.testing.assert_array_equal(slips.states[:, lost], np.tile(x[lost], (len(slips.states), 1)))
    np.testing.assert_array_equal(slips.arrest[others], whole.arrest[others])


def test_waves_are_cubics_in_the_slip_and_lines_before_and_after_it():
    random = np.random.default_rng(2)
    lanes_, steps = 5, 40
    force, h = np.cumsum(random.standard_normal((lanes_, steps + 1)), axis=1), random.uniform(0.5, 1.0, lanes_)
    duration, end, slope = (
        h * random.uniform(20, 30, lanes_),
        random.standard_normal(lanes_),
        random.standard_normal(lanes_),
    )
    waves = Waves.of(force, h, duration, end, slope)
    t = random.uniform(-10, 40, (lanes_, 300)) * h[:, None]
    value, rate = waves.with_rates(t)
    np.testing.assert_array_equal(waves.values(t), value)
    for i in range(lanes_):
        knots = h[i] * np.arange(steps + 1)
        tilt = np.convolve(np.pad(force[i], 1, mode="edge"), [0.5, 0.0, -0.5], "valid") / h[i]
        cubic = CubicHermiteSpline(knots, force[i], tilt)
        early, late = t[i] < 0.0, t[i] > duration[i]
        inside = ~early & ~late
        np.testing.assert_allclose(value[i, inside], cubic(t[i, inside]), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(rate[i, inside], cubic(t[i, inside], 1), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(value[i, early], force[i, 0] + slope[i] * t[i, early])
        np.testing.assert_allclose(value[i, late], end[i] + slope[i] * (t[i, late] - duration[i]))
        np.testing.assert_array_equal(rate[i, ~inside], slope[i])
