"""Where data do not tell a parameter, the motion is placed anew at the ends of the ridge, and with the other sign.

The pair is one of the recovery study: the logs at three speeds stick-slip, the fastest goes over to sliding. From
a = 10 s/m the way to sliding takes another course than at the true 61 s/m; chi^2 is larger by 50, which no cycle shows.
"""

from dataclasses import replace

import numpy as np
import pytest

from data_io import Record
from experiments import run_design_study
from experiments.run_recovery_study import Study
from experiments.study_problem import NAMES, RIG, scene_of
from identify.base.outcome import Status
from identify.estimation.agreement import noise_of
from identify.estimation.attempt import Clock, solve_from, usable
from identify.estimation.ridge_ends import _stronger, better_course, other_sign, strengthened
from identify.logs.parting import parted
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run

WRONG = {"mu_s": 0.353698, "mu_k0": 0.29213, "D": 9.9315e-06, "t_cr": 0.058197, "delta_mu_k": -0.235745, "a": 10.086}


@pytest.fixture(scope="module")
def pair():
    case, *_ = Study("wide").case(92)
    scene, records = parted(scene_of(case, None), case.records)
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    known = case.truth | case.rig

    def answer(values):
        theta = unknowns.theta(np.array([(known | values)[n] for n in unknowns.names]), unknowns.base(case.rig))
        return solve_from(logs, usable(logs), replace(unknowns, start=theta), Clock())

    return unknowns, case.truth, answer


def _along(unknowns, factor):
    """Points at which a is so many times larger and smaller, and its slope at rest the same."""
    names = [n for n, free in zip(unknowns.names, unknowns.free, strict=True) if free]
    away = np.zeros((2, len(names)))
    away[:, names.index("a")] = np.log(factor), -np.log(factor)
    away[:, names.index("delta_mu_k")] = WRONG["delta_mu_k"] * (1 / factor - 1), WRONG["delta_mu_k"] * (factor - 1)
    return away


@pytest.mark.slow
def test_a_better_course_is_found_from_the_ends_of_the_ridge(pair, monkeypatch):
    unknowns, truth, answer = pair
    neighbour, right = answer(WRONG), answer({})
    assert abs(2 * (neighbour.solved.solution.cost - right.solved.solution.cost)) < 1  # a hair away, it is met at once
    monkeypatch.setattr("identify.estimation.attempt.by_a_hair", lambda *_: [])
    stuck = answer(WRONG)
    assert stuck.gate.status is Status.CONVERGED  # nothing else tells
    assert 2 * (stuck.solved.solution.cost - right.solved.solution.cost) > 40
    found = better_course(stuck, unknowns, _along(unknowns, 2.0))
    assert found is not None
    assert found.logs == stuck.logs
    assert abs(2 * (found.solved.solution.cost - right.solved.solution.cost)) < 1
    a = np.exp(found.solved.theta[unknowns.names.index("a")])
    assert abs(a / truth["a"] - 1) < 0.25
    assert better_course(right, unknowns, np.zeros((1, 6))) is None  # it stays where it is best


ONE_SPEED = {"mu_s": 0.9056, "mu_k0": 0.7467, "delta_mu_k": -0.1367, "a": 947.5, "D": 2.623e-05, "t_cr": 2.578}
RISING = {"mu_s": 0.8858, "mu_k0": 0.5961, "delta_mu_k": 0.1032, "a": 15.2, "D": 1.833e-05, "t_cr": 1.331}


