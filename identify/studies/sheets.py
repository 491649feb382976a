"""The tables of a comparison as plain data, SI: what the CSV, Excel, LaTeX and HDF5 files hold."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from identify.base.result import ParameterResult
from identify.studies.compare import Comparison, PooledQuantity
from identify.studies.fits import FitEntry
from identify.studies.labels import cell
from identify.studies.operating_points import Common, Figure, GroupAnswer, SpeedCurve
from identify.studies.pooled import Mean
from identify.studies.reporting import Item

Cell = str | float | int | None
NOTHING = ParameterResult(None)


@dataclass(frozen=True)
class Sheet:
    """One table: file name, title, column heads (units in the names), rows of equal length."""

    name: str
    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


def fits_sheet(entries: Sequence[FitEntry]) -> Sheet:
    """Every fit that was found: status, labels, parameters with standard errors."""
    labels = list(dict.fromkeys(name for e in entries for name in e.labels))
    names = list(dict.fromkeys(n for e in entries for n in e.result.parameters))
    units = {n: next((p.unit for e in entries if (p := e.result.parameters.get(n, NOTHING)).unit), "") for n in names}
    heads = ["fit", "status", "message", *labels, "logs", "misfit chi2 per sample"]
    for name in names:
        heads += [_with_unit(name, units[name]), _with_unit(f"{name} standard error", units[name]), f"{name} verdict"]
    rows = []
    for entry in entries:
        gate = entry.result.gate
        row: list[Cell] = [entry.name, entry.status, entry.message, *(entry.labels.get(label) for label in labels)]
        row += [len(entry.logs), None if gate is None else gate.chi2_per_sample]
        for name in names:
            told = entry.result.parameters.get(name, NOTHING)
            row += [told.value, told.standard_error, told.verdict]
        rows.append(tuple(row))
    return Sheet("fits", "Fits", tuple(heads), tuple(rows))


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def comparison_sheets(
    comparison: Comparison, ground: Common | None, answers: Sequence[GroupAnswer], items: Sequence[Item]
) -> tuple[Sheet, ...]:
    """All tables of a comparison."""
    by = comparison.question.by
    return (
        _parameters(comparison, by),
        _differences(comparison),
        _scatter(comparison),
        _operating(by, ground, answers),
        *_curves(by, answers),
        Sheet("left_out", "Fits left out", ("fit", "reason"), comparison.taken.left_out),
        Sheet(
            "not_told",
            "Parameters that a fit does not tell",
            ("fit", "parameter", "reason"),
            tuple((name, q.quantity.name, reason) for q in comparison.quantities for name, reason in q.untold),
        ),
        Sheet(
            "outliers",
            "Fits that do not belong",
            ("fit", "parameter", "off by [standard deviations]", "chance among all fits"),
            tuple((o.name, o.quantity, o.z, o.p) for o in comparison.odd),
        ),
        Sheet(
            "reporting",
            "What ASTM G115 asks to be reported with a friction coefficient",
            ("item", "told", "where it comes from"),
            tuple((i.name, i.text or "missing", i.source) for i in items),
        ),
    )


def _parameters(comparison: Comparison, by: str) -> Sheet:
    """The means; standard error and scatter are in the unit of the mean, also where logarithms were pooled."""
    heads = (
        "parameter",
        "unit",
        by,
        "mean",
        "95 % low",
        "95 % high",
        "standard error",
        "pooled as",
        "degrees of freedom",
        "fits",
        comparison.taken.subject or "people",
        "scatter of its fits",
        "remark",
    )
    rows: list[tuple[Cell, ...]] = []
    for entry, group, mean in _means(comparison):
        q = entry.quantity
        if mean is None:
            rows.append((q.name, q.unit, group, *[None] * 9, entry.reason or "none of its fits tells it"))
            continue
        ends = (None, None) if mean.interval is None else (q.shown(mean.interval[0]), q.shown(mean.interval[1]))
        scale, per = ("logarithm", q.shown(mean.value)) if q.logarithmic else ("linear", 1.0)
        rows.append(
            (
                q.name,
                q.unit,
                group,
                q.shown(mean.value),
                *ends,
                mean.error * per,
                scale,
                mean.df,
                mean.fits,
                mean.subjects,
                None if mean.scatter is None else mean.scatter * per,
                mean.reason,
            )
        )
    return Sheet("parameters", f"Parameters by {by}", heads, tuple(rows))


def _means(comparison: Comparison) -> Iterator[tuple[PooledQuantity, str, Mean | None]]:
    """Every quantity and group with its mean, None where there is none."""
    for entry in comparison.quantities:
        found = {} if entry.pooled is None else {mean.group: mean for mean in entry.pooled.means}
        for group in comparison.groups:
            yield entry, group, found.get(group)


def _differences(comparison: Comparison) -> Sheet:
    heads = (
        "parameter",
        "unit",
        "first",
        "second",
        "kind",
        "value",
        "simultaneous low",
        "simultaneous high",
        "p of the family",
        "verdict",
        "reason",
        "degrees of freedom",
        "people with both",
    )
    rows = []
    for entry in comparison.quantities:
        q = entry.quantity
        for d in entry.pooled.differences if entry.pooled else ():
            low, high = d.interval or (None, None)
            kind = "ratio first/second" if q.logarithmic else "first minus second"
            shown = [None if v is None else q.shown(v) for v in (d.value, low, high)]
            rows.append(
                (
                    *(q.name, "" if q.logarithmic else q.unit, d.first, d.second, kind, *shown),
                    *(d.p, d.verdict, d.reason, d.df, d.shared),
                )
            )
    return Sheet("differences", "Differences", heads, tuple(rows))


def _scatter(comparison: Comparison) -> Sheet:
    who, by = comparison.taken.subject or "person", comparison.question.by
    heads = (
        "parameter",
        "unit",
        f"between {by}s",
        f"between {who}s",
        f"{who} by {by}",
        "between runs",
        "error of a fit",
        "repeatability",
        "repeatability low",
        "repeatability high",
        "intraclass correlation",
    )
    rows: list[tuple[Cell, ...]] = []
    for entry in comparison.quantities:
        if entry.pooled is None:
            continue
        s = entry.pooled.scatter
        unit = "logarithm" if entry.quantity.logarithmic else entry.quantity.unit
        ends = s.repeatability_interval or (None, None)
        rows.append(
            (
                *(entry.quantity.name, unit, s.between_groups, s.subject, s.subject_by_group, s.run, s.fit),
                *(s.repeatability, *ends, s.intraclass),
            )
        )
    return Sheet("scatter", "Scatter and repeatability (standard deviations)", heads, tuple(rows))


def _operating(by: str, ground: Common | None, answers: Sequence[GroupAnswer]) -> Sheet:
    heads = [by, "drive speed [m/s]", "normal force [N]", "what it does", "probability of stick-slip"]
    for name in ("fall, peak to valley [N]", "period [s]", "end of stick-slip over this speed"):
        heads += [name, f"{name} 95 % low", f"{name} 95 % high", f"{name} people low", f"{name} people high"]
    rows: list[tuple[Cell, ...]] = []
    for answer in answers:
        if not answer.at:
            rows.append((answer.group, None, None, answer.reason or "no answer", *[None] * 16))
        for at in answer.at:
            head = (answer.group, at.speed, ground.normal_force if ground else None, at.outcome, at.probability)
            rows.append((*head, *_five(at.fall), *_five(at.period), *_five(at.margin)))
    return Sheet("operating_points", "At common operating points", tuple(heads), tuple(rows))


def _five(figure: Figure) -> tuple[Cell, ...]:
    return (figure.value, *(figure.interval or (None, None)), *(figure.people or (None, None)))


def _curves(by: str, answers: Sequence[GroupAnswer]) -> Iterator[Sheet]:
    told = (
        ("friction_curve", "Friction coefficient of steady sliding over drive speed", "friction coefficient"),
        (
            "amplitude_curve",
            "Force from peak to valley in stick-slip over drive speed",
            "fall, peak to valley [N]",
        ),
    )
    for name, title, what in told:
        heads = (by, "drive speed [m/s]", what, "95 % low", "95 % high", "people low", "people high")
        curves = [(a.group, a.friction if name == "friction_curve" else a.amplitude) for a in answers]
        rows = tuple((group, *row) for group, curve in curves if curve is not None for row in _rows(curve))
        yield Sheet(name, title, heads, rows)


def _rows(curve: SpeedCurve) -> Iterator[tuple[Cell, ...]]:
    columns = (curve.speed, curve.value, curve.low, curve.high, curve.people_low, curve.people_high)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        yield tuple(None if value != value else value for value in row)


def workbook(sheets: Sequence[Sheet]) -> bytes:
    """The bytes of an .xlsx file with one sheet per table; the first row of each is its head and stays in sight."""
    from openpyxl import Workbook
    from openpyxl.cell import WriteOnlyCell
    from openpyxl.styles import Font

    book, bold, out = Workbook(write_only=True), Font(bold=True), io.BytesIO()
    for sheet in sheets:
        page = book.create_sheet(sheet.name)
        page.freeze_panes = "A2"
        for column in "ABC":
            page.column_dimensions[column].width = 20
        heads = [WriteOnlyCell(page, value=cell(head)) for head in sheet.heads]
        for head in heads:
            head.font = bold
        page.append(heads)
        for row in sheet.rows:
            page.append([cell(value) for value in row])
    book.save(out)
    return out.getvalue()
