"""report.html of a batch or a comparison: one file that opens from disk, sorts its tables itself and asks nobody."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from data_io.atomic import atomic_write
from identify.base.errors import IdentifyError
from identify.report.first_screen import templates
from identify.studies import comparison_views as views
from identify.studies import fit_views
from identify.studies.compare import Comparison, compare
from identify.studies.comparison_figures import curves, forest
from identify.studies.fits import PAGE, FitEntry, count, read_fits
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
        fits=fit_views.fits(entries, home, comparison),
        marks=fit_views.marks(),
        pictures=fit_views.pictures(entries, home, comparison),
        more_pictures=max(len(entries) - fit_views.MOST_PICTURES, 0),
        without_result=fit_views.without_result(entries, home),
        rejected=fit_views.rejected_logs(entries),
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
        "left_out": fit_views.left_out(comparison, home),
        "odd": fit_views.odd_fits(comparison, home),
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
