"""Finished fits as a comparison takes them: read from fit and batch folders, taken apart into what counts for itself,
and their parameters on the scales on which they are pooled."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import DocumentError
from identify.base.quantiles import NORMAL
from identify.base.result import LogResult, ParameterResult, Result
from identify.effects import ALL
from identify.scene.tables import DAMPING
from identify.scene.values import EACH_LOG
from identify.studies.batch_store import BATCH, JOB, RESULT
from identify.studies.job import CONVERGED
from identify.uneven.answer import SCALES

Array = NDArray[np.float64]

PAGE = "report.html"
MANY = 4  # folders below a given one in which results are sought
UNREADABLE = "unreadable"
WITH_VALUE = ("identified", "weak")  # verdicts of parameters that are pooled
DECLARED = {p.name: p for effect in ALL for p in effect.parameters}


@dataclass(frozen=True)
class FitEntry:
    """One fit of a comparison.

    name: its group in the batch, else its folder; folder: where its files are; status, message: as in result.json,
    or "unreadable" with the reason; labels: those that all its logs share; mixed: labels that differ between its
    logs; result: empty where there is none. Of a part of a fit (`parts`): fit: the name of the fit; elsewhere:
    parameters that other parts of it have.
    """

    name: str
    folder: Path
    status: str
    message: str
    labels: Mapping[str, str] = field(default_factory=dict)
    mixed: tuple[str, ...] = ()
    result: Result = field(default_factory=Result)
    fit: str = ""
    elsewhere: frozenset[str] = frozenset()

    @property
    def whole(self) -> str:
        """The name of the fit."""
        return self.fit or self.name

    @property
    def shared(self) -> bool:
        """Whether this is what all logs of a fit share while other parameters differ between them."""
        return self.fit == self.name

    @property
    def converged(self) -> bool:
        """Whether there is a result to compare."""
        return self.status == CONVERGED

    @property
    def fitted_logs(self) -> Sequence[LogResult]:
        """The logs that took part in the fit."""
        return [log for log in self.result.logs if not log.reason_left_out]


def count(entries: Iterable[FitEntry]) -> int:
    """How many fits these are, however many parts of each."""
    return len({(entry.folder, entry.whole) for entry in entries})


def natural(text: str) -> tuple[tuple[int, float, str], ...]:
    """A key that sorts "V2" before "V10"."""
    pieces = re.split(r"(\d{1,15})", text)
    return tuple((1, float(p), "") if p.isascii() and p.isdigit() else (0, 0.0, p.lower()) for p in pieces)


def read_fits(folders: Iterable[str | Path]) -> tuple[FitEntry, ...]:
    """The fits of fit folders (with a result.json) and of batch folders (with a batch.json, or with such below).

    A fit that cannot be read is an entry with the reason; a folder named twice counts once. Sorted by name.
    """
    entries: dict[str, FitEntry] = {}
    for folder in map(Path, folders):
        for entry in _folder(folder):
            entries.setdefault(os.path.realpath(entry.folder), entry)
    return tuple(sorted(entries.values(), key=lambda entry: natural(entry.name)))


def _folder(folder: Path) -> list[FitEntry]:
    if (folder / RESULT).is_file():
        return [_read(folder, folder.name or str(folder), {})]
    groups = _document(folder / BATCH).get("groups")
    if isinstance(groups, list) and groups:
        return [_group(folder, group) for group in groups if isinstance(group, Mapping)]
    depth = len(folder.parts)
    results = sorted(p for p in folder.rglob(RESULT) if len(p.parts) - depth <= MANY)
    holders = {path.parent for path in results}
    inner = [path.parent for path in results if holders.isdisjoint(path.parent.parents)]
    return [_read(path, path.relative_to(folder).as_posix(), {}) for path in inner]


def _document(path: Path) -> Mapping[str, object]:
    """A JSON file of ours; empty where it cannot be read."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return document if isinstance(document, Mapping) else {}


