"""Profile intervals, against points that IPOPT finds with one parameter fixed, from the answer and by itself."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.force_plates import plated
from experiments.study_problem import DEMO, RIG
from identify import Scene
from identify.base.budget import time_limit
from identify.base.progress import to_nobody
from identify.base.quantiles import NORMAL
from identify.base.result import Status
from identify.estimation.attempt import solve_again
from identify.estimation.certainty import Question, certainty
from identify.estimation.covariance import information_at
from identify.estimation.estimator import tracing
from identify.estimation.profile import CRITICAL, Profiles, Side, converged, profile
from identify.examples import FOLDER
from identify.logs.scene_records import with_records
from identify.logs.unknowns import from_scene
from identify.shooting.accuracy import DEFAULT_OPTIONS
from identify.shooting.passes import solve
from identify.shooting.shooting import shooting_problem
from tests.support.finding import find
from tests.support.two_logs import records, searched
from tests.support.two_logs import scene as two_logs


def answer_of(scene, logs):
    """An answer that IPOPT and Newton's method brought to its optimum, the unknowns and their standard errors."""
    attempt, unknowns = searched(scene, logs)
    assert attempt is not None and attempt.gate.status is Status.CONVERGED
    sizes = np.sqrt(np.diag(information_at(attempt.solved, unknowns).covariance()))
    solved = converged(attempt.solved, attempt.solved.problem, sizes)
    assert solved is not None and solved.solution.cost <= attempt.solved.solution.cost + 1e-6
    return replace(attempt, solved=solved), unknowns, sizes


@pytest.fixture(scope="module")
def pair():
    """Two logs with the mass known to 5 %."""
    return answer_of(two_logs(RIG | {"mass": {"value": 0.21, "tolerance": 0.05}}), records(17))


@pytest.fixture(scope="module")
def banana():
    """The shipped logs at 50 Hz, in which the parameters follow each other on a bent path."""
    scene, records = with_records(Scene.from_toml(FOLDER / "pair_at_50_Hz.toml"), None)
    return answer_of(scene, records)


def ratio(attempt, unknowns, index, value, steps=2):
    """The likelihood ratio of the answer with one parameter fixed, by IPOPT in steps from there; the user's prior of
    what is fixed counts."""
    solved, costs = attempt.solved, []
    theta, motion = solved.theta, solved.trajectories
    logs, soft = [log.data for log in attempt.fitted_logs], unknowns.with_weak_priors()
    soft = replace(soft, prior_sd=np.where(np.isfinite(unknowns.prior_sd), soft.prior_sd, 30.0 * soft.prior_sd))
    free = unknowns.free.copy()
    free[index] = False
    for place in np.linspace(solved.theta[index], value, steps):
        start = theta.copy()
        start[index] = place
        problem = shooting_problem(logs, motion, replace(soft, start=start, free=free), solved.grid)
        solution = solve(problem, mu_init=1e-6, iterations=60, exact=True)
        assert solution.success
        theta, motion = problem.layout.at(solution.x)
        prior = unknowns.off_prior(theta)[index] if np.isfinite(unknowns.prior_sd[index]) else 0.0
        costs.append(solution.cost + 0.5 * prior**2)
    return 2.0 * (costs[-1] - costs[0])


def test_what_is_allowed_for_beside_white_noise_moves_the_ends(pair):
    attempt, unknowns, sizes = pair
    index = unknowns.names.index("mu_k0")
    lengths = []
    for inflation in (1.0, 4.0):
        wide = np.full(sizes.size, inflation)
        low, high = profile(attempt.solved, unknowns, sizes, wide, [index]).ends["mu_k0"]
        lengths.append(high.end - low.end)
    assert lengths[1] == pytest.approx(2.0 * lengths[0], rel=0.05)


def test_on_a_bent_path_the_ends_are_where_the_data_object_and_those_of_the_covariance_are_not(banana):
    """Negative control: of the curvature at the answer an end would be four times too near."""
    attempt, unknowns, sizes = banana
    index = unknowns.names.index("mu_s")
    found = profile(attempt.solved, unknowns, sizes, np.ones(sizes.size), [index])
    size, off = NORMAL * sizes[np.flatnonzero(unknowns.free).tolist().index(index)], []
    for side in found.ends["mu_s"]:
        if side.end is not None:
            assert ratio(attempt, unknowns, index, side.end) == pytest.approx(CRITICAL, rel=0.05)
            off.append(abs(side.end - attempt.solved.theta[index]) / size - 1.0)
    assert max(off) > 3.0 and min(off) < -0.2


