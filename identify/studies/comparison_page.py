"""report.html of a batch or a comparison, one file that opens from disk without a network, and the files beside it."""

from __future__ import annotations

import base64
import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from data_io.atomic import atomic_write
from identify.base.table import Cell, OutputTable, visible, workbook
from identify.report.report_page import svg_element, templates
from identify.report.report_wording import VERDICT_MARK, plain_symbol
from identify.report.stored_result import as_json
from identify.report.style import drawing_style, printable, svg_text
from identify.studies import compare as comparing
from identify.studies.compare import PAGE, Comparison, FitEntry
from identify.studies.comparison_tables import comparison_tables, fits_table, sentences, together, unit_of

DOCUMENT = "comparison.json"
IN_LATEX = ("parameters", "differences", "scatter")


def write_batch_report(directory: str | Path) -> Path:
    """Write DIR/report.html over the fits of a batch folder; returns its path.

    A fit that cannot be read is a row with the reason. OSError where the page cannot be written.
    """
    directory = Path(directory)
    path = directory / PAGE
    with atomic_write(path) as handle:
        handle.write(render(directory.resolve().name, comparing.read_fits([directory]), None, directory))
    return path


def write_comparison(comparison: Comparison, folder: Path, home: Path | None = None) -> list[Path]:
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
    tables = comparison_tables(comparison)
    page = render(f"by {comparison.question.by}", comparison.entries, comparison, home or folder)
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
    words = zip(comparison.quantities, sentences(comparison), strict=True)
    return {
        "schema": 1,
        "status": "done",
        "by": comparison.question.by,
        "subject": comparison.selected.subject,
        "groups": list(comparison.groups),
        "fits": len(comparison.entries),
        "compared": len(comparison.selected.entries),
        "in_words": {entry.quantity.name: sentence for entry, (_, _, sentence) in words},
        "notes": list(comparison.selected.notes),
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
    home: Path,
) -> str:
    """The text of the page; `home`: the folder it will stand in."""
    environment = templates("identify.studies", "identify.report")
    environment.filters["visible"] = visible
    script = environment.get_template("page.js").render()
    links = [_link(entry, home) for entry in entries]
    good = [entry for entry in entries if entry.converged]
    failed = [
        (Cell(e.name, link=link), Cell(e.status, e.status.replace("_", " "), kind="bad"), e.message)
        for e, link in zip(entries, links, strict=True)
        if not e.converged
    ]
    rejected = [(log.name, e.name, log.reason_left_out) for e in good for log in e.result.logs if log.reason_left_out]
    tiles = [("fits", str(len(entries)), f"{sum(len(e.result.logs) for e in entries)} logs")]
    tiles.append(("converged", str(len(good)), f"{len(failed)} without a result"))
    if comparison is not None:
        compared = len(comparison.selected.entries)
        tiles.append(("compared", str(compared), f"{len(entries) - compared} left out"))
        tiles.append((comparison.question.by, str(len(comparison.groups)), "groups"))
    return environment.get_template("batch.html.j2").render(
        title=title,
        style=Markup(environment.get_template("style.css").render() + environment.get_template("batch.css").render()),
        script=Markup(script),
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        counts=tiles,
        fits=_page_fits(entries, links),
        marks=", ".join(f"{mark} {verdict}" for verdict, mark in VERDICT_MARK.items() if verdict != "identified"),
        without_result=OutputTable("", ("fit", "status", "reason"), tuple(failed), "without-result"),
        rejected=OutputTable("", ("log", "fit", "reason"), tuple(rejected), "rejected-logs"),
        comparison=None if comparison is None else _compared(comparison),
    )


