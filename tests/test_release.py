"""A start from which solves wander off: passes that go no farther than they are trusted, priors released in steps."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from experiments.run_design_study import design, scene_of
from identify.base.outcome import Status
from identify.estimation.attempt import FIRST, SLOWLY, Clock, released, solve_from, solve_held, usable
from identify.estimation.starts import own_starts
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.shooting.passes import Trust, held_back

DESIGN = 144  # one log of short sticks, whose own starts are off in all six


@pytest.fixture(scope="module")
def wandering():
    made = design(DESIGN)
    scene = scene_of(made)
    unknowns = from_scene(scene)
    prepared = [prepare(scene, e, r, unknowns) for e, r in zip(scene.logs, made.records, strict=True)]
    starts = [replace(unknowns, start=theta) for theta in islice(own_starts(prepared, unknowns), 2)]
    truth = unknowns.theta(np.array([(made.truth | made.rig)[n] for n in unknowns.names]), unknowns.base(made.rig))
    short = [solve_from(prepared, usable(prepared), start, Clock(), trust=Trust()) for start in starts]
    return prepared, starts, truth, short


@pytest.mark.slow
def test_passes_that_go_no_farther_than_they_are_trusted_find_their_way_where_others_are_lost(wandering):
    prepared, starts, truth, short = wandering
    for found in short:
        assert found.gate.status is Status.CONVERGED
        assert abs(found.solved.theta[0] / truth[0] - 1.0) < 0.1
    assert np.ptp([found.solved.solution.cost for found in short]) < 0.5, "all ways lead to the same answer"
    at_once = [solve_from(prepared, usable(prepared), start, Clock()) for start in starts]
    assert not all(found.gate.status is Status.CONVERGED for found in at_once), "without it some are lost"


def test_trust_holds_parameters_and_events_and_tells_what_was_held_back(wandering):
    _, starts, _, (found, *_) = wandering
    problem = found.solved.problem
    held = Trust(0.1).held_to(problem, found.solved.guesses)
    layout, free = held.layout, problem.layout.free
    spread = starts[0].spread[free]
    np.testing.assert_allclose((layout.upper - layout.start)[: free.size], 0.1 * spread, rtol=1e-12)
    slip = float(np.median(found.solved.guesses[0].arrest - found.solved.guesses[0].onset))
    assert np.max((layout.upper - layout.start)[layout.events]) <= slip / 3 + 1e-12
    assert not held_back(held, layout.start)
    x = layout.start.copy()
    x[0] = layout.upper[0]
    assert held_back(held, x)
    assert Trust().less().reach < Trust().reach < Trust().after(easy=True).reach
    trust: Trust | None = Trust()
    for _ in range(10):
        trust = None if trust is None else trust.less()
    assert trust is None, "it does not go on for ever"


@pytest.mark.slow
def test_each_step_of_a_release_fits_better_and_the_priors_do_not_count_in_the_end(wandering):
    prepared, starts, _, (in_short_passes, *_) = wandering
    held = solve_from(prepared, usable(prepared), starts[0], Clock(), SLOWLY[0])
    assert held is not None and held.solved.solution.success
    softer = SLOWLY[1:6]
    steps = list(released(held, starts[0], softer))
    assert [f for f, _ in steps] == list(softer)
    costs = [held.solved.solution.cost, *(tried.solved.solution.cost for _, tried in steps)]
    assert np.all(np.diff(costs) < 0.0), "a softer prior costs less"
    slowly = solve_held(prepared, usable(prepared), starts[0], Clock(), FIRST)
    assert slowly.solved.solution.cost == pytest.approx(in_short_passes.solved.solution.cost, abs=0.5)
