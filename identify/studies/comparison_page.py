"""report.html of a batch or a comparison, one file that opens from disk and asks nobody, and the files beside it."""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from data_io.atomic import atomic_write
from identify.base.table import Cell, OutputTable, visible, workbook
from identify.report.report_page import templates
from identify.report.report_wording import VERDICT_MARK, plain_symbol
from identify.report.stored_result import as_json
from identify.studies.compare import Comparison, compare
from identify.studies.comparison_figures import Thumbnails, curves, forest
from identify.studies.comparison_tables import comparison_tables, fits_table, sentences, together
from identify.studies.fits import PAGE, FitEntry, count, read_fits
from identify.studies.labels import CompareError, ComparisonQuestion, usual
from identify.studies.operating_points import Answers, answered
from identify.studies.reporting import reporting

MOST_PICTURES = 400
MOST_LABELS, MOST_PARAMETERS = 6, 8  # columns of the table of fits on the page
DOCUMENT = "comparison.json"
IN_LATEX = ("parameters", "differences", "scatter", "reporting")


@dataclass(frozen=True)
class Thumbnail:
    """One fit in small: name, link to its page, status with its kind, drawing (empty without curves), words."""

    name: str
    link: str
    status: str
    kind: str
    drawing: Markup
    words: str


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


def write_comparison(comparison: Comparison, answers: Answers, folder: Path, home: Path | None = None) -> list[Path]:
    """Write page, tables (CSV, LaTeX, workbook) and document into `folder`; returns the paths, the page last.

    Parameters
    ----------
    home : Path, optional
        Where the folder will stand in the end, for the links to the pages of the fits (default: `folder`).

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    tables = comparison_tables(comparison, answers)
    page = render(f"by {comparison.question.by}", comparison.entries, comparison, answers, home or folder)
    (folder / "tables").mkdir(parents=True, exist_ok=True)
    latex = "\n".join(tables[name].to_latex() for name in IN_LATEX)
    contents: dict[str, str | bytes] = {f"tables/{table.name}.csv": table.to_csv() for table in tables.values()}
    contents["comparison.xlsx"] = workbook(list(tables.values()))
    contents["comparison.tex"] = f"% needs \\usepackage{{booktabs,longtable}}\n{latex}"
    contents[DOCUMENT] = as_json(document(comparison, tables))
    contents[PAGE] = page
    for name, content in contents.items():
        with atomic_write(folder / name, "wb") as handle:
            handle.write(content.encode("utf-8") if isinstance(content, str) else content)
    return [folder / name for name in contents]


def document(comparison: Comparison, tables: Mapping[str, OutputTable]) -> Mapping[str, Any]:
    """The comparison as JSON: the question, what differs in words, notes, and every table but that of the fits."""
    taken = comparison.taken
    words = zip(comparison.quantities, sentences(comparison), strict=True)
    return {
        "schema": 1,
        "status": "done",
        "by": comparison.question.by,
        "subject": taken.subject,
        "adjusted": list(taken.adjusted),
        "groups": list(comparison.groups),
        "fits": len(comparison.entries),
        "compared": count(taken.entries),
        "in_words": {entry.quantity.name: sentence for entry, (_, _, sentence) in words},
        "notes": notes(comparison),
        "tables": {
            name: [dict(zip(table.columns, (c.value for c in row), strict=True)) for row in table.cells]
            for name, table in tables.items()
            if name != "fits"
        },
    }


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
    odd = comparison.odd_fits if comparison else frozenset()
    links = [_link(entry, home) for entry in entries]
    pictures = Thumbnails()
    return environment.get_template("batch.html.j2").render(
        title=title,
        style=Markup(environment.get_template("style.css").render() + environment.get_template("batch.css").render()),
        script=Markup(script),
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        counts=_counts(entries, comparison),
        fits=_page_fits(entries, links, comparison, odd),
        marks=", ".join(f"{mark} {verdict}" for verdict, mark in VERDICT_MARK.items() if verdict != "identified"),
        pictures=[
            _picture(pictures, entry, link, odd, f"fit-{place}")
            for place, (entry, link) in enumerate(zip(entries[:MOST_PICTURES], links, strict=False))
        ],
        more_pictures=max(len(entries) - MOST_PICTURES, 0),
        without_result=_failed(entries, links),
        rejected=_rejected_logs(entries),
        reporting=reporting(entries),
        reason=reason,
        comparison=None if comparison is None or answers is None else _compared(comparison, answers, home),
    )


def _counts(entries: Sequence[FitEntry], comparison: Comparison | None) -> list[tuple[str, str, str]]:
    """Tiles at the top: label, number, meaning."""
    good = sum(entry.converged for entry in entries)
    tiles = [("fits", str(len(entries)), f"{sum(len(e.logs) for e in entries)} logs")]
    tiles.append(("converged", str(good), f"{len(entries) - good} without a result"))
    if comparison is not None:
        taken, compared = comparison.taken, count(comparison.taken.entries)
        tiles.append(("compared", str(compared), f"{len(entries) - compared} left out"))
        tiles.append((comparison.question.by, str(len(comparison.groups)), "groups"))
        if taken.subject and taken.setting.subject:
            tiles.append((taken.subject, str(taken.people), "people"))
        tiles.append(("outliers", str(len(comparison.odd_fits)), "fits flagged, still counted"))
    return tiles


def _compared(comparison: Comparison, answers: Answers, home: Path) -> dict[str, object]:
    """What the template shows of a comparison."""
    tables, by = comparison_tables(comparison, answers), comparison.question.by
    links = {entry.name: _link(entry, home) for entry in comparison.parts if entry.converged}
    who = comparison.taken.subject
    untold = [
        (q.quantity.name, len(q.untold), ", ".join(sorted({reason for _, reason in q.untold})))
        for q in comparison.quantities
        if q.untold
    ]
    return {
        "by": by,
        "who": who,
        "sentences": together(sentences(comparison)),
        "parameters": tables["parameters"].select("parameter", by, "mean", "unit", "fits", who or "", "remark"),
        "differences": tables["differences"].select(
            "parameter", "first", "second", "difference", "p", "verdict", "people with both" if who else ""
        ),
        "scatter": tables["scatter"].select(
            *(c for c in tables["scatter"].columns if not c.endswith((" low", " high")) and c != "unit")
        ),
        "operating": tables["operating_points"].select(
            *(by, "drive speed [m/s]", "what it does", "P(stick-slip)", "peak to valley [N]", "period [s]"),
            "stick-slip ends above [m/s]",
        ),
        "no_operating": answers.reason,
        "ground": answers.ground,
        "forests": [forest(comparison, entry) for entry in comparison.quantities if entry.pooled],
        "curves": [drawing for which in ("friction", "amplitude") if (drawing := curves(answers, which))],
        "left_out": _linked(tables["left_out"], links),
        "odd": _linked(tables["outliers"], links),
        "untold": untold,
        "notes": notes(comparison),
        "family": len(comparison.quantities),
    }


def notes(comparison: Comparison) -> list[str]:
    """What the reader must know of how the groups were compared, in sentences."""
    taken = comparison.taken
    out = []
    if taken.subject is None:
        out.append("No label states whose fits these are: each fit counts as a person of its own.")
    if taken.adjusted:
        out.append(f"Means are adjusted for {', '.join(taken.adjusted)}: they stand for the average of these fits.")
    dropped = {name: why for q in comparison.quantities if q.pooled for name, why in q.pooled.dropped.items()}
    out += [f"{name[:1].upper()}{name[1:]} is not adjusted for: {why}." for name, why in dropped.items()]
    return [*out, *taken.notes]


# ----------------------------------------------------------------------------------------------------------------------
# The fits: their table with links, those without a result, and a picture of each.
# ----------------------------------------------------------------------------------------------------------------------


def _link(entry: FitEntry, home: Path) -> str:
    """The address of a fit's page from a page in `home`; empty where there is none."""
    page = entry.folder / PAGE
    if not entry.document or not page.is_file():
        return ""
    return quote(Path(os.path.relpath(os.path.realpath(page), os.path.realpath(home))).as_posix())