def test_friction_that_rises_is_tried_with_friction_that_falls():
    """Five slips of one speed: an answer whose friction rises fits within the noise, 18 in chi^2 above the true one."""
    times = np.arange(10001) / 500.0
    force = run(assemble(tuple(NAMES)), ONE_SPEED | RIG, 1e-4, 1.0, 20.0, accuracy=1e-7).sample(times)["force"]
    record = Record(
        times, np.ones(times.size), force + 5e-3 * np.random.default_rng(1468660268).standard_normal(times.size)
    )
    logs = [{"path": "log.csv", "drive_speed": 1e-4}]
    scene = Scene.from_document({"effects": [*NAMES], "rig": dict(RIG), "logs": logs})
    unknowns = from_scene(scene)
    prepared = [prepare(scene, scene.logs[0], record, unknowns)]

    def answer(values):
        theta = unknowns.theta(np.array([(values | RIG)[n] for n in unknowns.names]), unknowns.base(RIG))
        return solve_from(prepared, [0], replace(unknowns, start=theta), Clock())

    rising, right = answer(RISING), answer(ONE_SPEED)
    delta = unknowns.names.index("delta_mu_k")
    assert rising.gate.status is Status.CONVERGED and rising.solved.theta[delta] > 0.0  # nothing else tells
    assert 2 * (rising.solved.solution.cost - right.solved.solution.cost) > 15
    found = other_sign(rising, unknowns)
    assert found is not None and found.solved.theta[delta] < 0.0
    assert abs(2 * (found.solved.solution.cost - right.solved.solution.cost)) < 1
    assert other_sign(right, unknowns) is None


WEAKENING = {"mu_s": 0.47084, "mu_k0": 0.48411, "delta_mu_k": -0.339895, "a": 218.157, "D": 1.3183e-05, "t_cr": 959.3}
# Which valley a solve from there ends in hangs on its last digits, and so on the processor: starts beside each other.
BESIDE = (0.0, 1e-6, 1e-4, 1e-5, -1e-5, 2e-4, -2e-4, 3e-4)


@pytest.mark.slow
def test_a_contact_that_weakens_at_rest_is_tried_with_one_that_strengthens():
    """Slips of six samples. Settled, which takes the search more than one start, an answer whose static friction is
    below its kinetic one is 48 in chi^2 above the right one, passes the gate and calls mu_k0 = 0.4841 identified."""
    made = run_design_study.design(68)
    scene = run_design_study.scene_of(made)
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, made.records, strict=True)]

    def settle(theta):
        return solve_from(logs, usable(logs), replace(unknowns, start=theta), Clock())

    def answer(values):
        return settle(
            unknowns.theta(np.array([(values | made.rig)[n] for n in unknowns.names]), unknowns.base(made.rig))
        )

    right = answer(made.truth)
    starts = (WEAKENING | {name: WEAKENING[name] * (1.0 + by) for name in ("mu_s", "a")} for by in BESIDE)
    settled = (attempt for attempt in map(answer, starts) if attempt.gate.status is Status.CONVERGED)
    weakening = next(settled)
    mu_s, mu_k0 = (unknowns.names.index(name) for name in ("mu_s", "mu_k0"))
    wrong = weakening.solved.theta
    assert wrong[mu_s] < wrong[mu_k0] and weakening.gate.chi2_per_sample < 1.03
    assert 2 * (weakening.solved.solution.cost - right.solved.solution.cost) > 40
    found = strengthened(weakening, unknowns, noise_of(weakening))
    assert found is not None and abs(found.solved.theta[mu_s] - made.truth["mu_s"]) < 0.005
    assert found.solved.theta[mu_s] > found.solved.theta[mu_k0]
    assert found.solved.problem.samples == weakening.solved.problem.samples
    anew = settle(found.solved.theta)
    assert anew.solved.problem.samples == right.solved.problem.samples
    assert abs(2 * (anew.solved.solution.cost - right.solved.solution.cost)) < 1
    assert strengthened(right, unknowns, noise_of(right)) is None
    fixed = np.array([name == "t_cr" for name in unknowns.names])
    held = replace(unknowns, free=unknowns.free & ~fixed, start=np.where(fixed, wrong, unknowns.start))
    assert list(_stronger(weakening, unknowns)) and not list(_stronger(weakening, held)), "they move t_cr"
