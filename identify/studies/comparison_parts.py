"""A fit with parameters that differ between its logs, taken apart: what each group tells, and what all its logs share.

`D` with per = "volunteer" is one estimate for each volunteer, told by that volunteer's logs; it counts with their
labels. What all logs share is one estimate of the fit and counts once, with the labels that all its logs have.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from identify.scene.values import EACH_LOG
from identify.studies.fits import FitEntry, shared_labels

Group = tuple[str, str]  # the label that parameters differ by, and its value


def parts(entry: FitEntry) -> tuple[FitEntry, ...]:
    """What counts for itself of a fit: first what its logs share, then each group; the fit itself where no parameter
    differs between its logs."""
    if not entry.converged:
        return (entry,)
    own = _own(entry)
    if not own:
        return (entry,)
    keys = {key for names in own.values() for key in names.values()}
    common = {name: told for name, told in entry.document["parameters"].items() if name not in keys}
    estimated = {n for n, p in common.items() if isinstance(p, Mapping) and p.get("verdict") != "fixed"}
    apart = {name for names in own.values() for name in names}
    groups = [_group(entry, group, names, estimated | apart) for group, names in own.items()]
    if not estimated:
        return tuple(groups)
    document = dict(entry.document) | {"parameters": common}
    return (replace(entry, fit=entry.name, elsewhere=frozenset(apart - estimated), document=document), *groups)


def _own(entry: FitEntry) -> dict[Group, dict[str, str]]:
    """Of each group its parameters and under which key they stand; a label that makes one group only makes none."""
    found: dict[Group, dict[str, str]] = {}
    for key, told in entry.document["parameters"].items():
        if isinstance(told, Mapping) and told.get("per"):
            group = str(told["per"]), str(told.get("group"))
            found.setdefault(group, {})[str(told.get("parameter") or key)] = key
    several = [per for per, _ in found]
    return {group: keys for group, keys in found.items() if several.count(group[0]) > 1}


def _group(entry: FitEntry, group: Group, keys: Mapping[str, str], searched: set[str]) -> FitEntry:
    """One group with its own parameters under their plain names and with the labels of its logs."""
    per, value = group
    logs = [log for number, log in enumerate(entry.document.get("logs") or (), 1) if _of(log, number, group)]
    said, mixed = shared_labels(logs)
    asked = {} if per == EACH_LOG else {per: value}
    document = dict(entry.document) | {
        "parameters": {name: entry.document["parameters"][key] for name, key in keys.items()},
        "correlation": _renamed(entry.document.get("correlation"), keys),
        "logs": logs,
    }
    return replace(
        entry,
        name=f"{entry.name}, {value if per == EACH_LOG else f'{per} {value}'}",
        labels={n: v for n, v in entry.labels.items() if n not in mixed} | said | asked,
        mixed=tuple(name for name in mixed if name != per),
        document=document,
        fit=entry.name,
        elsewhere=frozenset(searched - set(keys)),
    )


def _of(log: Any, number: int, group: Group) -> bool:
    """Whether a log (counted from 1) belongs to a group."""
    per, value = group
    if per == EACH_LOG:
        return value == f"log {number}"
    labels = log.get("labels") if isinstance(log, Mapping) else None
    return isinstance(labels, Mapping) and str(labels.get(per, "")) == value


def _renamed(correlation: Any, keys: Mapping[str, str]) -> Any:
    """The correlation with a group's own parameters under their plain names; those of the others get no such name."""
    if not isinstance(correlation, Mapping):
        return correlation
    plain = {key: name for name, key in keys.items()}
    names = [str(name) for name in correlation.get("names") or ()]
    return dict(correlation) | {"names": [plain.get(n, f"{n} of another" if n in keys else n) for n in names]}
