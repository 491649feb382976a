"""Finished fits in, comparison out: fits as they are read, which of them are compared, every parameter pooled."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from identify.base.document import read_json
from identify.base.errors import DocumentError, IdentifyError
from identify.base.quantiles import NORMAL
from identify.base.result import LogResult, ParameterResult, Result
from identify.base.table import visible
from identify.effects import ALL
from identify.scene.tables import DAMPING
from identify.studies.batch_store import BATCH, CONVERGED, JOB, RESULT
from identify.studies.pooled import Pooled, PoolingError, Setting, pool
from identify.uneven.answer import SCALES

PAGE = "report.html"
MANY = 4  # folders below a given one in which results are sought
UNREADABLE = "unreadable"
WITH_VALUE = ("identified", "weak")  # verdicts of parameters that are pooled
DECLARED = {p.name: p for effect in ALL for p in effect.parameters}
SUBJECTS = ("volunteer", "subject", "participant", "person")  # labels that mean a person
NONE = "none"


class CompareError(IdentifyError):
    """These fits cannot be compared so; the text is one sentence."""


# Fits as they are read.


@dataclass(frozen=True)
class FitEntry:
    """One fit of a comparison.

    name: its group in the batch, else its folder; folder: where its files are; status, message: as in result.json,
    or "unreadable" with the reason; labels: those that all its logs share; mixed: labels that differ between its
    logs; result: empty where there is none.
    """

    name: str
    folder: Path
    status: str
    message: str
    labels: Mapping[str, str] = field(default_factory=dict)
    mixed: tuple[str, ...] = ()
    result: Result = field(default_factory=Result)

    @property
    def converged(self) -> bool:
        """Whether there is a result to compare."""
        return self.status == CONVERGED

    @property
    def fitted_logs(self) -> Sequence[LogResult]:
        """The logs that took part in the fit."""
        return [log for log in self.result.logs if not log.reason_left_out]


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
        groups = (read_json(folder / BATCH) or {}).get("groups")
        if (folder / RESULT).is_file():
            fits = [_read(folder, folder.name or str(folder), {})]
        elif isinstance(groups, list) and groups:
            fits = [_group(folder, group) for group in groups if isinstance(group, Mapping)]
        else:
            below = [p.parent for p in sorted(folder.rglob(RESULT)) if len(p.parts) - len(folder.parts) <= MANY]
            outer = [place for place in below if set(below).isdisjoint(place.parents)]
            fits = [_read(place, place.relative_to(folder).as_posix(), {}) for place in outer]
        for entry in fits:
            entries.setdefault(os.path.realpath(entry.folder), entry)
    return tuple(sorted(entries.values(), key=lambda entry: natural(entry.name)))


def _group(folder: Path, group: Mapping[str, object]) -> FitEntry:
    """One group of a batch: its result where there is one, else the reason why there is none."""
    name, stated = str(group.get("group") or "?"), group.get("labels")
    labels = {str(k): str(v) for k, v in stated.items() if v} if isinstance(stated, Mapping) else {}
    place = folder / str(group.get("folder") or name)
    if (place / RESULT).is_file():
        return _read(place, name, labels)
    job = read_json(place / JOB) or {}
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
    tables = [log.labels for log in result.logs if not log.reason_left_out] or [log.labels for log in result.logs]
    names = dict.fromkeys(name for table in tables for name in table)
    own = {label: tables[0][label] for label in names if len({table.get(label) for table in tables}) == 1}
    mixed = tuple(label for label in names if label not in own)
    labels = {key: value for key, value in labels.items() if key not in mixed} | own
    return FitEntry(name, folder, result.status, result.message, labels, mixed, result)


def of_one_pair(entry: FitEntry) -> FitEntry:
    """The fit with the parameters that its logs share, and rig quantities that its scene states with a tolerance as
    given: measurements of the rig determine them, so that no group differs in them."""
    parameters, rig = entry.result.parameters, entry.result.scene.get("rig")
    stated = rig.items() if isinstance(rig, Mapping) else ()
    known = {"damping" if n in DAMPING else n for n, v in stated if isinstance(v, Mapping) and "tolerance" in v}
    groups = {(p.per, p.group) for p in parameters.values() if p.per}
    several = {per for per, _ in groups if sum(per == other for other, _ in groups) > 1}
    shared = {n: p for n, p in parameters.items() if p.per not in several}
    shared = {n: replace(p, verdict="fixed") if n in known else p for n, p in shared.items()}
    return replace(entry, result=replace(entry.result, parameters=shared))


# What is pooled: the parameters of every fit on the scale where their errors are even.


@dataclass(frozen=True)
class Quantity:
    """A parameter that fits estimate: name, SI unit, whether it is pooled as a logarithm; its pooled answer, or the
    reason why there is none; missing: fits by name that do not have it, with the reason."""

    name: str
    unit: str
    logarithmic: bool
    pooled: Pooled | None = None
    reason: str = ""
    missing: tuple[tuple[str, str], ...] = ()

    def shown(self, y: float) -> float:
        """The value in SI units."""
        return float(np.exp(y)) if self.logarithmic else y

    def scaled(self, p: ParameterResult) -> tuple[float, float]:
        """Value and standard deviation of an estimate, as they are pooled."""
        value, error, (low, high) = p.value or 0.0, p.standard_error or 0.0, p.ends
        # An interval with two ends counts: where a profile was run, it is the better of the two.
        width = high - low if low is not None and high is not None else 0.0
        if self.logarithmic:
            value, error = float(np.log(value)), error / value
            width = float(np.log(high / low)) if low is not None and high is not None and 0.0 < low < high else 0.0
        return value, width / (2.0 * NORMAL) or error


def has_value(parameter: ParameterResult) -> bool:
    """Whether a parameter was estimated with a standard error."""
    return parameter.verdict in WITH_VALUE and parameter.value is not None and bool(parameter.standard_error)


# The comparison.


@dataclass(frozen=True)
class ComparisonQuestion:
    """What is asked: compare groups of label `by`; `subject`: label of the person, "none" for nobody, None: a usual
    one; `without`: fits left out by name."""

    by: str
    subject: str | None = None
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class Selection:
    """The fits that are compared, their setting, the label of the person, the other fits by name with the reason, and
    what the reader must know."""

    entries: tuple[FitEntry, ...]
    setting: Setting
    subject: str | None
    left_out: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """A finished comparison. entries: all fits that were found; selected: what is compared of them; groups: in natural
    order."""

    question: ComparisonQuestion
    entries: tuple[FitEntry, ...]
    selected: Selection
    quantities: tuple[Quantity, ...]
    groups: tuple[str, ...]

    @property
    def answered(self) -> Mapping[str, Pooled]:
        """The pooled quantities by name."""
        return {q.name: q.pooled for q in self.quantities if q.pooled is not None}


def compare(entries: Sequence[FitEntry], question: ComparisonQuestion) -> Comparison:
    """Compare groups of fits.

    Raises:
        CompareError: nothing to compare; the text says why.
    """
    selected = select([of_one_pair(entry) for entry in entries], question)
    tables = [entry.result.parameters for entry in selected.entries]
    names = dict.fromkeys(name for table in tables for name, p in table.items() if p.verdict in WITH_VALUE)
    if not names:
        raise CompareError("these fits have no parameter to compare; expected fits with parameters that are identified")
    quantities = tuple(_quantity(name, selected, len(names)) for name in names)
    groups = tuple(sorted(set(selected.setting.group), key=natural))
    return Comparison(question, tuple(entries), selected, quantities, groups)


def _quantity(name: str, selected: Selection, family: int) -> Quantity:
    """A parameter of the fits that are compared, one of so many."""
    column = [entry.result.parameters.get(name) for entry in selected.entries]
    known = [p for p in column if p is not None]
    positive = all((p.value or 0.0) > 0.0 for p in known if p.verdict in WITH_VALUE)
    logarithmic = positive and (name in SCALES or (name in DECLARED and DECLARED[name].scale == "log"))
    q, missing = Quantity(name, next((p.unit for p in known if p.unit), ""), logarithmic), []
    rows = np.full((len(column), 2), np.nan)
    for i, p in enumerate(column):
        if p is not None and has_value(p):
            rows[i] = q.scaled(p)
        else:
            missing.append((selected.entries[i].name, "not in its model" if p is None else p.verdict or "no value"))
    pooled, reason = None, ""
    try:
        pooled = pool(rows[:, 0], rows[:, 1] ** 2, selected.setting, family)
    except PoolingError as error:
        reason = str(error)
    return replace(q, pooled=pooled, reason=reason, missing=tuple(missing))


def select(entries: Sequence[FitEntry], question: ComparisonQuestion) -> Selection:
    """The fits that answer a question.

    Raises:
        CompareError: a label nobody has, no fit that converged, a name to leave out that is not there.
    """
    if not entries:
        raise CompareError("no fit was found in these folders; expected a result.json or a batch.json: give others")
    known = list(dict.fromkeys(name for entry in entries if entry.converged for name in entry.labels))
    for name in (question.by, question.subject):
        if name not in (None, NONE, *known) and not any(name in entry.mixed for entry in entries):
            others = ", ".join(map(visible, known[:12]))
            raise CompareError(
                f"no converged fit has the label {visible(str(name))!r}; expected "
                + (f"one of: {others}" if others else "fits with labels, and these have none")
                + f'; write labels = {{ {visible(str(name))} = "..." }} to the [[logs]] of a scene and fit it again, '
                "or name the column so in the manifest of a batch"
            )
    for name in set(question.without) - {entry.name for entry in entries}:
        raise CompareError(f"no fit is called {visible(name)!r}; expected a name of the table of fits")
    subject = question.subject if question.subject != NONE else None
    if question.subject is None:
        subject = next((s for s in SUBJECTS if s != question.by and any(s in e.labels for e in entries)), None)
    judged = [(entry, _reason(entry, question)) for entry in entries]
    kept = [entry for entry, reason in judged if not reason]
    left_out = tuple((entry.name, reason) for entry, reason in judged if reason)
    if not kept:
        why = visible(left_out[0][1])
        raise CompareError(f"no fit is left to compare ({why}); expected converged fits with {question.by!r}")
    people, notes = None, ["No label states whose fits these are: each fit counts as a person of its own."]
    if subject is not None:
        people = tuple(e.labels.get(subject) or f"unknown ({e.name})" for e in kept)
        unknown = sum(subject not in e.labels for e in kept)
        notes = [f"{unknown} fits state no one {subject}; each counts as another person."] if unknown else []
    same: dict[tuple[str, ...], list[str]] = {}
    for entry in kept:
        same.setdefault(tuple(sorted(log.sha256 or entry.name for log in entry.fitted_logs)), []).append(entry.name)
    for names in same.values():
        if len(names) > 1:
            notes.append(f"{' and '.join(map(visible, names))} are fits of the same logs: leave out one.")
    setting = Setting(tuple(e.labels[question.by] for e in kept), people)
    return Selection(tuple(kept), setting, subject, left_out, tuple(notes))


def _reason(entry: FitEntry, question: ComparisonQuestion) -> str:
    """Why a fit is not compared; "" where it is."""
    if entry.name in question.without:
        return "left out by --without"
    if not entry.converged:
        return f"{entry.status.replace('_', ' ')}: {entry.message}"
    if question.by in entry.mixed:
        return f"its logs differ in {question.by}; fit each {question.by} on its own"
    if question.by not in entry.labels:
        return f"it has no label {question.by}"
    if any(map(has_value, entry.result.parameters.values())):
        return ""
    verdicts: dict[str, list[str]] = {}
    for name, p in entry.result.parameters.items():
        verdicts.setdefault(p.verdict or "no value", []).append(name)
    listed = "; ".join(f"{', '.join(names)} {verdict}" for verdict, names in verdicts.items())
    return f"it has no value to compare: {listed or 'it has no parameter that its logs share'}"
