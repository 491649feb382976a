"""The shooting problem: counts, derivatives and compression against direct sums, the truth against the oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify.logs.unknowns import FORGOTTEN
from identify.model.model import assemble
from identify.shooting.layout import COARSE_GRID, Grid, transcribe
from identify.shooting.passes import solve, solve_in_passes
from identify.shooting.shooting import Problem, shooting_problem
from tests.support import shooting_case as case

SMALL = Grid(slip=4, renewed=3, steps=2)
FINE = Grid(slip=16, renewed=16, steps=4)
VARIED = [(0.0, 0.0), (1e-3, 0.0), (0.0, 1e-2)]  # standard deviations of the load in fast rhythms, and of strength


def _problem(
    pair=case.PAIR,
    free=case.FRICTION,
    load_sd=0.0,
    noise_seed=1,
    grid=SMALL,
    speeds=(case.SLOW, case.MIDDLE),
    jitter_sd=0.0,
    strength_sd=0.0,
):
    logs = [case.simulated(pair, *speed) for speed in speeds]
    unknowns = case.search_space(pair, free)
    data = [case.log_data(log, unknowns, noise_seed=noise_seed, load_sd=load_sd, jitter_sd=jitter_sd) for log in logs]
    data = [replace(log, strength_sd=strength_sd) for log in data]
    trajectories = case.placed(unknowns, logs, data, grid)
    return shooting_problem(data, trajectories, unknowns, grid), logs


def _somewhere(problem, size=1e-3, seed=3):
    return problem.start + size * np.random.default_rng(seed).standard_normal(problem.layout.size)


# A contact whose state never reaches 0 in the slow log, and does in the fast one: both types of slip.
MIXED = case.PAIR | {"D": 200e-6}


@pytest.mark.parametrize(("pair", "grid"), [(case.PAIR, SMALL), (MIXED, COARSE_GRID)], ids=["saturating", "both types"])
def test_unknowns_left_over_are_parameters_and_two_per_log(pair, grid):
    problem, logs = _problem(pair, grid=grid)
    assert problem.layout.size - problem.layout.rows == 6 + 2 * len(logs)


def test_every_further_freedom_is_counted():
    problem, logs = _problem(free=(*case.FRICTION, "mass", "stiffness"), load_sd=1e-3)
    cycles = sum(log.cycles for log in logs)
    assert problem.layout.size - problem.layout.rows == 8 + 2 * len(logs) + cycles
    trembling, _ = _problem(free=(*case.FRICTION, "mass", "stiffness"), load_sd=1e-3, jitter_sd=1e-3)
    assert trembling.layout.size - trembling.layout.rows == 8 + 2 * len(logs) + 2 * cycles
    scattering, _ = _problem(strength_sd=1e-2)
    assert scattering.layout.size - scattering.layout.rows == 6 + 2 * len(logs) + cycles


def test_rows_are_independent():
    problem, _ = _problem()
    jacobian = problem.evaluate(_somewhere(problem), derivatives=True).jacobian.toarray()
    norms = np.linalg.norm(jacobian, axis=1)
    singular = np.linalg.svd(jacobian / norms[:, None], compute_uv=False)
    assert singular[-1] > 1e-4 * singular[0]
    twice = np.vstack([jacobian, jacobian[0] + jacobian[5]])
    assert np.linalg.svd(twice, compute_uv=False)[-1] < 1e-10, "a redundant row would be seen"


@pytest.mark.parametrize(("tremor", "strength"), VARIED, ids=["calm", "trembling", "sticks differ"])
def test_derivatives_agree_with_central_differences(tremor, strength):
    free = (*case.FRICTION, "mass", "stiffness", "damping")
    problem, _ = _problem(MIXED, free=free, load_sd=1e-3, jitter_sd=tremor, strength_sd=strength)
    z = _somewhere(problem)
    point = problem.evaluate(z, derivatives=True)
    random, h = np.random.default_rng(5), 1e-6
    directions = [*random.standard_normal((6, z.size)), *np.eye(z.size)[:9]]
    for direction in directions:
        ahead, behind = (problem.evaluate(z + s * h * direction, derivatives=False) for s in (1, -1))
        slope = (ahead.cost - behind.cost) / (2 * h)
        assert slope == pytest.approx(point.gradient @ direction, rel=1e-6, abs=1e-6 * np.linalg.norm(point.gradient))
        moved = (ahead.rows - behind.rows) / (2 * h)
        expected = point.jacobian @ direction
        np.testing.assert_allclose(moved, expected, atol=1e-7 * np.max(np.abs(expected)))
        wrong = point.jacobian @ np.roll(direction, 1)
        assert np.max(np.abs(moved - wrong)) > 1e-2 * np.max(np.abs(expected)), "another column would be seen"


def test_hessian_is_that_of_the_linearised_residuals():
    problem, _ = _problem(load_sd=1e-3)
    z, h = _somewhere(problem), 1e-6
    upper = problem.evaluate(z, derivatives=True).hessian.toarray()
    hessian = upper + np.triu(upper, 1).T
    for direction in np.random.default_rng(6).standard_normal((5, z.size)):
        curvature = float(np.sum((direction * problem.layout.scale / problem.layout.prior_sd) ** 2))
        pairs = zip(problem.fitted(z + h * direction), problem.fitted(z - h * direction), problem.logs, strict=True)
        for ahead, behind, log in pairs:
            curvature += float(np.nansum(log.weight * ((ahead - behind) / (2 * h)) ** 2))
        assert direction @ hessian @ direction == pytest.approx(curvature, rel=1e-6)


@pytest.mark.parametrize(("tremor", "strength"), VARIED, ids=["calm", "trembling", "sticks differ"])
def test_exact_hessian_agrees_with_differences_of_the_gradient(tremor, strength):
    free = (*case.FRICTION, "mass")
    problem, _ = _problem(MIXED, free=free, load_sd=1e-3, jitter_sd=tremor, strength_sd=strength)
    z, h = _somewhere(problem, 1e-2), 1e-5
    multipliers = 30.0 * np.random.default_rng(7).standard_normal(problem.layout.rows)

    def slope(at):
        point = problem.evaluate(at, derivatives=True)
        return 0.7 * point.gradient + point.jacobian.T @ multipliers

    upper = problem.exact_hessian(z, 0.7, multipliers).toarray()
    hessian = upper + np.triu(upper, 1).T
    rough = problem.evaluate(z, derivatives=True).hessian.toarray()
    gauss_newton = 0.7 * (rough + np.triu(rough, 1).T)
    for direction in np.random.default_rng(8).standard_normal((4, z.size)):
        bent = (slope(z + h * direction) - slope(z - h * direction)) / (2 * h)
        largest = np.max(np.abs(bent))
        np.testing.assert_allclose(hessian @ direction, bent, atol=1e-6 * largest)
        assert np.max(np.abs(gauss_newton @ direction - bent)) > 1e-4 * largest, "the other Hessian is told apart"


def _direct_cost(problem, z):
    """Half chi^2 from the samples one by one, and the priors."""
    x = z * problem.layout.scale
    cost = 0.5 * float(np.sum(((x - problem.layout.prior_mean) / problem.layout.prior_sd) ** 2))
    for log, fitted in zip(problem.logs, problem.fitted(z), strict=True):
        inside = (log.time >= log.begin) & (log.time <= log.end)
        assert np.array_equal(np.isfinite(fitted), inside), "every sample of the window is in exactly one cell"
        residual = np.where(log.weight > 0, log.force - fitted, 0.0)[inside]
        cost += 0.5 * float(np.sum(residual**2 * log.weight[inside]))
    return cost


def _masked(problem):
    """The same problem with some samples masked, absurd values under the mask, other weights on some."""
    logs, layout = [], problem.layout
    for log in problem.logs:
        weight, force = log.weight.copy(), log.force.copy()
        weight[7::31] = 0.0
        force[7::31] = 1e6
        weight[::5] *= 0.3
        logs.append(replace(log, weight=weight, force=force))
    return Problem(logs, layout)


@pytest.mark.parametrize("size", [1e-3, 3e-2])
def test_compression_is_exact(size):
    problem = _masked(_problem(load_sd=1e-3)[0])
    z = _somewhere(problem, size)
    cost = problem.evaluate(z, derivatives=False).cost
    assert cost == pytest.approx(_direct_cost(problem, z), rel=1e-10)
    assert problem.samples == sum(log.samples for log in problem.logs)
    blocks = sum(float(c.sum()) for c in problem.block_costs(z))
    prior = ((z * problem.layout.scale - problem.layout.prior_mean) / problem.layout.prior_sd) ** 2
    assert cost == pytest.approx(0.5 * (blocks + float(prior.sum())), rel=1e-12)


def test_multipliers_of_a_solution_balance_its_gradient():
    problem, logs = _problem(load_sd=1e-4)
    unknowns = problem.layout.unknowns
    solved = solve_in_passes(problem.logs, case.placed(unknowns, logs, problem.logs, COARSE_GRID), unknowns)
    point = solved.problem.evaluate(solved.solution.z, derivatives=True)
    balanced = point.gradient + point.jacobian.T @ solved.solution.multipliers
    assert np.max(np.abs(balanced)) < 1e-5 * np.max(np.abs(point.gradient))
    assert np.max(np.abs(point.gradient)) > 1.0, "the rows hold the answer"


def test_cost_does_not_depend_on_the_curve_the_samples_are_compressed_about():
    problem = _problem(load_sd=1e-3)[0]
    z = _somewhere(problem)
    there = Problem(problem.logs, replace(problem.layout, start=_somewhere(problem, 1e-2, 8) * problem.layout.scale))
    a, b = (p.evaluate(z, derivatives=True) for p in (problem, there))
    assert a.cost == pytest.approx(b.cost, rel=1e-11)
    np.testing.assert_allclose(a.gradient, b.gradient, rtol=1e-7, atol=1e-9 * np.max(np.abs(a.gradient)))
    np.testing.assert_array_equal(a.rows, b.rows)


@pytest.mark.parametrize("pair", [case.PAIR, MIXED], ids=["saturating", "both types"])
def test_the_truth_solves_the_rows_and_has_the_event_times_of_the_independent_integrator(pair):
    logs = [case.simulated(pair, *speed) for speed in (case.SLOW, case.MIDDLE, case.FAST)]
    unknowns = case.search_space(pair, case.FRICTION)
    data = [case.log_data(log, unknowns) for log in logs]
    trajectories = case.placed(unknowns, logs, data, FINE)
    for _ in range(2):
        layout = transcribe(data, trajectories, unknowns, FINE)
        # Without the weak prior of gamma at the begin, which is 0 here: the data are exact.
        problem = Problem(data, replace(layout, prior_sd=np.full(layout.size, np.inf)))
        solution = solve(problem)
        _, trajectories = layout.at(solution.x)
    assert solution.success
    assert solution.constraint_violation < 1e-9
    assert solution.cost < 1e-3
    for log, trajectory in zip(logs, trajectories, strict=True):
        assert np.max(np.abs(trajectory.onset - log.truth.onsets[: log.cycles])) < 1e-6
        assert np.max(np.abs(trajectory.arrest - log.truth.arrests)) < 1e-6
        renewed = trajectory.until[trajectory.ending("wear")]
        assert renewed.size == log.truth.wear_times.size
        assert np.max(np.abs(renewed - log.truth.wear_times), initial=0.0) < 1e-6
    np.testing.assert_allclose(solution.x[:6], unknowns.start[unknowns.free], atol=1e-4)


@pytest.mark.parametrize("late", [True, False], ids=["events out of order", "a slide of no length"])
def test_a_trajectory_that_is_no_motion_is_a_failed_solve(late, recwarn):
    problem, logs = _problem(load_sd=1e-4)
    unknowns = problem.layout.unknowns
    trajectories = case.placed(unknowns, logs, problem.logs, COARSE_GRID)
    first, until = trajectories[0], trajectories[0].until.copy()
    which = int(first.ending("arrest" if late else "wear")[0])
    until[which] = first.onset[1] + 0.5 if late else until[which + 1]
    solved = solve_in_passes(problem.logs, [replace(first, until=until), trajectories[1]], unknowns)
    assert not solved.solution.success and solved.solution.cost == np.inf
    assert solved.solution.return_status == "Events_Out_Of_Order"
    assert not recwarn.list
    assert solve_in_passes(problem.logs, trajectories, unknowns).solution.success


@pytest.mark.parametrize("wrong", ["nothing", "no contact ageing", "mass"])
def test_a_wrong_model_does_not_fit(wrong):
    """Exact data: what remains of half chi^2 is the model's own error in units of the noise."""
    logs = [case.simulated(case.PAIR, *speed) for speed in (case.SLOW, case.MIDDLE, case.FAST)]
    model = case.MODEL
    if wrong == "no contact ageing":
        model = assemble(("inertia", "hysteresis_damping", "velocity_weakening"))
    unknowns = case.search_space(case.PAIR, case.FRICTION, model=model)
    data = [case.log_data(log, unknowns) for log in logs]
    base = data[0].base.copy()
    base[model.parameter_names.index("mass")] *= 1.2 if wrong == "mass" else 1.0
    data = [replace(d, base=base) for d in data]
    trajectories = case.placed(unknowns, logs, data, COARSE_GRID)
    solved = solve_in_passes(data, trajectories, unknowns.with_weak_priors())
    if wrong == "nothing":
        assert solved.solution.cost < 2.0
    else:
        assert not solved.solution.cost < 200.0


