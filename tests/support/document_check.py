"""Checks a result document against the promises of the interface; shared by the tests of fit and command line."""

from __future__ import annotations

import json
import math

import pytest
from jsonschema import Draft202012Validator

from identify.base.result import Result

UNITS = {"mu_s": "", "mu_k0": "", "delta_mu_k": "", "a": "s/m", "D": "m", "t_cr": "s"}
UNITS |= {"mass": "kg", "stiffness": "N/m", "damping": "N/m"}
LOGARITHMIC = {"a", "D", "t_cr", "mass", "stiffness", "damping"}


def validator() -> Draft202012Validator:
    """Of the schema of result.json."""
    return Draft202012Validator(Result.json_schema())


def check_document(result) -> dict:
    """Assert every rule; returns the document as strict JSON gives it back."""
    document = json.loads(json.dumps(result, allow_nan=False))
    assert document == json.loads(json.dumps(result)), "reading back changes it"
    validator().validate(document)
    converged = document["status"] == "converged"
    step = None
    if converged:
        step = document["parameters"]["mu_s"]["value"] - document["parameters"]["mu_k0"]["value"]
    for name, parameter in document["parameters"].items():
        _check_parameter(name, parameter, converged, step)
    if converged:
        _check_converged(document)
    elif document["parameters"]:
        assert document["last_iterate"].keys() >= document["parameters"].keys()
        for name, last in document["last_iterate"].items():
            assert last["unit"] == UNITS[name]
    timing = document["timing_s"]
    assert sum(v for k, v in timing.items() if k != "total") <= 1.01 * timing["total"] + 1e-3
    for log in document["logs"]:
        assert log["classical"]["rows"], "nobody leaves with nothing"
    return document


def _check_parameter(name, parameter, converged, step) -> None:
    assert parameter["unit"] == UNITS[name]
    value, error, (low, high) = parameter["value"], parameter["standard_error"], parameter["interval"]
    verdict = parameter["verdict"]
    if verdict == "fixed":
        assert (error, low, high) == (None, None, None)
        return
    if not converged:
        assert (value, error, low, high) == (None, None, None, None)
        return
    assert value is not None
    if verdict != "identified":
        assert parameter["reason"], "what test would tell it"
    if verdict == "not identifiable":
        assert error is None
        assert low is None or low < value
        assert high is None or high > value
        return
    assert error > 0
    assert low < value < high
    size = abs(step) if name == "delta_mu_k" else abs(value)
    within = max(value - low, high - value) <= 0.2 * size * (1 + 1e-9)
    assert (verdict == "identified") == within, f"{name}: {verdict} with {low} to {high}"
    if name in LOGARITHMIC:
        assert low > 0
        assert verdict == "identified" or (high <= 3 * value and low >= value / 3)


def _check_converged(document) -> None:
    gate = document["gate"]
    assert abs(gate["worst_cycle"]["z"]) < 6
    assert gate["event_shift_samples"] < 0.5
    names, matrix = document["correlation"]["names"], document["correlation"]["matrix"]
    assert set(names) == {n for n, p in document["parameters"].items() if p["verdict"] != "fixed"}
    for i, row in enumerate(matrix):
        assert row[i] is None or math.isclose(row[i], 1.0, rel_tol=1e-9)
        for j, entry in enumerate(row):
            assert entry == pytest.approx(matrix[j][i], abs=1e-9)
            assert entry is None or abs(entry) <= 1 + 1e-9
