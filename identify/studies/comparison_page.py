"""report.html of a batch or a comparison: one file that opens from disk, sorts its tables itself and asks nobody."""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup

from data_io.atomic import atomic_write
from identify.base.errors import IdentifyError
from identify.base.wording import DASH, Scale, decimals, number, places_for, scale_for
from identify.report.first_screen import templates
from identify.report.report_wording import VERDICT_MARK, plain_symbol
from identify.report.shown_error import scatter, shown_error
from identify.studies import comparison_views as views
from identify.studies.compare import Comparison, compare
from identify.studies.comparison_figures import curves, excerpt, forest, thumbnail
from identify.studies.comparison_views import REASON, PageCell, PageTable, table
from identify.studies.fits import PAGE, FitEntry, count, natural, read_fits
from identify.studies.labels import CompareError, ComparisonQuestion, usual, visible
from identify.studies.operating_points import Common, GroupAnswer, common, group_answers
from identify.studies.reporting import items


@dataclass(frozen=True)
class Answers:
    """What follows at common operating points: the ground they stand on, the answers, and why there are none."""

    ground: Common | None
    groups: tuple[GroupAnswer, ...]
    reason: str = ""


def answered(comparison: Comparison, speeds: Sequence[float] = (), normal_force: float | None = None) -> Answers:
    """Ask the nonlinear model about every group at common points; a reason where that cannot be."""
    try:
        ground = common(comparison, speeds, normal_force)
        return Answers(ground, group_answers(comparison, ground))
    except IdentifyError as error:
        return Answers(None, (), str(error))


def write_batch_report(directory: str | Path) -> Path:
    """Write DIR/report.html over the fits of a batch folder; returns its path.

    Groups are compared by the label `material` or the next usual one, where there is any. A fit that cannot be read
    is a row with the reason. OSError where the page cannot be written.
    """
    directory = Path(directory)
    entries = read_fits([directory])
    by, reason, comparison = usual(entries), "", None
    if by is not None:
        try:
            comparison = compare(entries, ComparisonQuestion(by))
        except CompareError as error:
            reason = str(error)
    answers = None if comparison is None else answered(comparison)
    path = directory / PAGE
    with atomic_write(path) as handle:
        handle.write(render(directory.resolve().name, entries, comparison, answers, directory, reason))
    return path


def render(
    title: str,
    entries: Sequence[FitEntry],
    comparison: Comparison | None,
    answers: Answers | None,
    home: Path,
    reason: str = "",
) -> str:
    """The text of the page; `home`: the folder it will stand in, `reason`: why there is no comparison."""
    environment = templates("identify.studies", "identify.report")
    environment.filters["visible"] = visible
    script = environment.get_template("page.js").render()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return environment.get_template("batch.html.j2").render(
        title=title,
        style=Markup(environment.get_template("style.css").render() + environment.get_template("batch.css").render()),
        script=Markup(script),
        digest=digest,
        counts=_counts(entries, comparison),
        fits=_fits(entries, home, comparison),
        marks=_marks(),
        pictures=_pictures(entries, home, comparison),
        more_pictures=max(len(entries) - MOST_PICTURES, 0),
        without_result=_without_result(entries, home),
        rejected=_rejected_logs(entries),
        reporting=views.reporting(items(entries)),
        reason=reason,
        comparison=None if comparison is None else _told(comparison, answers, home),
    )


def _counts(entries: Sequence[FitEntry], comparison: Comparison | None) -> list[tuple[str, str, str]]:
    """Tiles at the top: label, number, meaning."""
    good = sum(entry.converged for entry in entries)
    tiles = [("fits", str(len(entries)), f"{sum(len(e.logs) for e in entries)} logs")]
    tiles.append(("converged", str(good), f"{len(entries) - good} without a result"))
    if comparison is not None:
        taken = comparison.taken
        compared = count(taken.entries)
        tiles.append(("compared", str(compared), f"{len(entries) - compared} left out"))
        tiles.append((comparison.question.by, str(len(comparison.groups)), "groups"))
        if taken.subject and taken.setting.subject:
            tiles.append((taken.subject, str(taken.people), "people"))
        tiles.append(("do not belong", str(len(comparison.odd_fits)), "fits flagged, still counted"))
    return tiles


