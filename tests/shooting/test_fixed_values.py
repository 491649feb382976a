"""What a scene fixes stays fixed: no start moves it, whatever effect it is of."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from experiments.record_kinds import DEMO, FAST, RIG, SLOW, Kind
from identify.effects import ALL, MAIN
from identify.estimation.starts import starts_of
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.logs.vibration import tuned
from identify.scene import Scene

BY_NAME = {effect.name: effect for effect in ALL}
FITTED = [effect for effect in ALL if effect.name not in ("inertia", "friction_heterogeneity")]  # no fit has the last


def _composed(effect):
    """The main effects with this one, what it needs, and without its rival."""
    rivals = {name for name in MAIN if effect.role and BY_NAME[name].role == effect.role}
    return [name for name in (*MAIN, *effect.needs, effect.name) if name == effect.name or name not in rivals]


@pytest.fixture(scope="module")
def records():
    """One slow and one fast log of the main effects: starts need not fit to be right in this."""
    scene, records = Kind("", (SLOW, FAST), (SLOW, FAST), DEMO, RIG).made(1)
    return [{"path": str(log.path), "drive_speed": log.drive_speed} for log in scene.logs], records


@pytest.mark.parametrize("effect", FITTED, ids=lambda effect: effect.name)
def test_no_start_moves_what_a_scene_fixes(records, effect):
    entries, measured = records
    plain = {"effects": sorted(set(_composed(effect))), "rig": dict(RIG), "logs": entries}
    if effect.name == "power_law":
        plain["extrapolate"] = [effect.name]
    logs = []
    for parameter in effect.parameters:
        name = parameter.name
        if name in RIG:
            continue
        usual = parameter.default if np.isfinite(parameter.default) and parameter.default != 0.0 else 0.01
        value = float(np.clip(1.07 * usual, parameter.lower, parameter.upper))
        scene = Scene.from_document(plain | {"parameters": {name: {"fixed": value}}}, Path())
        unknowns = from_scene(scene)
        pairs = zip(scene.logs, measured, strict=True)
        logs = logs or [prepare(scene, entry, record, unknowns) for entry, record in pairs]  # whatever is fixed
        tuned_logs, unknowns = tuned(logs, unknowns)
        i = unknowns.names.index(name)
        assert not unknowns.free[i]
        starts = list(islice(starts_of(tuned_logs, unknowns), 2))
        assert starts
        for theta in (unknowns.start, *starts):
            for log in tuned_logs:
                told = unknowns.values(log.data.theta(theta), log.data.base)[i]
                assert told == pytest.approx(value, rel=1e-12), name
