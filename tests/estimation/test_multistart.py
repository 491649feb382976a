"""Other optima: found from starts about an answer, counted in intervals, and taken where they are lower."""

from dataclasses import replace

import numpy as np
import pytest

from experiments import in_vivo
from identify.base.result import Status
from identify.estimation.attempt import solve_from
from identify.estimation.certainty import Question, certainty
from identify.estimation.covariance import information_at
from identify.estimation.multistart import multistart
from identify.logs.prepare import prepare
from identify.logs.scene_records import parted, with_records
from identify.logs.unknowns import from_scene
from identify.logs.vibration import tuned
from identify.shooting.accuracy import DEFAULT_OPTIONS


def _prepared(scene, records):
    unknowns = from_scene(scene)
    return tuned([prepare(scene, e, r, unknowns) for e, r in zip(scene.logs, records, strict=True)], unknowns)


VALLEY = {
    "mu_s": 1.02, "mu_k0": 0.649, "D": 2.28e-4, "t_cr": 17.6, "delta_mu_k": -0.138, "a": 331.0, "stiffness": 1366.0,
    "mass": 0.235, "damping": 147.0, "occlusion_level": -0.0656, "occlusion_time": 24.9, "skin_stiffness": 3360.0,
}  # fmt: skip


@pytest.mark.slow
def test_a_start_about_an_answer_ends_in_the_other_valley_which_intervals_hold():
    """An in-vivo twin at 50 Hz, and an answer whose contact ages on and on, which describes it nearly as well; as a
    negative control, an interval of that alone claims what is wrong."""
    made = in_vivo.twin(32)
    prepared, unknowns = _prepared(*parted(*with_records(made.scene(), made.records(50.0))))
    values = np.array([(made.truth | VALLEY).get(name, 1.0) for name in unknowns.names])
    start = np.where(unknowns.free, unknowns.theta(values, prepared[0].data.base), unknowns.start)
    wrong = solve_from(prepared, [0, 1], replace(unknowns, start=start))
    covariance = information_at(wrong.solved, unknowns).covariance()
    assert wrong.gate.status is Status.CONVERGED, "it passes the gate"

    def off(theta, name):
        i = unknowns.names.index(name)
        return abs((np.exp(theta[i]) if unknowns.logarithmic[i] else theta[i]) / made.truth[name] - 1.0)

    assert off(wrong.solved.theta, "t_cr") > 2.0
    thetas = [optimum.attempt.solved.theta for optimum in multistart(wrong, unknowns, 0, covariance)]
    assert any(all(off(theta, name) < 0.15 for name in ("mu_s", "mu_k0", "t_cr")) for theta in thetas)
    i, truth = unknowns.names.index("mu_k0"), made.truth["mu_k0"]
    alone = 1.96 * np.sqrt(covariance.diagonal())[np.flatnonzero(unknowns.free).tolist().index(i)]
    assert wrong.solved.theta[i] - alone > truth + 0.02
    question = Question(unknowns, wrong.fitted_logs[0].data.base, DEFAULT_OPTIONS, 0.0, 0, lambda *_: None)
    estimate = next(e for e in certainty(wrong, question).estimates if e.name == "mu_k0")
    assert estimate.verdict == "not identifiable" or estimate.lower < truth - 0.005 < estimate.upper
