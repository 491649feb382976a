"""Whose values hold for a log of a finished fit: those of its own group where parameters differ from group to group."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.scene import Scene
from identify.scene.values import EACH_LOG, Tie

Array = NDArray[np.float64]
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
