"""Influence of samples and parametric bootstrap on two small logs: against the covariance and refits."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from identify.estimation.attempt import Attempt
from identify.estimation.covariance import information_at
from identify.estimation.influence import bootstrap, drawn_noise, influence
from identify.estimation.residual_autocorrelation import ArModel, autoregression
from identify.shooting.layout import COARSE_GRID
from identify.shooting.passes import solve, solve_in_passes
from identify.shooting.shooting import Problem
from tests.support import shooting_case as case


def solved_of(speeds, free=case.FRICTION):
    """Noisy logs, solved; the unknowns at the answer, and the influence of the data there."""
    unknowns = case.search_space(case.PAIR, free)
    logs = [case.simulated(case.PAIR, *speed) for speed in speeds]
    data = [case.log_data(log, unknowns, noise_seed=seed) for seed, log in enumerate(logs)]
    solved = solve_in_passes(data, case.placed(unknowns, logs, data, COARSE_GRID), unknowns)
    assert solved.solution.success
    return replace(unknowns, start=solved.theta), solved, influence(solved)


@pytest.fixture(scope="module")
def fitted():
    return solved_of((case.MIDDLE, case.FAST))


def test_influence_of_all_logs_adds_up_to_the_covariance(fitted):
    unknowns, solved, known = fitted
    covariance = information_at(solved, unknowns).covariance()
    size = np.outer(*(2 * [np.sqrt(np.diag(covariance))]))
    np.testing.assert_allclose(known.covariances.sum(axis=0) / size, covariance / size, atol=1e-4)
    assert np.max(np.abs(known.moves.sum(axis=0)) / np.sqrt(np.diag(covariance))) < 0.05, "pulls cancel at an answer"


def test_moves_of_samples_are_those_of_a_refit(fitted):
    _, solved, known = fitted
    size = np.sqrt(np.diag(known.covariances.sum(axis=0)))
    first = solved.problem.logs[0]
    change = 1e-4 * np.random.default_rng(5).standard_normal(first.time.size)
    logs = [replace(first, force=first.force + change), solved.problem.logs[1]]
    again = solve(Problem(logs, solved.problem.layout), start=solved.solution.z, mu_init=1e-8)
    settled = solve(solved.problem, start=solved.solution.z, mu_init=1e-8)
    expected, moved = change @ known.by_sample[0], (again.x - settled.x)[:6]
    np.testing.assert_allclose(moved / size, expected / size, atol=0.02 * np.max(np.abs(expected / size)))


def test_replicates_spread_as_the_covariance_says():
    unknowns, solved, known = solved_of(((1e-3, 1.0, 1000.0),), ("mu_s", "mu_k0", "D"))
    size = np.sqrt(np.diag(known.covariances.sum(axis=0)))
    attempt = Attempt((0,), (), solved, SimpleNamespace(levels=np.ones(1)))
    made = bootstrap(attempt, unknowns, size, 40, seed=1)
    assert np.all(made.settled) and made.replicates.shape == (40, 3)
    ratio = made.replicates.std(axis=0, ddof=1) / size
    assert np.all((ratio > 0.6) & (ratio < 1.45)), ratio  # 4 standard errors of a spread of 40
    answer = solved.theta[unknowns.free]
    assert np.all((made.interval[:, 0] < answer) & (answer < made.interval[:, 1]))


def test_noise_is_drawn_with_its_autoregression():
    drawn = drawn_noise(ArModel(np.array([0.8]), 0.36), 40_000, np.random.default_rng(2))
    assert np.std(drawn) == pytest.approx(1.0, rel=0.05)
    assert autoregression(drawn).inflation == pytest.approx(9.0, rel=0.15)