def test_a_bound_of_the_scene_ends_an_interval_and_says_so(pair):
    attempt, unknowns, sizes = pair
    index = unknowns.names.index("D")
    size = sizes[np.flatnonzero(unknowns.free).tolist().index(index)]
    upper, walls = unknowns.upper.copy(), unknowns.user_bounds.copy()
    upper[index], walls[1, index] = attempt.solved.theta[index] + size, True
    bounded = replace(unknowns, upper=upper, user_bounds=walls)
    low, high = profile(attempt.solved, bounded, sizes, np.ones(sizes.size), [index]).ends["D"]
    assert high.walled and high.end == pytest.approx(upper[index]) and not low.walled


def test_a_lower_point_is_handed_back(pair):
    """An answer that stopped too early: held five standard errors away."""
    attempt, unknowns, sizes = pair
    index = unknowns.names.index("mu_k0")
    held, sd = attempt.solved.theta.copy(), unknowns.prior_sd.copy()
    held[index] += 5.0 * sizes[np.flatnonzero(unknowns.free).tolist().index(index)]
    sd[index] = 1e-6
    mean = np.where(np.isfinite(sd), held, unknowns.prior_mean)
    early = solve_again(attempt, replace(unknowns, start=held, prior_mean=mean, prior_sd=sd))
    assert early.gate.status is Status.CONVERGED, "its curve fits"
    gain = 2.0 * (early.solved.solution.cost - attempt.solved.solution.cost)
    found = profile(early.solved, unknowns, sizes, np.ones(sizes.size), [index], restart=True)
    assert found.lower is not None and found.gain == pytest.approx(gain, rel=0.1)
    np.testing.assert_allclose((found.lower.theta - attempt.solved.theta)[unknowns.free] / sizes, 0.0, atol=0.3)


@pytest.mark.parametrize("late", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_an_interval_that_no_profile_could_check_is_not_given(banana, late):
    """Of the shipped logs at 50 Hz, whose truth is known: the covariance alone puts mu_k0 to 0.59 ± 0.05 for 0.43.
    Negative control: with time there is a profile of each."""
    attempt, unknowns, _ = banana
    base = unknowns.base(RIG)
    question = Question(unknowns, base, DEFAULT_OPTIONS, 0.0, 0, to_nobody)
    with time_limit(0.0 if late else np.inf), tracing() as trace:
        found = certainty(attempt, question)
    assert found is not None and found.refused is None and ("profiles" in trace.not_tried) is late
    free = [e for e in found.estimates if e.verdict != "fixed"]
    assert any(e.verdict == "not profiled" for e in free) is late
    given = [e for e in free if e.verdict != "not profiled"]
    for e in (e for e in free if e.verdict == "not profiled"):
        assert e.value is not None and (e.standard_error, e.lower, e.upper) == (None, None, None)
    # Of six intervals of 95 % one may miss.
    held = [e.lower is None or e.upper is None or e.lower < DEMO[e.name] < e.upper for e in given]
    assert sum(held) >= len(held) - 1
    assert all(ok for ok, e in zip(held, given, strict=True) if e.name == "mu_k0")


@pytest.mark.slow
def test_what_follows_another_on_its_bent_path_is_profiled_too():
    """Of the two slowest logs of a plate the covariance alone puts mu_s to within 0.1 %, and t_cr, which it follows, is
    open: the profile of t_cr shows that, and then mu_s is profiled as well."""
    made = plated(19)
    _, found = find(replace(made.scene, logs=made.scene.logs[:2], time_limit=300.0), made.case.records[:2])
    estimates = {estimate.name: estimate for estimate in found.estimates}
    for name in ("t_cr", "mu_s", "mu_k0"):
        assert estimates[name].verdict == "not identifiable", name
        assert estimates[name].lower < made.case.truth[name] and estimates[name].upper is None


def test_another_optimum_widens_an_interval_that_is_open_on_one_side():
    unknowns = from_scene(two_logs())
    found, halves = Profiles({"mu_s": (Side(1.08, False), Side(None, True))}), np.full(len(unknowns.names), 0.02)
    lower, inside = (found.with_optimum(unknowns, np.full(halves.size, at), halves).ends["mu_s"] for at in (0.6, 1.3))
    assert (lower[0].end, inside[0].end) == (pytest.approx(0.58), 1.08)
    assert lower[1].end is inside[1].end is None
