"""Noise with a memory is accepted for what it is. A misfit of the same size is not: tests/diagnosis/test_held.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from experiments.study_problem import DEMO, NAMES, RIG
from identify.base.outcome import Status
from identify.estimation.goodness_of_fit import pass_gate
from identify.estimation.residual_autocorrelation import (
    ArModel,
    autocorrelated_covariance,
    autoregression,
    innovations,
    repeats,
)
from identify.identification import find
from identify.logs.segment import noise_on_lines
from identify.scene import Scene
from tests.support.two_logs import drawn

LOGS = ((1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0))  # drive speed [m/s], duration [s], rate [Hz]
WHITE, SLOW, TIME = 5e-3, 2e-3, 0.02  # standard deviations [N] and memory [s]


def _records(seed):
    random = np.random.default_rng(seed)
    out = drawn(LOGS, noise=WHITE, seed=seed)
    for i, (_, _, rate) in enumerate(LOGS):
        kept, size = np.exp(-1.0 / (rate * TIME)), out[i].time.size
        new = np.sqrt(1.0 - kept**2) * random.standard_normal(size + round(20 * TIME * rate))
        slow = SLOW * lfilter([1.0], [1.0, -kept], new)[-size:]
        out[i] = replace(out[i], friction_force=out[i].friction_force + slow)
    return out


def _found(records):
    logs = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, *_) in enumerate(LOGS, 1)]
    scene = Scene.from_document({"effects": [*NAMES], "rig": dict(RIG), "logs": logs}, Path())
    return find(scene, records)[1]


def _distance(found):
    """Squared distance of the answer from the truth, in its own covariance."""
    unknowns = found.unknowns
    truth = unknowns.theta(np.array([(DEMO | RIG)[name] for name in unknowns.names]), unknowns.base(RIG))
    off = (found.attempt.solved.theta - truth)[unknowns.free]
    return float(off @ np.linalg.solve(found.covariance, off))


@pytest.mark.slow
def test_noise_with_a_memory_is_accepted_and_widens_the_errors():
    found = _found(_records(2))
    assert found.status is Status.CONVERGED, found.message
    assert _distance(found) < chi2.isf(1e-3, 6)
    level = found.attempt.gate.level
    assert 1.0 < level < 1.5 and "autocorrelated noise" in found.message
    white = np.diag(found.sure.allowed.white)
    assert np.all(np.diag(found.covariance) > level * white), "as much wider as the noise is larger, and more"
    names = [log.name for log in found.attempt.fitted_logs]
    assert pass_gate(found.attempt.solved, names, [True, True]).status is Status.CONVERGED
    assert pass_gate(found.attempt.solved, names, [False, False]).status is Status.MODEL_MISFIT, "noise that was stated"


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
