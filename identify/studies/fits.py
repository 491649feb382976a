"""Finished fits as a comparison takes them: read from fit and batch folders, each with its labels or its reason."""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from identify.base.document import Json
from identify.base.errors import DocumentError
from identify.base.quantiles import NORMAL
from identify.base.result import LogResult, ParameterResult, Result
from identify.base.table import FORMULA
from identify.effects import ALL
from identify.studies.batch_store import BATCH, INDEX, RESULT
from identify.studies.job import CONVERGED
from identify.uneven.answer import SCALES

PAGE = "report.html"
# Columns of a batch's index that say how a fit went; every other column is a label ("label: status" is the label
# that happens to be called as one of them).
NOT_LABELS = frozenset("group status message result folder logs seconds path drive_speed".split())
LABEL = "label: "
MANY = 4  # folders below a batch folder in which results are sought
UNREADABLE = "unreadable"
REASONS = {"waiting": "the batch has not come to it"}


@dataclass(frozen=True)
class FitEntry:
    """One fit of a comparison.

    name: its group in the batch, else its folder; folder: where its files are; status, message: as in result.json,
    or "unreadable" with the reason; labels: those that all its logs share; mixed: labels that differ between its
    logs; result, and its document: empty where there is none. Of a part of a fit (`parts`): fit: the name of the fit;
    elsewhere: parameters that other parts of it tell.
    """

    name: str
    folder: Path
    status: str
    message: str
    labels: Mapping[str, str] = field(default_factory=dict)
    mixed: tuple[str, ...] = ()
    result: Result = field(default_factory=Result)
    document: Mapping[str, Json] = field(default_factory=dict)
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
    def logs(self) -> tuple[LogResult, ...]:
        """The logs of the fit."""
        return self.result.logs

    @property
    def taken(self) -> Sequence[LogResult]:
        """The logs that took part in the fit."""
        return [log for log in self.logs if not log.reason_left_out]


def count(entries: Iterable[FitEntry]) -> int:
    """How many fits these are, however many parts of each."""
    return len({(entry.folder, entry.whole) for entry in entries})


def read_fits(folders: Iterable[str | Path]) -> tuple[FitEntry, ...]:
    """The fits of fit folders (with a result.json) and of batch folders (with an index.csv, or with such below).

    A fit that cannot be read is an entry with the reason; a folder named twice counts once. Sorted by name.
    """
    found: dict[str, FitEntry] = {}
    for folder in map(Path, folders):
        for entry in _folder(folder):
            found.setdefault(os.path.realpath(entry.folder) if entry.document else f"{folder}:{entry.name}", entry)
    return tuple(sorted(found.values(), key=lambda entry: natural(entry.name)))


def natural(text: str) -> tuple[tuple[int, float, str], ...]:
    """A key that sorts "V2" before "V10"."""
    parts = re.split(r"(\d{1,15})", text)
    return tuple(
        (1, float(part), "") if part.isascii() and part.isdigit() else (0, 0.0, part.lower()) for part in parts
    )


def _folder(folder: Path) -> list[FitEntry]:
    if (folder / RESULT).is_file():
        return [_read(folder, folder.name or str(folder), {})]
    if (folder / INDEX).is_file():
        rows = _index(folder / INDEX)
        exact = _groups(folder / BATCH)
        groups = exact if len(exact) == len(rows) else [{} for _ in rows]
        listed = [_row(folder, row, group) for row, group in zip(rows, groups, strict=True)]
        if listed:
            return listed
    depth = len(folder.parts)
    results = sorted(p for p in folder.rglob(RESULT) if len(p.parts) - depth <= MANY)
    holders = {path.parent for path in results}
    inner = [path for path in results if holders.isdisjoint(path.parent.parents)]
    return [_read(path.parent, path.parent.relative_to(folder).as_posix(), {}) for path in inner]


