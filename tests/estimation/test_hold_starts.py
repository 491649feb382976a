"""A drive programme with holds tells strength and ageing apart from the start, which cycles of one speed do not."""

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import NOISE, RIG
from identify import Scene
from identify.effects import MAIN
from identify.estimation import search
from identify.estimation.starts import starts_of
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.simulation.simulate import run

AGES = {"mu_s": 0.8, "mu_k0": 0.53, "delta_mu_k": -0.08, "a": 220.0, "D": 25e-6, "t_cr": 1.5}
HOLDS = ((0.0, 3e-3), (0.3, 0.0), (1.3, 3e-3), (1.55, 0.0), (4.55, 3e-3), (4.8, 0.0), (14.8, 3e-3))


@pytest.fixture(scope="module")
def logs():
    """Holds of 1, 3 and 10 s, and two seconds of cycles at 3 mm/s: each rests for a tenth of t_cr."""
    drives, random = ((HOLDS, 15.05), (3e-3, 2.0)), np.random.default_rng(1)
    entries = [{"path": f"{i}.csv", "drive_speed": [list(s) for s in HOLDS] if i == 1 else 3e-3} for i in (1, 2)]
    scene = Scene.from_document({"effects": [*MAIN, "varying_normal_force"], "rig": RIG, "logs": entries})
    unknowns, out = from_scene(scene), []
    for entry, (drive, duration) in zip(scene.logs, drives, strict=True):
        times = np.arange(round(500.0 * duration)) / 500.0
        force = run(assemble(MAIN), AGES | RIG, drive, 1.0, duration).sample(times)["force"]
        record = Record(times, np.ones(times.size), force + NOISE * random.standard_normal(times.size))
        out.append(prepare(scene, entry, record, unknowns))
    return out, unknowns


def _start(logs, unknowns):
    values = unknowns.values(next(starts_of(logs, unknowns)), logs[0].data.base).tolist()
    return dict(zip(unknowns.names, values, strict=True))


def test_holds_tell_strength_and_ageing_apart_from_the_start(logs):
    prepared, unknowns = logs
    start, alone = _start(prepared, unknowns), _start(prepared[1:], unknowns)
    assert start["mu_s"] == pytest.approx(AGES["mu_s"], rel=0.03)
    assert start["t_cr"] == pytest.approx(AGES["t_cr"], rel=0.1)
    assert alone["t_cr"] < 0.3 * AGES["t_cr"], "cycles of one speed do not"


def test_both_are_solved_together_from_there(logs):
    prepared, unknowns = logs
    found, left_out = search.search(search.SearchProblem(prepared, unknowns))
    assert found.log_numbers == (0, 1) and not left_out
    values = dict(zip(unknowns.names, unknowns.values(found.solved.theta, prepared[0].data.base).tolist(), strict=True))
    assert values["t_cr"] == pytest.approx(AGES["t_cr"], rel=0.02)
