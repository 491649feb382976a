"""Logs without noise, on uneven rows, or with a clock in single precision give the numbers they were made of."""

from pathlib import Path

import pytest

from identify.identification import fit
from identify.scene import Scene

pytestmark = pytest.mark.usefixtures("no_predictions")

CASES = Path(__file__).parents[1] / "cases"
TRUTH = {"mu_s": 0.62, "mu_k0": 0.40, "delta_mu_k": -0.12, "a": 250.0, "D": 60e-6, "t_cr": 0.4}


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("noise_free_stated", "thinned")]


@pytest.mark.parametrize("name", ["noise_free", "pair_f32", *SLOW])
def test_the_truth_is_found(name):
    result = fit(Scene.from_toml(CASES / f"{name}.toml")).result
    assert result["status"] == "converged", result["message"]
    for parameter, true in TRUTH.items():
        found = result["parameters"][parameter]
        off = abs(found["value"] - true)
        assert off < 3.0 * found["standard_error"] or off < 1e-4 * abs(true), parameter
    assert ("have no noise" in result["message"]) == name.startswith("noise_free")