def _told(comparison: Comparison, answers: Answers | None, home: Path) -> dict[str, object]:
    """What the template says of a comparison."""
    groups = answers.groups if answers else ()
    ground = answers.ground if answers else None
    marks = ground.speeds if ground else ()
    untold = [
        (q.quantity.name, len(q.untold), ", ".join(sorted({reason for _, reason in q.untold})))
        for q in comparison.quantities
        if q.untold
    ]
    return {
        "by": comparison.question.by,
        "who": comparison.taken.subject,
        "sentences": views.together(views.sentences(comparison)),
        "parameters": views.parameters(comparison),
        "differences": views.differences(comparison),
        "scatter": views.scatter(comparison),
        "operating": views.operating(comparison.question.by, groups, ground.normal_force if ground else None),
        "no_operating": answers.reason if answers else "",
        "ground": ground,
        "forests": [forest(comparison, entry) for entry in comparison.quantities if entry.pooled],
        "curves": [c for c in (curves(groups, "friction", marks), curves(groups, "amplitude", marks)) if c],
        "left_out": _left_out(comparison, home),
        "odd": _odd_fits(comparison, home),
        "untold": untold,
        "notes": notes(comparison),
        "family": len(comparison.values.quantities),
    }


def notes(comparison: Comparison) -> list[str]:
    """What the reader must know of how the groups were compared, in sentences."""
    taken, by = comparison.taken, comparison.question.by
    out = []
    if taken.subject is None:
        out.append("No label says whose fits these are: each fit counts as a person of its own.")
    if taken.adjusted:
        out.append(f"Means are adjusted for {', '.join(taken.adjusted)}: they stand for the average of these fits.")
    dropped = {name: why for q in comparison.quantities if q.pooled for name, why in q.pooled.design.dropped.items()}
    who = taken.subject or "person"
    for name, why in dropped.items():
        words = [w.replace("subject", who).replace("group", by) for w in (name, why)]
        out.append(f"{words[0][:1].upper()}{words[0][1:]} is not told on its own: {words[1]}.")
    return [*out, *taken.notes]


# ----------------------------------------------------------------------------------------------------------------------
# The fits: their table with links, those left out, those that do not belong, and a picture of each.
# ----------------------------------------------------------------------------------------------------------------------

MOST_LABELS = 6
MOST_PARAMETERS = 8
MOST_PICTURES = 400
PLAIN = "identified"  # a verdict that is not marked


@dataclass(frozen=True)
class Thumbnail:
    """One fit in small: name, link to its page, status with its kind, drawing (empty without curves), words."""

    name: str
    link: str
    status: str
    kind: str
    drawing: Markup
    words: str


def _link(entry: FitEntry, home: Path) -> str:
    """The address of a fit's page from a page in `home`; empty where there is none."""
    page = entry.folder / PAGE
    if not entry.document or not page.is_file():
        return ""
    return quote(Path(os.path.relpath(os.path.realpath(page), os.path.realpath(home))).as_posix())


def _fits(entries: Sequence[FitEntry], home: Path, comparison: Comparison | None) -> PageTable:
    """Every fit with its status, labels and parameters; flagged where it does not belong."""
    labels = _labels(entries, comparison)
    names = list(dict.fromkeys(n for e in entries for n in e.result.parameters))[:MOST_PARAMETERS]
    units = {name: _unit(entries, name) for name in names}
    odd = comparison.odd_fits if comparison else frozenset()
    heads = ["fit", "status", *labels, "misfit"]
    heads += [f"{plain_symbol(n)}{f' [{units[n].unit}]' if units[n].unit else ''}" for n in names]
    rows = []
    for entry in entries:
        flag = "does not belong?" if entry.name in odd else ""
        row = [PageCell(entry.name, flag, link=_link(entry, home), sort=entry.name), _status(entry)]
        row += [PageCell(entry.labels.get(label, DASH), sort=entry.labels.get(label)) for label in labels]
        chi2 = None if entry.result.gate is None else entry.result.gate.chi2_per_sample
        row.append(PageCell(number(chi2, 3), sort=chi2))
        row += [_parameter(entry, name, units[name].factor) for name in names]
        rows.append(row)
    return table("fits", heads, rows)


