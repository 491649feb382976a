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
    CHANCE,
    ArModel,
    autocorrelated_covariance,
    autocorrelation_test,
    autoregression,
    in_common,
)
from identify.identification import find
from identify.scene import Scene
from tests.support.two_logs import drawn

LOGS = ((1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0))  # drive speed [m/s], duration [s], rate [Hz]
WHITE, SLOW, TIME = 5e-3, 2e-3, 0.02  # standard deviations [N] and memory [s]
BINS = 24


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


@pytest.mark.parametrize("cycles", [(4, 11), (30,), (5, 5, 5)])
def test_noise_has_nothing_in_common_and_a_misfit_has(cycles):
    random = np.random.default_rng(1)
    place = np.sin(np.linspace(0.0, 3.0, BINS))
    noise, misfit = [], []
    for _ in range(60):
        # Neighbouring places are alike, as where noise has a memory.
        stacks = [lfilter([1.0], [1.0, -0.8], random.standard_normal((c, BINS)), axis=1) for c in cycles]
        noise.append(in_common(stacks, random))
        misfit.append(in_common([stack + 2.0 * place for stack in stacks], random))
    assert np.mean(noise) == pytest.approx(0.5, abs=4.0 / np.sqrt(12 * 60)), "a chance is spread evenly"
    assert min(noise) > CHANCE > np.median(misfit)


@pytest.mark.parametrize(("correlation", "stated"), [(0.8, False), (0.8, True), (0.0, False)])
def test_noise_as_large_as_in_the_sticks_may_scatter_more_from_cycle_to_cycle(correlation, stated):
    count, random = 20000, np.random.default_rng(4)
    new = np.sqrt(1.0 - correlation**2) * random.standard_normal(count + 200)
    force = WHITE * lfilter([1.0], [1.0, -correlation], new)[200:]
    data = SimpleNamespace(time=np.arange(count) * 1e-3, force=force, weight=np.full(count, WHITE**-2), noise=WHITE)
    trajectory = SimpleNamespace(arrest=np.linspace(1.0, 19.0, 10), onset=np.linspace(0.9, 18.9, 10))
    level = np.array([np.mean((force / WHITE) ** 2)])
    solved = SimpleNamespace(problem=SimpleNamespace(logs=[data]), trajectories=[trajectory], fitted=[np.zeros(count)])
    known = autocorrelation_test(solved, [not stated], level)
    if stated or correlation == 0.0:
        assert known is None
        return
    assert known is not None and known.levels[0] == pytest.approx(1.0, abs=0.02)
    # of a sum of squares of an autoregression of first order, against that of white noise
    assert known.spread_inflation[0] == pytest.approx(np.sqrt((1 + correlation**2) / (1 - correlation**2)), rel=0.05)


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
