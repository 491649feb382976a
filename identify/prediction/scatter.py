"""Several fits of one pair, each with its covariance, as one: their mean, and what one more record would scatter.

Random effects by the method of moments: what the estimates scatter beyond their own covariances is the scatter between
records. With few records that is itself uncertain, so the covariances are widened as Student's t asks for; for people,
groups and covariates there is the comparison of fits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.base.quantiles import LEVEL, NORMAL, student
from identify.model.model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pooled:
    """Mean (f,) of r records; covariances (f, f) of the mean, between records, and of one more record about the mean
    (where own errors are as large as the scatter, its 95 % hold 93 % with six records)."""

    mean: Array
    of_mean: Array
    between: Array
    of_next: Array


def pooled(values: Array, covariances: Array) -> Pooled:
    """Records as one: estimates (r, f), r at least 2, each with its covariance (r, f, f)."""
    records = values.shape[0]
    excess = np.atleast_2d(np.cov(values, rowvar=False)) - np.mean(covariances, axis=0)
    sizes, directions = np.linalg.eigh(0.5 * (excess + excess.T))
    between = (directions * np.maximum(sizes, 0.0)) @ directions.T
    weights = np.linalg.inv(between + covariances)
    of_mean = np.linalg.inv(np.sum(weights, axis=0))
    mean = of_mean @ np.einsum("rij,rj->i", weights, values)
    wider = (float(student(0.5 + LEVEL / 2, records - 1)) / NORMAL) ** 2
    return Pooled(mean, wider * of_mean, between, wider * (between + of_mean))


def pooled_result(documents: Sequence[Mapping[str, Any]], model: Model) -> dict[str, Any]:
    """The document of the first result with the values of all, and the covariance of one more record of the pair.

    Raises:
        SimulationError: results that do not estimate the same parameters.
    """
    first = dict(documents[0])
    names = [tuple((d.get("correlation") or {}).get("names") or ()) for d in documents]
    told = [all(d["parameters"][n]["standard_error"] is not None for n in names[0]) for d in documents if names[0]]
    if len({frozenset(n) for n in names}) != 1 or not told or not all(told):
        raise SimulationError(
            "these results do not tell the same parameters; give results of one pair, fitted with the same scene, "
            "in which every parameter is known"
        )
    groups = [{n: (e.get("per"), e.get("group")) for n, e in d["parameters"].items()} for d in documents]
    if any(other != groups[0] for other in groups):
        raise SimulationError(
            "the parameters of these results differ between other groups of logs; give results of one pair, fitted "
            "with the same scene and labels"
        )
    logs = np.array([model.parameter(_parameter(first, name)).scale == "log" for name in names[0]])
    rows = [_estimates(document, names[0], logs) for document in documents]
    together = pooled(np.array([row for row, _ in rows]), np.array([matrix for _, matrix in rows]))
    values = np.where(logs, np.exp(np.where(logs, together.mean, 0.0)), together.mean)
    scale = np.where(logs, values, 1.0)
    covariance = together.of_next * np.outer(scale, scale)
    sd = np.sqrt(np.diag(covariance))
    entries = {
        name: {**first["parameters"][name], "value": float(value), "standard_error": float(error)}
        for name, value, error in zip(names[0], values, sd, strict=True)
    }
    matrix = (covariance / np.outer(sd, sd)).tolist()
    correlation = {"names": list(names[0]), "matrix": matrix, "standard_errors": sd.tolist()}
    return first | {"parameters": {**first["parameters"], **entries}, "correlation": correlation}


def _parameter(document: Mapping[str, Any], name: str) -> str:
    """Which parameter an estimate is of: "D (V08)" is one of D."""
    return str(document["parameters"][name].get("parameter") or name)


def _estimates(document: Mapping[str, Any], names: Sequence[str], logs: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Estimates (f,) and covariance (f, f) as they are searched: logarithms where the parameter is."""
    own = list(document["correlation"]["names"])
    order = [own.index(name) for name in names]
    values = np.array([document["parameters"][name]["value"] for name in names], dtype=float)
    told = document["correlation"].get("standard_errors") or [document["parameters"][n]["standard_error"] for n in own]
    errors = np.array(told, dtype=float)[order]
    scale = np.where(logs, values, 1.0)
    matrix = np.array(document["correlation"]["matrix"], dtype=float)[np.ix_(order, order)]
    return np.where(logs, np.log(np.where(logs, values, 1.0)), values), matrix * np.outer(
        errors / scale, errors / scale
    )
