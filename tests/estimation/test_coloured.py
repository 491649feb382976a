"""Noise with a memory: what is found in residuals, and covariances against repeated draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from identify.estimation import residual_autocorrelation as coloured
from identify.estimation.residual_autocorrelation import Colour, _asked, _correlation, colour, coloured_covariance


def _process(random, n, regression):
    """An autoregression of unit innovation, settled."""
    return lfilter([1.0], np.concatenate([[1.0], -np.asarray(regression)]), random.standard_normal(n + 2000))[2000:]


def test_white_noise_is_called_white():
    random = np.random.default_rng(1)
    assert all(colour(random.standard_normal(2000)).white for _ in range(200))


@pytest.mark.parametrize("regression", [[0.8], [0.3], [1.2, -0.5]])
def test_the_memory_of_an_autoregression_is_found(regression):
    random = np.random.default_rng(2)
    found = colour(3.0 * _process(random, 40_000, regression))
    poles = np.concatenate([[1.0], -np.asarray(regression)])
    # Sum of correlations over all lags, from the spectrum at zero and the variance by its impulse response.
    response = lfilter([1.0], poles, np.eye(1, 4000)[0])
    memory = np.sum(response) ** 2 / np.sum(response**2)
    assert found.memory == pytest.approx(memory, rel=0.08)
    assert np.mean(found.spectrum(40_000)[1:-1]) == pytest.approx(1.0, rel=0.01)


def test_missing_samples_do_not_hide_the_memory():
    random = np.random.default_rng(3)
    noise = _process(random, 20_000, [0.8])
    noise[5000:9000] = np.nan
    assert colour(noise).memory == pytest.approx(9.0, rel=0.15)
    assert colour(np.full(100, np.nan)).white, "nothing known: nothing claimed"


def test_covariance_is_that_of_repeated_draws():
    random = np.random.default_rng(4)
    moves = np.stack([np.sin(np.linspace(0, 30, 1500)), np.linspace(-1, 1, 1500)], axis=1)
    moves[700:720] *= 6.0
    noise = Colour(np.array([0.8]), 1 - 0.64)
    draws = np.array([moves.T @ (0.6 * _process(random, 1500, [0.8])) for _ in range(3000)])
    expected = coloured_covariance([moves], [1.0], [noise])
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(np.cov(draws.T) / np.outer(size, size), expected / np.outer(size, size), atol=0.11)
    white = coloured_covariance([moves], [1.0], [Colour(np.empty(0), 1.0)])
    np.testing.assert_allclose(white, moves.T @ moves)
    assert np.all(np.diag(expected) > 4 * np.diag(white)), "the memory matters here"


@pytest.mark.parametrize("portion", [1, 7, 300, 1000, 5000])
def test_correlation_in_portions_is_that_of_the_whole(portion, monkeypatch):
    monkeypatch.setattr(coloured, "PORTION", portion)
    monkeypatch.setattr(coloured, "MOST_PORTIONS", 1000)
    residual = _process(np.random.default_rng(6), 1000, [0.8])
    whole = [residual[: 1000 - lag] @ residual[lag:] for lag in range(25)]
    found = _correlation(residual, np.ones(1000, bool), _asked(1000), 24)
    np.testing.assert_allclose(found, np.array(whole) / whole[0], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("regression", [[], [0.8]])
def test_a_long_log_is_asked_from_all_over_it(regression):
    samples = 1_000_000
    asked = _asked(samples)
    assert len(asked) == coloured.MOST_PORTIONS
    assert asked[0].start == 0
    assert asked[-1].stop >= samples > asked[-1].start
    found = colour(_process(np.random.default_rng(7), samples, regression))
    assert found.memory == pytest.approx(9.0 if regression else 1.0, rel=0.08)  # (1 + 0.8) / (1 - 0.8)


def test_noise_that_is_coloured_in_one_half_of_a_long_log_is_coloured():
    random = np.random.default_rng(8)
    halves = [random.standard_normal(500_000), 0.6 * _process(random, 500_000, [0.8])]
    for residual in (np.concatenate(halves), np.concatenate(halves[::-1])):
        assert colour(residual).memory == pytest.approx(5.0, rel=0.2)  # the mean of 1 and 9
