"""Which fits a comparison takes and what their labels say: groups, people, covariates; the rest with reasons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from identify.base.errors import IdentifyError
from identify.studies.fits import FitEntry, natural, tells, verdicts
from identify.studies.pooled import Setting

# Labels that mean a person, and numbers that are adjusted for without being asked, where the fits have them.
SUBJECTS = ("volunteer", "subject", "participant", "person")
COVARIATES = ("order", "trial", "hydration")
FACTORS = ("site", "material")  # names that are adjusted for in the same way: another site is no repetition
FIRST_CHOICES = ("material", "sample", "surface", "site")  # what a batch is compared by when nobody says
NONE = "none"
LONG = 60  # characters of a label in a sentence


class CompareError(IdentifyError):
    """These fits cannot be compared so; the text is one sentence."""


@dataclass(frozen=True)
class ComparisonQuestion:
    """What is asked: compare groups of label `by`; `subject`: label of the person, None without one; `adjust`:
    labels adjusted for (None: COVARIATES and FACTORS where the fits have them); `without`: fits left out by name."""

    by: str
    subject: str | None = None
    adjust: tuple[str, ...] | None = None
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class Taken:
    """The fits that are compared, their setting, the label of the person that was found, what is adjusted for, the
    others by name with the reason, and what the reader must know."""

    entries: tuple[FitEntry, ...]
    setting: Setting
    subject: str | None
    adjusted: tuple[str, ...]
    left_out: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups in natural order."""
        return tuple(sorted(set(self.setting.group), key=natural))

    @property
    def people(self) -> int:
        """How many people were measured; what the logs of several people share is no further person."""
        whose = self.setting.subject or ()
        return len({who for who, entry in zip(whose, self.entries, strict=True) if not entry.shared})


def levels(entries: Sequence[FitEntry]) -> dict[str, list[str]]:
    """Every label and its values among the fits that converged."""
    found: dict[str, set[str]] = {}
    for entry in entries:
        for name, value in entry.labels.items() if entry.converged else ():
            found.setdefault(name, set()).add(value)
    return {name: sorted(values, key=natural) for name, values in found.items()}