def _linked(table: OutputTable, links: Mapping[str, str]) -> OutputTable:
    """The rows of fits that have a page, with links to it."""
    rows = [
        (Cell(row[0].value, link=links[str(row[0].value)]), *row[1:]) for row in table.cells if row[0].value in links
    ]
    return OutputTable(table.title, table.columns, tuple(rows), table.name)


def _page_fits(
    entries: Sequence[FitEntry], links: Sequence[str], comparison: Comparison | None, odd: frozenset[str]
) -> OutputTable:
    """The table of fits with the labels worth a column: those of the question, then those that differ."""
    labels = list(dict.fromkeys(name for e in entries for name in e.labels))
    asked = [comparison.question.by, comparison.taken.subject, *comparison.taken.adjusted] if comparison else []
    differing = [n for n in labels if len({e.labels.get(n) for e in entries}) > 1]
    first = list(dict.fromkeys(str(n) for n in [*asked, *differing] if n in labels))[:MOST_LABELS]
    whole = fits_table(entries, links, odd, first)
    names = list(dict.fromkeys(n for e in entries for n in e.result.parameters))[:MOST_PARAMETERS]
    values = [c for c in whole.columns if c.split(" [")[0] in names]
    shown = whole.select("fit", "status", *first, "misfit", *values)
    heads = {value: plain_symbol(value.split(" [")[0]) for value in values}  # the cells hold their units
    return replace(shown, columns=tuple(heads.get(column, column) for column in shown.columns))


def _failed(entries: Sequence[FitEntry], links: Sequence[str]) -> OutputTable:
    rows = [
        (Cell(e.name, link=link), Cell(e.status, e.status.replace("_", " "), kind="bad"), e.message)
        for e, link in zip(entries, links, strict=True)
        if not e.converged
    ]
    return OutputTable("Fits without a result", ("fit", "status", "reason"), tuple(rows), "without-result")


def _rejected_logs(entries: Sequence[FitEntry]) -> OutputTable:
    rows = [
        (log.name, entry.name, log.reason_left_out)
        for entry in entries
        if entry.converged
        for log in entry.logs
        if log.reason_left_out
    ]
    return OutputTable("Logs that took no part in their fit", ("log", "fit", "reason"), tuple(rows), "rejected-logs")


def _picture(drawer: Thumbnails, entry: FitEntry, link: str, odd: frozenset[str], name: str) -> Thumbnail:
    drawing, words = drawer.draw(entry, name)
    status = "outlier?" if entry.name in odd else "" if entry.converged else entry.status.replace("_", " ")
    kind = "good" if entry.converged and not status else "fair" if entry.converged else "bad"
    return Thumbnail(entry.name, link, status, kind, drawing, words)