def _group(folder: Path, group: Mapping[str, object]) -> FitEntry:
    """One group of a batch: its result where there is one, else the reason why there is none."""
    name = str(group.get("group") or "?")
    stated = group.get("labels")
    labels = {str(k): str(v) for k, v in stated.items() if v} if isinstance(stated, Mapping) else {}
    place = folder / str(group.get("folder") or name)
    if (place / RESULT).is_file():
        return _read(place, name, labels)
    job = _document(place / JOB)
    status = str(job.get("status") or group.get("status") or UNREADABLE)
    if status == CONVERGED:  # its result was taken away
        return FitEntry(name, place, UNREADABLE, f"{RESULT} is missing", labels)
    message = str(job.get("message") or ("the batch has not come to it" if status == "waiting" else "no result"))
    return FitEntry(name, place, status, message, labels)


def _read(folder: Path, name: str, labels: Mapping[str, str]) -> FitEntry:
    try:
        document = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        result = Result.from_dict(document)
    except DocumentError:
        result = Result()
    except (OSError, ValueError, RecursionError) as error:
        return FitEntry(name, folder, UNREADABLE, f"{RESULT} cannot be read: {type(error).__name__}", labels)
    if not result.status or not isinstance(document.get("parameters"), Mapping):
        return FitEntry(name, folder, UNREADABLE, f"{RESULT} is no result of a fit", labels)
    own, mixed = _shared_labels(result.logs)
    labels = {key: value for key, value in labels.items() if key not in mixed} | own
    return FitEntry(name, folder, result.status, result.message, labels, mixed, result)


