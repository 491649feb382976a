"""The points of a profile: Newton's steps and the solver come to the same ones, the user's prior counted in both."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.study_problem import DEMO, RIG, SPEEDS, simulated_case
from identify import Scene
from identify.effects import MAIN
from identify.estimation import profile_line as profile_ground
from identify.estimation.agreement import noise_of
from identify.estimation.examined import information_at
from identify.estimation.profile_line import ProfileLine
from identify.estimation.search import SearchProblem, search
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene

LOGS = (2, 3)  # 1 and 5 mm/s: soon fitted
OFF = 2.0  # standard errors


@pytest.fixture(scope="module")
def fitted():
    """An answer with the mass known to 5 % and its standard errors by parameter."""
    records = [simulated_case(DEMO, 17).records[i] for i in LOGS]
    rig = RIG | {"mass": {"value": 0.21, "tolerance": 0.05}}
    logs = [{"path": f"log_{i}.csv", "drive_speed": SPEEDS[i][0]} for i in LOGS]
    scene = Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": logs})
    unknowns = from_scene(scene)
    prepared = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    attempt, _ = search(SearchProblem(prepared, unknowns))
    size = np.sqrt(np.diag(information_at(attempt, unknowns).covariance()))
    return attempt, unknowns, size


@pytest.fixture
def line(fitted):
    attempt, unknowns, size = fitted
    return ProfileLine.at(attempt.fitted_logs, attempt.solved, unknowns, size, noise_of(attempt))


def held(line, name, off):
    """Index of a parameter and its value so many standard errors off the answer."""
    index = line.unknowns.names.index(name)
    place = np.flatnonzero(line.unknowns.free).tolist().index(index)
    return index, float(line.best.theta[index] + off * line.ground.size[place])


@pytest.mark.parametrize("name", ["mu_k0", "D", "t_cr", "delta_mu_k", "a", "mass"])
@pytest.mark.parametrize("off", [-OFF, OFF])
def test_newtons_steps_and_the_solver_find_the_same_point(line, name, off):
    index, value = held(line, name, off)
    warm, cold = line._warm(line.best, index, value), line._from_theta(line.best, index, value)
    assert warm is not None and warm.home is not None
    assert cold is not None and cold.home is None
    assert warm.theta[index] == pytest.approx(value, rel=1e-9) and cold.theta[index] == value
    assert 2 * (warm.cost - line.best.cost) == pytest.approx(OFF**2, rel=0.3)
    assert warm.cost == pytest.approx(cold.cost, abs=2e-3)
    np.testing.assert_allclose(warm.theta[line.unknowns.free], cold.theta[line.unknowns.free], atol=0.02)


def test_a_prior_of_what_is_held_counts(line):
    index, value = held(line, "mass", OFF)
    mean, sd = line.unknowns.prior_mean[index], line.unknowns.prior_sd[index]
    with_it = line._from_theta(line.best, index, value)
    untold = replace(line.unknowns, prior_sd=np.full_like(line.unknowns.prior_sd, np.inf))
    without = replace(line, ground=replace(line.ground, unknowns=untold))._from_theta(line.best, index, value)
    prior = 0.5 * ((value - mean) / sd) ** 2
    assert prior > 0.1
    assert with_it.cost - without.cost == pytest.approx(prior, rel=1e-6)


def test_where_events_move_far_the_samples_are_assigned_anew(fitted, line, monkeypatch):
    index, value = held(line, "mu_k0", OFF)
    near = line._warm(line.best, index, value)
    monkeypatch.setattr(profile_ground, "MOVED", 1e-4)
    attempt, unknowns, size = fitted
    at = ProfileLine.at(attempt.fitted_logs, attempt.solved, unknowns, size, noise_of(attempt))
    moved = at._warm(at.best, index, value)
    assert near.home is line.best.home
    assert moved is not None and moved.home is not at.best.home
    # what the few samples that change their place add is all the difference
    assert moved.cost - at.best.cost == pytest.approx(near.cost - line.best.cost, rel=0.01)


def test_homes_are_let_go_and_made_anew(fitted, monkeypatch):
    monkeypatch.setattr(profile_ground, "MOVED", 1e-4)
    attempt, unknowns, size = fitted
    line = ProfileLine.at(attempt.fitted_logs, attempt.solved, unknowns, size, noise_of(attempt))
    index, value = held(line, "mu_k0", OFF)
    first = line._warm(line.best, index, value)
    for off in (-OFF, 0.5 * OFF, -0.5 * OFF):
        line._warm(line.best, *held(line, "mu_k0", off))
    assert first.home() is None and line.best.home() is not None
    again = line._warm(first, index, value)
    assert again.home() is not None and again.cost == pytest.approx(first.cost, abs=1e-3)


def test_where_newtons_steps_have_no_factors_the_solver_is_asked(fitted, monkeypatch):
    def singular(_matrix):
        raise RuntimeError("Factor is exactly singular")

    attempt, unknowns, size = fitted
    line = ProfileLine.at(attempt.fitted_logs, attempt.solved, unknowns, size, noise_of(attempt))
    index, value = held(line, "mu_k0", OFF)
    warm = line.best.home().warm
    monkeypatch.setattr("identify.shooting.warm.Factors", singular)
    assert warm.settle(line.best.z, held=(0, 2.0 * line.best.z[0])) is None
    without = ProfileLine.at(attempt.fitted_logs, attempt.solved, unknowns, size, noise_of(attempt))
    found = without.point(without.best, index, value)
    assert without.best.home is None and found is not None and found.home is None
    assert 2 * (found.cost - without.best.cost) == pytest.approx(OFF**2, rel=0.3)


def test_a_place_at_which_the_solver_finds_no_end_is_met_with_what_is_farthest_off_held(line, monkeypatch):
    index, value = held(line, "t_cr", OFF)
    place = line.point(line.best, index, value)
    solved, asked = type(line.ground).solved, []

    def without_end(ground, theta, trajectories, what):
        asked.append(what)
        return None if what == profile_ground.FREE else solved(ground, theta, trajectories, what)

    monkeypatch.setattr(type(line.ground), "solved", without_end)
    met = line.settled(place.theta, place.trajectories)
    assert asked[0] == profile_ground.FREE and len(asked) == 2
    assert met is not None and met.held == asked[1] and met.cost == pytest.approx(place.cost, abs=0.05)


def test_where_the_answer_does_not_settle_with_coarser_steps_than_its_own_the_walks_take_its_own(fitted, monkeypatch):
    attempt, unknowns, size = fitted
    own = profile_ground.STEPS + 4
    solved = replace(attempt.solved, grid=replace(attempt.solved.grid, steps=own))
    asked = []
    settle, free = profile_ground.Ground.home, profile_ground.Ground.solved

    def home(ground, theta, trajectories):
        asked.append(ground.grid.steps)
        return settle(ground, theta, trajectories) if ground.grid.steps == own else None

    def by_solver(ground, theta, trajectories, held):
        return free(ground, theta, trajectories, held) if ground.grid.steps == own else None

    coarse = ProfileLine.at(attempt.fitted_logs, solved, unknowns, size, noise_of(attempt))
    assert coarse.ground.grid.steps == profile_ground.STEPS and coarse.seen  # what settles coarsely is walked coarsely
    monkeypatch.setattr(profile_ground.Ground, "home", home)
    monkeypatch.setattr(profile_ground.Ground, "solved", by_solver)
    fine = ProfileLine.at(attempt.fitted_logs, solved, unknowns, size, noise_of(attempt))
    assert asked == [profile_ground.STEPS, own]
    assert fine.ground.grid.steps == own and fine.first is not None and fine.seen
    point = fine.point(fine.best, unknowns.names.index("a"), fine.best.theta[unknowns.names.index("a")] + 0.01)
    assert point is not None and np.isfinite(fine.loss_root(point))
