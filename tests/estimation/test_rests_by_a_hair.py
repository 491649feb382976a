"""A slip that comes to rest only because its contact ages again has its end followed, and not put in closed form."""

import numpy as np
import pytest

from data_io import Record
from identify import Scene
from identify.base.outcome import Status
from identify.effects import MAIN
from identify.identification import find
from identify.model.model import assemble
from identify.shooting.following import SlideParts
from identify.simulation.simulate import run

MODEL = assemble(MAIN)
# Just above the speed at which stick-slip ends: four slips, the last of which hardly comes to rest, then sliding.
PAIR = {"mu_s": 0.85686, "mu_k0": 0.48028, "delta_mu_k": -0.020716, "a": 164.25, "D": 1.9896e-5, "t_cr": 0.042589}
RIG = {"mass": 0.12004, "stiffness": 832.23, "damping": 102.30}
SPEED, DURATION, RATE, NOISE = 0.02, 2.0, 2000.0, 5e-3
BELIEVED = 0.0442  # t_cr [s], before the fit


@pytest.fixture(scope="module")
def record() -> Record:
    time = np.arange(int(DURATION * RATE)) / RATE
    force = run(MODEL, PAIR | RIG, SPEED, 1.0, DURATION).sample(time)["force"]
    noise = NOISE * np.random.default_rng(3).standard_normal(time.size)
    return Record(time, np.ones(time.size), force + noise)


def searched(record, pair, rig, speed, start):
    """The findings with one parameter searched from a start, all others known."""
    parameters = {name: {"fixed": value} for name, value in pair.items()} | {n: {"start": v} for n, v in start.items()}
    logs = [{"path": "log.csv", "drive_speed": speed}]
    scene = Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": logs, "parameters": parameters})
    _, found = find(scene, [record], progress=lambda _stage, _share: None, starts="user")
    assert found.status is Status.CONVERGED and found.attempt is not None and found.covariance is not None
    return found


def off(record: Record) -> tuple[float, list[str]]:
    """By how many standard errors t_cr is off, the only one that is searched, and what ends each worn part."""
    found = searched(record, PAIR, RIG, SPEED, {"t_cr": BELIEVED})
    error = found.attempt.solved.theta[MODEL.parameter_names.index("t_cr")] - np.log(PAIR["t_cr"])
    modes = found.attempt.solved.trajectories[0].modes
    ends = [ended_by for kind, ended_by, _ in modes if kind == "worn"]
    return float(error / np.sqrt(found.covariance[0, 0])), ends


@pytest.mark.slow
def test_what_such_a_slip_tells_is_true(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    wrong, ends = off(record)
    assert abs(wrong) < 2.5
    assert ends[:4] == ["arrest", "arrest", "arrest", "release"]
    monkeypatch.setattr(SlideParts, "_rests_anyway", lambda _self, _with_weakening_priors: True)
    wrong, ends = off(record)
    assert ends[:4] == ["arrest"] * 4  # it is as brief as the others
    assert abs(wrong) > 5.0  # and the closed form starts from a rest that there is not
