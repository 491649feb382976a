"""How one pass is solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify.shooting import passes
from identify.shooting.grid import COARSE_GRID
from tests.support import shooting_case as case


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


@pytest.mark.parametrize("firm", [True, False])
def test_a_pass_that_fails_is_solved_again_within_a_trust_region_that_is_gone_at_the_answer(firm, monkeypatch):
    """A solver that loses its way where the parameters are free to go: the answer is that of one that does not."""
    unknowns = case.search_space(case.PAIR, case.FRICTION).with_weak_priors()
    log = case.simulated(case.PAIR, *case.MIDDLE)
    data = [case.log_data(log, unknowns, noise_seed=3)]
    start = replace(unknowns, start=unknowns.start + 0.02 * unknowns.spread * unknowns.free)
    trajectories = case.placed(unknowns, [log], data, COARSE_GRID)
    right = passes.solve_in_passes(data, trajectories, start)
    solve, weights = passes.solve, list[float]()

    def astray(problem, **options):
        sd, at = problem.layout.prior_sd[0], np.flatnonzero(unknowns.free)[0]
        weights.append(round(float((unknowns.weakest[at] / sd) ** 2 - 1.0), 6))
        solution = solve(problem, **options)
        lost = weights[-1] < 50.0 and (len(set(weights)) == 1 or not firm)
        return replace(solution, success=False, constraint_violation=0.3) if lost else solution

    monkeypatch.setattr(passes, "solve", astray)
    found = passes.solve_in_passes(data, trajectories, start)
    assert right.solution.success and found.solution.success == firm
    assert weights[:2] == [0.0, passes.FIRST_WEIGHT]
    if firm:
        assert weights[-1] == 0.0
        assert found.solution.cost == pytest.approx(right.solution.cost, abs=1e-3)