def usual(entries: Sequence[FitEntry]) -> str | None:
    """The label a batch is compared by when nobody says: a usual name, else the first that makes a few groups."""
    known = levels(entries)
    usable = {name: values for name, values in known.items() if 2 <= len(values) <= max(2, len(entries) // 2)}
    first = next((name for name in FIRST_CHOICES if name in usable), None)
    others = [
        n
        for n in usable
        if n not in SUBJECTS + COVARIATES + FACTORS and not all(number(v) is not None for v in usable[n])
    ]
    return first or (others[0] if others else None)


def number(text: str) -> float | None:
    """A label as a number, None where it is none ("12", "12.5 %", "12,5")."""
    try:
        value = float(text.strip().removesuffix("%").strip().replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def take(entries: Sequence[FitEntry], question: ComparisonQuestion) -> Taken:
    """The fits that answer a question.

    Raises:
        CompareError: a label nobody has, no fit that converged, a name to leave out that is not there.
    """
    _check(entries, question)
    subject = question.subject if question.subject != NONE else None
    if question.subject is None:
        subject = next((s for s in SUBJECTS if s != question.by and any(s in e.labels for e in entries)), None)
    left_out: list[tuple[str, str]] = []
    kept = []
    for entry in entries:
        reason = _reason(entry, question)
        if reason:
            left_out.append((entry.name, reason))
        else:
            kept.append(entry)
    if not kept:
        reason = left_out[0][1] if left_out else "there is none"
        raise CompareError(
            f"no fit is left to compare ({_short(reason)}); expected converged fits with {question.by!r}"
        )
    kept, lost, factors, covariates, notes = _adjusted(kept, question)
    if subject is not None:
        notes += _nameless(kept, subject)
    notes += _twice(kept)
    return Taken(
        tuple(kept),
        Setting(
            group=tuple(e.labels[question.by] for e in kept),
            subject=None if subject is None else tuple(_who(e, subject) for e in kept),
            factors=factors,
            covariates=covariates,
        ),
        subject,
        (*factors, *covariates),
        tuple(left_out + lost),
        tuple(notes),
    )


def _check(entries: Sequence[FitEntry], question: ComparisonQuestion) -> None:
    if not entries:
        raise CompareError("no fit was found in these folders; expected a result.json or an index.csv: give others")
    known = levels(entries)
    asked = [question.by, *(question.adjust or ())]
    asked += [question.subject] if question.subject not in (None, NONE) else []
    for name in asked:
        if name != NONE and name not in known and not any(name in entry.mixed for entry in entries):
            told = ", ".join(_short(label) for label in list(known)[:12])
            raise CompareError(
                f"no converged fit has the label {_short(str(name))!r}; expected "
                + (f"one of: {told}" if told else "fits with labels, and these have none")
                + f'; write labels = {{ {_short(str(name))} = "..." }} to the [[logs]] of a scene and fit it again, or '
                "name the column so in the manifest of a batch"
            )
    names = {name for entry in entries for name in (entry.name, entry.whole)}
    for name in question.without:
        if name not in names:
            raise CompareError(f"no fit is called {_short(name)!r}; expected a name of the table of fits")


def _reason(entry: FitEntry, question: ComparisonQuestion) -> str:
    """Why a fit is not compared, or nothing."""
    if entry.name in question.without or entry.whole in question.without:
        return "left out as asked"
    if not entry.converged:
        return f"{entry.status.replace('_', ' ')}: {entry.message}"
    if question.by in entry.mixed:
        shared = f"what its logs share ({', '.join(entry.result.parameters)}) is of no one {question.by}"
        return shared if entry.shared else f"its logs differ in {question.by}"
    if question.by not in entry.labels:
        return f"it has no label {question.by}"
    return "" if tells(entry) else f"it tells nothing: {verdicts(entry)}"


def _adjusted(
    kept: list[FitEntry], question: ComparisonQuestion
) -> tuple[
    list[FitEntry],
    list[tuple[str, str]],
    dict[str, tuple[str, ...]],
    dict[str, tuple[float, ...]],
    list[str],
]:
    """Labels to adjust for as factors and numbers; fits without them are left out where they were asked for."""
    asked = question.adjust is not None
    usual_ones = (*COVARIATES, *FACTORS)
    wanted = [n for n in (usual_ones if question.adjust is None else question.adjust) if n not in (question.by, NONE)]
    lost: list[tuple[str, str]] = []
    notes: list[str] = []
    for name in wanted if asked else ():
        lost += [(e.name, f"it has no label {name}") for e in kept if name not in e.labels]
        kept = [e for e in kept if name in e.labels]
    if not kept:
        raise CompareError(f"no fit has all of the labels {', '.join(map(_short, wanted))}; adjust for fewer")
    factors: dict[str, tuple[str, ...]] = {}
    covariates: dict[str, tuple[float, ...]] = {}
    for name in wanted:
        values = [e.labels.get(name) for e in kept]
        numbers = [number(v) for v in values if v is not None]
        if len(numbers) < len(kept):
            if numbers:
                notes.append(f"{name} is told of {len(numbers)} of {len(kept)} fits only: not adjusted for.")
        elif all(v is not None for v in numbers) and name not in FACTORS:
            covariates[name] = tuple(v for v in numbers if v is not None)
        elif asked or name in FACTORS:
            factors[name] = tuple(str(v) for v in values)
        else:
            notes.append(f"{name} is not a number everywhere: not adjusted for (--adjust takes it as a factor).")
    return kept, lost, factors, covariates, notes


def _who(entry: FitEntry, subject: str) -> str:
    return entry.labels.get(subject) or f"nobody told ({entry.name})"


def _nameless(kept: Sequence[FitEntry], subject: str) -> list[str]:
    """What to say of fits that do not tell whose they are."""
    shared = sum(subject in e.mixed and e.shared for e in kept)
    mixed = sum(subject in e.mixed and not e.shared for e in kept)
    told = sum(subject in e.labels for e in kept)
    notes = []
    if shared:
        notes.append(f"{shared} fits tell some parameters of several {subject}s at once; there each is one person.")
    if mixed:
        notes.append(f"{mixed} fits join logs of different {subject}s; each counts as one person of its own.")
    if told + mixed + shared < len(kept):
        notes.append(
            f"{len(kept) - told - mixed - shared} fits do not tell the {subject}; each counts as another person."
        )
    return notes


def _twice(kept: Sequence[FitEntry]) -> list[str]:
    """Fits that were made from the very same logs and would count twice."""
    made_from: dict[tuple[str, ...], list[str]] = {}
    for entry in kept:
        key = tuple(sorted(log.sha256 or "" for log in entry.taken))
        if key and all(key):
            made_from.setdefault(key, []).append(entry.name)
    return [
        f"{' and '.join(map(_short, n))} are fits of the same logs: leave out one." for n in made_from.values() if n[1:]
    ]


def _short(text: str) -> str:
    return text if len(text) <= LONG else text[:LONG] + "…"