def _index(path: Path) -> list[dict[str, str]]:
    """Rows of a batch's index; an index that cannot be read has none."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as handle:
            return [
                {_unguarded(str(k)): _unguarded(v or "") for k, v in row.items() if k and not isinstance(v, list)}
                for row in csv.DictReader(handle)
            ]
    except (OSError, ValueError, csv.Error):
        return []


def _unguarded(text: str) -> str:
    """Text as it was before a spreadsheet was kept from taking it for a formula."""
    return text[1:] if text.startswith("'") and text[1:].lstrip().startswith(FORMULA) else text


def _groups(path: Path) -> list[Mapping[str, Json]]:
    """The groups of a batch as its document tells them: names and labels exactly as they were given."""
    try:
        groups = json.loads(path.read_text(encoding="utf-8"))["groups"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []
    return [g if isinstance(g, Mapping) else {} for g in groups] if isinstance(groups, list) else []


def _row(folder: Path, row: Mapping[str, str], group: Mapping[str, Json]) -> FitEntry:
    """One row of an index: its result where there is one, else the reason why there is none."""
    name = str(group.get("group") or row.get("group") or "?")
    labels = {key.removeprefix(LABEL): value for key, value in row.items() if key not in NOT_LABELS and value}
    exact = group.get("labels")
    if isinstance(exact, Mapping):
        labels = {str(key): str(value) for key, value in exact.items() if value}
    told = row.get("result") or ""
    path = folder / (told or f"{group.get('folder') or row.get('folder') or name}/{RESULT}")
    if path.is_dir():
        path = path / RESULT
    if path.is_file() and (told or row.get("status") in ("", CONVERGED)):
        return _read(path.parent, name, labels)
    status = row.get("status") or UNREADABLE
    return FitEntry(name, path.parent, status, row.get("message") or REASONS.get(status, "no result"), labels)


def _read(folder: Path, name: str, labels: Mapping[str, str]) -> FitEntry:
    try:
        document = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        return FitEntry(name, folder, UNREADABLE, f"{RESULT} cannot be read: {type(error).__name__}", labels)
    try:
        result = Result.from_dict(document)
    except DocumentError:
        result = Result()
    if not isinstance(document, Mapping) or not isinstance(document.get("parameters"), Mapping) or not result.status:
        return FitEntry(name, folder, UNREADABLE, f"{RESULT} is no result of a fit", labels)
    said, mixed = shared_labels(result.logs)
    return FitEntry(
        name=name,
        folder=folder,
        status=result.status,
        message=result.message,
        labels={key: value for key, value in labels.items() if key not in mixed} | said,
        mixed=mixed,
        result=result,
        document=document,
    )


def shared_labels(logs: Sequence[LogResult]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Labels that all logs which took part share, and the names of those that differ."""
    tables = [log.labels for log in logs if not log.reason_left_out] or [log.labels for log in logs]
    names = list(dict.fromkeys(name for table in tables for name in table))
    same = {name: tables[0][name] for name in names if len({table.get(name) for table in tables}) == 1}
    return same, tuple(name for name in names if name not in same)


# ----------------------------------------------------------------------------------------------------------------------
# What is pooled: the parameters of every fit on the scale where their errors are even.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

TOLD = ("identified", "weak")
DECLARED = {p.name: p for effect in ALL for p in effect.parameters}


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
    """Quantities of n fits: y and variance (n, m) on their scales, NaN where a fit does not have one; untold: fits by
    index that do not have a quantity, with the reason."""

    quantities: tuple[Quantity, ...]
    y: Array
    variance: Array
    untold: Mapping[str, tuple[tuple[int, str], ...]]


def values(entries: Sequence[FitEntry]) -> Values:
    """The parameters that these fits estimate, in the order in which they first occur."""
    names = list(dict.fromkeys(name for e in entries for name, p in e.result.parameters.items() if p.verdict in TOLD))
    quantities = tuple(_quantity(name, entries) for name in names)
    n, m = len(entries), len(quantities)
    y, sd = np.full((n, m), np.nan), np.full((n, m), np.nan)
    untold: dict[str, list[tuple[int, str]]] = {name: [] for name in names}
    for i, entry in enumerate(entries):
        for k, quantity in enumerate(quantities):
            parameter = entry.result.parameters.get(quantity.name)
            y[i, k], sd[i, k], reason = _told(parameter, quantity)
            if reason and quantity.name not in entry.elsewhere:
                untold[quantity.name].append((i, reason))
    return Values(quantities, y, sd**2, {name: tuple(found) for name, found in untold.items()})


def tells(entry: FitEntry) -> bool:
    """Whether a fit has a number for any parameter."""
    return any(_numbered(p) for p in entry.result.parameters.values())


def verdicts(entry: FitEntry) -> str:
    """The verdicts on the parameters of a fit in words: "mu_s, a not identifiable; D at bound"."""
    found: dict[str, list[str]] = {}
    for name, p in entry.result.parameters.items():
        found.setdefault("no standard error" if p.verdict in TOLD else p.verdict or "no value", []).append(name)
    return "; ".join(f"{', '.join(names)} {verdict}" for verdict, names in found.items()) or "it has no parameter"


def _numbered(parameter: ParameterResult) -> bool:
    """Whether a parameter was estimated with a standard error."""
    return parameter.verdict in TOLD and parameter.value is not None and bool(parameter.standard_error)


def _quantity(name: str, entries: Sequence[FitEntry]) -> Quantity:
    told = [e.result.parameters[name] for e in entries if name in e.result.parameters]
    positive = all((p.value or 0.0) > 0.0 for p in told if p.verdict in TOLD)
    declared = DECLARED.get(name)
    unit = next((p.unit for p in told if p.unit), "")
    logarithmic = name in SCALES or (declared is not None and declared.scale == "log")
    return Quantity(name, unit, logarithmic and positive)


def _told(parameter: ParameterResult | None, quantity: Quantity) -> tuple[float, float, str]:
    """Value and standard deviation on the scale of the quantity, or why there is none.

    The interval counts where it has two ends: where a profile was run, it is the better of the two.
    """
    if parameter is None:
        return np.nan, np.nan, "not in its model"
    value, error, (low, high) = parameter.value, parameter.standard_error, parameter.ends
    if value is None or not error or not _numbered(parameter):
        return np.nan, np.nan, parameter.verdict or "no value"
    if quantity.logarithmic:
        width = np.log(high / low) if low is not None and high is not None and 0.0 < low < high else 0.0
        return float(np.log(value)), float(width) / (2.0 * NORMAL) or error / value, ""
    width = high - low if low is not None and high is not None else 0.0
    return value, width / (2.0 * NORMAL) or error, ""
