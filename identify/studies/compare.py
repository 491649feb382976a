"""Fits in, comparison out: which fits are compared, every parameter pooled by group, outliers by name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from identify.base.errors import IdentifyError
from identify.studies.fits import FitEntry, Quantity, Values, has_value, natural, parts, values, with_known_rig
from identify.studies.pooled import Pooled, PoolingError, Setting, pool

SUBJECTS = ("volunteer", "subject", "participant", "person")  # labels that mean a person
FIRST_CHOICES = ("material", "sample", "surface", "site")  # what a batch is compared by without --by
NOT_CHOSEN = (*SUBJECTS, "order", "trial", "hydration")
NONE = "none"
LONG = 60  # characters of a label in a sentence


class CompareError(IdentifyError):
    """These fits cannot be compared so; the text is one sentence."""


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
class OddFit:
    """A fit that does not belong: its name, the quantity, how many standard deviations it is off, the chance."""

    name: str
    quantity: str
    z: float
    p: float


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
    odd: tuple[OddFit, ...]
    groups: tuple[str, ...]

    @property
    def answered(self) -> Mapping[str, Pooled]:
        """The pooled quantities by name."""
        return {q.quantity.name: q.pooled for q in self.quantities if q.pooled is not None}

    @property
    def odd_fits(self) -> frozenset[str]:
        """The fits that do not belong, or a part of which does not."""
        odd = {o.name for o in self.odd}
        return frozenset(part.whole for part in self.parts if part.name in odd)


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
    quantities, odd = [], []
    for k, quantity in enumerate(table.quantities):
        missing = tuple((names[i], reason) for i, reason in table.missing[quantity.name])
        try:
            pooled = pool(table.y[:, k], table.variance[:, k], selected.setting, len(table.quantities))
        except PoolingError as error:
            quantities.append(PooledQuantity(quantity, None, str(error), missing))
            continue
        quantities.append(PooledQuantity(quantity, pooled, "", missing))
        odd += [OddFit(names[pooled.rows[o.row]], quantity.name, o.z, o.p) for o in pooled.outliers]
    groups = tuple(sorted(set(selected.setting.group), key=natural))
    return Comparison(question, tuple(entries), every, selected, table, tuple(quantities), tuple(odd), groups)


def usual(entries: Sequence[FitEntry]) -> str | None:
    """The label a batch is compared by without --by: a usual name, else the first that makes a few groups."""
    known = {n: v for n, v in _levels(entries).items() if 2 <= len(v) <= max(2, len(entries) // 2)}
    first = [name for name in FIRST_CHOICES if name in known]
    others = [n for n, v in known.items() if n not in NOT_CHOSEN and not all(map(_is_number, v))]
    return next(iter([*first, *others]), None)


def _levels(entries: Sequence[FitEntry]) -> dict[str, set[str]]:
    """Every label and its values among the fits that converged."""
    found: dict[str, set[str]] = {}
    for entry in entries:
        for name, value in entry.labels.items() if entry.converged else ():
            found.setdefault(name, set()).add(value)
    return found


def _is_number(text: str) -> bool:
    """Whether a label is a number ("12", "12.5 %", "12,5")."""
    try:
        return math.isfinite(float(text.strip().removesuffix("%").strip().replace(",", ".")))
    except ValueError:
        return False


def select(entries: Sequence[FitEntry], question: ComparisonQuestion) -> Selection:
    """The fits that answer a question.

    Raises:
        CompareError: a label nobody has, no fit that converged, a name to leave out that is not there.
    """
    _check(entries, question)
    subject = question.subject if question.subject != NONE else None
    if question.subject is None:
        subject = next((s for s in SUBJECTS if s != question.by and any(s in e.labels for e in entries)), None)
    reasons = [_reason(entry, question) for entry in entries]
    kept = [entry for entry, reason in zip(entries, reasons, strict=True) if not reason]
    left_out = tuple((entry.name, reason) for entry, reason in zip(entries, reasons, strict=True) if reason)
    if not kept:
        raise CompareError(
            f"no fit is left to compare ({_short(left_out[0][1])}); expected converged fits with {question.by!r}"
        )
    group, people = tuple(e.labels[question.by] for e in kept), None
    notes = []
    if subject is None:
        notes.append("No label states whose fits these are: each fit counts as a person of its own.")
    else:
        people = tuple(e.labels.get(subject) or f"unknown ({e.name})" for e in kept)
        notes += _people_notes(kept, subject)
    same: dict[tuple[str, ...], list[str]] = {}
    for entry in kept:
        same.setdefault(tuple(sorted(log.sha256 or entry.name for log in entry.fitted_logs)), []).append(entry.name)
    for names in same.values():
        if len(names) > 1:
            notes.append(f"{' and '.join(map(_short, names))} are fits of the same logs: leave out one.")
    return Selection(tuple(kept), Setting(group, people), subject, left_out, tuple(notes))


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


def _people_notes(kept: Sequence[FitEntry], subject: str) -> list[str]:
    """Which fits are of several people or of somebody unknown."""
    shared = sum(subject in e.mixed and e.shared for e in kept)
    mixed = sum(subject in e.mixed and not e.shared for e in kept)
    unknown = sum(subject not in e.labels and subject not in e.mixed for e in kept)
    notes = [
        (shared, f"{shared} fits have some parameters of several {subject}s at once; there each is one person."),
        (mixed, f"{mixed} fits join logs of different {subject}s; each counts as one person of its own."),
        (unknown, f"{unknown} fits do not state the {subject}; each counts as another person."),
    ]
    return [sentence for number, sentence in notes if number]


def _short(text: str) -> str:
    return text if len(text) <= LONG else text[:LONG] + "…"
