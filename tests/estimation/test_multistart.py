"""Other optima: found from starts about an answer, counted in intervals, and taken where they are lower."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, qmc

from experiments import in_vivo
from experiments.record_kinds import DEMO, FAST, RIG, SLOW, Kind
from identify.base.outcome import Status
from identify.estimation.attempt import solve_again, solve_from
from identify.estimation.certainty import certainty, information_at
from identify.estimation.multistart import Optimum, _quasi_random, multistart, weakens
from identify.estimation.search import SearchProblem, search
from identify.estimation.starts import ranked
from identify.logs.parting import parted
from identify.logs.prepare import prepare
from identify.logs.scene_records import with_records
from identify.logs.unknowns import from_scene
from identify.logs.vibration import tuned
from identify.shooting.accuracy import DEFAULT_OPTIONS


def _prepared(scene, records):
    unknowns = from_scene(scene)
    return tuned([prepare(scene, e, r, unknowns) for e, r in zip(scene.logs, records, strict=True)], unknowns)


def _sure(attempt, unknowns):
    base = attempt.fitted_logs[0].data.base
    quiet = {"speed_tolerance": 0.0, "seed": 0, "progress": lambda *_: None}
    return certainty(attempt, unknowns, base, DEFAULT_OPTIONS, **quiet)


@pytest.fixture(scope="module")
def pair():
    """A good answer, the search space, an answer that stopped too early, five errors of mu_k0 away, and covariance."""
    kind = Kind("", (SLOW, FAST), (SLOW, FAST), DEMO, RIG)
    prepared, unknowns = _prepared(*kind.made(1))
    right, _ = search(SearchProblem(prepared, unknowns))
    assert right.gate.status is Status.CONVERGED
    covariance = information_at(right, unknowns).covariance()
    i = unknowns.names.index("mu_k0")
    place = np.flatnonzero(unknowns.free).tolist().index(i)
    held, sd = right.solved.theta.copy(), unknowns.prior_sd.copy()
    held[i] += 5.0 * np.sqrt(covariance[place, place])
    sd[i] = 1e-6
    mean = np.where(np.isfinite(sd), held, unknowns.prior_mean)
    early = solve_again(right, replace(unknowns, start=held, prior_mean=mean, prior_sd=sd))
    assert early.gate.status is Status.CONVERGED, "its curve fits: the gate alone does not see it"
    return right, early, unknowns, covariance


@pytest.mark.slow
def test_an_answer_that_stopped_too_early_is_moved_to_the_lowest_point(pair):
    right, early, unknowns, covariance = pair
    sure = _sure(early, unknowns)
    assert sure.attempt.gate.status is Status.CONVERGED
    away = (sure.attempt.solved.theta - right.solved.theta)[unknowns.free]
    assert float(away @ np.linalg.solve(covariance, away)) < 0.2
    before = (early.solved.theta - right.solved.theta)[unknowns.free]
    assert float(before @ np.linalg.solve(covariance, before)) > 20.0


def test_starts_are_ranked_by_the_motion_that_follows_from_each(pair):
    right, early, unknowns, _ = pair
    there, beside = right.solved.theta, early.solved.theta
    far, nowhere = there.copy(), there.copy()
    far[unknowns.names.index("D")] += 1.0
    nowhere[[unknowns.names.index(name) for name in ("mu_k0", "delta_mu_k")]] = 2.0, 0.5  # slides steadily
    order = ranked(list(right.fitted_logs), unknowns, [nowhere, far, beside, there])
    assert [next(i for i, t in enumerate((there, beside, far)) if t is start.theta) for start in order] == [0, 1, 2]
    costs = [start.cost for start in order]
    assert 0.45 < costs[0] < 0.7 and costs == sorted(costs), "half of chi^2 per sample, on the coarse grid"


def test_where_the_data_have_one_optimum_all_starts_lead_to_it(pair):
    right, _, unknowns, covariance = pair
    optima = multistart(right, unknowns, 0, covariance)
    assert [type(o) for o in optima] == [Optimum] and optima[0].starts > 1
    assert optima[0].attempt is right


VALLEY = {
    "mu_s": 1.02, "mu_k0": 0.649, "D": 2.28e-4, "t_cr": 17.6, "delta_mu_k": -0.138, "a": 331.0, "stiffness": 1366.0,
    "mass": 0.235, "damping": 147.0, "occlusion_level": -0.0656, "occlusion_time": 24.9, "skin_stiffness": 3360.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def doubled():
    """An in-vivo twin at 50 Hz, an answer whose contact ages on and on, which describes it nearly as well, and the
    optima about that."""
    made = in_vivo.twin(32)
    prepared, unknowns = _prepared(*parted(*with_records(made.scene(all_known=False), made.records(50.0))))
    values = np.array([(made.truth | VALLEY).get(name, 1.0) for name in unknowns.names])
    start = np.where(unknowns.free, unknowns.theta(values, prepared[0].data.base), unknowns.start)
    wrong = solve_from(prepared, [0, 1], replace(unknowns, start=start))
    assert wrong.gate.status is Status.CONVERGED, "it passes the gate"
    return made, wrong, unknowns, multistart(wrong, unknowns, 0, information_at(wrong, unknowns).covariance())


def _off(theta, made, unknowns, name):
    i = unknowns.names.index(name)
    value = np.exp(theta[i]) if unknowns.logarithmic[i] else theta[i]
    return abs(value / made.truth[name] - 1.0)


@pytest.mark.slow
def test_a_start_about_an_answer_ends_in_the_other_valley(doubled):
    made, wrong, unknowns, optima = doubled
    assert _off(wrong.solved.theta, made, unknowns, "t_cr") > 2.0
    assert any(
        all(_off(o.attempt.solved.theta, made, unknowns, name) < 0.15 for name in ("mu_s", "mu_k0", "t_cr"))
        for o in optima
    )


@pytest.mark.slow
def test_optima_are_of_the_same_samples(doubled):
    _, wrong, unknowns, optima = doubled
    assert any(o.attempt is wrong for o in optima) and len(optima) > 1
    for o in optima:
        assert o.attempt.gate.status is Status.CONVERGED and o.attempt.log_numbers == wrong.log_numbers
        assert o.attempt.solved.problem.samples == wrong.solved.problem.samples
    assert min(o.cost for o in optima) < wrong.solved.solution.cost + 0.5 * chi2.ppf(0.95, unknowns.free.sum())


@pytest.mark.slow
def test_intervals_hold_an_optimum_that_the_data_do_not_rule_out(doubled):
    """Negative control: an interval of the wrong answer alone claims what is wrong."""
    made, wrong, unknowns, _ = doubled
    i, truth = unknowns.names.index("mu_k0"), made.truth["mu_k0"]
    place = np.flatnonzero(unknowns.free).tolist().index(i)
    alone = 1.96 * np.sqrt(np.diag(information_at(wrong, unknowns).covariance()))[place]
    assert wrong.solved.theta[i] - alone > truth + 0.02
    estimate = next(e for e in _sure(wrong, unknowns).estimates if e.name == "mu_k0")
    assert estimate.verdict == "not identifiable" or estimate.lower < truth - 0.005 < estimate.upper


def test_contacts_that_weaken_at_rest_are_told_from_others(pair):
    right, _, unknowns, _ = pair
    turned = right.solved.theta.copy()
    static, kinetic = (unknowns.names.index(name) for name in ("mu_s", "mu_k0"))
    turned[[static, kinetic]] = turned[[kinetic, static]]
    assert weakens(unknowns, turned) and not weakens(unknowns, right.solved.theta)


@pytest.mark.parametrize("dimensions", [1, 3, 7])
def test_quasi_random_points_fill_the_cube_more_evenly_than_random_ones(dimensions):
    points = _quasi_random(64, dimensions, 0)
    assert points.shape == (64, dimensions) and points.min() >= 0.0 and points.max() < 1.0
    random = np.random.default_rng(0).random((64, dimensions))
    assert qmc.discrepancy(points) < 0.6 * qmc.discrepancy(random)
