"""A layout that is laid out again is the one that a walk along the logs would have made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify.logs.unknowns import FORGOTTEN
from identify.shooting.grid import Grid
from identify.shooting.retranscription import with_finer_steps
from identify.shooting.shooting import Problem, shooting_problem
from identify.shooting.transcription import transcribe
from tests.support import shooting_case as case

SMALL = Grid(slip=4, worn=3, steps=2)


def _made(per: str | None = None, tremor: float = 0.0):
    """Two small logs of both types, transcribed; a point beside the start."""
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    logs = [case.simulated(case.PAIR, *speed) for speed in (case.SLOW, case.MIDDLE)]
    data = [
        replace(case.log_data(log, unknowns, noise_seed=i), tremor_sd=tremor, normal_force_sd=tremor)
        for i, log in enumerate(logs)
    ]
    trajectories = case.placed(unknowns, logs, data, SMALL)
    if per is not None:
        unknowns = replace(unknowns, per=tuple(per if name == "mu_s" else None for name in unknowns.names))
        trajectories = [
            replace(g, own=np.where(unknowns.own, unknowns.start, np.nan)) if g.own.size else g for g in trajectories
        ]
    problem = shooting_problem(data, trajectories, unknowns, SMALL)
    z = problem.start + 1e-3 * np.random.default_rng(5).standard_normal(problem.layout.size)
    return data, trajectories, unknowns, problem, z


def _same(one: Problem, other: Problem, z) -> None:
    a, b = (p.evaluate(z, derivatives=True) for p in (one, other))
    assert a.cost == pytest.approx(b.cost, rel=1e-12)
    for x, y in ((a.rows, b.rows), (a.gradient, b.gradient), (a.jacobian.toarray(), b.jacobian.toarray())):
        np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-9 * max(np.max(np.abs(y)), 1e-300))
    h, k = a.hessian.toarray(), b.hessian.toarray()
    np.testing.assert_allclose(h, k, rtol=1e-9, atol=1e-12 * np.max(np.abs(k)))


@pytest.mark.parametrize("tremor", [0.0, 1e-3], ids=["calm", "trembling"])
@pytest.mark.parametrize("per", [None, "log"], ids=["shared", "own"])
def test_every_parameter_is_where_a_walk_would_put_it(per, tremor):
    data, trajectories, unknowns, problem, z = _made(per, tremor)
    assert not np.all(unknowns.free)
    again, at = problem.with_all_parameters(unknowns, z)
    walked = transcribe(data, trajectories, replace(unknowns, free=np.ones(len(unknowns.names), bool)), SMALL)
    for name in ("free", "scale", "start", "lower", "upper", "prior_mean", "prior_sd"):
        np.testing.assert_array_equal(getattr(again.layout, name), getattr(walked, name), err_msg=name)
    for mine, theirs in zip(again.layout.places, walked.places, strict=True):
        for name in ("start", "until", "nodes", "deviation", "own", "slip_deviation", "strength"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name), err_msg=name)
    _same(again, Problem(data, walked), at)
    assert again.evaluate(at, derivatives=False).cost == pytest.approx(problem.evaluate(z, derivatives=False).cost)


def test_a_wide_prior_of_the_search_is_no_information_on_what_a_log_has_for_itself():
    _, _, unknowns, problem, z = _made("log")
    soft, _ = problem.with_all_parameters(unknowns.with_weak_priors(), z)
    plain, _ = problem.with_all_parameters(unknowns, z)
    own = [int(i) for place in plain.layout.places for i in place.own if i >= len(unknowns.names)]
    assert len(own) == 1
    spread = unknowns.spread[unknowns.names.index("mu_s")]
    assert plain.layout.prior_sd[own[0]] == FORGOTTEN * spread
    assert soft.layout.prior_sd[own[0]] < FORGOTTEN * spread


def test_finer_steps_are_those_of_a_finer_grid():
    data, trajectories, unknowns, problem, z = _made()
    finer = problem.with_finer_steps()
    walked = shooting_problem(data, trajectories, unknowns, replace(SMALL, steps=4))
    _same(finer, walked, z)
    coarse, fine = (p.evaluate(z, derivatives=False) for p in (problem, finer))
    assert np.max(np.abs(coarse.rows - fine.rows)) > 1e-9, "more steps change nothing"
    assert [f.block.n_cells for f in with_finer_steps(problem.layout).families] != [
        f.block.n_cells for f in problem.layout.families
    ]
