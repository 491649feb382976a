"""Noise with a memory: its innovations, its autoregression, and the covariance it leaves; a misfit is none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from identify.estimation.residual_autocorrelation import (
    ArModel,
    autocorrelated_covariance,
    autoregression,
    innovations,
    repeats,
)
from identify.logs.segment import noise_on_lines

WHITE = 5e-3  # standard deviation [N]


def _teeth(correlation, misfit=0.0, cycles=200, seed=4):
    """Sticks of 40 samples and slips of 20 under such noise; what the curve misses comes back in every cycle."""
    count, random = 60 * cycles, np.random.default_rng(seed)
    noise = WHITE * np.sqrt(1.0 - correlation**2) * _process(random, count, [correlation])
    time, place = 1e-3 * np.arange(count), np.arange(count) % 60
    curve = 0.3 * np.minimum(place / 40.0, (60 - place) / 20.0)
    residual, first = noise + misfit * np.sin(np.pi * place / 30.0), 60e-3 * np.arange(cycles)
    motion = SimpleNamespace(onset=first + 40e-3, arrest=first + 60e-3)
    data = SimpleNamespace(time=time, force=curve + residual)
    solved = SimpleNamespace(problem=SimpleNamespace(logs=[data]), trajectories=[motion])
    return data.force, innovations(data, motion, residual), solved


def test_innovations_of_noise_are_as_large_as_those_in_its_short_sticks():
    force, new, _ = _teeth(0.8)
    sticks = [(first, first + 40) for first in range(0, 12_000, 60)]
    assert noise_on_lines(force, sticks) < 0.7 * WHITE, "lines through the sticks do not show what is slow"
    assert np.nanmean(new**2) == pytest.approx(1.0, abs=0.05)
    assert np.nanmean(new[1:] * new[:-1]) == pytest.approx(0.0, abs=0.04)
    assert _teeth(0.0)[1] is None, "white residuals are their own innovations"


def test_what_comes_back_in_every_cycle_is_no_noise_however_slow():
    """Noise is called a misfit once in a thousand times."""
    noise = [_teeth(0.8, cycles=40, seed=seed) for seed in range(100)]
    assert sum(repeats(solved, [new]) for _, new, solved in noise) <= 1
    misfits = [_teeth(0.8, WHITE, cycles=40, seed=seed) for seed in range(10)]
    assert all(repeats(solved, [new]) for _, new, solved in misfits)
    _, new, few = _teeth(0.8, cycles=12)
    assert repeats(few, [new]), "too few to know"


def _process(random, n, regression):
    """An autoregression of unit innovation, settled."""
    return lfilter([1.0], np.concatenate([[1.0], -np.asarray(regression)]), random.standard_normal(n + 2000))[2000:]


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


def test_white_noise_is_called_white_and_missing_samples_do_not_hide_a_memory():
    random = np.random.default_rng(3)
    assert all(autoregression(random.standard_normal(2000)).white for _ in range(200))
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
