"""A parameter at a bound: whose bound it is decides what to do."""

from pathlib import Path

import numpy as np
import pytest

from identify.effects import MAIN
from identify.preparation.unknowns import from_scene
from identify.scene import Scene
from identify.search.status_words import at_bounds

RIG = {"mass": {"value": 0.2, "tolerance": 0.02}, "stiffness": 1470.0, "damping": 147.0}


def _told(name, side, parameters):
    logs = [{"path": "log.csv", "drive_speed": 1e-3}]
    document = {"effects": list(MAIN), "rig": RIG, "logs": logs, "parameters": parameters}
    unknowns = from_scene(Scene.from_document(document, Path()))
    theta, i = unknowns.start.copy(), unknowns.names.index(name)
    assert not at_bounds(unknowns, theta)
    theta[i] = (unknowns.lower, unknowns.upper)[side][i]
    assert np.isfinite(theta[i])
    told = at_bounds(unknowns, theta)
    assert list(told) == [name]
    return told[name]


@pytest.mark.parametrize(("side", "bound"), [(0, "lower"), (1, "upper")])
def test_the_scenes_own_bound_can_be_widened(side, bound):
    said = _told("t_cr", side, {"t_cr": {"lower": 0.1, "upper": 2.0}})
    assert said == f"t_cr sits at its {bound} bound; widen it in [parameters], or fix t_cr"


@pytest.mark.parametrize(("side", "end", "other"), [(0, "lower", {"upper": 2.0}), (1, "upper", {"lower": 0.1})])
def test_the_models_bound_can_not_and_says_that_the_logs_do_not_tell(side, end, other):
    said = _told("t_cr", side, {"t_cr": other})
    assert f"{end} end of what the model admits: these logs do not tell it" in said and "widen" not in said
    assert "fix t_cr" in said and "add a log that tells it" in said


def test_a_rig_quantity_far_from_what_is_stated_is_to_be_checked():
    said = _told("mass", 1, {})
    assert "a factor of three from what [rig] states" in said and "check it" in said and "widen" not in said
