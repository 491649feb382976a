"""Tables of the page: text in lab units, with what they sort by, built from a comparison."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

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
from identify.report.report_wording import MEANINGS, OUTCOMES, plain_symbol
from identify.studies.compare import Comparison, PooledQuantity
from identify.studies.fits import Quantity
from identify.studies.labels import SHOWN, visible
from identify.studies.operating_points import Figure, GroupAnswer
from identify.studies.pooled import DIFFERENT, NOT_TESTED, Difference
from identify.studies.reporting import Item

REASON = 400  # characters of a reason that are shown
VERDICT_KIND = {DIFFERENT: "good", "not told apart": "plain", NOT_TESTED: "fair"}


@dataclass(frozen=True)
class PageCell:
    """One cell: text, a smaller note, a chip of a kind instead of plain text, a link, what it sorts by, and how many
    characters of the text are shown."""

    text: str
    note: str = ""
    chip: str = ""
    link: str = ""
    sort: float | str | None = None
    most: int = SHOWN


@dataclass(frozen=True)
class PageTable:
    """A table that sorts itself: id, heads (numeric ones are set right), rows of cells, the first being the head."""

    id: str
    heads: tuple[str, ...]
    numeric: tuple[bool, ...]
    rows: tuple[tuple[PageCell, ...], ...]


def table(id_: str, heads: Sequence[str], rows: Sequence[Sequence[PageCell]]) -> PageTable:
    """A table; a column is numeric where all its cells with something to sort by are numbers."""
    numeric = []
    for k in range(len(heads)):
        keys = [row[k].sort for row in rows if row[k].sort is not None]
        numeric.append(bool(keys) and not any(isinstance(key, str) for key in keys))
    return PageTable(id_, tuple(heads), tuple(numeric), tuple(tuple(row) for row in rows))


def named(quantity_: Quantity) -> PageCell:
    """The parameter as the first cell of a row."""
    return PageCell(plain_symbol(quantity_.name), sort=quantity_.name)


def parameters(comparison: Comparison) -> PageTable:
    """The pooled means of every parameter and group."""
    who = comparison.taken.subject
    heads = ["parameter", comparison.question.by, "mean", "95 % interval", "unit", "fits"]
    heads += [f"{who}s"] if who else []
    rows = []
    for entry in comparison.quantities:
        if entry.pooled is None:
            continue
        q = entry.quantity
        unit = _unit(entry)
        for mean in sorted(entry.pooled.means, key=lambda m: comparison.groups.index(m.group)):
            value = q.shown(mean.value) / unit.factor
            ends = [q.shown(v) / unit.factor for v in mean.interval or ()]
            shown = places_of_positive if q.logarithmic else places_for
            places = shown((ends[1] - ends[0]) / 4 if ends else None, value)
            interval = ends_text(ends[0], ends[1], places) if ends else "open"
            row = [
                named(q),
                PageCell(mean.group, sort=mean.group),
                PageCell(decimals(value, places), sort=q.shown(mean.value)),
                PageCell(interval, mean.reason, sort=ends[0] if ends else None),
                PageCell(unit.unit or "1"),
                PageCell(str(mean.fits), sort=mean.fits),
            ]
            rows.append(row + ([PageCell(str(mean.subjects), sort=mean.subjects)] if who else []))
    return table("parameters", heads, rows)


def _unit(entry: PooledQuantity) -> Scale:
    """The unit in which a parameter is shown: that of the middle of its means."""
    values = sorted(abs(entry.quantity.shown(m.value)) for m in (entry.pooled.means if entry.pooled else ()))
    return scale_for(values[len(values) // 2] if values else None, entry.quantity.unit)


def differences(comparison: Comparison) -> PageTable:
    """All differences between groups, with simultaneous intervals and verdicts."""
    who = comparison.taken.subject
    heads = ["parameter", "first", "second", "difference", "simultaneous interval", "verdict"]
    heads += [f"{who}s with both"] if who else []
    rows = []
    for entry in comparison.quantities:
        for d in entry.pooled.differences if entry.pooled else ():
            text, interval = difference_text(entry, d)
            chance = "" if d.p is None else "p < 0.001" if d.p < 0.001 else f"p = {d.p:.2g}"
            row = [
                named(entry.quantity),
                PageCell(d.first, sort=d.first),
                PageCell(d.second, sort=d.second),
                PageCell(text, sort=d.value),
                PageCell(interval, d.reason),
                PageCell(d.verdict, chance, chip=VERDICT_KIND[d.verdict], sort=d.verdict),
            ]
            rows.append(row + ([PageCell(str(d.shared), sort=d.shared)] if who else []))
    return table("differences", heads, rows)


def difference_text(entry: PooledQuantity, d: Difference) -> tuple[str, str]:
    """A difference and its interval as text: a factor where the parameter is pooled as a logarithm."""
    if entry.quantity.logarithmic:
        ends = [math.exp(v) for v in d.interval or ()]
        places = places_of_positive((ends[1] - ends[0]) / 4 if ends else None, math.exp(d.value))
        return f"× {decimals(math.exp(d.value), places)}", f"× {ends_text(ends[0], ends[1], places)}" if ends else DASH
    unit = _unit(entry)
    values = [v / unit.factor for v in (d.value, *(d.interval or ()))]
    places = places_for((values[2] - values[1]) / 4 if d.interval else None, values[0])
    shown = [decimals(v, places) for v in values]
    tail = f" {unit.unit}" if unit.unit else ""
    sign = "+" if d.value > 0 else ""
    return f"{sign}{shown[0]}{tail}", f"{shown[1]} to {shown[2]}{tail}" if d.interval else DASH


def scatter(comparison: Comparison) -> PageTable:
    """Where the scatter comes from, and how well a run repeats itself."""
    who, by = comparison.taken.subject or "person", comparison.question.by
    heads = [
        "parameter",
        f"between {by}s",
        f"between {who}s",
        f"{who} on one {by}",
        "between runs",
        "error of a fit",
        "repeatability",
        "intraclass correlation",
    ]
    rows = []
    for entry in comparison.quantities:
        if entry.pooled is None:
            continue
        s, unit = entry.pooled.scatter, _unit(entry)
        parts = (s.between_groups, s.subject, s.subject_by_group, s.run, s.fit)
        cells = [PageCell(_sd(entry.quantity, unit, v), sort=v) for v in parts]
        ends = s.repeatability_interval
        note = f"{_sd(entry.quantity, unit, ends[0])} to {_sd(entry.quantity, unit, ends[1])}" if ends else ""
        repeat = PageCell(_sd(entry.quantity, unit, s.repeatability), note, sort=s.repeatability)
        icc = PageCell(DASH if s.intraclass is None else decimals(s.intraclass, 2), sort=s.intraclass)
        rows.append([named(entry.quantity), *cells, repeat, icc])
    return table("scatter", heads, rows)


def _sd(q: Quantity, unit: Scale, value: float | None) -> str:
    if value is None:
        return DASH
    if q.logarithmic:
        return f"{number(100 * value, 2)} %"
    return f"{number(value / unit.factor, 2)} {unit.unit}".rstrip()


def operating(by: str, answers: Sequence[GroupAnswer], normal_force: float | None) -> PageTable:
    """What each group does at the common operating points."""
    heads = [
        by,
        "drive speed",
        "what it does",
        "P(stick-slip)",
        "peak to valley",
        "stick-slip ends above",
        "margin",
    ]
    rows = []
    for answer in answers:
        if not answer.at:
            group, reason, dash = (
                PageCell(answer.group, sort=answer.group),
                PageCell(answer.reason, most=REASON),
                PageCell(DASH),
            )
            rows.append([group, dash, dash, reason, dash, dash, dash])
        for at in answer.at:
            rows.append(
                [
                    PageCell(answer.group, sort=answer.group),
                    PageCell(quantity(at.speed, "m/s", 3), sort=at.speed),
                    PageCell(OUTCOMES.get(at.outcome, at.outcome), sort=at.outcome),
                    PageCell(_probability(at.probability), sort=at.probability),
                    _figure(at.fall, "N"),
                    _figure(answer.critical_speed, "m/s"),
                    PageCell(
                        DASH if at.margin.value is None else f"× {number(at.margin.value, 3)}",
                        _ends(at.margin.interval, ""),
                        sort=at.margin.value,
                    ),
                ]
            )
    return table("operating", heads, rows)


def _probability(p: float | None) -> str:
    if p is None:
        return DASH
    if p > 0.999:
        return "> 99.9 %"
    return "< 0.1 %" if p < 0.001 else f"{number(100 * p, 3)} %"


def _figure(figure: Figure, unit: str) -> PageCell:
    note = _ends(figure.interval, unit)
    if figure.value is None:
        return PageCell("none", figure.reason)
    return PageCell(quantity(figure.value, unit, 3), note or (figure.reason and "interval open"), sort=figure.value)


def _ends(ends: tuple[float, float] | None, unit: str) -> str:
    if ends is None:
        return ""
    scale = scale_for(ends[0], unit)
    low, high = (number(v / scale.factor, 3) for v in ends)
    return f"{low} to {high} {scale.unit}".rstrip()


def reporting(items: Sequence[Item]) -> PageTable:
    """The data sheet of ASTM G115."""
    rows = [
        [
            PageCell(i.name, sort=i.name),
            PageCell(i.text, sort=i.text, most=REASON) if i.text else PageCell("missing", chip="fair", sort=""),
            PageCell(i.source if i.text else f"give it as {i.source}"),
        ]
        for i in items
    ]
    return table("reporting", ["item", "told", "from"], rows)


def sentences(comparison: Comparison) -> list[tuple[str, str, str]]:
    """What differs: symbol, meaning and one plain sentence per parameter."""
    named = [(entry.quantity.name, _sentence(entry)) for entry in comparison.quantities]
    return [(plain_symbol(name), MEANINGS.get(name, name.replace("_", " ")), words) for name, words in named]


def together(told: Sequence[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """The same with equal sentences said once, for all parameters of which they hold."""
    names: dict[str, list[str]] = {}
    meanings = {words: meaning for _, meaning, words in told}
    for name, _, words in told:
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
    told = [f"{visible(higher, 40)} above {visible(lower, 40)}" for higher, lower in apart]
    rest = sum(d.verdict == "not told apart" for d in found)
    untested = sum(d.verdict == NOT_TESTED for d in found)
    words = (
        "; ".join(told[:6]) + (f" and {len(told) - 6} more" if len(told) > 6 else "") if told else "no difference seen"
    )
    if told and rest:
        words += f"; {rest} pair{'s' * (rest != 1)} not told apart"
    if untested:
        words += f"; {untested} not tested"
    return words + "."
