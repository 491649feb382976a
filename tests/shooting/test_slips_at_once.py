"""Slips of many rows at once: as the independent integrator has them, and none disturbs another."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from identify.shooting import batch
from identify.simulation.phases import sticks
from tests.support import shooting_case as case

PER_HALF_PERIOD = 60
MODEL = case.MODEL


def _given(n=60, seed=4):
    """Pairs far apart, at the onset of their slips: states (n, 3), parameters (n, 9), inputs (n, 4)."""
    random = np.random.default_rng(seed)
    truth = case.PAIR | case.RIG
    p = np.array([truth[name] for name in MODEL.parameter_names]) * np.exp(0.5 * random.standard_normal((n, 9)))
    u = np.column_stack([np.exp(random.uniform(-9, -4, n)), np.full(n, 1.0), np.ones(n), np.zeros(n)])
    time, at_onset, _ = sticks(MODEL, np.column_stack([np.zeros((n, 2)), np.full(n, 0.5)]), p, u)
    return at_onset[np.isfinite(time)], p[np.isfinite(time)], u[np.isfinite(time)]


def test_slips_end_when_those_of_the_independent_integrator_do():
    for speed in (case.SLOW, case.MIDDLE, case.FAST):
        truth = case.simulated(case.PAIR, *speed).truth
        n = min(truth.arrests.size, truth.wear_times.size)
        x = truth.onset_states[:n]
        p = np.tile([(case.PAIR | case.RIG)[name] for name in MODEL.parameter_names], (n, 1))
        u = np.tile([speed[0], case.LOAD, 1.0, 0.0], (n, 1))
        slips = batch.slip(MODEL, x, p, u, PER_HALF_PERIOD)
        assert np.all(slips.rested)
        np.testing.assert_allclose(slips.arrest, (truth.arrests - truth.onsets[: truth.arrests.size])[:n], rtol=2e-3)
        np.testing.assert_allclose(slips.wear, truth.wear_times[:n] - truth.onsets[:n], rtol=2e-3)
        size = case.LOAD / case.RIG["stiffness"]
        np.testing.assert_allclose(slips.at_arrest[:, 0], truth.arrest_states[:n, 0], atol=2e-3 * size)


def test_a_row_slips_alone_as_among_others():
    x, p, u = _given()
    many = batch.slip(MODEL, x, p, u, PER_HALF_PERIOD)
    assert np.ptp(many.arrest[many.rested] / many.h[many.rested]) > 20, "they end many steps apart"
    assert 0 < np.count_nonzero(np.isfinite(many.wear)) < x.shape[0]
    for i in range(0, x.shape[0], 7):
        alone = batch.slip(MODEL, x[i : i + 1], p[i : i + 1], u[i : i + 1], PER_HALF_PERIOD)
        for name in ("wear", "arrest", "at_wear", "at_arrest"):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(many, name)[i], err_msg=name)
        np.testing.assert_array_equal(alone.states[:, 0], many.states[: len(alone.states), i])


def test_a_row_that_is_lost_does_not_rest_and_disturbs_no_other():
    x, p, u = _given()
    whole = batch.slip(MODEL, x, p, u, PER_HALF_PERIOD)
    lost = int(np.flatnonzero(whole.rested)[3])
    p[lost, MODEL.parameter_names.index("mu_k0")] = np.nan
    slips = batch.slip(MODEL, x, p, u, PER_HALF_PERIOD)
    others = np.arange(x.shape[0]) != lost
    assert not slips.rested[lost]
    np.testing.assert_array_equal(slips.states[:, lost], np.tile(x[lost], (len(slips.states), 1)))
    np.testing.assert_array_equal(slips.arrest[others], whole.arrest[others])


def test_waves_are_cubics_in_the_slip_and_lines_before_and_after_it():
    random = np.random.default_rng(2)
    rows, steps = 5, 40
    force, h = np.cumsum(random.standard_normal((rows, steps + 1)), axis=1), random.uniform(0.5, 1.0, rows)
    duration, (end, slope) = h * random.uniform(20, 30, rows), random.standard_normal((2, rows))
    waves = batch.Waves.of(force, h, duration, end, slope)
    t = random.uniform(-10, 40, (rows, 300)) * h[:, None]
    value, rate = waves.with_rates(t)
    np.testing.assert_array_equal(waves.values(t), value)
    for i in range(rows):
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
