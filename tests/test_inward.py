"""An answer at a bound of the model that the data do not ask for is taken inside; one that they ask for stays."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.record_kinds import DEMO, FAST, RIG, SLOW, Kind, Log
from identify.base.outcome import Status
from identify.estimation.agreement import noise_of
from identify.estimation.attempt import Attempt, resolve
from identify.estimation.ridge_ends import at_own_bounds, taken_inside
from identify.estimation.search import search
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene

SLOWER = Log(1e-4, 20.0, 500.0)
SOON = float(np.log(1e-2))  # of t_cr [s]


def _answer(*logs):
    scene, records = Kind("", logs, logs, DEMO, RIG).made(1)
    unknowns = from_scene(scene)
    prepared = [prepare(scene, e, r, unknowns) for e, r in zip(scene.logs, records, strict=True)]
    found, _ = search(prepared, unknowns)
    assert found is not None and found.gate.status is Status.CONVERGED
    return found, unknowns


@pytest.fixture(scope="module")
def slow():
    """Sticks of seconds: the contact saturates whatever t_cr is."""
    return _answer(SLOWER)


def _from(unknowns, i, bound):
    """The search space with another lower bound of one parameter, which the model gives."""
    return replace(unknowns, lower=np.where(np.arange(unknowns.lower.size) == i, bound, unknowns.lower))


def _held_at(found: Attempt, unknowns, name: str, value: float) -> Attempt:
    """The answer with a parameter held at a value, as if the search had ended there."""
    i = unknowns.names.index(name)
    start, free = found.solved.theta.copy(), unknowns.free.copy()
    start[i], free[i] = value, False
    return resolve(found, replace(unknowns, start=start, free=free))


def test_an_answer_at_a_bound_that_the_data_do_not_ask_for_is_taken_inside(slow):
    found, unknowns = slow
    i = unknowns.names.index("t_cr")
    unknowns = _from(unknowns, i, SOON)
    at = _held_at(found, unknowns, "t_cr", SOON)
    assert at.gate.status is Status.CONVERGED and at_own_bounds(unknowns, at.solved.theta)[i]
    inside = taken_inside(at, unknowns, noise_of(at))
    assert inside is not None and inside.gate.status is Status.CONVERGED
    assert not np.any(at_own_bounds(unknowns, inside.solved.theta))
    assert inside.solved.solution.cost < at.solved.solution.cost + 8.0
    assert taken_inside(inside, unknowns, noise_of(inside)) is None, "it is inside already"


def test_an_answer_at_a_bound_of_the_scene_stays(slow):
    found, unknowns = slow
    i = unknowns.names.index("t_cr")
    walled = _from(unknowns, i, SOON)
    walled = replace(walled, given=np.stack([np.arange(walled.lower.size) == i, np.zeros(walled.lower.size, bool)]))
    at = _held_at(found, walled, "t_cr", SOON)
    assert at.gate.status is Status.CONVERGED
    assert taken_inside(at, walled, noise_of(at)) is None


def test_an_answer_at_a_bound_that_the_data_ask_for_stays():
    found, unknowns = _answer(SLOW, FAST)
    i = unknowns.names.index("mu_s")
    bound = float(found.solved.theta[i]) + 0.003  # the data want less
    at = _held_at(found, _from(unknowns, i, bound), "mu_s", bound)
    assert at.solved.solution.success
    assert taken_inside(at, _from(unknowns, i, bound), noise_of(at)) is None
