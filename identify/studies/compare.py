"""Finished fits in, comparison out: fits as they are read, which of them are compared, every parameter pooled."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import DocumentError, IdentifyError
from identify.base.quantiles import NORMAL
from identify.base.result import LogResult, ParameterResult, Result
from identify.effects import ALL
from identify.scene.tables import DAMPING
from identify.scene.values import EACH_LOG
from identify.studies.batch_store import BATCH, CONVERGED, JOB, RESULT
from identify.studies.pooled import Pooled, PoolingError, Setting, pool
from identify.uneven.answer import SCALES

Array = NDArray[np.float64]

PAGE = "report.html"
MANY = 4  # folders below a given one in which results are sought
UNREADABLE = "unreadable"
WITH_VALUE = ("identified", "weak")  # verdicts of parameters that are pooled
DECLARED = {p.name: p for effect in ALL for p in effect.parameters}
SUBJECTS = ("volunteer", "subject", "participant", "person")  # labels that mean a person
FIRST_CHOICES = ("material", "sample", "surface", "site")  # what a batch is compared by without --by
NOT_CHOSEN = (*SUBJECTS, "order", "trial", "hydration")
NONE = "none"
LONG = 60  # characters of a label in a sentence


class CompareError(IdentifyError):
    """These fits cannot be compared so; the text is one sentence."""


# ----------------------------------------------------------------------------------------------------------------------
# Fits as they are read, and a fit with parameters that differ between its logs taken apart.
# ----------------------------------------------------------------------------------------------------------------------


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
        groups = _document(folder / BATCH).get("groups")
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


def parts(entry: FitEntry) -> tuple[FitEntry, ...]:
    """What counts for itself of a fit whose parameters differ between its logs: first what its logs share, with the
    labels that all of them have, then each group of logs with its own parameters under their plain names and its own
    labels; of all other fits the fit itself."""
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
    out = []
    if estimated:
        result = replace(entry.result, parameters=common)
        out.append(replace(entry, fit=entry.name, elsewhere=apart - estimated, result=result))
    for (per, value), own in keys.items():
        by_log, numbered = per == EACH_LOG, enumerate(entry.result.logs, 1)
        logs = tuple(log for n, log in numbered if value == (f"log {n}" if by_log else log.labels.get(per, "")))
        shared, mixed = _shared_labels(logs)
        kept = {name: text for name, text in entry.labels.items() if name not in mixed}
        part = replace(
            entry,
            name=f"{entry.name}, {value if by_log else f'{per} {value}'}",
            labels=kept | shared | ({} if by_log else {per: value}),
            mixed=tuple(name for name in mixed if name != per),
            result=replace(entry.result, parameters={n: entry.result.parameters[k] for n, k in own.items()}, logs=logs),
            fit=entry.name,
            elsewhere=(estimated | apart) - set(own),
        )
        out.append(part)
    return tuple(out)


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
        column = [table[name] for table in tables if name in table]
        positive = all((p.value or 0.0) > 0.0 for p in column if p.verdict in WITH_VALUE)
        logarithmic = name in SCALES or (name in DECLARED and DECLARED[name].scale == "log")
        quantities.append(Quantity(name, next((p.unit for p in column if p.unit), ""), logarithmic and positive))
    y, sd = np.full((2, len(entries), len(quantities)), np.nan)
    missing: dict[str, list[tuple[int, str]]] = {name: [] for name in names}
    for i, entry in enumerate(entries):
        for k, q in enumerate(quantities):
            p = tables[i].get(q.name)
            if p is not None and has_value(p):
                value, error, (low, high) = p.value or 0.0, p.standard_error or 0.0, p.ends
                # An interval with two ends counts: where a profile was run, it is the better of the two.
                y[i, k], width = value, (high - low) if low is not None and high is not None else 0.0
                if q.logarithmic:
                    y[i, k], error = np.log(value), error / value
                    width = np.log(high / low) if low is not None and high is not None and 0.0 < low < high else 0.0
                sd[i, k] = width / (2.0 * NORMAL) or error
            elif q.name not in entry.elsewhere:
                missing[q.name].append((i, "not in its model" if p is None else p.verdict or "no value"))
    return Values(tuple(quantities), y, sd**2, {name: tuple(fits) for name, fits in missing.items()})


def has_value(parameter: ParameterResult) -> bool:
    """Whether a parameter was estimated with a standard error."""
    return parameter.verdict in WITH_VALUE and parameter.value is not None and bool(parameter.standard_error)


# ----------------------------------------------------------------------------------------------------------------------
# The comparison.
# ----------------------------------------------------------------------------------------------------------------------


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

    @property
    def people(self) -> int:
        """How many people were measured; what the logs of several people share is no further person."""
        whose = self.setting.subject or ()
        return len({who for who, entry in zip(whose, self.entries, strict=True) if not entry.shared})


@dataclass(frozen=True)
class PooledQuantity:
    """A quantity and its pooled answer, or the reason why there is none; missing: fits by name that do not have it."""

    quantity: Quantity
    pooled: Pooled | None
    reason: str
    missing: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Comparison:
    """A finished comparison. entries: all fits that were found; parts: what counts for itself of them; selected: what
    is compared of that; groups: in natural order."""

    question: ComparisonQuestion
    entries: tuple[FitEntry, ...]
    parts: tuple[FitEntry, ...]
    selected: Selection
    values: Values
    quantities: tuple[PooledQuantity, ...]
    groups: tuple[str, ...]

    @property
    def answered(self) -> Mapping[str, Pooled]:
        """The pooled quantities by name."""
        return {q.quantity.name: q.pooled for q in self.quantities if q.pooled is not None}


def compare(entries: Sequence[FitEntry], question: ComparisonQuestion) -> Comparison:
    """Compare groups of fits.

    Raises:
        CompareError: nothing to compare; the text says why.
    """
    every = tuple(part for entry in entries for part in parts(with_known_rig(entry)))
    selected = select(every, question)
    table = values(selected.entries)
    if not table.quantities:
        raise CompareError("these fits have no parameter to compare; expected fits with parameters that are identified")
    names = [e.name for e in selected.entries]
    quantities = []
    for k, quantity in enumerate(table.quantities):
        missing = tuple((names[i], reason) for i, reason in table.missing[quantity.name])
        try:
            pooled = pool(table.y[:, k], table.variance[:, k], selected.setting, len(table.quantities))
        except PoolingError as error:
            quantities.append(PooledQuantity(quantity, None, str(error), missing))
            continue
        quantities.append(PooledQuantity(quantity, pooled, "", missing))
    groups = tuple(sorted(set(selected.setting.group), key=natural))
    return Comparison(question, tuple(entries), every, selected, table, tuple(quantities), groups)


def usual(entries: Sequence[FitEntry]) -> str | None:
    """The label a batch is compared by without --by: a usual name, else the first that makes a few groups and is not a
    number ("12", "12.5 %", "12,5")."""
    number = re.compile(r"\s*[-+]?\d+([.,]\d*)?\s*%?\s*")
    known = {n: v for n, v in _levels(entries).items() if 2 <= len(v) <= max(2, len(entries) // 2)}
    first = [name for name in FIRST_CHOICES if name in known]
    others = [n for n, v in known.items() if n not in NOT_CHOSEN and not all(map(number.fullmatch, v))]
    return next(iter([*first, *others]), None)


def _levels(entries: Sequence[FitEntry]) -> dict[str, set[str]]:
    """Every label and its values among the fits that converged."""
    levels: dict[str, set[str]] = {}
    for entry in entries:
        for name, value in entry.labels.items() if entry.converged else ():
            levels.setdefault(name, set()).add(value)
    return levels


def select(entries: Sequence[FitEntry], question: ComparisonQuestion) -> Selection:
    """The fits that answer a question.

    Raises:
        CompareError: a label nobody has, no fit that converged, a name to leave out that is not there.
    """
    _check(entries, question)
    subject = question.subject if question.subject != NONE else None
    if question.subject is None:
        subject = next((s for s in SUBJECTS if s != question.by and any(s in e.labels for e in entries)), None)
    judged = [(entry, _reason(entry, question)) for entry in entries]
    kept = [entry for entry, reason in judged if not reason]
    left_out = tuple((entry.name, reason) for entry, reason in judged if reason)
    if not kept:
        why = _short(left_out[0][1])
        raise CompareError(f"no fit is left to compare ({why}); expected converged fits with {question.by!r}")
    notes = ["No label states whose fits these are: each fit counts as a person of its own."]
    people = None
    if subject is not None:
        people = tuple(e.labels.get(subject) or f"unknown ({e.name})" for e in kept)
        shared = sum(subject in e.mixed and e.shared for e in kept)
        mixed = sum(subject in e.mixed and not e.shared for e in kept)
        unknown = sum(subject not in e.labels and subject not in e.mixed for e in kept)
        counted = (
            (shared, f"have some parameters of several {subject}s at once; there each is one person."),
            (mixed, f"join logs of different {subject}s; each counts as one person of its own."),
            (unknown, f"do not state the {subject}; each counts as another person."),
        )
        notes = [f"{number} fits {words}" for number, words in counted if number]
    same: dict[tuple[str, ...], list[str]] = {}
    for entry in kept:
        same.setdefault(tuple(sorted(log.sha256 or entry.name for log in entry.fitted_logs)), []).append(entry.name)
    for names in same.values():
        if len(names) > 1:
            notes.append(f"{' and '.join(map(_short, names))} are fits of the same logs: leave out one.")
    setting = Setting(tuple(e.labels[question.by] for e in kept), people)
    return Selection(tuple(kept), setting, subject, left_out, tuple(notes))


def _check(entries: Sequence[FitEntry], question: ComparisonQuestion) -> None:
    if not entries:
        raise CompareError("no fit was found in these folders; expected a result.json or a batch.json: give others")
    known = _levels(entries)
    for name in (question.by, question.subject):
        if name not in (None, NONE, *known) and not any(name in entry.mixed for entry in entries):
            others = ", ".join(_short(label) for label in list(known)[:12])
            raise CompareError(
                f"no converged fit has the label {_short(str(name))!r}; expected "
                + (f"one of: {others}" if others else "fits with labels, and these have none")
                + f'; write labels = {{ {_short(str(name))} = "..." }} to the [[logs]] of a scene and fit it again, or '
                "name the column so in the manifest of a batch"
            )
    names = {name for entry in entries for name in (entry.name, entry.whole)}
    for name in question.without:
        if name not in names:
            raise CompareError(f"no fit is called {_short(name)!r}; expected a name of the table of fits")


def _reason(entry: FitEntry, question: ComparisonQuestion) -> str:
    """Why a fit is not compared; "" where it is."""
    parameters = entry.result.parameters
    if {entry.name, entry.whole} & set(question.without):
        return "left out by --without"
    if not entry.converged:
        return f"{entry.status.replace('_', ' ')}: {entry.message}"
    if question.by in entry.mixed:
        shared = f"what its logs share ({', '.join(parameters)}) is of no one {question.by}"
        return shared if entry.shared else f"its logs differ in {question.by}"
    if question.by not in entry.labels:
        return f"it has no label {question.by}"
    if any(map(has_value, parameters.values())):
        return ""
    verdicts: dict[str, list[str]] = {}
    for name, p in parameters.items():
        verdicts.setdefault(p.verdict or "no value", []).append(name)
    listed = "; ".join(f"{', '.join(names)} {verdict}" for verdict, names in verdicts.items())
    return f"it has no value to compare: {listed or 'it has no parameter'}"


def _short(text: str) -> str:
    return text if len(text) <= LONG else text[:LONG] + "…"
