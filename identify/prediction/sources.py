"""What scenes and finished fits say of operating points: groups, several fits as one, tolerances, the tested range."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.base.outcome import numbers_of
from identify.base.quantiles import LEVEL, NORMAL, student
from identify.base.wording import three_figures
from identify.model.model import Model
from identify.prediction.wording import listed, said
from identify.scene import Scene
from identify.scene.values import EACH_LOG, Tie

# ----------------------------------------------------------------------------------------------------------------------
# How well an operating point is known where nothing was fitted: by the tolerances and priors its scene states.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


def stated(scene: Scene, values: Mapping[str, float], drive_speed: float) -> tuple[tuple[str, ...], Array] | None:
    """Names and covariance (f, f) [SI] of what a scene says is not exact; None where it takes all as exact.

    Args:
        values: every parameter of the model at the operating point, SI. drive_speed: [m/s].

    The tolerances of the rig are relative standard deviations, that of the drive speed among them; a prior of a
    parameter is its standard deviation, in SI. They are independent.
    """
    deviations = {
        name: share * abs(drive_speed if name == "drive_speed" else values[name])
        for name, share in scene.rig.tolerances.items()
        if name == "drive_speed" or name in values
    }
    for name, spec in scene.parameters.items():
        if spec.prior_sd is not None and name in values:
            deviations[name] = spec.prior_sd
    known = {name: sd for name, sd in deviations.items() if sd > 0.0}
    return (tuple(known), np.diag(np.square(list(known.values())))) if known else None


# ----------------------------------------------------------------------------------------------------------------------
# Whose values hold for a log of a finished fit: those of its own group where parameters differ from group to group.
# ----------------------------------------------------------------------------------------------------------------------

Groups = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Pair:
    """What a result says of one log's pair.

    groups: (label, value) of all that parameters differ by, (EACH_LOG, "log 2") of what every log has for itself;
    values [SI] by parameter; covariance (f, f) [SI] of `names`, tied parameters among them, variances infinite
    where these logs do not tell; untold: why there are no values, empty where there are.
    """

    groups: Groups = ()
    values: Mapping[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    covariance: Array | None = None
    untold: str = ""


def pair_of(document: Mapping[str, Any], scene: Scene, log: int) -> Pair:
    """The pair of a log of a result (the document of result.json); `log` counts from 0."""
    groups = groups_of(document, log)
    if document.get("estimator") == "uneven":
        return Pair(groups, untold=_uneven(document))
    mine = dict(groups)
    entries = document["parameters"]
    keys = {_parameter(key, entry): key for key, entry in entries.items() if _holds(entry, mine)}
    missing = [name for name in dict.fromkeys(_parameter(*item) for item in entries.items()) if name not in keys]
    if missing:
        return Pair(groups, untold=_sentence(document, log, missing[0]))
    values = {name: float(entries[k]["value"]) for name, k in keys.items() if entries[k]["value"] is not None}
    ties = ties_of(scene)
    values |= {name: tie.factor * values[tie.to] + tie.offset for name, tie in ties.items() if tie.to in values}
    names, covariance = _covariance(document, keys)
    if covariance is not None:
        names, covariance = with_tied(names, covariance, ties)
    return Pair(groups, values, names, covariance)


def _uneven(document: Mapping[str, Any]) -> str:
    """What is known of a pair whose cycles differ: how they are spread where they were seen, and nothing elsewhere."""
    told = []
    for name, entry in (document.get("distributions") or {}).items():
        if isinstance(entry, Mapping):
            low, middle, high = (three_figures(entry["quantiles"][q]["value"]) for q in ("5", "50", "95"))
            unit = f" {entry['unit']}" if entry["unit"] else " of the load"
            told.append(f"{name.replace('_', ' ')} {middle}{unit} ({low} to {high} in nine of ten cycles)")
    seen = f"at the drive speed, stiffness and load of the record: {', '.join(told)}; " if told else ""
    return (
        f"the cycles of this pair differ, and no one friction pair describes them; {seen}anywhere else: extrapolated, "
        "not supported by these records"
    )


def groups_of(document: Mapping[str, Any], log: int) -> Groups:
    """Which group a log (from 0) of a result belongs to, by everything that its parameters differ by."""
    labels = document["logs"][log].get("labels") or {}
    every = dict.fromkeys(str(entry["per"]) for entry in document["parameters"].values() if entry.get("per"))
    return tuple((per, f"log {log + 1}" if per == EACH_LOG else str(labels.get(per, ""))) for per in every)


def ties_of(scene: Scene) -> dict[str, Tie]:
    """What the scene ties to another parameter, by name."""
    return {name: spec.tie for name, spec in scene.parameters.items() if spec.tie is not None}


def named(groups: Groups) -> str:
    """A group in words: "volunteer V08", "log 2"."""
    return ", ".join(value if per == EACH_LOG else f"{per} {value}" for per, value in groups)


def with_tied(names: Sequence[str], covariance: Array, ties: Mapping[str, Tie]) -> tuple[tuple[str, ...], Array]:
    """Names and covariance (f, f) [SI] with the tied parameters, which move as those do that they follow."""
    follow = {name: tie for name, tie in ties.items() if tie.to in names and name not in names}
    source = [*range(len(names)), *(list(names).index(tie.to) for tie in follow.values())]
    scale = np.array([1.0] * len(names) + [tie.factor for tie in follow.values()])
    # Picked, not multiplied out: a product would spread what is not known (infinite) over everything.
    return (*names, *follow), np.outer(scale, scale) * covariance[np.ix_(source, source)]


def _holds(entry: Mapping[str, Any], groups: Mapping[str, str]) -> bool:
    return not entry.get("per") or str(entry.get("group")) == groups[str(entry["per"])]


def _parameter(key: str, entry: Mapping[str, Any]) -> str:
    return str(entry.get("parameter") or key)


def _sentence(document: Mapping[str, Any], log: int, name: str) -> str:
    """Why a log has no values."""
    told = [e for key, e in document["parameters"].items() if _parameter(key, e) == name]
    known = ", ".join(str(entry.get("group")) for entry in told)
    per, mine = next(((p, v) for p, v in groups_of(document, log) if p == told[0].get("per")), ("", ""))
    whose = f"{mine} has none" if per == EACH_LOG else f"this log is of {per} {mine}" if mine else f"it has no {per}"
    return f"this fit tells {name} of {known} only, and {whose}; fit it again with a log of this group that takes part"


def _covariance(document: Mapping[str, Any], keys: Mapping[str, str]) -> tuple[tuple[str, ...], Array | None]:
    """Names and covariance [SI] of what was estimated of a pair; None where there is none.

    What the logs do not tell has no standard error: its variance is infinite here, and what depends on it is open. The
    errors are those of the correlation; older results tell those of the parameters only, which a profile may have
    given.
    """
    told = document.get("correlation") or {}
    order = list(told.get("names") or ())
    names = tuple(name for name, key in keys.items() if key in order)
    open_ = np.array([document["parameters"][keys[name]]["standard_error"] is None for name in names])
    places = [order.index(keys[name]) for name in names]
    own = told.get("standard_errors")
    errors = [own[i] if own else document["parameters"][order[i]]["standard_error"] for i in places]
    if not names:
        return (), None
    known = np.array([np.nan if e is None else e for e in errors], dtype=float)
    matrix = np.outer(known, known) * np.array(told["matrix"], dtype=float)[np.ix_(places, places)]
    matrix[open_, :] = matrix[:, open_] = 0.0
    matrix[open_, open_] = np.inf
    return (names, matrix) if not np.any(np.isnan(matrix)) else ((), None)


# ----------------------------------------------------------------------------------------------------------------------
# Several fits of one pair, each with its covariance, as one: their mean, and what one more record would scatter.
#
# Random effects by the method of moments: what the estimates scatter beyond their own covariances is the scatter
# between records. With few records that is itself uncertain, so the covariances are widened as Student's t asks for;
# for people, groups and covariates there is the comparison of fits.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PooledRecords:
    """Mean (f,) of r records; covariances (f, f) of the mean, between records, and of one more record about the mean
    (where own errors are as large as the scatter, its 95 % hold 93 % with six records)."""

    mean: Array
    of_mean: Array
    between: Array
    of_next: Array


def pooled(values: Array, covariances: Array) -> PooledRecords:
    """Records as one: estimates (r, f), r at least 2, each with its covariance (r, f, f)."""
    records = values.shape[0]
    excess = np.atleast_2d(np.cov(values, rowvar=False)) - np.mean(covariances, axis=0)
    sizes, directions = np.linalg.eigh(0.5 * (excess + excess.T))
    between = (directions * np.maximum(sizes, 0.0)) @ directions.T
    weights = np.linalg.inv(between + covariances)
    of_mean = np.linalg.inv(np.sum(weights, axis=0))
    mean = of_mean @ np.einsum("rij,rj->i", weights, values)
    wider = (float(student(0.5 + LEVEL / 2, records - 1)) / NORMAL) ** 2
    return PooledRecords(mean, wider * of_mean, between, wider * (between + of_mean))


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
    logs = np.array([model.parameter(_scatter_parameter(first, name)).scale == "log" for name in names[0]])
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


def _scatter_parameter(document: Mapping[str, Any], name: str) -> str:
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


# ----------------------------------------------------------------------------------------------------------------------
# The range of speed, load and stiffness in which a pair was tested: what lies outside is extrapolated.
# ----------------------------------------------------------------------------------------------------------------------

SLACK = 1.1  # beyond the range by this factor still counts as inside
QUANTITIES = ("drive_speed", "normal_force", "stiffness")
UNITS = {"drive_speed": "m/s", "normal_force": "N", "stiffness": "N/m"}


@dataclass(frozen=True)
class Tested:
    """Lowest and highest value [SI] by name (QUANTITIES); a name that is absent was not tested at any known value."""

    ranges: Mapping[str, tuple[float, float]]

    @staticmethod
    def of(points: Iterable[Mapping[str, float]]) -> Tested:
        """The range of tests, each given by its values."""
        given = list(points)
        seen = {name: [abs(p[name]) for p in given if name in p] for name in QUANTITIES}
        return Tested({name: (min(values), max(values)) for name, values in seen.items() if values})

    @staticmethod
    def joined(parts: Iterable[Tested]) -> Tested:
        """The range that several tests cover together."""
        found: dict[str, tuple[float, float]] = {}
        for name, (low, high) in ((n, r) for part in parts for n, r in part.ranges.items()):
            before = found.get(name, (low, high))
            found[name] = (min(low, before[0]), max(high, before[1]))
        return Tested(found)

    @staticmethod
    def of_result(document: Mapping[str, Any]) -> Tested:
        """The range of the logs that took part in a finished fit (the document of result.json)."""
        scene = document.get("provenance", {}).get("scene") or {}
        entries, rig = scene.get("logs") or (), scene.get("rig") or {}
        logs = document.get("logs", ())
        points = []
        for number, log in zip(numbers_of(logs), logs, strict=True):
            if log.get("reason_left_out"):
                continue
            own = entries[number] if number < len(entries) else {}
            said = {
                "drive_speed": log.get("drive_speed_m_per_s"),
                "normal_force": log.get("normal_force_N"),
                "stiffness": own.get("stiffness", rig.get("stiffness")),
            }
            plain = {name: v.get("value") if isinstance(v, Mapping) else v for name, v in said.items()}
            points.append({name: float(v) for name, v in plain.items() if v})
        return Tested.of(points)

    def beyond(self, values: Mapping[str, float]) -> str:
        """A sentence on what of these values [SI] was not tested; "" where all of it was."""
        out = []
        for name in QUANTITIES:
            if name in values and name in self.ranges and self.extrapolated(name, values[name]):
                low, high = (said(end, UNITS[name]) for end in self.ranges[name])
                span = low if low == high else f"{low} to {high}"
                out.append(f"a {name.replace('_', ' ')} of {said(abs(values[name]), UNITS[name])} ({span} tested)")
        return f"Extrapolated: the logs did not test {listed(out)}." if out else ""

    def extrapolated(self, name: str, value: float) -> bool:
        """Whether a value [SI] lies outside the tested range by more than a tenth; False for what is no such name."""
        if name not in QUANTITIES:
            return False
        if name not in self.ranges:
            return True
        low, high = self.ranges[name]
        return not low / SLACK <= abs(value) <= high * SLACK