def _labels(entries: Sequence[FitEntry], comparison: Comparison | None) -> list[str]:
    """Labels worth a column: those of the question first, then those that differ between fits."""
    names = list(dict.fromkeys(name for e in entries for name in e.labels))
    asked = [comparison.question.by, comparison.taken.subject, *comparison.taken.adjusted] if comparison else []
    differing = [n for n in names if len({e.labels.get(n) for e in entries}) > 1]
    return list(dict.fromkeys(str(n) for n in [*asked, *differing] if n in names))[:MOST_LABELS]


def _unit(entries: Sequence[FitEntry], name: str) -> Scale:
    told = [p for e in entries if (p := e.result.parameters.get(name)) is not None]
    values = sorted(abs(p.value) for p in told if p.value is not None)
    return scale_for(values[len(values) // 2] if values else None, next((p.unit for p in told if p.unit), ""))


def _status(entry: FitEntry) -> PageCell:
    words = entry.status.replace("_", " ")
    return PageCell(words, chip="good" if entry.converged else "bad", sort=words)


def _parameter(entry: FitEntry, name: str, factor: float) -> PageCell:
    told = entry.result.parameters.get(name)
    if told is None or told.value is None:
        return PageCell(DASH)
    value, error, scattered = told.value, shown_error(told), scatter(told)
    places = places_for(scattered / factor, value / factor) if scattered else places_for(None, value / factor) - 1
    mark = VERDICT_MARK.get(told.verdict, "")
    note = f"± {decimals(error / factor, places)}" if error else told.verdict
    return PageCell(
        decimals(value / factor, places) + (f" {mark}" if mark and told.verdict != PLAIN else ""), note, sort=value
    )


def _marks() -> str:
    """What stands beside a value, in words."""
    return ", ".join(f"{mark} {verdict}" for verdict, mark in VERDICT_MARK.items() if verdict != PLAIN)


def _without_result(entries: Sequence[FitEntry], home: Path) -> PageTable:
    """Fits that gave no result, with the reason."""
    rows = [
        [
            PageCell(e.name, link=_link(e, home), sort=e.name),
            _status(e),
            PageCell(e.message, sort=e.message, most=REASON),
        ]
        for e in entries
        if not e.converged
    ]
    return table("without-result", ["fit", "status", "reason"], rows)


def _left_out(comparison: Comparison, home: Path) -> PageTable:
    """Fits with a result that took no part all the same, with the reason."""
    by_name = {entry.name: entry for entry in comparison.parts if entry.converged}
    rows = [
        [PageCell(name, link=_link(by_name[name], home), sort=name), PageCell(reason, sort=reason, most=REASON)]
        for name, reason in sorted(comparison.taken.left_out, key=lambda item: natural(item[0]))
        if name in by_name
    ]
    return table("left-out", ["fit", "reason"], rows)


def _rejected_logs(entries: Sequence[FitEntry]) -> PageTable:
    """Logs that took no part in their fit, with the reason."""
    rows = []
    for entry in entries:
        for log in entry.logs if entry.converged else ():
            if log.reason_left_out:
                named, reason = PageCell(log.name, sort=log.name), PageCell(log.reason_left_out, most=REASON)
                rows.append([named, PageCell(entry.name, sort=entry.name), reason])
    return table("rejected-logs", ["log", "fit", "reason"], rows)


def _odd_fits(comparison: Comparison, home: Path) -> PageTable:
    """Fits that do not belong, by name."""
    by_name = {entry.name: entry for entry in comparison.parts}
    rows = [
        [
            PageCell(o.name, link=_link(by_name[o.name], home), sort=o.name),
            PageCell(plain_symbol(o.quantity), sort=o.quantity),
            PageCell(f"{number(o.z, 3)} sd", sort=o.z),
            PageCell(f"{o.p:.2g}", sort=o.p),
        ]
        for o in comparison.odd
    ]
    return table("odd", ["fit", "parameter", "off by", "chance among all fits"], rows)


def _pictures(entries: Sequence[FitEntry], home: Path, comparison: Comparison | None) -> list[Thumbnail]:
    """A small picture of every fit, in the order of the table; at most MOST_PICTURES."""
    odd = comparison.odd_fits if comparison else frozenset()
    out = []
    for entry in entries[:MOST_PICTURES]:
        part = excerpt(entry)
        words = "does not belong?" if entry.name in odd else "" if entry.converged else entry.status.replace("_", " ")
        kind = "good" if entry.converged and not words else "fair" if entry.converged else "bad"
        out.append(Thumbnail(entry.name, _link(entry, home), words, kind, thumbnail(part), part.words))
    return out
