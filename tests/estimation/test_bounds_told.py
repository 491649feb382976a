"""A parameter at a bound: whose bound it is decides what to do."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.record_kinds import Kind, Log
from experiments.study_problem import DEMO
from experiments.study_problem import RIG as TRUE_RIG
from identify.base.outcome import Status
from identify.effects import MAIN
from identify.estimation import starts
from identify.estimation.status_words import at_bounds, underivable
from identify.estimation.strategies import Strategy, tracing
from identify.identification import fit
from identify.logs.unknowns import from_scene
from identify.scene import Scene

pytestmark = pytest.mark.usefixtures("no_further_logs")

RIG = {"mass": {"value": 0.2, "tolerance": 0.02}, "stiffness": 1470.0, "damping": 147.0}


def _told(name, side, parameters, more=()):
    logs = [{"path": "log.csv", "drive_speed": 1e-3}]
    document = {"effects": [*MAIN, *more], "rig": RIG, "logs": logs, "parameters": parameters}
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
    assert "fix t_cr" in said and "add a log that tells it" in said and "effects" not in said


def test_an_effect_too_many_can_be_taken_out():
    said = _told("lag_time", 0, {}, ("sensor_lag",))
    assert "fix lag_time in [parameters], take sensor_lag out of the effects, or add a log" in said


def test_a_rig_quantity_far_from_what_is_stated_is_to_be_checked():
    said = _told("mass", 1, {})
    assert "a factor of three from what [rig] states" in said and "check it" in said and "widen" not in said


def test_an_answer_without_derivatives_names_a_misfit_only_where_there_is_one():
    def said(chi2):
        return underivable(SimpleNamespace(gate=SimpleNamespace(chi2_per_sample=chi2)))

    assert "(misfit 3.5 times the noise variance)" in said(3.5)
    assert "nan" not in said(np.nan) and "drive speed and when it changes" in said(np.nan)


def test_a_log_that_no_start_reproduces_is_not_said_to_stick_and_slip_where_it_slides(monkeypatch):
    """Speed steps so fast that the friction changes no more: a level, and nothing that tells where it was reached."""
    stated = ((0.0, 5e-2), (2.0, 1e-1), (5.0, 2e-1))
    log = Log(((0.0, 5e-2), (5.0, 1e-1), (8.0, 2e-1)), 12.0, 2000.0, begins=3.0, said=stated)
    monkeypatch.setattr(starts, "RANDOM", ())
    with tracing((Strategy.FURTHER_STARTS, Strategy.CAUSES)):  # the first start ends as all others do
        result = fit(*Kind("fast", (log,), (), DEMO, TRUE_RIG).made(0)).result
    assert result["status"] == Status.MODEL_MISFIT.value and "stick-slip" not in result["message"]
    assert "take a window of one speed" in result["message"]
