"""How sure an answer is and what to change, as tables of the page: intervals, combinations, accuracy, effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from identify.base.document import Json, from_document
from identify.base.result import (
    AccuracyLevel,
    CombinationsResult,
    ComparedModel,
    Interval,
    Number,
    Result,
)
from identify.base.wording import DASH, number, quantity
from identify.prediction.stabilising import ChangeAdvice, StabilisingAdvice
from identify.report.answers import interval_text
from identify.report.report_tables import ReportCell, ReportTable, Row
from identify.report.report_wording import plain_symbol, with_group

# ----------------------------------------------------------------------------------------------------------------------
# Advice as a table: what each quantity of the rig is, its limit, and what it should be.
# ----------------------------------------------------------------------------------------------------------------------

HEADS = (ReportCell("now"), ReportCell("limit"), ReportCell("should be"))


def advice_table(head: ReportCell, derived: Mapping[str, Json]) -> ReportTable | None:
    """The table of the advice of a log; None where it has none."""
    if not derived.get("advice"):
        return None
    advice = from_document(StabilisingAdvice, derived["advice"], "advice")
    if not advice.changes:
        return None
    task = "to stay steady" if advice.steady else "to make sliding steady"
    corner = f"{head.text}: {task}, margin {100 * advice.margin:.3g} %, one of these"
    return ReportTable(corner, HEADS, tuple(_row(change) for change in advice.changes))


def _row(change: ChangeAdvice) -> Row:
    word = {"least": "at least ", "most": "at most "}.get(change.at or "", "")
    notes = [change.reason, "extrapolated: outside the tested range" if change.extrapolated else ""]
    if change.zeta:
        notes.insert(0, f"ζ = {change.zeta:.3g}")
    if change.advised.value is None:
        told = "any" if change.limit.value is None and "it is steady" in change.reason else "cannot be reached"
    else:
        told = "as it is" if change.advised.value == change.now.value else word + _said(change.advised)
    limit = change.limit.reason or interval_text(change.limit.interval, change.limit.value, change.limit.unit)
    return Row(
        change.label,
        (
            ReportCell(_said(change.now)),
            ReportCell(_said(change.limit), " · ".join(filter(None, (limit, change.kind)))),
            ReportCell(told, " · ".join(filter(None, notes)), "doubt" if change.extrapolated else ""),
        ),
    )


def _said(entry: Number) -> str:
    return quantity(entry.value, entry.unit, 3)


def interval_table(result: Result) -> ReportTable | None:
    """The 95 % intervals side by side: the result's own, by profile, by bootstrap; None where neither was run."""
    heads = [ReportCell("result")]
    methods: list[dict[str, tuple[Interval, str]]] = []  # interval and remark by parameter
    if result.profile and result.profile.parameters:
        heads.append(ReportCell("profile"))
        methods.append({})
        for name, curve in result.profile.parameters.items():
            doubts = ["ends at a bound of the scene"] * any(curve.at_bound) + ["a point failed"] * any(curve.failed)
            methods[-1][name] = curve.interval, " · ".join(doubts)
    if result.bootstrap and result.bootstrap.parameters:
        failed = f", {result.bootstrap.failed} did not settle" if result.bootstrap.failed else ""
        heads.append(ReportCell("bootstrap", f"{result.bootstrap.replicates} replicates{failed}"))
        methods.append({})
        for name, part in result.bootstrap.parameters.items():
            spread = part.spread_in_standard_errors
            methods[-1][name] = part.interval, "" if spread is None else f"spread {number(spread, 2)} SE"
    rows = []
    for name, entry in result.parameters.items():
        if not any(name in method for method in methods):
            continue
        cells = [ReportCell(interval_text(entry.interval, entry.value, entry.unit) or "open")]
        for method in methods:
            interval, note = method.get(name, (None, ""))
            text = interval_text(interval, entry.value, entry.unit) or "open"
            cells.append(ReportCell(text, note) if name in method else ReportCell(DASH))
        rows.append(
            Row(plain_symbol(with_group(name, entry.group)), tuple(cells), quantity(entry.value, entry.unit, 5))
        )
    return ReportTable("parameter", tuple(heads), tuple(rows)) if rows else None


def combination_table(combinations: CombinationsResult) -> ReportTable | None:
    """Combinations that are known better than their parts; None without any."""
    rows = [
        Row(
            entry.name,
            (
                ReportCell(quantity(entry.value, entry.unit)),
                ReportCell(interval_text(entry.interval, entry.value, entry.unit)),
                ReportCell(f"{number(entry.sharper, 2)} ×"),
            ),
            note=entry.meaning,
        )
        for entry in combinations.natural
    ]
    heads = (ReportCell("value"), ReportCell("95 % interval"), ReportCell("sharper than its loosest part"))
    return ReportTable("combination", heads, tuple(rows)) if rows else None


def direction_lines(combinations: CombinationsResult) -> tuple[str, ...]:
    """The best and the worst known direction, in words."""
    lines = [direction.text for direction in combinations.directions]
    return tuple(line[:1].upper() + line[1:] + "." for line in (lines[:1] + lines[-1:] if len(lines) > 1 else lines))


def accuracy_rows(table: Sequence[AccuracyLevel]) -> ReportTable | None:
    """What each level of accuracy costs, and by how many standard errors it moves each parameter."""
    if not table:
        return None
    names = list(dict.fromkeys(name for level in table for name in level.shift_in_standard_errors or {}))
    heads = ("seconds", "iterations", "steps", "error left", *(plain_symbol(name) for name in names))
    rows = []
    for level in table:
        left = [abs(error) for error in (level.left_in_standard_errors or {}).values() if error is not None]
        shift = level.shift_in_standard_errors or {}
        cells = (
            number(level.seconds, 3),
            _count(level.iterations),
            _count(level.steps),
            f"{number(max(left), 2)} SE" if left else DASH,
            *(number(shift.get(name), 2) for name in names),
        )
        rows.append(Row(level.accuracy, tuple(map(ReportCell, cells)), note="" if shift else "did not solve"))
    return ReportTable("accuracy", tuple(map(ReportCell, heads)), tuple(rows))


def comparison_table(models: Sequence[ComparedModel]) -> ReportTable | None:
    """The fit with and without each effect: information criteria and errors on what was left out."""
    rows = []
    for entry in models:
        cells = (
            _count(entry.parameters),
            number(entry.chi2_per_sample, 5),
            _signed(entry.delta_aic),
            _signed(entry.delta_bic),
            number(entry.left_out_cycles, 4),
            number(entry.left_out_logs, 4),
        )
        rows.append(
            Row(entry.model.replace("_", " "), (*map(ReportCell, cells), ReportCell(entry.verdict, kind="words")))
        )
    heads = ("parameters", "χ² per sample", "ΔAIC", "ΔBIC", "error on cycles left out", "error on logs left out")
    return (
        ReportTable("model", (*map(ReportCell, heads), ReportCell("verdict", kind="words")), tuple(rows))
        if rows
        else None
    )


def _count(value: int | None) -> str:
    return DASH if value is None else str(value)


def _signed(value: float | None) -> str:
    return number(value, 3) if value is None or value <= 0 else f"+{number(value, 3)}"
