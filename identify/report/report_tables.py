"""Tables of the page as plain data, built from whatever entries the document holds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from identify.base.document import finite
from identify.base.result import EffectReason, HeldResult, LogResult, Shift
from identify.base.wording import DASH, number, quantity, scale_for, split_key
from identify.report.report_wording import RECORD_WORDS, plain_symbol
from identify.report.text_tables import classical_rows, column_names

LOGS_PER_TABLE = 6
MOST_CLASSICAL_COLUMNS = 60
FAR = 4.0  # standard errors beyond which a stated value stands out
EFFECT_COLUMNS = (
    ("group", "value"),
    ("error without it", "error"),
    ("costs", "cost"),
    ("gain in the data", "statistic"),
    ("error on cycles kept back", "held_out"),
)  # heads and keys of a reason


@dataclass(frozen=True)
class ReportCell:
    """One cell: its text, a smaller second line, and a kind that the style sheet knows."""

    text: str
    note: str = ""
    kind: str = ""


@dataclass(frozen=True)
class Row:
    """One row: its head, a smaller word beside it (a unit, say), its cells; `heading` rows only part the table."""

    head: str
    cells: tuple[ReportCell, ...] = ()
    note: str = ""
    heading: bool = False


@dataclass(frozen=True)
class ReportTable:
    """A table with a corner text, column heads and rows."""

    corner: str
    heads: tuple[ReportCell, ...]
    rows: tuple[Row, ...]


def classical_tables(logs: Sequence[LogResult]) -> tuple[ReportTable, ...]:
    """The classical table turned on its side: one column per log, step and stroke, one row per quantity.

    Several tables where there are many columns, so that they fit a sheet; at most 60 columns in all
    (classical.csv holds every one).
    """
    rows = classical_rows(logs)[:MOST_CLASSICAL_COLUMNS]
    keys = [key for key in ("step", "stroke", "direction") if any(key in row for _, row in rows)]
    names = [name for name in column_names(rows) if name not in keys and any(told(row.get(name)) for _, row in rows)]
    tables = []
    for first in range(0, len(rows), LOGS_PER_TABLE):
        part = rows[first : first + LOGS_PER_TABLE]
        heads = tuple(
            ReportCell(f"log {position}", ", ".join(f"{key} {row[key]}" for key in keys if told(row.get(key))))
            for position, row in part
        )
        tables.append(
            ReportTable("", heads, tuple(_classical_row(name, [row.get(name) for _, row in part]) for name in names))
        )
    return tuple(tables)


def definitions(logs: Sequence[LogResult]) -> list[tuple[str, str]]:
    """What each row of the classical table is, as the document says it: (name, sentence)."""
    said: dict[str, str] = {}
    for log in logs:
        for name, sentence in log.classical.definitions.items():
            words = split_key(name)[0]
            said.setdefault(RECORD_WORDS.get(words, words), sentence)
    return list(said.items())


def sensitivity_table(sensitivity: Mapping[str, Mapping[str, Shift]]) -> ReportTable:
    """What an error of 1 % in a rig quantity (rows) would do to each parameter (columns)."""
    names = list(dict.fromkeys(name for shifts in sensitivity.values() for name in shifts))
    rows = tuple(
        Row(f"{quantity_name.replace('_', ' ')} + 1 %", tuple(_shift_cell(shifts.get(name)) for name in names))
        for quantity_name, shifts in sensitivity.items()
    )
    return ReportTable("", tuple(ReportCell(plain_symbol(name)) for name in names), rows)


def held_table(held: Mapping[str, HeldResult]) -> ReportTable:
    """Rig quantities (rows) as stated, and where the data would put them."""
    heads = tuple(ReportCell(head) for head in ("stated", "by the data", "standard error (SE)", "apart"))
    rows = []
    for name, entry in held.items():
        numbers = number(entry.stated, 4), number(entry.from_data, 4), number(entry.standard_error, 2)
        apart = math.sqrt(entry.squared_distance)
        cells = (
            *(ReportCell(text) for text in numbers),
            ReportCell(f"{apart:.2g} SE", kind="strong" if apart > FAR else ""),
        )
        rows.append(Row(name, cells, entry.unit))
    return ReportTable("", heads, tuple(rows))


def effects_table(reasons: Sequence[EffectReason]) -> ReportTable | None:
    """Which effects and why: one row per effect that was looked at; columns that nobody fills are left out."""
    if not reasons:
        return None
    columns = [(head, key) for head, key in EFFECT_COLUMNS if any(told(getattr(each, key)) for each in reasons)]
    heads = (ReportCell("kept"), *(ReportCell(head) for head, _ in columns), ReportCell("why", kind="words"))
    return ReportTable("effect", heads, tuple(_effect_row(reason, [key for _, key in columns]) for reason in reasons))


def _effect_row(reason: EffectReason, keys: Sequence[str]) -> Row:
    cells = [ReportCell("yes" if reason.kept else "no", kind="" if reason.kept else "doubt")]
    for key in keys:
        value = getattr(reason, key)
        shown = finite(value)
        text = plain_text(value) if shown is None else number(shown, 3)
        if key == "error" and shown is not None:
            text = f"{number(100 * shown, 2)} %"
        cells.append(ReportCell(text, reason.group if key == "value" else ""))
    return Row(reason.effect.replace("_", " "), (*cells, ReportCell(reason.sentence, kind="words")))


def told(value: object) -> bool:
    """Whether a cell has something to say: not None, not empty, not NaN."""
    return value is not None and value != "" and value == value


def _classical_row(key: str, values: Sequence[object]) -> Row:
    name, unit = split_key(key)
    numbers = [abs(shown) for value in values if (shown := finite(value)) is not None]
    scale = scale_for(sorted(numbers)[len(numbers) // 2] if numbers else None, unit)
    cells = tuple(
        ReportCell(number(shown / scale.factor))
        if (shown := finite(value)) is not None
        else ReportCell(plain_text(value))
        for value in values
    )
    return Row(RECORD_WORDS.get(name, name), cells, note=scale.unit)


def plain_text(value: object) -> str:
    """Anything that is no number as the text of a cell."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value) if told(value) else DASH


def _shift_cell(entry: Shift | None) -> ReportCell:
    if entry is None or entry.shift is None:
        return ReportCell(DASH)
    text = quantity(entry.shift, entry.unit, 2)
    text, errors = text if entry.shift < 0 else f"+{text}", entry.in_standard_errors
    if errors is None:
        return ReportCell(text)
    return ReportCell(text, f"{number(abs(errors), 2)} SE", "strong" if abs(errors) >= 1 else "")
