"""The fits on the page: their table with links, those left out, those that do not belong, and a picture of each."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup

from identify.report.quantity_text import DASH, Scale, decimals, number, places_for, scale_for, scatter, shown_error
from identify.report.report_wording import VERDICT_MARK, plain_symbol
from identify.studies.compare import Comparison
from identify.studies.comparison_figures import excerpt, thumbnail
from identify.studies.comparison_views import REASON, PageCell, PageTable, table
from identify.studies.fits import PAGE, FitEntry, natural

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


def link(entry: FitEntry, home: Path) -> str:
    """The address of a fit's page from a page in `home`; empty where there is none."""
    page = entry.folder / PAGE
    if not entry.document or not page.is_file():
        return ""
    return quote(Path(os.path.relpath(os.path.realpath(page), os.path.realpath(home))).as_posix())


def fits(entries: Sequence[FitEntry], home: Path, comparison: Comparison | None) -> PageTable:
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
        row = [PageCell(entry.name, flag, link=link(entry, home), sort=entry.name), _status(entry)]
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


def marks() -> str:
    """What stands beside a value, in words."""
    return ", ".join(f"{mark} {verdict}" for verdict, mark in VERDICT_MARK.items() if verdict != PLAIN)


def without_result(entries: Sequence[FitEntry], home: Path) -> PageTable:
    """Fits that gave no result, with the reason."""
    rows = [
        [
            PageCell(e.name, link=link(e, home), sort=e.name),
            _status(e),
            PageCell(e.message, sort=e.message, most=REASON),
        ]
        for e in entries
        if not e.converged
    ]
    return table("without-result", ["fit", "status", "reason"], rows)


def left_out(comparison: Comparison, home: Path) -> PageTable:
    """Fits with a result that took no part all the same, with the reason."""
    by_name = {entry.name: entry for entry in comparison.parts if entry.converged}
    rows = [
        [PageCell(name, link=link(by_name[name], home), sort=name), PageCell(reason, sort=reason, most=REASON)]
        for name, reason in sorted(comparison.taken.left_out, key=lambda item: natural(item[0]))
        if name in by_name
    ]
    return table("left-out", ["fit", "reason"], rows)


def rejected_logs(entries: Sequence[FitEntry]) -> PageTable:
    """Logs that took no part in their fit, with the reason."""
    rows = []
    for entry in entries:
        for log in entry.logs if entry.converged else ():
            if log.reason_left_out:
                named, reason = PageCell(log.name, sort=log.name), PageCell(log.reason_left_out, most=REASON)
                rows.append([named, PageCell(entry.name, sort=entry.name), reason])
    return table("rejected-logs", ["log", "fit", "reason"], rows)


def odd_fits(comparison: Comparison, home: Path) -> PageTable:
    """Fits that do not belong, by name."""
    by_name = {entry.name: entry for entry in comparison.parts}
    rows = [
        [
            PageCell(o.name, link=link(by_name[o.name], home), sort=o.name),
            PageCell(plain_symbol(o.quantity), sort=o.quantity),
            PageCell(f"{number(o.z, 3)} sd", sort=o.z),
            PageCell(f"{o.p:.2g}", sort=o.p),
        ]
        for o in comparison.odd
    ]
    return table("odd", ["fit", "parameter", "off by", "chance among all fits"], rows)


def pictures(entries: Sequence[FitEntry], home: Path, comparison: Comparison | None) -> list[Thumbnail]:
    """A small picture of every fit, in the order of the table; at most MOST_PICTURES."""
    odd = comparison.odd_fits if comparison else frozenset()
    out = []
    for entry in entries[:MOST_PICTURES]:
        part = excerpt(entry)
        words = "does not belong?" if entry.name in odd else "" if entry.converged else entry.status.replace("_", " ")
        kind = "good" if entry.converged and not words else "fair" if entry.converged else "bad"
        out.append(Thumbnail(entry.name, link(entry, home), words, kind, thumbnail(part), part.words))
    return out
