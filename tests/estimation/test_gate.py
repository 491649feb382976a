"""The gate lets right answers through and each kind of wrong one not; every refusal says where and what to do."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from identify.base.result import Status
from identify.estimation.goodness_of_fit import inconsistency, outliers, pass_gate
from identify.model.model import SPEED
from identify.shooting.layout import COARSE_GRID
from identify.shooting.passes import solve_in_passes
from identify.shooting.shooting import Problem
from tests.support import shooting_case as case

NAMES = ("calm.csv", "brisk.csv")
EXACT = (False, False)


def _fit(change=lambda data: data, slip_times=lambda times: times):
    """Two noisy logs, changed, and the passes from the truth with these times of slips."""
    logs = [case.simulated(case.PAIR, *speed) for speed in (case.MIDDLE, case.FAST)]
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    data = change([case.log_data(log, unknowns, noise_seed=seed) for seed, log in enumerate(logs)])
    trajectories = case.placed(
        unknowns, logs, data, COARSE_GRID, slip_times=slip_times([log.slip_times for log in logs])
    )
    return solve_in_passes(data, trajectories, unknowns.with_weak_priors())


@pytest.fixture(scope="module")
def right():
    return _fit()


def _scaled(data, **factors):
    """The logs with their mass or the weights of their samples scaled."""
    base = data[0].base.copy()
    base[case.MODEL.parameter_names.index("mass")] *= factors.get("mass", 1.0)
    return [replace(d, base=base, weight=d.weight * factors.get("weight", 1.0)) for d in data]


def test_a_right_answer_passes(right):
    gate = pass_gate(right, NAMES, EXACT)
    assert gate.status is Status.CONVERGED
    assert abs(gate.chi2_per_sample - 1) < 5 * np.sqrt(2 / right.problem.samples)
    assert gate.z.size == 12
    assert np.max(np.abs(gate.z)) < 6
    assert gate.event_shift < 0.5
    assert (gate.log.tolist(), gate.cycle.tolist()) == ([1] * 6 + [2] * 6, [*range(1, 7)] * 2)


def test_misfit_of_a_cycle_is_that_of_its_samples(right):
    """Counted sample by sample: from arrest to arrest, what follows the last slip with the last cycle."""
    gate, problem = pass_gate(right, NAMES, EXACT), right.problem
    fitted = problem.fitted(right.solution.z)[0]
    log, trajectory = problem.logs[0], right.trajectories[0]
    edges = np.concatenate([[log.begin], trajectory.arrest[:-1], [log.end + 1e-9]])
    for i, (first, last) in enumerate(pairwise(edges)):
        mine = (log.time >= first) & (log.time < last)
        square = float(np.sum(((log.force - fitted)[mine] / case.NOISE) ** 2))
        count = int(np.count_nonzero(mine))
        # Samples are assigned at the event times of the pass before, up to a sample apart.
        assert gate.z[i] == pytest.approx((square - count) / np.sqrt(2 * count), abs=0.5)


@pytest.mark.parametrize(
    ("solver", "shift", "word"),
    [
        ({}, 0.6, "samples per pass"),
        ({"success": False, "return_status": "Maximum_Iterations_Exceeded"}, 0.0, "Maximum_Iterations"),
        ({"z": np.nan, "success": False, "return_status": "Invalid_Number_Detected"}, 0.0, "Invalid_Number"),
    ],
)
def test_a_curve_that_fits_is_not_enough(right, solver, shift, word):
    if "z" in solver:
        solver = solver | {"z": right.solution.z * np.nan}
    gate = pass_gate(replace(right, solution=replace(right.solution, **solver), event_shift=shift), NAMES, EXACT)
    assert gate.status is Status.SOLVER_FAILED and word in gate.message


def test_a_normal_force_moved_further_than_its_measurement_allows_is_refused():
    """The samples fit, and the load takes up what a wrong answer gets wrong from cycle to cycle."""
    solved = _fit(lambda data: [replace(d, normal_force_sd=1e-3) for d in data])
    assert pass_gate(solved, NAMES, EXACT).status is Status.CONVERGED
    for off in ([7.0, 0.0, 0.0, 0.0, 0.0, 0.0], [-4.0, -4.0, -3.0, 3.0, 4.0, 4.0]):
        strained = replace(solved.trajectories[0], deviation=1e-3 * np.array(off))
        gate = pass_gate(replace(solved, trajectories=[strained, solved.trajectories[1]]), NAMES, EXACT)
        assert gate.status is Status.MODEL_MISFIT
        assert "standard errors of its measured course" in gate.message


def test_a_wrong_mass_is_refused():
    wrong = _fit(lambda data: _scaled(data, mass=1.2))
    gate = pass_gate(wrong, NAMES, EXACT)
    assert gate.status is pass_gate(wrong, NAMES, (True, True)).status is Status.MODEL_MISFIT
    assert "brisk.csv" in gate.message
    assert gate.log[gate.worst] == 2


def test_a_wrong_noise_level_is_refused_unless_it_was_estimated_and_could_be_wrong_by_that(right):
    """3903 samples tell their variance to 2.3 %; five of these are allowed. Slips that hardly show count as noise while
    it is measured: what the curve leaves is less than that."""

    def status(weight, estimated):
        logs = [replace(log, weight=log.weight * weight) for log in right.problem.logs]
        problem = Problem(logs, right.problem.layout)
        return pass_gate(replace(right, problem=problem), NAMES, estimated).status

    assert status(1.03, EXACT) is Status.CONVERGED and status(1.3, EXACT) is Status.MODEL_MISFIT
    assert status(1.3, (True, True)) is Status.MODEL_MISFIT
    assert status(0.85, (True, True)) is Status.CONVERGED and status(0.85, EXACT) is Status.MODEL_MISFIT
    assert status(0.5, (True, True)) is Status.MODEL_MISFIT
    wrong = _fit(lambda data: _scaled(_scaled(data, mass=1.3), weight=0.85))
    assert pass_gate(wrong, NAMES, (True, True)).status is not Status.CONVERGED


def _dip(data):
    """A slip in the middle of a stick of the first log that nobody detected: gone after 30 ms."""
    shape = 0.2 * np.exp(-(((data[0].time - 1.18) / 0.01) ** 2))
    return [replace(data[0], force=data[0].force - shape), data[1]]


def test_one_bad_stretch_is_named():
    gate = pass_gate(_fit(_dip), NAMES, EXACT)
    assert gate.status is Status.WRONG_EVENT_COUNT
    assert "calm.csv, cycle 4" in gate.message and "exclude that stretch" in gate.message
    assert gate.z[gate.worst] > 30


@pytest.mark.parametrize("missed", [True, False], ids=["missed", "invented"])
def test_a_slip_missed_or_invented_is_refused(missed):
    def seen(slip_times):
        more = np.sort(np.append(slip_times[0], 0.5 * (slip_times[0][2] + slip_times[0][3])))
        return [np.delete(slip_times[0], 3) if missed else more, slip_times[1]]

    gate = pass_gate(_fit(slip_times=seen), NAMES, EXACT)
    assert gate.status in (Status.WRONG_EVENT_COUNT, Status.MODEL_MISFIT)
    assert "calm.csv" in gate.message
    assert abs(gate.cycle[gate.worst] - 4) <= 1


@pytest.mark.parametrize("phase", [4, 5], ids=["before", "after the wear"])
def test_a_slip_that_runs_backwards_is_named(right, phase) -> None:
    log, trajectory, unknowns = right.problem.logs[0], right.trajectories[0], right.problem.layout.unknowns
    nodes = trajectory.nodes.copy()
    nodes[trajectory.first[phase] + 3, SPEED] = -1e-4
    wrong = replace(trajectory, nodes=nodes)
    said = [inconsistency([log], [each], unknowns, right.theta, ["log"]) for each in (trajectory, wrong)]
    assert said[0] is None and "cycle 2: at this answer the slip reverses before it ends" in said[1]


def test_slips_that_misfit_are_not_hidden_by_long_rests(right):
    """Three tenths more variance in the slips alone: the record as a whole and every cycle are as noisy as they may."""

    def louder(data):
        out = []
        for log, trajectory in zip(data, right.trajectories, strict=True):
            slides = np.searchsorted(trajectory.onset, log.time) != np.searchsorted(trajectory.arrest, log.time)
            more = 0.55 * log.noise * np.random.default_rng(3).standard_normal(log.time.size)
            out.append(replace(log, force=log.force + np.where(slides, more, 0.0)))
        return out

    gate = pass_gate(_fit(louder), NAMES, EXACT)
    assert abs(gate.chi2_per_sample - 1) < 5 * np.sqrt(2 / right.problem.samples)
    assert np.max(np.abs(gate.z)) < 6
    assert gate.status is Status.MODEL_MISFIT
    assert "in its slips" in gate.message


ROSNER = (
    -0.25, 0.68, 0.94, 1.15, 1.20, 1.26, 1.26, 1.34, 1.38, 1.43, 1.49, 1.49, 1.55, 1.56, 1.58, 1.65, 1.69, 1.70, 1.76,
    1.77, 1.81, 1.91, 1.94, 1.96, 1.99, 2.06, 2.09, 2.10, 2.14, 2.15, 2.23, 2.24, 2.26, 2.35, 2.37, 2.40, 2.47, 2.54,
    2.62, 2.64, 2.90, 2.92, 2.92, 2.93, 3.21, 3.26, 3.30, 3.59, 3.68, 4.30, 4.64, 5.34, 5.42, 6.01,
)  # fmt: skip


def test_outliers_are_those_of_the_published_example_and_hide_each_other_in_vain():
    """NIST/SEMATECH e-Handbook of Statistical Methods, 1.3.5.17.3: three at the 5 % level."""
    assert set(outliers(np.array(ROSNER), 0.05)[0]) == {51, 52, 53}
    drawn = np.random.default_rng(7).standard_normal((1000, 40))
    assert 0.03 < np.mean([outliers(row, 0.05)[0].size > 0 for row in drawn]) < 0.075
    half = np.where(np.arange(40) < 16, 30.0 * (-1.0) ** np.arange(40), drawn[0])
    assert set(outliers(half, 1e-7)[0]) == set(range(16))
