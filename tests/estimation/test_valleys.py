"""Answers beside the lowest one: handed back by a profile, and found from thrown starts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from experiments import in_vivo
from experiments.record_kinds import DEMO, FAST, RIG, SLOW, Kind
from identify.base.outcome import Status
from identify.estimation import certainty as sureness
from identify.estimation import examined, search
from identify.estimation import other_optima as room
from identify.estimation.agreement import noise_of
from identify.estimation.attempt import solve_again, solve_from
from identify.estimation.covariance import information
from identify.estimation.other_optima import optima_about, within
from identify.estimation.profile import ProfileNoise, ProfileOptions, Profiles, Side, profile
from identify.estimation.profile_line import ProfilePoint
from identify.estimation.residual_autocorrelation import Colour, NoiseAutocorrelation
from identify.estimation.starts import PlacedStart, distinguishable, ranked
from identify.logs.parting import parted
from identify.logs.prepare import prepare
from identify.logs.scene_records import with_records
from identify.logs.unknowns import from_scene
from identify.logs.vibration import tuned
from identify.shooting.accuracy import DEFAULT_OPTIONS


def _prepared(scene, records):
    unknowns = from_scene(scene)
    return tuned([prepare(scene, e, r, unknowns) for e, r in zip(scene.logs, records, strict=True)], unknowns)


def _covariance(attempt, unknowns):
    solved = attempt.solved
    at = replace(unknowns, start=solved.theta)
    return information(*solved.problem.with_all_parameters(at, solved.solution.z)).covariance()


def _sure(attempt, unknowns):
    base = attempt.fitted_logs[0].data.base
    quiet = {"speed_tolerance": 0.0, "seed": 0, "progress": lambda *_: None}
    return sureness.certainty(attempt, unknowns, base, DEFAULT_OPTIONS, **quiet)


@pytest.fixture(scope="module")
def pair():
    """A good answer, the search space, and an answer that stopped too early: with mu_k0 held five errors away."""
    kind = Kind("", (SLOW, FAST), (SLOW, FAST), DEMO, RIG)
    prepared, unknowns = _prepared(*kind.made(1))
    right, _ = search.search(search.SearchProblem(prepared, unknowns))
    assert right.gate.status is Status.CONVERGED
    covariance = _covariance(right, unknowns)
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
def test_a_profile_hands_back_the_lowest_point_from_which_it_began(pair):
    right, early, unknowns, covariance = pair
    d = [unknowns.names.index("D")]
    found = {}
    for name, attempt in (("right", right), ("early", early)):
        solved, noise = attempt.solved, noise_of(attempt)
        allowed = ProfileNoise(covariance, noise)
        found[name] = profile(attempt.fitted_logs, solved, unknowns, allowed, ProfileOptions(only=d))
    assert found["right"].better is None
    lowest = min(point.cost for point in found["right"].met)  # the solver stops where what is left tells nothing
    gain = 2.0 * (early.solved.solution.cost - lowest)
    assert gain == pytest.approx(25.0, rel=0.2), "five standard errors"
    assert found["early"].gain == pytest.approx(gain, rel=0.02)
    sizes = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((found["early"].better.theta - right.solved.theta)[unknowns.free] / sizes, 0.0, atol=0.3)


@pytest.mark.slow
def test_an_answer_that_stopped_too_early_is_moved_to_the_lowest_point(pair):
    right, early, unknowns, covariance = pair
    sure = _sure(early, unknowns)
    assert sure.attempt.gate.status is Status.CONVERGED
    away = (sure.attempt.solved.theta - right.solved.theta)[unknowns.free]
    assert float(away @ np.linalg.solve(covariance, away)) < 0.2
    before = (early.solved.theta - right.solved.theta)[unknowns.free]
    assert float(before @ np.linalg.solve(covariance, before)) > 20.0


def test_intervals_seen_from_an_answer_that_they_do_not_hold_are_open(pair):
    right, early, unknowns, covariance = pair
    only = [unknowns.names.index("mu_k0")]
    noise = ProfileNoise(covariance, noise_of(right))
    walked = profile(right.fitted_logs, right.solved, unknowns, noise, ProfileOptions(only=only))
    low, high = walked.ends["mu_k0"]
    assert low.end is not None and high.end is not None
    seen = walked.seen_from(unknowns, early.solved.theta)
    assert seen.ends["mu_k0"][0].end == low.end and seen.ends["mu_k0"][1].end is None
    free = unknowns.free
    np.testing.assert_allclose(
        seen.likely + early.solved.theta[free], walked.likely + walked.middle[free], rtol=1e-12, err_msg="same points"
    )


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


VALLEY = {
    "mu_s": 1.02, "mu_k0": 0.649, "D": 2.28e-4, "t_cr": 17.6, "delta_mu_k": -0.138, "a": 331.0, "stiffness": 1366.0,
    "mass": 0.235, "damping": 147.0, "occlusion_level": -0.0656, "occlusion_time": 24.9, "skin_stiffness": 3360.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def astray():
    """An in-vivo twin at 50 Hz, and an answer whose contact ages on and on, which describes it nearly as well."""
    made = in_vivo.twin(32)
    prepared, unknowns = _prepared(*parted(*with_records(made.scene(all_known=False), made.records(50.0))))
    values = np.array([(made.truth | VALLEY).get(name, 1.0) for name in unknowns.names])
    start = np.where(unknowns.free, unknowns.theta(values, prepared[0].data.base), unknowns.start)
    wrong = solve_from(prepared, [0, 1], replace(unknowns, start=start))
    assert wrong.gate.status is Status.CONVERGED, "it passes the gate"
    return made, wrong, unknowns


@pytest.fixture(scope="module")
def doubled(astray):
    """The same, and the optima about it."""
    made, wrong, unknowns = astray
    return made, wrong, unknowns, optima_about(wrong, unknowns, 0, noise_of(wrong))


def _off(theta, made, unknowns, name):
    i = unknowns.names.index(name)
    value = np.exp(theta[i]) if unknowns.logarithmic[i] else theta[i]
    return abs(value / made.truth[name] - 1.0)


@pytest.mark.slow
def test_a_start_thrown_about_the_datas_own_start_ends_in_the_other_valley(doubled):
    made, wrong, unknowns, optima = doubled
    assert _off(wrong.solved.theta, made, unknowns, "t_cr") > 2.0
    assert any(
        all(_off(optimum.solved.theta, made, unknowns, name) < 0.15 for name in ("mu_s", "mu_k0", "D", "t_cr"))
        for optimum in optima
    )


@pytest.mark.slow
def test_other_valleys_are_of_the_same_samples_and_inside_the_joint_region_the_lowest_first(doubled):
    _, wrong, unknowns, optima = doubled
    costs = [optimum.solved.solution.cost for optimum in optima]
    assert costs and costs == sorted(costs)
    assert costs[-1] < wrong.solved.solution.cost + 0.5 * chi2.ppf(0.95, np.count_nonzero(unknowns.free))
    for optimum in optima:
        assert optimum.gate.status is Status.CONVERGED and optimum.log_numbers == wrong.log_numbers
        assert optimum.solved.problem.samples == wrong.solved.problem.samples


def test_the_lowest_valley_takes_the_place_and_what_was_left_is_kept(astray, monkeypatch):
    _, wrong, unknowns = astray

    def at(cost):
        solved = wrong.solved
        return replace(wrong, solved=replace(solved, solution=replace(solved.solution, cost=cost)))

    first, lower, beside, above, beyond = (at(cost) for cost in (100.0, 97.0, 99.0, 101.0, 109.0))
    looks, own = [[lower, beside, beyond], [above]], []
    monkeypatch.setattr(room, "optima_about", lambda *_, **how: own.append(how["own"]) or looks.pop(0))
    answer, others = room.lowest_optimum(first, unknowns, 0, noise_of(first))
    assert answer is lower and own == [True, False], "about the data's own start once"
    assert {id(other) for other in others} == {id(first), id(beside), id(above)}, "109 is outside the joint region"
    looks = [[beside]]
    assert room.lowest_optimum(at(99.02), unknowns, 0, noise_of(first))[1] == [beside], (
        "hardly lower: no place to move to"
    )


def test_where_noise_has_a_memory_a_valley_counts_that_white_noise_would_object_to(astray):
    _, wrong, unknowns = astray
    limit = float(chi2.ppf(0.95, np.count_nonzero(unknowns.free)))
    weights = tuple(log.data.weight for log in wrong.fitted_logs)
    curves = wrong.solved.fitted
    off = np.sqrt(2.0 * limit / np.sum(weights[0][np.isfinite(curves[0])]))
    solution = replace(wrong.solved.solution, cost=wrong.solved.solution.cost + limit)
    beside = replace(wrong.solved, solution=solution)
    beside.__dict__["fitted"] = [curves[0] + off, *curves[1:]]  # twice the limit, all along the first log
    other, levels = replace(wrong, solved=beside), (1.0,) * len(weights)
    white = NoiseAutocorrelation(weights, (Colour(np.empty(0), 1.0),) * len(weights), levels)
    slow = NoiseAutocorrelation(weights, (Colour(np.array([0.9]), 1.0 - 0.9**2),) * len(weights), levels)
    assert not within(wrong, other, unknowns, white)
    assert within(wrong, other, unknowns, slow)


@pytest.mark.slow
def test_an_interval_holds_a_valley_that_the_data_do_not_object_to(doubled):
    made, wrong, unknowns, found = doubled
    i, truth = unknowns.names.index("mu_k0"), made.truth["mu_k0"]
    covariance, ends = _covariance(wrong, unknowns), []
    noise = ProfileNoise(covariance, noise_of(wrong))
    for optima in ([], [optimum.solved for optimum in found]):
        asked = ProfileOptions(only=[i], optima=optima)
        walked = profile(wrong.fitted_logs, wrong.solved, unknowns, noise, asked)
        ends.append([side.end for side in walked.ends["mu_k0"]])
    assert ends[0][0] > truth + 0.02, "who does not look for it claims what is wrong"
    assert ends[1][0] < truth - 0.005 and truth < ends[1][1]
    assert ends[1][1] > wrong.solved.theta[i], "and holds the answer still"


@pytest.mark.slow
def test_a_place_on_a_ridge_without_end_counts_and_takes_nobodys_place(astray, monkeypatch):
    _, wrong, unknowns = astray
    solution = replace(wrong.solved.solution, cost=wrong.solved.solution.cost - 1.0, success=False)
    gate = replace(wrong.gate, status=Status.SOLVER_FAILED, solver="Maximum_Iterations_Exceeded")
    stalled = replace(wrong, solved=replace(wrong.solved, solution=solution), gate=gate)
    monkeypatch.setattr(room, "solve_from", lambda *_: stalled)
    answer, others = room.lowest_optimum(wrong, unknowns, 0, noise_of(wrong))
    assert answer is wrong and others and all(other.gate.status is Status.SOLVER_FAILED for other in others)
    misfit = replace(stalled, gate=replace(gate, chi2_per_sample=1.6))
    monkeypatch.setattr(room, "solve_from", lambda *_: misfit)
    assert room.lowest_optimum(wrong, unknowns, 0, noise_of(wrong))[1] == [], "what does not fit says nothing"


def test_starts_whose_motions_the_data_do_not_tell_apart_are_one():
    rows = [
        PlacedStart(np.zeros(2), cost, {0: np.array([x, np.nan])}) for cost, x in ((1.0, 0.0), (1.1, 3.0), (1.2, 5.0))
    ]
    assert [start.cost for start in distinguishable(rows, 10.0)] == [1.0, 1.2], "9, 25 and 4 squares apart"
    assert rows[0].differs(PlacedStart(np.zeros(2), 1.0, {1: np.zeros(2)})) == np.inf, "of another log"


def _walks(unknowns, at, cost, low, high):
    theta = np.full(len(unknowns.names), at)
    some = np.zeros((1, np.count_nonzero(unknowns.free)))
    point = ProfilePoint(theta, [], cost, -1)
    ends = {"D": (Side(low, False), Side(high, False)), "t_cr": (Side(low, False), Side(None, False))}
    return Profiles(ends, None, {}, 0.0, theta, cost, some, np.array([4.0]), (point,))


def test_an_interval_holds_what_the_walks_from_another_optimum_do(astray):
    """Where a slip has another phase the curves have another form: no walk leads from the one valley to the other."""
    _, _, unknowns = astray
    one, other = _walks(unknowns, 0.0, 100.0, -1.0, 1.0), _walks(unknowns, 5.0, 102.0, 4.0, 6.0)
    length, time = (unknowns.names.index(name) for name in ("D", "t_cr"))
    assert one.outside(unknowns, np.full(len(unknowns.names), 0.5)) == []
    assert one.outside(unknowns, other.middle) == [(length, 1.0)], "t_cr is open that way"
    assert other.outside(unknowns, one.middle) == [(length, -1.0), (time, -1.0)]
    both = one.joined(other, unknowns)
    assert [side.end for side in both.ends["D"]] == [-1.0, 6.0]
    assert [side.end for side in both.ends["t_cr"]] == [-1.0, None]
    np.testing.assert_allclose(both.likely[:, 0], [0.0, 5.0])
    np.testing.assert_allclose(both.objection, [4.0, 8.0])
    lower = one.joined(_walks(unknowns, 5.0, 99.0, 4.0, 6.0), unknowns)
    assert lower.better is not None and lower.gain == pytest.approx(2.0), "the lower place is handed back"


def test_an_optimum_that_an_interval_does_not_hold_is_walked_from_on_that_side(astray, monkeypatch):
    _, wrong, unknowns = astray
    length = unknowns.names.index("D")
    cost, theta = wrong.solved.solution.cost, wrong.solved.theta

    def beside(moved, above):
        solution = replace(wrong.solved.solution, cost=cost + above)
        return replace(wrong, solved=replace(wrong.solved, theta=theta + moved, solution=solution))

    inside, other, ruled_out = beside(0.5, 1.0), beside(5.0, 1.0), beside(9.0, 60.0)
    asked = []

    def walks(place, _answer, _along, _question, sides=None):
        asked.append((place.attempt, sides))
        at = float(place.attempt.solved.theta[length] - theta[length])
        made = _walks(unknowns, at, place.attempt.solved.solution.cost, at - 1.0, at + 1.0)
        return replace(made, ends={"D": tuple(Side(theta[length] + at + d, False) for d in (-1.0, 1.0))})

    question = SimpleNamespace(unknowns=unknowns, asked=DEFAULT_OPTIONS)
    allowed = SimpleNamespace(noise=noise_of(wrong))
    history = examined.History(optima=(inside, other, ruled_out))
    here = examined.Examined(wrong, None, None, SimpleNamespace(allowed=allowed), history)
    monkeypatch.setattr(examined, "_profile", walks)
    monkeypatch.setattr(examined, "_along", lambda *_: None)
    monkeypatch.setattr(examined, "_moved", lambda attempt, *_: replace(here, attempt=attempt))
    monkeypatch.setattr(examined, "_with_walk", lambda place, walked, _: replace(place, walked=walked))
    done = examined._walked(here, question, last=True)
    assert [(attempt is wrong, sides) for attempt, sides in asked] == [(True, None), (False, [(length, 1.0)])]
    assert asked[1][0] is other, "one is held, one the data rule out"
    assert [side.end - theta[length] for side in done.walked.ends["D"]] == pytest.approx([-1.0, 6.0])