@pytest.mark.parametrize(("per", "jitter"), [(None, 0.0), ("log", 1e-3)], ids=["shared", "own"])
def test_a_point_keeps_its_cost_where_every_parameter_is_unknown(per, jitter):
    problem, _ = _problem(load_sd=jitter, jitter_sd=jitter)
    unknowns = problem.layout.unknowns
    if per is not None:
        unknowns = replace(unknowns, per=tuple(per if name == "mu_s" else None for name in unknowns.names))
        problem = shooting_problem(problem.logs, list(problem.layout.trajectories), unknowns, SMALL)
    z = _somewhere(problem)
    every, at = problem.with_all_parameters(unknowns, z)
    assert every.layout.free.size == len(unknowns.names) > unknowns.free.sum()
    cost = problem.evaluate(z, derivatives=False).cost
    assert every.evaluate(at, derivatives=False).cost == pytest.approx(cost, rel=1e-9)
    own = [int(i) for place in every.layout.places for i in place.own if i >= len(unknowns.names)]
    assert len(own) == (per is not None)
    if own:  # a wide prior of the search is no information on what a log has for itself
        spread = unknowns.spread[unknowns.names.index("mu_s")]
        soft, _ = problem.with_all_parameters(unknowns.with_weak_priors(), z)
        assert every.layout.prior_sd[own[0]] == FORGOTTEN * spread > soft.layout.prior_sd[own[0]]


def test_a_trust_region_is_a_prior_that_adds_its_information():
    """Of two Gaussians: precisions add, and the mean is that of both, weighted by them."""
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    sd = np.where(np.arange(unknowns.free.size) == 0, 0.02, np.inf)
    unknowns = replace(unknowns, prior_mean=unknowns.start - 0.1, prior_sd=sd)
    held = unknowns.within_region(100.0)
    wide = unknowns.weakest / 10.0
    np.testing.assert_allclose(held.prior_sd[1:], wide[1:])
    np.testing.assert_allclose(held.prior_mean[1:], unknowns.start[1:])
    both = np.array([0.02, wide[0]]) ** -2.0
    assert held.prior_sd[0] == pytest.approx(both.sum() ** -0.5)
    assert held.prior_mean[0] == pytest.approx(both @ [unknowns.start[0] - 0.1, unknowns.start[0]] / both.sum())
    np.testing.assert_allclose(unknowns.within_region(0.0).prior_sd, sd)
