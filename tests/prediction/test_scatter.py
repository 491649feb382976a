"""Several records of one pair: what they scatter is carried into the answers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from identify import examples
from identify.cli.main import main
from identify.prediction.sources import pooled


def records(
    between: np.ndarray, own: np.ndarray, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    f = own.shape[0]
    truths = rng.multivariate_normal(np.zeros(f), between, count)
    estimates = truths + rng.multivariate_normal(np.zeros(f), own, count)
    return estimates, np.broadcast_to(own, (count, f, f))


def test_scatter_between_records_is_found():
    rng = np.random.default_rng(3)
    between, own = np.array([[4.0, 1.5], [1.5, 1.0]]), np.array([[0.5, -0.2], [-0.2, 0.4]])
    found = np.mean([pooled(*records(between, own, 40, rng)).between for _ in range(60)], axis=0)
    np.testing.assert_allclose(found, between, atol=0.25)


def test_intervals_hold_the_mean_and_one_more_record():
    rng = np.random.default_rng(4)
    between, own = np.diag([1.0, 0.3]), np.diag([0.2, 0.5])
    hits, further = [], []
    for _ in range(1500):
        found = pooled(*records(between, own, 6, rng))
        one_more = rng.multivariate_normal(np.zeros(2), between)
        hits.append(np.abs(found.mean) < 1.96 * np.sqrt(np.diag(found.of_mean)))
        further.append(np.abs(one_more - found.mean) < 1.96 * np.sqrt(np.diag(found.of_next)))
    assert np.all(np.mean(hits, axis=0) > 0.94) and np.mean(hits, axis=0)[0] < 0.98
    assert np.all(np.abs(np.mean(further, axis=0) - 0.93) < 0.02)  # as the room says of six records


def test_without_the_scatter_one_more_record_is_missed():
    """Negative control: the covariance of the mean is no interval for one more record."""
    rng = np.random.default_rng(5)
    held = []
    for _ in range(400):
        found = pooled(*records(np.eye(1), 0.05 * np.eye(1), 8, rng))
        held.append(abs(rng.standard_normal() - found.mean[0]) < 1.96 * np.sqrt(found.of_mean[0, 0]))
    assert np.mean(held) < 0.7


def result(value: float, error: float) -> dict[str, object]:
    names = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "a": 300.0, "D": 37.4e-6, "t_cr": 0.5}
    parameters = {
        name: {"value": v, "unit": "", "standard_error": 1e-3 * abs(v), "interval": None, "verdict": "identified"}
        for name, v in names.items()
    }
    parameters["mu_s"] |= {"value": value, "standard_error": error}
    from identify import Scene

    scene = Scene.from_toml(examples.SCENE).as_document()
    scene["logs"] = scene["logs"][2:3]
    log = {"sha256": "", "path": "x", "normal_force_N": 1.0, "drive_speed_m_per_s": 1e-3, "reason_left_out": None}
    return {
        "schema": 1,
        "status": "converged",
        "parameters": parameters,
        "correlation": {"names": list(names), "matrix": np.eye(6).tolist()},
        "logs": [log],
        "provenance": {"scene": scene},
    }


def test_several_results_on_the_command_line(tmp_path, capsys):
    paths = []
    for i, value in enumerate((0.61, 0.62, 0.63)):
        paths.append(tmp_path / f"{i}.json")
        paths[-1].write_text(json.dumps(result(value, 1e-3)))

    def drop(chosen):
        assert main(["amplitude", "--result", *map(str, chosen), "--json"]) == 0
        return json.loads(capsys.readouterr().out)["points"][0]["amplitude"]["drop"]

    alone, together = drop(paths[1:2]), drop(paths)
    assert together["value"] == pytest.approx(alone["value"], rel=1e-3)
    widths = [entry["interval"][1] - entry["interval"][0] for entry in (alone, together)]
    assert widths[1] > 10 * widths[0]
    other = result(0.62, 1e-3)
    other["correlation"] = {"names": ["mu_s"], "matrix": [[1.0]]}
    paths[0].write_text(json.dumps(other))
    assert main(["amplitude", "--result", *map(str, paths)]) == 2
    assert "do not tell the same parameters" in capsys.readouterr().err
