"""The paper's test: what it states, ranges for what it does not, and a pair to stand in for the one it measured."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify import Scene, fit
from identify.examples import SCENE
from identify.prediction.groups import QUANTITIES, formed, groups

Array = NDArray[np.float64]

STATED = {"normal_force": 1.0, "drive_speed": 0.1e-3 / 60, "stiffness": 1470.0, "D": 37.4e-6, "t_cr": 0.5}  # SI
MASSES = (0.05, 0.2, 0.5)  # kg: not stated
ZETAS = (0.01, 0.2)  # not stated
STEPS = (0.05, 0.3)  # mu_s - mu_k0: not stated
WEAKENING = (0.0, 40.0)  # |dmu_k| a [s/m]: not stated
STAND_IN = {  # the simulated pair of the example logs: measured where the paper's is, everything else chosen
    **STATED,
    "mass": 0.2,
    "damping": 147.0,
    "mu_s": 0.62,
    "mu_k0": 0.43,
    "delta_mu_k": -0.13,
    "a": 300.0,
}
TOLERANCES = {"mass": "2 %", "damping": "10 %"}  # of the rig, in the fit of the stand-in


@dataclass(frozen=True)
class Known:
    """A pair and how well it is known: values [SI] of `steady.QUANTITIES`, names and covariance (f, f) of those that
    are uncertain."""

    values: dict[str, float]
    names: tuple[str, ...]
    covariance: Array


STEP, LEAST = 1e-5, 1e-8  # of a difference: relative, and absolute for what is zero
NOTHING = 1e-13  # of a number: a difference that small is rounding


def slopes(
    formula: Callable[[dict[str, Any]], Mapping[str, Any]], values: Mapping[str, float], names: Sequence[str]
) -> dict[str, NDArray[np.float64]]:
    """Derivatives (f,) by `names` of every number that a formula makes of named values [SI], which it takes as arrays.

    Central differences, good to nine digits; NaN where a number is lost on one side of the point.
    """
    steps = np.array([STEP * abs(values[name]) or LEAST for name in names])
    moved = {name: np.full((2, len(names)), float(value)) for name, value in values.items()}
    for i, name in enumerate(names):
        moved[name][:, i] += [steps[i], -steps[i]]
    with np.errstate(all="ignore"):
        found = {name: np.broadcast_to(value, (2, len(names))) for name, value in formula(moved).items()}
        return {
            name: np.where(np.abs(above - below) <= NOTHING * np.abs(above), 0.0, (above - below) / (2.0 * steps))
            for name, (above, below) in found.items()
        }


def fitted() -> Known:
    """The stand-in from its four example logs, mass and damping known to a tolerance only."""
    text = SCENE.read_text(encoding="utf-8").replace('path = "', f'path = "{SCENE.parent.as_posix()}/')
    for name, value in (("mass", "0.2 kg"), ("damping", "147 N/m")):
        text = text.replace(
            f'{name} = "{value}"', f'{name} = {{ value = "{value}", tolerance = "{TOLERANCES[name]}" }}'
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pair.toml"
        path.write_text(text, encoding="utf-8")
        result = fit(Scene.from_toml(path)).result
    names = tuple(result["correlation"]["names"])
    errors = np.array([result["parameters"][name]["standard_error"] for name in names])
    values = STAND_IN | {name: result["parameters"][name]["value"] for name in names}
    return Known(values, names, np.outer(errors, errors) * np.array(result["correlation"]["matrix"]))


def assumed() -> Known:
    """The truth of the stand-in with one percent on everything: for a quick look."""
    names = ("mass", "damping", "mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
    return Known(dict(STAND_IN), names, np.diag([(0.01 * STAND_IN[name]) ** 2 for name in names]))


def arguments(values: dict[str, Any]) -> tuple[Any, Any, Any, Any]:
    """The arguments of the calculators."""
    rig, friction = (SimpleNamespace(**{n: values[n] for n in part}) for part in (QUANTITIES[:3], QUANTITIES[3:9]))
    return rig, friction, values["drive_speed"], values["normal_force"]


def region(known: Known, x: str, y: str, count: int = 181) -> tuple[Array, Array, Array]:
    """Centre (2,) and 95 % confidence region, as a closed curve (2, count), of two groups; with their standard errors
    (2,)."""
    found, table = groups(*arguments(known.values)), slopes(formed, known.values, known.names)
    rows = np.array([table[g] for g in (x, y)])
    joint = rows @ known.covariance @ rows.T
    angle = np.linspace(0, 2 * np.pi, count)
    circle = np.stack([np.cos(angle), np.sin(angle)]) * np.sqrt(5.991)  # chi-squared of two, 95 %
    values, vectors = np.linalg.eigh(joint)
    centre = np.array([getattr(found, x), getattr(found, y)])
    edge = centre[:, None] + vectors @ (np.sqrt(np.maximum(values, 0))[:, None] * circle)
    return centre, edge, np.sqrt(np.diag(joint))


def box() -> dict[str, tuple[float, float]]:
    """Ranges of the groups over what the paper does not state."""
    F, v, k = STATED["normal_force"], STATED["drive_speed"], STATED["stiffness"]
    w = [F / (v * np.sqrt(m * k)) for m in MASSES]
    impedance = [np.sqrt(m * k) for m in MASSES]
    pi = F * STATED["t_cr"] / STATED["D"]
    return {
        "loading": (STEPS[0] * min(w), STEPS[1] * max(w)),
        "alpha": (ZETAS[0] - WEAKENING[1] * F / (2 * min(impedance)), ZETAS[1]),
        "zeta": ZETAS,
        "Pi": (pi * STEPS[0] / max(impedance), pi * STEPS[1] / min(impedance)),
        "tau_cr": tuple(sorted(STATED["t_cr"] * np.sqrt(k / m) for m in (MASSES[0], MASSES[-1]))),  # type: ignore[dict-item]
    }
