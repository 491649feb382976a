"""report.html of a batch or a comparison, one file that opens from disk without a network, and the files beside it."""

from __future__ import annotations

import base64
import hashlib
import math
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
from identify.base.document import as_json
from identify.base.result import ParameterResult
from identify.base.table import Cell, OutputTable, Row, visible, workbook
from identify.base.wording import DASH, Scale, decimals, number, scale_for, value_and_interval
from identify.report.report_page import svg_element, templates
from identify.report.report_wording import MEANINGS, VERDICT_MARK, plain_symbol
from identify.report.style import WIDTHS, drawing_style, svg_text
from identify.studies import compare as comparing
from identify.studies.compare import PAGE, Comparison, FitEntry, Quantity
from identify.studies.pooled import DIFFERENT, NOT_DISTINGUISHED, NOT_TESTED, Difference

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
        "in_words": {entry.name: sentence for entry, (_, _, sentence) in words},
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
        (q.name, len(q.missing), ", ".join(sorted({reason for _, reason in q.missing})))
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
        "scatter": tables["scatter"].select(*(c for c in tables["scatter"].columns if c not in hidden)).filled(),
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


def forest(comparison: Comparison, entry: Quantity) -> Markup:
    """One parameter: for each group the mean with its 95 % interval, and every fit as a faint mark."""
    pooled, unit = entry.pooled, unit_of(entry)
    assert pooled is not None
    groups = [group for group in comparison.groups if group in pooled.groups]
    fits = np.array([entry.shown(float(v)) for v in pooled.y]) / unit.factor
    of = np.array([comparison.selected.setting.group[i] for i in pooled.rows])
    means = np.array([entry.shown(pooled.mean_of(group).value) for group in groups]) / unit.factor
    span = FAR * max(float(np.ptp(np.append(fits, means))), 0.1 * float(np.max(np.abs(means))))
    with drawing_style():
        figure = Figure(figsize=(WIDTHS[1], 0.6 + 0.25 * len(groups)), layout="constrained")
        axes = figure.add_subplot()
        for place, (group, value) in enumerate(zip(groups, means, strict=True)):
            mean, y = pooled.mean_of(group), -place
            colour = COLOURS[comparison.groups.index(group) % len(COLOURS)]
            own = fits[of == group]
            axes.plot(own, np.full(len(own), y - 0.3), "|", color=colour, alpha=0.55, markersize=4)
            if mean.interval is not None:
                ends = np.clip([entry.shown(v) / unit.factor for v in mean.interval], value - span, value + span)
                axes.plot(ends, [y, y], color=colour, linewidth=1.8)
            axes.plot(
                [value], [y], "o", color=colour, markersize=4, markerfacecolor=colour if mean.interval else "white"
            )
        axes.set_yticks([-k for k in range(len(groups))], [visible(g, NAME) for g in groups])
        axes.set_ylim(-len(groups) + 0.4, 0.5)
        axes.set_xlabel(f"{plain_symbol(entry.name)}{f' ({unit.unit})' if unit.unit else ''}")
        label = f"{entry.name} by {comparison.question.by}: means with 95 % intervals, every fit as a small mark"
        drawing = svg_element(svg_text(figure), f"forest-{comparison.quantities.index(entry)}")
    # with a description for those who cannot see it
    box = Markup('<div class="drawing" role="img" aria-label="{}">{}</div>')
    return box.format(visible(label, 300), Markup(drawing))


# The tables of a comparison, the same for page, CSV, LaTeX and workbook; and what differs, in sentences.

VERDICT_KIND = {DIFFERENT: "good", NOT_DISTINGUISHED: "plain", NOT_TESTED: "fair"}
MOST_NAMED = 6  # pairs of groups in a sentence


def comparison_tables(comparison: Comparison) -> dict[str, OutputTable]:
    """Every table of a comparison by name."""
    missing = [(name, _name(q), reason) for q in comparison.quantities for name, reason in q.missing]
    left_out = comparison.selected.left_out
    tables = (
        _parameters(comparison),
        _differences(comparison),
        _scatter(comparison),
        OutputTable("Fits left out", ("fit", "reason"), left_out, "left_out"),
        OutputTable("Parameters that a fit does not have", ("fit", "parameter", "reason"), tuple(missing), "missing"),
        fits_table(comparison.entries),
    )
    return {table.name: table for table in tables}


def _name(entry: Quantity) -> Cell:
    """A parameter: its name in files, its symbol for people."""
    return Cell(entry.name, plain_symbol(entry.name))