def _shared_labels(logs: Sequence[LogResult]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Labels that all logs which took part share, and the names of those that differ."""
    tables = [log.labels for log in logs if not log.reason_left_out] or [log.labels for log in logs]
    names = list(dict.fromkeys(name for table in tables for name in table))
    same = {name: tables[0][name] for name in names if len({table.get(name) for table in tables}) == 1}
    return same, tuple(name for name in names if name not in same)


# ----------------------------------------------------------------------------------------------------------------------
# A fit with parameters that differ between its logs, taken apart: each group of logs with the values of its own, and
# what all logs share.
#
# `D` with per = "volunteer" is one estimate for each volunteer, from that volunteer's logs; it counts with their
# labels. What all logs share is one estimate of the fit and counts once, with the labels that all its logs have.
# ----------------------------------------------------------------------------------------------------------------------


def parts(entry: FitEntry) -> tuple[FitEntry, ...]:
    """What counts for itself of a fit: first what its logs share, then each group; the fit itself where no parameter
    differs between its logs."""
    keys: dict[tuple[str, str], dict[str, str]] = {}  # of each group, under which key its parameters stand
    for key, p in entry.result.parameters.items() if entry.converged else ():
        if p.per:
            keys.setdefault((p.per, p.group), {})[p.parameter or key] = key
    labels = [per for per, _ in keys]
    keys = {group: own for group, own in keys.items() if labels.count(group[0]) > 1}
    if not keys:
        return (entry,)
    grouped = {key for own in keys.values() for key in own.values()}
    common = {name: p for name, p in entry.result.parameters.items() if name not in grouped}
    estimated = frozenset(name for name, p in common.items() if p.verdict != "fixed")
    apart = frozenset(name for own in keys.values() for name in own)
    groups = [_part(entry, per, value, own, estimated | apart) for (per, value), own in keys.items()]
    if not estimated:
        return tuple(groups)
    result = replace(entry.result, parameters=common)
    return (replace(entry, fit=entry.name, elsewhere=apart - estimated, result=result), *groups)


def _part(entry: FitEntry, per: str, value: str, keys: Mapping[str, str], searched: frozenset[str]) -> FitEntry:
    """One group with its own parameters under their plain names and with the labels of its logs."""
    by_log = per == EACH_LOG
    logs = tuple(
        log
        for number, log in enumerate(entry.result.logs, 1)
        if (value == f"log {number}" if by_log else log.labels.get(per, "") == value)
    )
    own, mixed = _shared_labels(logs)
    kept = {n: v for n, v in entry.labels.items() if n not in mixed}
    return replace(
        entry,
        name=f"{entry.name}, {value if by_log else f'{per} {value}'}",
        labels=kept | own | ({} if by_log else {per: value}),
        mixed=tuple(name for name in mixed if name != per),
        result=replace(
            entry.result, parameters={n: entry.result.parameters[key] for n, key in keys.items()}, logs=logs
        ),
        fit=entry.name,
        elsewhere=searched - set(keys),
    )


def with_known_rig(entry: FitEntry) -> FitEntry:
    """The fit with rig quantities that its scene states with a tolerance as given: measurements of the rig determine
    them, so that no group differs in them."""
    rig = entry.result.scene.get("rig")
    stated = rig.items() if isinstance(rig, Mapping) else ()
    known = {"damping" if n in DAMPING else n for n, v in stated if isinstance(v, Mapping) and "tolerance" in v}
    parameters = {n: replace(p, verdict="fixed") if n in known else p for n, p in entry.result.parameters.items()}
    return replace(entry, result=replace(entry.result, parameters=parameters)) if known else entry


# ----------------------------------------------------------------------------------------------------------------------
# What is pooled: the parameters of every fit on the scale where their errors are even.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Quantity:
    """A parameter that fits estimate: name, SI unit, whether it is pooled as a logarithm."""

    name: str
    unit: str
    logarithmic: bool

    def shown(self, y: float) -> float:
        """The value in SI units."""
        return float(np.exp(y)) if self.logarithmic else y


@dataclass(frozen=True)
class Values:
    """Quantities of n fits: y and variance (n, m) on their scales, NaN where a fit does not have one; missing: fits by
    index that do not have a quantity, with the reason."""

    quantities: tuple[Quantity, ...]
    y: Array
    variance: Array
    missing: Mapping[str, tuple[tuple[int, str], ...]]


def values(entries: Sequence[FitEntry]) -> Values:
    """The parameters that these fits estimate, in the order in which they first occur."""
    tables = [entry.result.parameters for entry in entries]
    names = dict.fromkeys(name for table in tables for name, p in table.items() if p.verdict in WITH_VALUE)
    quantities = []
    for name in names:
        found = [table[name] for table in tables if name in table]
        positive = all((p.value or 0.0) > 0.0 for p in found if p.verdict in WITH_VALUE)
        logarithmic = name in SCALES or (name in DECLARED and DECLARED[name].scale == "log")
        quantities.append(Quantity(name, next((p.unit for p in found if p.unit), ""), logarithmic and positive))
    y, sd = np.full((2, len(entries), len(quantities)), np.nan)
    missing: dict[str, list[tuple[int, str]]] = {name: [] for name in names}
    for i, entry in enumerate(entries):
        for k, q in enumerate(quantities):
            p = tables[i].get(q.name)
            if p is not None and has_value(p):
                y[i, k], sd[i, k] = _on_scale(p, q)
            elif q.name not in entry.elsewhere:
                missing[q.name].append((i, "not in its model" if p is None else p.verdict or "no value"))
    return Values(tuple(quantities), y, sd**2, {name: tuple(fits) for name, fits in missing.items()})


def has_value(parameter: ParameterResult) -> bool:
    """Whether a parameter was estimated with a standard error."""
    return parameter.verdict in WITH_VALUE and parameter.value is not None and bool(parameter.standard_error)


def _on_scale(parameter: ParameterResult, quantity: Quantity) -> tuple[float, float]:
    """Value and standard deviation on the scale of the quantity.

    The interval counts where it has two ends: where a profile was run, it is the better of the two.
    """
    value, error, (low, high) = parameter.value or 0.0, parameter.standard_error or 0.0, parameter.ends
    closed = low is not None and high is not None
    if quantity.logarithmic:
        width = float(np.log(high / low)) if closed and 0.0 < low < high else 0.0  # type: ignore[operator]
        return float(np.log(value)), width / (2.0 * NORMAL) or error / value
    return value, ((high - low) if closed else 0.0) / (2.0 * NORMAL) or error  # type: ignore[operator]
