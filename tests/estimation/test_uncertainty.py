"""Information, covariance and verdicts: against dense linear algebra, repeated draws of the noise, and refits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify.estimation.covariance import estimates, information
from identify.shooting.layout import COARSE_GRID, Grid
from identify.shooting.passes import solve_in_passes
from identify.shooting.shooting import shooting_problem
from tests.support import shooting_case as case

SMALL = Grid(slip=4, renewed=4, steps=3)
QUIET = 0.1  # noise so small that the fit is linear in it


def _logs(speeds=(case.SLOW, case.MIDDLE)):
    return [case.simulated(case.PAIR, *speed) for speed in speeds]


def _quiet(log, unknowns, seed=None, **options):
    data = case.log_data(log, unknowns, **options)
    noise = 0.0 if seed is None else np.random.default_rng(seed).standard_normal(log.time.size)
    return replace(data, force=log.force + QUIET * case.NOISE * noise, weight=data.weight / QUIET**2)


def _information(data, trajectories, unknowns, grid):
    problem = shooting_problem(data, trajectories, unknowns, grid)
    return information(*problem.with_all_parameters(unknowns, problem.start))


@pytest.fixture(scope="module")
def fitted():
    """A fit of two quiet logs: unknowns at the answer, the logs, and the passes."""
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    logs = _logs()
    data = [_quiet(log, unknowns, seed) for seed, log in enumerate(logs)]
    solved = solve_in_passes(data, case.placed(unknowns, logs, data, COARSE_GRID), unknowns)
    assert solved.solution.success
    return replace(unknowns, start=solved.theta), data, solved


@pytest.mark.parametrize("load_sd", [0.0, 1e-3])
def test_covariance_agrees_with_the_dense_null_space(load_sd):
    """Of a problem in which only the free parameters are unknown: the rig must not enter."""
    unknowns = case.search_space(case.PAIR, (*case.FRICTION, "mass"))
    sd = np.where(np.array(unknowns.names) == "mass", 0.02, np.inf)
    unknowns = replace(unknowns, prior_sd=sd)
    logs = _logs()
    data = [case.log_data(log, unknowns, load_sd=load_sd) for log in logs]
    trajectories = case.placed(unknowns, logs, data, SMALL)
    covariance = _information(data, trajectories, unknowns, SMALL).covariance()
    problem = shooting_problem(data, trajectories, unknowns, SMALL)
    point = problem.evaluate(problem.start, derivatives=True)
    upper, jacobian = point.hessian.toarray(), point.jacobian.toarray()
    hessian = upper + np.triu(upper, 1).T
    norms = np.linalg.norm(jacobian, axis=1)
    q, _ = np.linalg.qr((jacobian / norms[:, None]).T, mode="complete")
    null = q[:, problem.layout.rows :]
    factor = np.linalg.cholesky(null.T @ hessian @ null)
    n = problem.layout.free.size
    half = np.linalg.solve(factor, null[:n].T)
    dense = (half.T @ half) * np.outer(problem.layout.scale[:n], problem.layout.scale[:n])
    sd = np.sqrt(np.diag(dense))
    np.testing.assert_allclose(covariance / np.outer(sd, sd), dense / np.outer(sd, sd), atol=1e-6)
    # Without the rows the answer is another one: the null space matters.
    blind = np.linalg.inv(hessian + 1e-9 * np.eye(len(hessian)))[:n, :n]
    assert not np.allclose(np.diag(blind), np.diag(dense) / problem.layout.scale[:n] ** 2, rtol=0.1)


def test_covariance_is_that_of_repeated_draws_of_the_noise():
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    logs, repeats = _logs(), 25
    trajectories = case.placed(unknowns, logs, [case.log_data(log, unknowns) for log in logs], COARSE_GRID)
    off, solved, data = [], None, []
    for repeat in range(repeats):
        data = [_quiet(log, unknowns, (100 + repeat, i)) for i, log in enumerate(logs)]
        solved = solve_in_passes(data, trajectories, unknowns)
        assert solved.solution.success
        off.append((solved.theta - unknowns.start)[unknowns.free])
    covariance = _information(
        data, solved.trajectories, replace(unknowns, start=solved.theta), solved.grid
    ).covariance()
    deviations = np.array(off)
    # Mean squared joint distance: chi^2 with 6 * 25 degrees of freedom over 25; 4 standard deviations of it.
    distance = np.einsum("ki,ij,kj->k", deviations, np.linalg.inv(covariance), deviations)
    assert abs(distance.mean() - 6) < 4 * np.sqrt(12 / repeats)
    ratio = deviations.std(axis=0, ddof=1) / np.sqrt(np.diag(covariance))
    assert np.all((ratio > 0.55) & (ratio < 1.5)), ratio
    # Standard errors that are right with correlations that are wrong would not pass, nor would errors 1.5 times off.
    for wrong in (covariance * (0.5 + 0.5 * np.eye(6)), covariance / 2.25, covariance * 2.25):
        seen = np.einsum("ki,ij,kj->k", deviations, np.linalg.inv(wrong), deviations)
        assert abs(seen.mean() - 6) > 3 * np.sqrt(12 / repeats)


@pytest.mark.parametrize("quantity", ["mass", "damping"])
def test_rig_sensitivity_agrees_with_a_refit(fitted, quantity):
    unknowns, data, solved = fitted
    column, wrong = unknowns.names.index(quantity), 0.001
    known = _information(data, solved.trajectories, unknowns, solved.grid)
    expected = wrong * known.shift(column)
    base = data[0].base.copy()
    base[column] *= np.exp(wrong)
    again = solve_in_passes([replace(d, base=base) for d in data], solved.trajectories, unknowns)
    moved = (again.theta - solved.theta)[unknowns.free]
    size = np.sqrt(np.diag(known.covariance()))
    largest = float(np.max(np.abs(expected / size)))
    np.testing.assert_allclose(moved / size, expected / size, atol=0.05 * largest)
    assert largest > 0.1, "the shift is large enough to tell"


def test_what_the_data_cannot_tell_gets_no_small_error():
    """One slow log at 20 Hz: a slip holds one sample, so nothing of its shape is seen."""
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    logs = [case.simulated(case.PAIR, case.SLOW[0], case.SLOW[1], 20.0)]
    data = [case.log_data(logs[0], unknowns, load_sd=1e-4)]
    trajectories = case.placed(unknowns, logs, data, COARSE_GRID)
    known = _information(data, trajectories, unknowns, COARSE_GRID)
    told = {e.name: e for e in _told(unknowns, known.covariance())}
    for name in ("a", "delta_mu_k", "D", "mu_k0", "t_cr"):
        assert told[name].verdict == "not identifiable"
        assert told[name].standard_error is None
        assert told[name].lower is None or told[name].upper is None
        assert told[name].reason
    rich = _logs((case.SLOW, case.MIDDLE, case.FAST))
    both = [case.log_data(log, unknowns) for log in rich]
    known = _information(both, case.placed(unknowns, rich, both, COARSE_GRID), unknowns, COARSE_GRID)
    assert {e.verdict for e in _told(unknowns, known.covariance())} == {"identified", "fixed"}


def _told(unknowns, covariance, **options):
    given = {"at_bound": {}, "hints": {}, "profiles": {}} | options
    return estimates(unknowns, unknowns.start, unknowns.base(case.RIG), covariance, **given)


def _one(name, sd, **options):
    """The estimate of one parameter with this standard deviation of theta, the others well known."""
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    free = np.array(unknowns.names)[unknowns.free]
    covariance = np.diag(np.where(free == name, sd, 1e-4) ** 2)
    return _told(unknowns, covariance, **options)[unknowns.names.index(name)]


# Half width of a 95 % interval = 1.96 sd. Logarithm: both ends within 20 % means exp(1.96 sd) <= 1.2.
@pytest.mark.parametrize(
    ("name", "half", "verdict"),
    [
        ("a", np.log(1.2) * 0.999, "identified"),
        ("a", np.log(1.2) * 1.001, "weak"),
        ("t_cr", np.log(3.0) * 0.999, "weak"),
        ("t_cr", np.log(3.0) * 1.001, "not identifiable"),
        ("mu_k0", 0.2 * 0.43 * 1.001, "weak"),
        ("mu_s", 2 / 3 * 0.62 * 1.001, "not identifiable"),
        # delta_mu_k is judged by mu_s - mu_k0 = 0.19
        ("delta_mu_k", 0.2 * 0.19 * 0.999, "identified"),
        ("delta_mu_k", 2 / 3 * 0.19 * 1.001, "not identifiable"),
    ],
)
def test_verdicts_change_where_the_interface_says(name, half, verdict):
    estimate = _one(name, half / 1.959964)
    assert estimate.verdict == verdict
    assert (estimate.standard_error is None) == (verdict == "not identifiable")