def unit_of(entry: Quantity) -> Scale:
    """The unit in which a parameter is shown: that of the middle of its means."""
    values = sorted(abs(entry.shown(m.value)) for m in (entry.pooled.means if entry.pooled else ()))
    return scale_for(values[len(values) // 2] if values else None, entry.unit)


def _parameters(comparison: Comparison) -> OutputTable:
    """The means; standard error and scatter are in the unit of the mean, also where logarithms were pooled."""
    rows: list[Row] = []
    for entry in comparison.quantities:
        scale = unit_of(entry)
        means = {m.group: m for m in (entry.pooled.means if entry.pooled else ())}
        for group in comparison.groups:
            mean = means.get(group)
            if mean is None:
                rows.append((_name(entry), group, *[None] * 8, entry.reason or "none of its fits has it"))
                continue
            value = entry.shown(mean.value)
            low, high = mean.interval or (None, None)
            ends = None if low is None else entry.shown(low), None if high is None else entry.shown(high)
            per = value if entry.logarithmic else 1.0
            text, interval = value_and_interval(value, ends, scale, positive=entry.logarithmic)
            remark = mean.reason or ("mean of the logarithm" if entry.logarithmic else "")
            scatter = None if mean.scatter is None else mean.scatter * per
            counts = (mean.error * per, mean.fits, mean.subjects, scatter, remark)
            shown = (Cell(value, text, interval or "open"), *ends, Cell(entry.unit, scale.unit or "1"))
            rows.append((_name(entry), group, *shown, *counts))
    by, who = comparison.question.by, comparison.selected.subject or "people"
    heads = ("parameter", by, "mean", "95 % low", "95 % high", "unit", "standard error", "fits", who)
    return OutputTable(f"Parameters by {by}", (*heads, "scatter of its fits", "remark"), tuple(rows), "parameters")


def difference_text(entry: Quantity, d: Difference) -> tuple[str, str]:
    """A difference and its interval as text: a factor where the mean is that of the logarithm."""
    if entry.logarithmic:
        ends = (None, None) if d.interval is None else (math.exp(d.interval[0]), math.exp(d.interval[1]))
        text, interval = value_and_interval(math.exp(d.value), ends, Scale("", 1.0), positive=True)
        return f"× {text}", f"× {interval}" if interval else ""
    unit = unit_of(entry)
    text, interval = value_and_interval(d.value, d.interval or (None, None), unit)
    tail = f" {unit.unit}" if unit.unit else ""
    return f"{'+' * (d.value > 0)}{text}{tail}", f"{interval}{tail}" if interval else ""


def _differences(comparison: Comparison) -> OutputTable:
    rows: list[Row] = []
    for entry in comparison.quantities:
        for d in entry.pooled.differences if entry.pooled else ():
            text, interval = difference_text(entry, d)
            ends = [None if v is None else entry.shown(v) for v in d.interval or (None, None)]
            chance = None if d.p is None else Cell(d.p, "< 0.001" if d.p < 0.001 else f"{d.p:.2g}")
            verdict = Cell(d.verdict, note=visible(d.reason, 300), kind=VERDICT_KIND[d.verdict])
            shown = (
                Cell(entry.shown(d.value), text, interval),
                *ends,
                "first / second" if entry.logarithmic else entry.unit,
            )
            rows.append((_name(entry), d.first, d.second, *shown, chance, verdict, d.reason, d.df, d.shared))
    heads = ("parameter", "first", "second", "difference", "simultaneous low", "simultaneous high", "unit", "p")
    rest = ("verdict", "reason", "degrees of freedom", "people with both")
    return OutputTable("Differences", (*heads, *rest), tuple(rows), "differences")


def _scatter(comparison: Comparison) -> OutputTable:
    rows: list[Row] = []
    for entry in comparison.quantities:
        if entry.pooled is None:
            continue
        s = entry.pooled.scatter
        scale = Scale("%", 0.01) if entry.logarithmic else unit_of(entry)
        cells = [
            Cell() if value is None else Cell(value, f"{number(value / scale.factor, 2)} {scale.unit}".rstrip())
            for value in (s.subject, s.run, s.fit, s.repeatability, *(s.repeatability_interval or (None, None)))
        ]
        if s.repeatability is not None:
            cells[3] = Cell(s.repeatability, cells[3].text, f"{cells[4].text} to {cells[5].text}")
        icc = Cell(s.intraclass, DASH if s.intraclass is None else decimals(s.intraclass, 2))
        rows.append((_name(entry), *cells, icc, "logarithm" if entry.logarithmic else entry.unit))
    heads = ("parameter", f"between {comparison.selected.subject or 'person'}s", "between runs", "error of a fit")
    rest = ("repeatability", "repeatability low", "repeatability high", "intraclass correlation", "unit")
    return OutputTable("Scatter and repeatability (standard deviations)", (*heads, *rest), tuple(rows), "scatter")


def fits_table(entries: Sequence[FitEntry], links: Sequence[str] = ()) -> OutputTable:
    """Every fit that was found: status, labels, parameters with standard errors; links: address of each fit's page."""
    labels = list(dict.fromkeys(name for e in entries for name in e.labels))
    names = list(dict.fromkeys(n for e in entries for n in e.result.parameters))
    heads = ["fit", "status", "message", *labels, "logs", "misfit"]
    scales = []
    for name in names:
        estimates = [p for e in entries if (p := e.result.parameters.get(name)) is not None]
        values = sorted(abs(p.value) for p in estimates if p.value is not None)
        unit = next((p.unit for p in estimates if p.unit), "")
        scales.append(scale_for(values[len(values) // 2] if values else None, unit))
        tail = f" [{unit}]" if unit else ""
        heads += [f"{name}{tail}", f"{name} standard error{tail}", f"{name} verdict"]
    rows: list[Row] = []
    for entry, link in zip(entries, links or [""] * len(entries), strict=True):
        misfit = None if entry.result.gate is None else entry.result.gate.chi2_per_sample
        row: list[Cell | str | int | float | None] = [
            Cell(entry.name, link=link),
            Cell(entry.status, entry.status.replace("_", " "), kind="good" if entry.converged else "bad"),
            entry.message,
            *(entry.labels.get(label) for label in labels),
            len(entry.result.logs),
            Cell(misfit, "" if misfit is None else decimals(misfit, 3)),
        ]
        for name, scale in zip(names, scales, strict=True):
            p, cell = entry.result.parameters.get(name, ParameterResult(None)), Cell()
            if p.value is not None:
                value, interval = value_and_interval(p.value, p.ends, scale, p.standard_error)
                mark = "" if p.verdict == "identified" else VERDICT_MARK.get(p.verdict, "")
                text = " ".join(filter(None, (value, scale.unit, mark)))
                cell = Cell(p.value, text, (interval or "open") if p.interval else p.verdict)
            row += [cell, p.standard_error, p.verdict]
        rows.append(tuple(row))
    return OutputTable("Fits", tuple(heads), tuple(rows), "fits")


def sentences(comparison: Comparison) -> list[tuple[str, str, str]]:
    """What differs: symbol, meaning and one plain sentence per parameter."""
    named = [(entry.name, _sentence(entry)) for entry in comparison.quantities]
    return [(plain_symbol(name), MEANINGS.get(name, name.replace("_", " ")), words) for name, words in named]


def together(parts: Sequence[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """The same with equal sentences given once, for all parameters of which they hold."""
    names: dict[str, list[str]] = {}
    meanings = {words: meaning for _, meaning, words in parts}
    for name, _, words in parts:
        names.setdefault(words, []).append(name)
    return [(", ".join(group), meanings[words] if len(group) == 1 else "", words) for words, group in names.items()]


def _sentence(entry: Quantity) -> str:
    if entry.pooled is None:
        return f"not compared: {entry.reason}."
    differences, count = entry.pooled.differences, len(entry.pooled.means)
    if not differences:
        return "there is only one group." if count < 2 else f"{count} groups are too many to compare in pairs."
    if all(d.verdict == NOT_TESTED for d in differences):
        return f"not tested: {differences[0].reason}."
    apart = [(d.first, d.second) if d.value > 0 else (d.second, d.first) for d in differences if d.verdict == DIFFERENT]
    named = [f"{visible(higher, 40)} above {visible(lower, 40)}" for higher, lower in apart]
    rest, untested = (sum(d.verdict == verdict for d in differences) for verdict in (NOT_DISTINGUISHED, NOT_TESTED))
    more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    pieces = [("; ".join(named[:MOST_NAMED]) or "no difference found") + more]
    pieces += [f"{rest} pair{'s' * (rest != 1)} not distinguished"] if named and rest else []
    pieces += [f"{untested} not tested"] if untested else []
    return f"{'; '.join(pieces)}."
