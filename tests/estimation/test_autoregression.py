"""Noise with a memory: what is found in residuals, and covariances against repeated draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from identify.estimation.residual_autocorrelation import ArModel, autocorrelated_covariance, autoregression


def _process(random, n, regression):
    """An autoregression of unit innovation, settled."""
    return lfilter([1.0], np.concatenate([[1.0], -np.asarray(regression)]), random.standard_normal(n + 2000))[2000:]


def test_white_noise_is_called_white():
    random = np.random.default_rng(1)
    assert all(autoregression(random.standard_normal(2000)).white for _ in range(200))


@pytest.mark.parametrize("regression", [[0.8], [0.3], [1.2, -0.5]])
def test_the_memory_of_an_autoregression_is_found(regression):
    random = np.random.default_rng(2)
    found = autoregression(3.0 * _process(random, 40_000, regression))
    poles = np.concatenate([[1.0], -np.asarray(regression)])
    # Sum of correlations over all lags, from the spectrum at zero and the variance by its impulse response.
    response = lfilter([1.0], poles, np.eye(1, 4000)[0])
    memory = np.sum(response) ** 2 / np.sum(response**2)
    assert found.inflation == pytest.approx(memory, rel=0.08)
    assert np.mean(found.spectrum(40_000)[1:-1]) == pytest.approx(1.0, rel=0.01)


def test_missing_samples_do_not_hide_the_memory():
    random = np.random.default_rng(3)
    noise = _process(random, 20_000, [0.8])
    noise[5000:9000] = np.nan
    assert autoregression(noise).inflation == pytest.approx(9.0, rel=0.15)
    assert autoregression(np.full(100, np.nan)).white, "nothing known: nothing claimed"


def test_covariance_is_that_of_repeated_draws():
    random = np.random.default_rng(4)
    moves = np.stack([np.sin(np.linspace(0, 30, 1500)), np.linspace(-1, 1, 1500)], axis=1)
    moves[700:720] *= 6.0
    noise = ArModel(np.array([0.8]), 1 - 0.64)
    draws = np.array([moves.T @ (0.6 * _process(random, 1500, [0.8])) for _ in range(3000)])
    expected = autocorrelated_covariance([moves], np.ones(1), [noise])
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(np.cov(draws.T) / np.outer(size, size), expected / np.outer(size, size), atol=0.11)
    white = autocorrelated_covariance([moves], np.ones(1), [ArModel(np.empty(0), 1.0)])
    np.testing.assert_allclose(white, moves.T @ moves)
    assert np.all(np.diag(expected) > 4 * np.diag(white)), "the memory matters here"
