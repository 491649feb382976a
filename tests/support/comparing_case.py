"""Made-up finished fits on disk: drawn studies as result.json files, as quick as writing text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.pooling_draws import Plan, draw
from identify.effects import MAIN

NAMES = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
UNITS = ("", "", "", "s/m", "m", "s")
SPEEDS = (1e-4, 1e-3)
SCENE = {
    "name": "made up",
    "effects": list(MAIN),
    "rig": {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0},
    "logs": [{"path": f"log_{k}.csv", "drive_speed": speed} for k, speed in enumerate(SPEEDS)],
}


def document(values: np.ndarray, covariance: np.ndarray, labels: Mapping[str, str]) -> dict[str, Any]:
    """A result.json as the interface promises it; values and covariance on the scales of `pooling_draws`."""
    sd = np.sqrt(np.diag(covariance))
    parameters = {}
    for k, name in enumerate(NAMES):
        logarithmic = k >= 3
        value = float(np.exp(values[k])) if logarithmic else float(values[k])
        error = float(sd[k]) * (value if logarithmic else 1.0)
        parameters[name] = {
            "value": value,
            "unit": UNITS[k],
            "standard_error": error,
            "interval": [value - 1.96 * error, value + 1.96 * error],
            "level": 0.95,
            "verdict": "identified",
            "reason": "",
        }
    logs = [
        {
            "path": f"log_{k}.csv",
            "sha256": f"{abs(hash((k, float(values[0])))):064x}",
            "labels": dict(labels),
            "normal_force_N": 1.0,
            "drive_speed_m_per_s": speed,
            "reason_left_out": None,
            "classical": {"rows": [{"static_peak_coefficient": 0.6, "kinetic_mean_coefficient": 0.4}]},
        }
        for k, speed in enumerate(SPEEDS)
    ]
    return {
        "schema": 1,
        "status": "converged",
        "message": "the misfit is noise",
        "parameters": parameters,
        "effects": {"names": list(MAIN), "chosen": "listed", "reasons": []},
        "correlation": {"names": list(NAMES), "matrix": (covariance / np.outer(sd, sd)).tolist()},
        "gate": {"chi2_per_sample": 1.0},
        "logs": logs,
        "provenance": {"scene": SCENE},
    }


def write_fit(folder: Path, told: Mapping[str, Any]) -> None:
    """One fit's folder."""
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(json.dumps(told), encoding="utf-8")
    (folder / "report.html").write_text("<!doctype html><title>fit</title>", encoding="utf-8")


def write_study(folder: Path, plan: Plan, seed: int = 1) -> np.ndarray:
    """A whole study below `folder`, one fit per folder; returns the true means (materials, 6)."""
    study = draw(plan, np.random.default_rng(seed))
    assert study.setting.subject is not None
    for i, (group, who) in enumerate(zip(study.setting.group, study.setting.subject, strict=True)):
        labels = {"material": group, "volunteer": who}
        write_fit(folder / f"{group}_{who}_{i}", document(study.y[i], study.noise[i], labels))
    return study.truth
