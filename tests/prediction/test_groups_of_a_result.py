"""A fit whose parameters differ between groups: every answer asked of its result is that of the log's own group."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify import Scene, examples
from identify.base.result import Result
from identify.cli.operating import points_of
from identify.prediction.cycles import CLOSELY
from identify.prediction.predict import predictions
from identify.prediction.sources import pair_of
from tests.support.maps_case import settled_orbit

MU_K0 = 0.43  # of both groups, not estimated
SHARED = {"delta_mu_k": -0.13, "a": 300.0, "t_cr": 0.5}
OWN = {"A": {"mu_s": 0.62, "D": 37.4e-6}, "B": {"mu_s": 0.66, "D": 60e-6}}
KEYS = ("mu_s", "delta_mu_k", "a", "D", "t_cr", "mu_s (B)", "D (B)")
OF_PAIR = {"A": (0, 1, 2, 3, 4), "B": (5, 1, 2, 6, 4)}
LOGS = [(group, 5e-3) for group in OWN]
VALUE = np.array([0.62, -0.13, 300.0, 37.4e-6, 0.5, 0.66, 60e-6])
ERRORS = 2e-3 * np.abs(VALUE)
_MIX = np.random.default_rng(5).standard_normal((7, 7))
MATRIX = _MIX @ _MIX.T / np.sqrt(np.outer(np.diag(_MIX @ _MIX.T), np.diag(_MIX @ _MIX.T)))


def document():
    scene = Scene.from_toml(examples.SCENE).as_document()
    scene["parameters"] |= {name: {"per": "volunteer"} for name in OWN["A"]}
    scene["parameters"]["mu_k0"] = {"fixed": MU_K0}
    told = [{"path": f"{group}.csv", "labels": {"volunteer": group}} for group, _ in LOGS]
    scene["logs"] = [log | {"drive_speed": speed} for log, (_, speed) in zip(told, LOGS, strict=True)]
    at = {"sha256": "", "normal_force_N": 1.0, "reason_left_out": None}
    known = {"unit": "", "interval": None, "verdict": "identified"}
    parameters = {
        key: {"value": float(value), "standard_error": float(error), **known}
        for key, value, error in zip(KEYS, VALUE, ERRORS, strict=True)
    }
    for name in OWN["A"]:
        parameters[name] |= {"group": "A", "per": "volunteer"}
        parameters[f"{name} (B)"] |= {"group": "B", "per": "volunteer", "parameter": name}
    parameters["mu_k0"] = {**known, "value": MU_K0, "standard_error": None, "verdict": "fixed"}
    return {
        "schema": 1,
        "status": "converged",
        "parameters": parameters,
        "correlation": {"names": list(KEYS), "matrix": MATRIX.tolist()},
        "logs": [log | at | {"drive_speed_m_per_s": speed} for log, (_, speed) in zip(told, LOGS, strict=True)],
        "provenance": {"scene": scene},
    }


def drop_at(group, speed, changed=0.0):
    """The truth: drop [N] of a pair, each parameter of it moved by what `changed` (5,) says."""
    names = [KEYS[i].removesuffix(" (B)") for i in OF_PAIR[group]]
    moved = np.array([VALUE[i] for i in OF_PAIR[group]]) + changed
    scene = Scene.from_toml(examples.SCENE)
    values = scene.values() | dict(zip(names, moved.tolist(), strict=True))
    values["mu_k0"] = MU_K0
    w = np.array([*(values[name] for name in scene.model.parameter_names), 1.0, speed])
    batch, y = settled_orbit(scene.model, w)
    return batch.figures(y, CLOSELY)[0, 0]


def spread_of_drop(group, speed):
    """Its standard deviation by differences of the whole."""
    places = list(OF_PAIR[group])
    steps = 1e-4 * np.abs(VALUE[places])
    slopes = [
        (drop_at(group, speed, step * unit) - drop_at(group, speed, -step * unit)) / (2 * step)
        for step, unit in zip(steps, np.eye(5), strict=True)
    ]
    covariance = (MATRIX * np.outer(ERRORS, ERRORS))[np.ix_(places, places)]
    return float(np.sqrt(np.array(slopes) @ covariance @ np.array(slopes)))


def half_width(entry):
    return np.diff(entry.interval)[0] / (2 * 1.959964)


def test_each_log_is_answered_by_its_own_group_and_covariance():
    result = Result.from_dict(document())
    for (group, speed), point in zip(LOGS, points_of(Scene.from_document(result.scene), result), strict=True):
        (answer,) = predictions([replace(point.site, names=() if group == "A" else point.site.names)], 60)
        drop = answer.amplitude.numbers["drop"]
        assert point.groups == (("volunteer", group),)
        assert drop.value == pytest.approx(drop_at(group, speed), rel=1e-6)
    assert half_width(drop) == pytest.approx(spread_of_drop(group, speed), rel=0.2)  # ends of 60 draws


def pair(told, log):
    return pair_of(Result.from_dict(told), log)


def test_a_log_whose_group_has_no_values_is_not_answered_by_another():
    told = document()
    told["logs"][1]["labels"] = {"volunteer": "C"}
    assert not pair(told, 0).refusal
    assert "has mu_s of A, B only, and this log is of C" in pair(told, 1).refusal


def test_a_parameter_of_every_log_goes_by_the_number_of_the_log():
    told = document()
    for key, entry in told["parameters"].items():
        if entry.get("per"):
            entry |= {"per": "log", "group": "log 2" if key.endswith("(B)") else "log 1"}
    assert pair(told, 1).values["D"] == 60e-6 and pair(told, 0).values["mu_k0"] == pytest.approx(0.43)
    told["parameters"]["D"]["group"] = told["parameters"]["mu_s"]["group"] = "log 3"
    assert "this log is of log 1" in pair(told, 0).refusal


def test_what_is_not_identifiable_has_an_infinite_variance():
    told = document()
    told["parameters"]["t_cr"]["standard_error"] = None
    found = pair(told, 0)
    place = found.names.index("t_cr")
    assert np.isinf(found.covariance[place, place]) and np.isfinite(found.covariance).sum() == found.covariance.size - 1
