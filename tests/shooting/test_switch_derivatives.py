"""Derivatives through every switch, against differences of the independent integrator."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy.sparse.linalg as sla

from identify.estimation.influence import sample_moves
from identify.shooting import blocks
from identify.shooting.layout import KNOWN, Grid
from identify.shooting.shooting import shooting_problem
from tests.support import oracle
from tests.support import shooting_case as case

# Fine enough that the steps of the shooting err by far less than what is claimed.
GRID = Grid(slip=64, renewed=64, steps=8)
ON_TIME = 2e-9  # s
KINDS = {"onsets": "onset", "wear_times": "wear", "arrests": "arrest"}
EVENTS_MOVE = 1e-5  # s, in a difference: a slip begins within milliseconds
SLOW, FAST = (1e-4, 9.0, 100.0), (5e-3, 0.35, 500.0)  # drive speed [m/s], duration [s], rate [Hz]
CLAIMED = 1e-6  # of the largest derivative
# A slip that wears the contact off is drawn to rest as if the contact did not age again just before, and what follows
# starts from where it does rest. Where that moment is long, the arrest and the samples in it are a little beside it.
MOMENT, IN_MOMENT, OF_ARREST = 2e-3, 1e-4, 2e-5
# Pair, log, whether slips wear the contact off, and what is claimed of arrests and of samples in that moment.
CASES = {
    "renewed in each slip": (case.PAIR, SLOW, True, CLAIMED, CLAIMED),
    "never renewed": (case.PAIR | {"D": 200e-6}, SLOW, False, CLAIMED, CLAIMED),
    "fast, ageing slowly": (case.PAIR | {"t_cr": 4.0}, FAST, True, CLAIMED, CLAIMED),
    "fast, ageing again before arrest": (case.PAIR, FAST, True, CLAIMED, CLAIMED),
    "fast, ageing fast before arrest": (
        case.PAIR | {"D": 18e-6, "t_cr": 0.067, "a": 50.0},
        FAST,
        True,
        OF_ARREST,
        IN_MOMENT,
    ),
}


def _solved(pair, log):
    """The motion of the pair from rest, unloaded, fresh: problem, x (n,), and indices of what follows from theta."""
    unknowns = case.search_space(pair, case.FRICTION)
    logs = [case.simulated(pair, *log)]
    data = [case.log_data(log, unknowns) for log in logs]
    trajectories = case.placed(unknowns, logs, data, GRID)
    for _ in range(2):  # the second time about the event times found, so that every sample lies in its own cell
        problem = shooting_problem(data, trajectories, unknowns, GRID)
        layout, place = problem.layout, problem.layout.places[0]
        begin = place.start[place.start != KNOWN]
        follows = np.setdiff1d(np.arange(layout.free.size, layout.size), begin)
        assert follows.size == layout.rows, "what is left is determined"
        x = layout.start.copy()
        x[begin] = 0.0
        for _ in range(8):
            point = problem.evaluate(x / layout.scale, derivatives=True)
            step = sla.spsolve(point.jacobian[:, follows].tocsc(), -point.rows)
            x[follows] += step * layout.scale[follows]
        assert np.max(np.abs(problem.evaluate(x / layout.scale, derivatives=False).rows)) < 1e-11
        trajectories = [place.read(trajectories[0], x)]
    return problem, x, follows, trajectories[0]


@cache
def _solved_once(kind):
    return _solved(*CASES[kind][:2])


def _moved(problem, x, follows):
    """d x / d theta (n, 6) of the motion from a given start, by the rows alone."""
    layout = problem.layout
    jacobian = problem.evaluate(x / layout.scale, derivatives=True).jacobian
    direct = jacobian[:, :6].toarray() / layout.scale[:6]
    out = np.zeros((layout.size, 6))
    out[:6] = np.eye(6)
    out[follows] = layout.scale[follows][:, None] * sla.splu(jacobian[:, follows].tocsc()).solve(-direct)
    return out


def _differences(unknowns, index, log, wanted, h):
    """Five-point differences of what is wanted of the integrator's motion, with respect to theta[index]."""
    base, ends = unknowns.base(case.RIG), []
    for step in (-2, -1, 1, 2):
        theta = unknowns.start.copy()
        theta[index] += step * h
        at = dict(zip(unknowns.names, unknowns.values(theta, base).tolist(), strict=True))
        ends.append(wanted(oracle.simulate(at, log[0], case.LOAD, log[1])))
    return (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * h)


KIND = [pytest.param(k, marks=[pytest.mark.slow] * (k == "never renewed")) for k in CASES]  # the longest


@pytest.mark.parametrize("kind", KIND)
def test_derivatives_through_every_switch_are_those_of_the_integrator(kind):
    pair, log, renewed, of_arrests, in_moment = CASES[kind]
    problem, x, follows, trajectory = _solved_once(kind)
    moved = _moved(problem, x, follows)
    layout, place = problem.layout, problem.layout.places[0]
    data = problem.logs[0]
    inside = data.time <= data.end
    slopes = sample_moves(problem, x / layout.scale, moved)[0] / data.weight[:, None]
    switches = {name: place.until[trajectory.ending(end)] for name, end in KINDS.items()}
    assert switches["onsets"].size >= 2
    assert bool(switches["wear_times"].size) == renewed
    count = sum(which.size for which in switches.values())

    def wanted(truth):
        counted = [getattr(truth, name)[: which.size] for name, which in switches.items()]
        return np.concatenate([*counted, truth.force(data.time)[inside]])

    arrests = oracle.simulate(pair | case.RIG, log[0], case.LOAD, log[1]).arrests
    for column, index in enumerate(layout.free.tolist()):
        times = moved[np.concatenate(list(switches.values())), column]
        step = EVENTS_MOVE / np.max(np.abs(times))
        expected = _differences(layout.unknowns, index, log, wanted, step)
        found = np.concatenate([times, slopes[inside, column]])
        first, times_at = count - switches["arrests"].size, data.time[inside]
        brief = np.any([(times_at > end - MOMENT) & (times_at < end + MOMENT) for end in arrests], axis=0)
        parts = [(np.arange(first), CLAIMED), (np.arange(first, count), of_arrests)]
        parts += [(count + np.flatnonzero(~brief), CLAIMED), (count + np.flatnonzero(brief), in_moment)]
        for part, claimed in parts:
            size = np.max(np.abs(expected[:count] if np.all(part < count) else expected[count:]))
            np.testing.assert_allclose(found[part], expected[part], rtol=0, atol=claimed * size)
        # Forces at a given time depend on when the switches before it were: that part alone is far larger.
        held = slopes[inside, column] * (data.time[inside] < problem.logs[0].time[0] + 1e-9)
        assert np.max(np.abs(held - expected[count:])) > 1e-2 * np.max(np.abs(expected[count:]))


@pytest.mark.parametrize("kind", KIND)
def test_the_motion_is_that_of_the_integrator(kind, monkeypatch):
    pair, log, *_ = CASES[kind]
    truth = oracle.simulate(pair | case.RIG, log[0], case.LOAD, log[1])

    def late(trajectory):
        found = trajectory.onset
        return float(np.max(np.abs(found - truth.onsets[: found.size])))

    assert late(_solved_once(kind)[3]) < ON_TIME
    if kind == "fast, ageing fast before arrest":  # without that moment every slip comes too late
        monkeypatch.setattr(blocks.AgeingBlock, "FASTEST", 1e-9)
        blocks.block.cache_clear()
        assert late(_solved(pair, log)[3]) > 1e3 * ON_TIME
        blocks.block.cache_clear()
