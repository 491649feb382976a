"""Parameters per group and per log, bounds and priors: recovered, counted, and with the right covariance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from identify.base.result import Status
from identify.effects import MAIN
from identify.scene import Scene
from identify.shooting.layout import kept_parameters
from tests.support import shooting_case as case
from tests.support.finding import find
from tests.support.two_logs import drawn

pytestmark = pytest.mark.usefixtures("no_predictions")

OTHER = case.PAIR | {"D": 60e-6, "mu_s": 0.66}
SPEEDS = ((1e-4, 10.0, 250.0), (1e-3, 1.6, 1000.0))
GROUPS = {"A": case.PAIR, "B": OTHER}


def _records(*pairs):
    return [
        drawn([speed], pair, seed=(number, i))[0] for number, pair in enumerate(pairs) for i, speed in enumerate(SPEEDS)
    ]


def _scene(parameters, groups="AB", **rig):
    logs = [
        {"path": f"{group}_{i}.csv", "drive_speed": speed[0], "labels": {"volunteer": group}}
        for group in groups
        for i, speed in enumerate(SPEEDS)
    ]
    rig = case.RIG | {"noise": case.NOISE} | rig
    return Scene.from_document({"effects": list(MAIN), "rig": rig, "parameters": parameters, "logs": logs}, Path())


def _found(parameters, groups="AB", **rig):
    records = _records(*(GROUPS[group] for group in groups))
    return find(_scene(parameters, groups, **rig), records)[1]


@pytest.fixture(scope="module")
def grouped():
    """D per volunteer, mu_s per log."""
    return _found({"D": {"per": "volunteer"}, "mu_s": {"per": "log"}})


@pytest.fixture(scope="module")
def free():
    """One pair, nothing said of its parameters."""
    return _found({}, "A")


def test_groups_are_recovered(grouped):
    assert grouped.status is Status.CONVERGED, grouped.message
    estimates = {e.name: e for e in grouped.estimates} | {e.name: e for _, e in grouped.sure.of_groups}
    truth = {"D": 37.4e-6, "D (B)": 60e-6, "mu_s": 0.62, "mu_s (log 2)": 0.62}
    truth |= {"mu_s (log 3)": 0.66, "mu_s (log 4)": 0.66}
    for name, value in truth.items():
        assert abs(estimates[name].value - value) < 4 * estimates[name].standard_error, name
    assert estimates["D (B)"].value / estimates["D"].value == pytest.approx(60 / 37.4, rel=0.15)
    apart = np.log(estimates["D (B)"].value / estimates["D"].value)
    assert apart > 5 * estimates["D"].standard_error / estimates["D"].value, "one value for all would not do"


def test_joint_covariance_agrees_with_the_dense_null_space(grouped):
    solved = grouped.attempt.solved
    problem, layout = solved.problem, solved.problem.layout
    point = problem.evaluate(solved.solution.z, derivatives=True)
    upper, jacobian = point.hessian.toarray(), point.jacobian.toarray()
    hessian = upper + np.triu(upper, 1).T
    _, _, right = np.linalg.svd(jacobian / np.linalg.norm(jacobian, axis=1)[:, None])
    null = right[layout.rows :].T
    kept = kept_parameters(layout)
    covariance = null[kept] @ np.linalg.solve(null.T @ hessian @ null, null[kept].T)
    covariance = covariance * np.outer(layout.scale[kept], layout.scale[kept])
    size = np.sqrt(np.diag(covariance))
    known = grouped.information.joint_covariance()
    assert known.shape == grouped.sure.allowed.joint.shape == (10, 10)
    np.testing.assert_allclose(known / np.outer(size, size), covariance / np.outer(size, size), atol=1e-3)
    across = covariance[2, 6:] / (size[2] * size[6:])
    assert np.max(np.abs(across)) > 0.05, "what is shared ties the groups together"


def test_a_prior_pulls_as_bayes_says(free):
    place = [free.unknowns.names[i] for i in np.flatnonzero(free.unknowns.free)].index("D")
    size = float(np.sqrt(free.sure.allowed.white[place, place]))
    mean = float(np.exp(free.attempt.solved.theta[free.unknowns.names.index("D")] + size))
    found = _found({"D": {"prior": {"mean": mean, "sd": mean * size}}}, "A")
    assert found.status is Status.CONVERGED
    theta = [f.attempt.solved.theta[f.unknowns.names.index("D")] for f in (free, found)]
    # Equal weights: half way between the data and the prior, and half the variance.
    assert theta[1] == pytest.approx(0.5 * (theta[0] + np.log(mean)), abs=0.1 * size)
    assert found.sure.allowed.white[place, place] == pytest.approx(0.5 * size**2, rel=0.1)
