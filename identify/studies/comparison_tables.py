"""The tables of a comparison, the same for the page, CSV, LaTeX and workbook; and what differs, in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from identify.base.result import ParameterResult
from identify.base.table import Cell, OutputTable, Row, visible
from identify.base.wording import (
    DASH,
    Scale,
    decimals,
    ends_text,
    number,
    places_for,
    places_of_positive,
    quantity,
    scale_for,
)
from identify.report.report_wording import MEANINGS, OUTCOMES, VERDICT_MARK, plain_symbol
from identify.report.shown_error import scatter as digits_follow
from identify.report.shown_error import shown_error
from identify.studies.compare import Comparison, PooledQuantity
from identify.studies.fits import FitEntry, Quantity
from identify.studies.operating_points import Answers, Figure, GroupAnswer
from identify.studies.pooled import DIFFERENT, NOT_TESTED, NOT_TOLD_APART, Difference
from identify.studies.reporting import reporting

VERDICT_KIND = {DIFFERENT: "good", NOT_TOLD_APART: "plain", NOT_TESTED: "fair"}
NO_PARAMETER = ParameterResult(None)


def comparison_tables(comparison: Comparison, answers: Answers) -> dict[str, OutputTable]:
    """Every table of a comparison by name."""
    by = comparison.question.by
    untold = [(name, plain(q.quantity), reason) for q in comparison.quantities for name, reason in q.untold]
    odd = [(o.name, plain_cell(o.quantity), o.z, Cell(o.p, f"{o.p:.2g}")) for o in comparison.odd]
    tables = (
        _parameters(comparison),
        _differences(comparison),
        _scatter(comparison),
        _operating(by, answers),
        _curve(by, "friction_curve", "Friction coefficient of steady sliding over drive speed", answers.groups),
        _curve(by, "amplitude_curve", "Fall of the force in stick-slip over drive speed [N]", answers.groups),
        OutputTable("Fits left out", ("fit", "reason"), comparison.taken.left_out, "left_out"),
        OutputTable("Parameters that a fit does not have", ("fit", "parameter", "reason"), tuple(untold), "not_told"),
        OutputTable("Outliers", ("fit", "parameter", "off by [sd]", "chance among all fits"), tuple(odd), "outliers"),
        reporting(comparison.entries),
        fits_table(comparison.entries),
    )
    return {table.name: table for table in tables}


def plain_cell(name: str) -> Cell:
    """A parameter as a cell: its name in files, its symbol for people."""
    return Cell(name, plain_symbol(name))


def plain(q: Quantity) -> Cell:
    """The same of a quantity."""
    return plain_cell(q.name)


def unit_of(entry: PooledQuantity) -> Scale:
    """The unit in which a parameter is shown: that of the middle of its means."""
    values = sorted(abs(entry.quantity.shown(m.value)) for m in (entry.pooled.means if entry.pooled else ()))
    return scale_for(values[len(values) // 2] if values else None, entry.quantity.unit)


def _parameters(comparison: Comparison) -> OutputTable:
    """The means; standard error and scatter are in the unit of the mean, also where logarithms were pooled."""
    by, who = comparison.question.by, comparison.taken.subject or "people"
    rows: list[Row] = []
    for entry in comparison.quantities:
        q, scale = entry.quantity, unit_of(entry)
        means = {m.group: m for m in (entry.pooled.means if entry.pooled else ())}
        for group in comparison.groups:
            mean = means.get(group)
            if mean is None:
                rows.append((plain(q), group, *[None] * 8, Cell(entry.reason or "none of its fits tells it")))
                continue
            value, ends = q.shown(mean.value), [q.shown(v) for v in mean.interval or ()]
            per = value if q.logarithmic else 1.0
            shown = places_of_positive if q.logarithmic else places_for
            places = shown((ends[1] - ends[0]) / 4 / scale.factor if ends else None, value / scale.factor)
            interval = ends_text(ends[0] / scale.factor, ends[1] / scale.factor, places) if ends else "open"
            rows.append(
                (
                    plain(q),
                    group,
                    Cell(value, decimals(value / scale.factor, places), interval),
                    *(ends or (None, None)),
                    Cell(q.unit, scale.unit or "1"),
                    mean.error * per,
                    mean.fits,
                    mean.subjects,
                    None if mean.scatter is None else mean.scatter * per,
                    mean.reason or ("mean of the logarithm" if q.logarithmic else ""),
                )
            )
    heads = ("parameter", by, "mean", "95 % low", "95 % high", "unit", "standard error", "fits", who)
    return OutputTable(f"Parameters by {by}", (*heads, "scatter of its fits", "remark"), tuple(rows), "parameters")


def _differences(comparison: Comparison) -> OutputTable:
    rows: list[Row] = []
    for entry in comparison.quantities:
        q = entry.quantity
        for d in entry.pooled.differences if entry.pooled else ():
            values = [None if v is None else q.shown(v) for v in (d.value, *(d.interval or (None, None)))]
            text, interval = difference_text(entry, d)
            chance = None if d.p is None else Cell(d.p, "< 0.001" if d.p < 0.001 else f"{d.p:.2g}")
            unit = Cell("first / second") if q.logarithmic else Cell(q.unit)
            verdict = Cell(d.verdict, note=visible(d.reason, 300), kind=VERDICT_KIND[d.verdict])
            rows.append(
                (
                    *(plain(q), d.first, d.second, Cell(values[0], text, interval), *values[1:], unit, chance),
                    *(verdict, d.reason, d.df, d.shared),
                )
            )
    heads = ("parameter", "first", "second", "difference", "simultaneous low", "simultaneous high", "unit", "p")
    rest = ("verdict", "reason", "degrees of freedom", "people with both")
    return OutputTable("Differences", (*heads, *rest), tuple(rows), "differences")


def difference_text(entry: PooledQuantity, d: Difference) -> tuple[str, str]:
    """A difference and its interval as text: a factor where the mean is that of the logarithm."""
    if entry.quantity.logarithmic:
        ends = [math.exp(v) for v in d.interval or ()]
        places = places_of_positive((ends[1] - ends[0]) / 4 if ends else None, math.exp(d.value))
        return f"× {decimals(math.exp(d.value), places)}", f"× {ends_text(ends[0], ends[1], places)}" if ends else ""
    unit = unit_of(entry)
    values = [v / unit.factor for v in (d.value, *(d.interval or ()))]
    places = places_for((values[2] - values[1]) / 4 if d.interval else None, values[0])
    shown = [decimals(v, places) for v in values]
    tail = f" {unit.unit}" if unit.unit else ""
    return f"{'+' * (d.value > 0)}{shown[0]}{tail}", f"{shown[1]} to {shown[2]}{tail}" if d.interval else ""


def _scatter(comparison: Comparison) -> OutputTable:
    who, by = comparison.taken.subject or "person", comparison.question.by
    rows: list[Row] = []
    for entry in comparison.quantities:
        if entry.pooled is None:
            continue
        s, q, unit = entry.pooled.scatter, entry.quantity, unit_of(entry)

        def sd(value: float | None, q: Quantity = q, unit: Scale = unit) -> Cell:
            if value is None:
                return Cell()
            factor, name = (0.01, "%") if q.logarithmic else (unit.factor, unit.unit)
            return Cell(value, f"{number(value / factor, 2)} {name}".rstrip())

        low, high = (sd(end) for end in s.repeatability_interval or (None, None))
        repeat = sd(s.repeatability)
        if low.text:
            repeat = Cell(repeat.value, repeat.text, f"{low.text} to {high.text}")
        icc = Cell(s.intraclass, DASH if s.intraclass is None else decimals(s.intraclass, 2))
        parts = (sd(s.between_groups), sd(s.subject), sd(s.run), sd(s.fit))
        rows.append((plain(q), *parts, repeat, low, high, icc, "logarithm" if q.logarithmic else q.unit))
    heads = ("parameter", f"between {by}s", f"between {who}s", "between runs", "error of a fit", "repeatability")
    rest = ("repeatability low", "repeatability high", "intraclass correlation", "unit")
    return OutputTable("Scatter and repeatability (standard deviations)", (*heads, *rest), tuple(rows), "scatter")


def _operating(by: str, answers: Answers) -> OutputTable:
    force = answers.ground.normal_force if answers.ground else None
    names = ("peak to valley [N]", "period [s]", "stick-slip ends above [m/s]")
    ends = [f"{name} {end}" for name in names for end in ("low", "high", "people low", "people high")]
    heads = (by, "drive speed [m/s]", "normal force [N]", "what it does", "P(stick-slip)", *names, *ends)
    rows: list[Row] = []
    for answer in answers.groups:
        if not answer.at:
            rows.append((answer.group, None, force, answer.reason or "no answer", *[None] * (len(heads) - 4)))
        for at in answer.at:
            figures = ((at.fall, "N"), (at.period, "s"), (answer.critical_speed, "m/s"))
            rows.append(
                (
                    answer.group,
                    Cell(at.speed, quantity(at.speed, "m/s", 3)),
                    force,
                    Cell(at.outcome, OUTCOMES.get(at.outcome, at.outcome)),
                    Cell(at.probability, _probability(at.probability)),
                    *(_figure(figure, unit) for figure, unit in figures),
                    *(e for f, _ in figures for e in (*(f.interval or (None, None)), *(f.people or (None, None)))),
                )
            )
    return OutputTable("At common operating points", tuple(heads), tuple(rows), "operating_points")


def _probability(p: float | None) -> str:
    if p is None or 1e-3 <= p <= 0.999:
        return DASH if p is None else f"{number(100 * p, 3)} %"
    return "> 99.9 %" if p > 0.5 else "< 0.1 %"


def _figure(figure: Figure, unit: str) -> Cell:
    if figure.value is None:
        return Cell(None, "none", figure.reason)
    if figure.interval is None:
        return Cell(figure.value, quantity(figure.value, unit, 3), "interval open")
    scale = scale_for(figure.interval[0], unit)
    low, high = (number(end / scale.factor, 3) for end in figure.interval)
    return Cell(figure.value, quantity(figure.value, unit, 3), f"{low} to {high} {scale.unit}")


def _curve(by: str, name: str, title: str, answers: Iterable[GroupAnswer]) -> OutputTable:
    curves = [(a.group, a.friction if name == "friction_curve" else a.amplitude) for a in answers]
    rows = tuple(
        (group, *(None if value != value else value for value in row))
        for group, c in curves
        if c is not None
        for row in zip(
            *(v.tolist() for v in (c.speed, c.value, c.low, c.high, c.people_low, c.people_high)), strict=True
        )
    )
    heads = (by, "drive speed [m/s]", "value", "95 % low", "95 % high", "people low", "people high")
    return OutputTable(title, heads, rows, name)


def fits_table(
    entries: Sequence[FitEntry], links: Sequence[str] = (), odd: frozenset[str] = frozenset(), first: Sequence[str] = ()
) -> OutputTable:
    """Every fit that was found: status, labels (`first` of them first), parameters with standard errors.

    links: address of each fit's page; odd: names of fits that are outliers.
    """
    labels = list(dict.fromkeys(name for e in entries for name in e.labels))
    labels.sort(key=lambda name: list(first).index(name) if name in first else len(first))
    names = list(dict.fromkeys(n for e in entries for n in e.result.parameters))
    scales = {n: _scale(entries, n) for n in names}
    rows: list[Row] = []
    for entry, link in zip(entries, links or [""] * len(entries), strict=True):
        gate = entry.result.gate
        row: list[Cell | str | int | float | None] = [
            Cell(entry.name, note="outlier?" if entry.name in odd else "", link=link),
            Cell(entry.status, entry.status.replace("_", " "), kind="good" if entry.converged else "bad"),
            entry.message,
            *(entry.labels.get(label) for label in labels),
            len(entry.logs),
            Cell(gate.chi2_per_sample, number(gate.chi2_per_sample, 3)) if gate else None,
        ]
        for name in names:
            told = entry.result.parameters.get(name, NO_PARAMETER)
            row += [_parameter(told, scales[name][0]), told.standard_error, told.verdict]
        rows.append(tuple(row))
    heads = ["fit", "status", "message", *labels, "logs", "misfit"]
    for name in names:
        unit = f" [{scales[name][1]}]" if scales[name][1] else ""
        heads += [f"{name}{unit}", f"{name} standard error{unit}", f"{name} verdict"]
    return OutputTable("Fits", tuple(heads), tuple(rows), "fits")


def _scale(entries: Sequence[FitEntry], name: str) -> tuple[Scale, str]:
    told = [p for e in entries if (p := e.result.parameters.get(name)) is not None]
    values = sorted(abs(p.value) for p in told if p.value is not None)
    unit = next((p.unit for p in told if p.unit), "")
    return scale_for(values[len(values) // 2] if values else None, unit), unit


def _parameter(told: ParameterResult, scale: Scale) -> Cell:
    if told.value is None:
        return Cell()
    value, error, spread = told.value / scale.factor, shown_error(told), digits_follow(told)
    places = places_for(spread / scale.factor, value) if spread else places_for(None, value) - 1
    mark = "" if told.verdict == "identified" else VERDICT_MARK.get(told.verdict, "")
    text = " ".join(filter(None, (decimals(value, places), scale.unit, mark)))
    return Cell(told.value, text, f"± {decimals(error / scale.factor, places)}" if error else told.verdict)


# ----------------------------------------------------------------------------------------------------------------------
# What differs, in sentences.
# ----------------------------------------------------------------------------------------------------------------------


def sentences(comparison: Comparison) -> list[tuple[str, str, str]]:
    """What differs: symbol, meaning and one plain sentence per parameter."""
    named = [(entry.quantity.name, _sentence(entry)) for entry in comparison.quantities]
    return [(plain_symbol(name), MEANINGS.get(name, name.replace("_", " ")), words) for name, words in named]


def together(parts: Sequence[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """The same with equal sentences given once, for all parameters of which they hold."""
    names: dict[str, list[str]] = {}
    meanings = {words: meaning for _, meaning, words in parts}
    for name, _, words in parts:
        names.setdefault(words, []).append(name)
    return [(", ".join(group), meanings[words] if len(group) == 1 else "", words) for words, group in names.items()]


def _sentence(entry: PooledQuantity) -> str:
    if entry.pooled is None:
        return f"not compared: {entry.reason}."
    found = entry.pooled.differences
    if not found:
        count = len(entry.pooled.means)
        return "there is only one group." if count < 2 else f"{count} groups are too many to compare in pairs."
    if all(d.verdict == NOT_TESTED for d in found):
        return f"not tested: {found[0].reason}."
    apart = [(d.first, d.second) if d.value > 0 else (d.second, d.first) for d in found if d.verdict == DIFFERENT]
    named = [f"{visible(higher, 40)} above {visible(lower, 40)}" for higher, lower in apart]
    rest, untested = (sum(d.verdict == verdict for d in found) for verdict in (NOT_TOLD_APART, NOT_TESTED))
    words = "; ".join(named[:6]) or "no difference seen"
    words += f" and {len(named) - 6} more" if len(named) > 6 else ""
    words += f"; {rest} pair{'s' * (rest != 1)} not told apart" if named and rest else ""
    return words + (f"; {untested} not tested" if untested else "") + "."