def _compared(comparison: Comparison) -> dict[str, object]:
    """What the template shows of a comparison."""
    tables, by, who = comparison_tables(comparison), comparison.question.by, comparison.selected.subject
    missing = [
        (q.quantity.name, len(q.missing), ", ".join(sorted({reason for _, reason in q.missing})))
        for q in comparison.quantities
        if q.missing
    ]
    good = {entry.name for entry in comparison.entries if entry.converged}
    left_out = [row for row in comparison.selected.left_out if row[0] in good]
    different = ("parameter", "first", "second", "difference", "p", "verdict", "people with both" if who else "")
    hidden = ("repeatability low", "repeatability high", "unit")
    return {
        "by": by,
        "who": who,
        "sentences": together(sentences(comparison)),
        "parameters": tables["parameters"].select("parameter", by, "mean", "unit", "fits", who or "", "remark"),
        "differences": tables["differences"].select(*different),
        "scatter": tables["scatter"].select(*(c for c in tables["scatter"].columns if c not in hidden)),
        "forests": [forest(comparison, entry) for entry in comparison.quantities if entry.pooled],
        "left_out": replace(tables["left_out"], rows=tuple(left_out)),
        "missing": missing,
        "notes": comparison.selected.notes,
        "family": len(comparison.quantities),
    }


def _link(entry: FitEntry, home: Path) -> str:
    """The address of a fit's page from a page in `home`; empty where there is none."""
    page = entry.folder / PAGE
    if not entry.result.status or not page.is_file():
        return ""
    return quote(Path(os.path.relpath(os.path.realpath(page), os.path.realpath(home))).as_posix())


def _page_fits(entries: Sequence[FitEntry], links: Sequence[str]) -> OutputTable:
    """The table of fits with one column per parameter: its cells hold unit and standard error."""
    whole = fits_table(entries, links)
    shown = whole.select(
        *(c for c in whole.columns if c != "message" and not re.search(r" (standard error|verdict)", c))
    )
    heads = (
        plain_symbol(c.split(" [")[0]) if f"{c.split(' [')[0]} verdict" in whole.columns else c for c in shown.columns
    )
    return replace(shown, columns=tuple(heads))


# Okabe and Ito's colours, black and yellow left out.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B8860B", "#3f4750")
NAME = 24  # characters of a group in a drawing
FAR = 2.5  # times what means and fits span: an interval is drawn no further


def forest(comparison: Comparison, entry: comparing.PooledQuantity) -> Markup:
    """One parameter: for each group the mean with its 95 % interval, and every fit as a faint mark."""
    q, pooled, unit = entry.quantity, entry.pooled, unit_of(entry)
    assert pooled is not None
    groups = [group for group in comparison.groups if group in pooled.groups]
    fits = np.array([q.shown(float(v)) for v in pooled.y]) / unit.factor
    of = np.array([comparison.selected.setting.group[i] for i in pooled.rows])
    means = np.array([q.shown(pooled.mean_of(group).value) for group in groups]) / unit.factor
    span = FAR * max(float(np.ptp(np.append(fits, means))), 0.1 * float(np.max(np.abs(means))))
    with drawing_style():
        figure = Figure(figsize=(5.0, 0.9 + 0.34 * len(groups)), layout="constrained")
        axes = figure.add_subplot()
        for place, (group, value) in enumerate(zip(groups, means, strict=True)):
            mean, y = pooled.mean_of(group), -place
            colour = COLOURS[comparison.groups.index(group) % len(COLOURS)]
            own = fits[of == group]
            axes.plot(own, np.full(len(own), y - 0.3), "|", color=colour, alpha=0.55, markersize=5)
            if mean.interval is not None:
                ends = np.clip([q.shown(v) / unit.factor for v in mean.interval], value - span, value + span)
                axes.plot(ends, [y, y], color=colour, linewidth=2.4)
            axes.plot([value], [y], "o", color=colour, markerfacecolor=colour if mean.interval else "white")
        axes.set_yticks([-k for k in range(len(groups))], [printable(visible(g, NAME)) for g in groups])
        axes.set_ylim(-len(groups) + 0.4, 0.5)
        axes.set_xlabel(f"{plain_symbol(q.name)}{f' ({unit.unit})' if unit.unit else ''}")
        label = f"{q.name} by {comparison.question.by}: means with 95 % intervals, every fit as a small mark"
        drawing = svg_element(svg_text(figure), f"forest-{comparison.quantities.index(entry)}")
    # with a description for those who cannot see it
    box = Markup('<div class="drawing" role="img" aria-label="{}">{}</div>')
    return box.format(visible(label, 300), Markup(drawing))
