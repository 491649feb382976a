"""Influence, warm solves, bootstrap and profile on two small logs: against dense algebra, refits and the solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from identify.estimation.bootstrap import bootstrap
from identify.estimation.covariance import information
from identify.estimation.influence import influence, sample_moves
from identify.shooting.grid import COARSE_GRID
from identify.shooting.passes import solve_in_passes
from identify.shooting.shooting import Problem
from identify.shooting.solve import Warm, solve
from tests.support import shooting_case as case

SPEEDS = (case.SLOW, case.MIDDLE)


@pytest.fixture(scope="module")
def fitted():
    """Two noisy logs, solved; the unknowns at the answer, and the influence of the data there."""
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    logs = [case.simulated(case.PAIR, *speed) for speed in SPEEDS]
    data = [case.log_data(log, unknowns, noise_seed=seed) for seed, log in enumerate(logs)]
    solved = solve_in_passes(data, case.placed(unknowns, logs, data, COARSE_GRID), unknowns)
    assert solved.solution.success
    cycles = [trajectory.cycles for trajectory in solved.trajectories]
    known = influence(solved.problem, solved.solution.z, cycles)
    return replace(unknowns, start=solved.theta), solved, known, cycles


def test_influence_adds_up_to_the_covariance(fitted):
    unknowns, solved, known, _ = fitted
    made = solved.problem.with_all_parameters(unknowns, solved.solution.z)
    covariance = information(*made).covariance()
    size = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(known.covariance / np.outer(size, size), covariance / np.outer(size, size), atol=1e-4)
    moves = sample_moves(solved.problem, solved.solution.z, known.columns)
    by_samples = sum(m.T @ (m / log.weight[:, None]) for m, log in zip(moves, solved.problem.logs, strict=True))
    np.testing.assert_allclose(
        by_samples / np.outer(size, size), known.white.sum(axis=0) / np.outer(size, size), atol=1e-9
    )


def test_moves_of_samples_are_those_of_a_refit(fitted):
    _, solved, known, _ = fitted
    moves = sample_moves(solved.problem, solved.solution.z, known.columns)
    size = np.sqrt(np.diag(known.covariance))
    random = np.random.default_rng(5)
    change = 1e-4 * random.standard_normal(solved.problem.logs[0].time.size)
    first = solved.problem.logs[0]
    logs = [replace(first, force=first.force + change), solved.problem.logs[1]]
    again = solve(Problem(logs, solved.problem.layout), start=solved.solution.z, mu_init=1e-8)
    settled = solve(solved.problem, start=solved.solution.z, mu_init=1e-8)
    expected = change @ moves[0]
    found = (again.x - settled.x)[:6]
    np.testing.assert_allclose(found / size, expected / size, atol=0.02 * np.max(np.abs(expected / size)))


def test_what_the_fit_takes_out_of_a_cycle_is_that_of_dense_algebra(fitted):
    """Of residuals r = (1 - H) e with H the hat matrix of all unknowns, rows included."""
    _, solved, known, cycles = fitted
    problem, layout = solved.problem, solved.problem.layout
    point = problem.evaluate(solved.solution.z, derivatives=True)
    jacobian = point.jacobian.toarray()
    _, _, right = np.linalg.svd(jacobian / np.linalg.norm(jacobian, axis=1)[:, None])
    null = layout.scale[:, None] * right[layout.rows :].T  # of all motions that obey the rows
    slopes = np.concatenate(sample_moves(problem, solved.solution.z, null))  # weight times slope along each
    weight = np.concatenate([log.weight for log in problem.logs])
    slopes = slopes / np.sqrt(weight)[:, None]
    prior = null.T @ (null / layout.prior_sd[:, None] ** 2)
    inverse = np.linalg.inv(slopes.T @ slopes + prior)
    hat = slopes @ inverse @ slopes.T
    mine = slopes @ inverse @ null[:6].T  # (samples, 6)
    times = [log.time for log in problem.logs]
    trajectory = solved.trajectories[1]
    first = times[0].size
    inside = np.flatnonzero((times[1] > trajectory.arrest[1]) & (times[1] <= trajectory.arrest[2])) + first
    block = mine[inside]
    expected = block.T @ hat[np.ix_(inside, inside)] @ block
    size = np.sqrt(np.diag(known.covariance))
    found = known.absorbed[cycles[0] + 2]
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=1e-4)
    assert np.max(np.abs(expected / np.outer(size, size))) > 5e-3


def test_warm_solves_are_those_of_the_solver(fitted):
    _, solved, known, _ = fitted
    problem, z = solved.problem, solved.solution.z
    size = np.sqrt(np.diag(known.covariance))
    warm = Warm(problem, z, known.kept, size)
    best = warm.settle(z, within=1e-4)
    assert best is not None
    held = 5
    target = best.z[held] + 0.5 * size[held] / problem.layout.scale[held]
    found = warm.settle(best.z, held=(held, target), within=1e-4)
    assert found is not None
    assert found.z[held] == pytest.approx(target, abs=1e-12)
    lower, upper = problem.layout.lower.copy(), problem.layout.upper.copy()
    at = target * problem.layout.scale[held]
    lower[held], upper[held] = at - 1e-9, at + 1e-9
    boxed = Problem(problem.logs, replace(problem.layout, lower=lower, upper=upper), problem.moments)
    by_solver = solve(boxed, start=found.z, mu_init=1e-8)
    assert found.cost == pytest.approx(by_solver.cost, abs=2e-4)
    assert 2 * (found.cost - best.cost) == pytest.approx(0.25, rel=0.05)
    assert warm.settle(best.z, held=(held, best.z[held] + 1e4)) is None, "far away is no neighbourhood"


def test_bootstrap_of_white_noise_spreads_as_the_covariance_says(fitted):
    _, solved, known, _ = fitted
    # Residuals of one cycle are one draw; over many fits their squares would average to what white noise leaves.
    random = np.random.default_rng(7)
    spreads = []
    for _ in range(60):
        left = known.white - known.absorbed
        moves = np.stack([random.multivariate_normal(np.zeros(6), (m + m.T) / 2, method="eigh") for m in left])
        drawn = replace(known, moves=moves)
        made = bootstrap(solved.problem, solved.solution.z, drawn, 200, refine=False, seed=1)
        spreads.append(made.replicates.var(axis=0) / np.diag(known.covariance))
    np.testing.assert_allclose(np.mean(spreads, axis=0), 1.0, atol=0.15)
    doubled = replace(known, moves=2 * known.moves, log=known.log)
    narrow, wide = (bootstrap(solved.problem, solved.solution.z, k, 200, refine=False) for k in (known, doubled))
    ratio = np.diff(wide.interval, axis=1) / np.diff(narrow.interval, axis=1)
    assert np.all(ratio > 1.5), "residuals twice as large are seen"


def test_replicates_solved_again_are_near_the_linear_ones(fitted):
    _, solved, known, _ = fitted
    settled = Warm(solved.problem, solved.solution.z, known.kept, np.sqrt(np.diag(known.covariance))).settle(
        solved.solution.z, within=1e-4
    )
    refined, linear = (bootstrap(solved.problem, settled.z, known, 40, refine=refine) for refine in (True, False))
    size = np.sqrt(np.diag(known.covariance))
    assert np.count_nonzero(refined.settled) >= 38
    apart = (refined.replicates - linear.replicates[refined.settled]) / size
    assert np.max(np.abs(apart)) < 0.5
    assert np.std(linear.replicates / size) > 0.5
    again = bootstrap(solved.problem, settled.z, known, 40, refine=False)
    np.testing.assert_array_equal(again.replicates, linear.replicates)


def test_the_limit_of_a_profile_is_that_of_one_parameter():
    from identify.estimation.profile import CRITICAL

    assert pytest.approx(chi2.ppf(0.95, 1)) == CRITICAL
