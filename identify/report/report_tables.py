"""The tables of a fit, the same for page, terminal, CSV and LaTeX, built from whatever entries the document holds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from scipy.special import ndtri

from identify.base.document import Json, finite, to_dict
from identify.base.result import (
    AccuracyLevel,
    CauseResult,
    EffectReason,
    HeldResult,
    LogResult,
    ParameterResult,
    QualityFigure,
    Result,
    Shift,
)
from identify.base.table import Cell, OutputTable, Row, Value
from identify.base.wording import (
    DASH,
    decimals,
    interval_text,
    number,
    places_for,
    quantity,
    scale_for,
    speed,
    split_key,
)
from identify.prediction.wording import WINDOWS
from identify.report.report_wording import (
    ANSWER_ORDER,
    ANSWER_WORDS,
    MEANINGS,
    OUTCOMES,
    RECORD_WORDS,
    SLIPS,
    VERDICT_CLASS,
    VERDICT_MARK,
    plain_symbol,
    with_group,
)

Entry = Mapping[str, Json]
KeyPath = tuple[str, ...]

# ----------------------------------------------------------------------------------------------------------------------
# Parameters: value, intervals, verdict; how sure they are by each method.
# ----------------------------------------------------------------------------------------------------------------------


UNLIKE = 1.5  # times: an interval so much longer or shorter than the error has it is not that of a normal distribution


def shown_error(entry: ParameterResult) -> float | None:
    """The standard error of a parameter in its unit; None where it is null, and where the interval beside it is not
    that of a normal distribution: "0.620 ± 0.008" beside "0.618 to 0.631" would leave a reader to guess which holds."""
    error, normal = entry.standard_error, _normal_error(entry)
    fits = not error or normal is None or error / UNLIKE <= normal <= error * UNLIKE
    return error if fits else None


def spread_of(entry: ParameterResult) -> float | None:
    """What the digits of a value follow, in its unit: the standard error that is shown, else that of a normal
    distribution with so long an interval; None where neither is known."""
    error = shown_error(entry)
    return _normal_error(entry) if error is None else error


def _normal_error(entry: ParameterResult) -> float | None:
    """The standard error of a normal distribution with an interval as long as the entry's; None where it is open."""
    low, high = entry.ends
    if low is None or high is None:
        return None
    return 0.5 * (high - low) / float(ndtri(0.5 + 0.5 * (entry.level or 0.95)))


def parameter_table(parameters: Mapping[str, ParameterResult], errors: bool = True) -> OutputTable:
    """Value, 95 % interval and verdict of each parameter in lab units, beside them the interval of noise alone where
    there is one. The first column holds the name, its symbol for a page; errors: standard errors beside the values."""
    exact = any(entry.interval_rig_exact for entry in parameters.values())
    rows = []
    for name, entry in parameters.items():
        error, spread, scale = shown_error(entry), spread_of(entry), scale_for(entry.value, entry.unit)
        shown = None if entry.value is None else entry.value / scale.factor
        places = places_for(spread / scale.factor, shown) if spread else places_for(None, shown) - 1
        text = DASH if shown is None else decimals(shown, places)
        text += "" if error is None or shown is None or not errors else f" ± {decimals(error / scale.factor, places)}"
        si = f"{number(entry.value, 5)} {entry.unit}" if entry.value is not None and scale.factor != 1 else ""
        kind = VERDICT_CLASS.get(entry.verdict, "plain")
        known = entry.verdict != "fixed" and entry.interval
        ends = entry.interval_rig_exact
        halves = [abs(end / scale.factor - (shown or 0.0)) for end in ends or () if end is not None]
        alone = places_for(min(halves, default=0.0) / 2, shown)
        rig_exact = interval_text(ends, scale, alone) if ends and shown is not None else ""
        rows.append(
            (
                Cell(
                    with_group(name, entry.group),
                    with_group(plain_symbol(entry.parameter or name), entry.group),
                    MEANINGS.get(entry.parameter or name, ""),
                ),
                Cell(entry.value, text, si, "doubt" if kind == "bad" else ""),
                Cell(interval_text(entry.ends, scale, places) if known else DASH),
                *([Cell(rig_exact, kind="exact")] if exact else []),
                Cell(entry.unit, scale.unit or "1"),
                Cell(
                    entry.verdict, f"{VERDICT_MARK.get(entry.verdict, '')} {entry.verdict}".strip(), entry.reason, kind
                ),
            )
        )
    heads = ("parameter", "value", "95 % interval", *(["rig exact"] if exact else []), "unit", "verdict")
    return OutputTable("Parameters", heads, tuple(rows), "parameters")


def method_table(result: Result) -> OutputTable:
    """The 95 % intervals side by side: the result's own, by profile, by bootstrap; empty where neither was run."""
    profiles = result.profile.parameters if result.profile else {}
    resampled = result.bootstrap.parameters if result.bootstrap else {}
    rows = []
    for name, entry in result.parameters.items():
        if name not in profiles and name not in resampled:
            continue
        scale = scale_for(entry.value, entry.unit)
        row = [Cell(plain_symbol(with_group(name, entry.group)), note=quantity(entry.value, entry.unit, 5))]
        row.append(Cell(interval_text(entry.ends, scale)))
        if profiles:
            curve = profiles.get(name)
            doubts = ["ends at a bound of the scene"] * bool(curve and any(curve.at_bound))
            doubts += ["a point failed"] * bool(curve and any(curve.failed))
            row.append(Cell(interval_text(curve.interval, scale), note=" · ".join(doubts)) if curve else Cell())
        if resampled:
            part = resampled.get(name)
            spread = part.spread_in_standard_errors if part else None
            note = "" if spread is None else f"spread {number(spread, 2)} SE"
            row.append(Cell(interval_text(part.interval, scale), note=note) if part else Cell())
        rows.append(tuple(row))
    heads = ["parameter", "result", *(["profile"] if profiles else [])]
    if result.bootstrap and resampled:
        failed = f", {result.bootstrap.failed} did not settle" if result.bootstrap.failed else ""
        heads.append(f"bootstrap, {result.bootstrap.replicates} replicates{failed}")
    return OutputTable("Intervals by each method", tuple(heads), tuple(rows))


# ----------------------------------------------------------------------------------------------------------------------
# What accuracy costs, which effects and why, what the rig's errors would do.
# ----------------------------------------------------------------------------------------------------------------------

FAR = 4.0  # standard errors beyond which a stated value stands out


def accuracy_rows(table: Sequence[AccuracyLevel]) -> OutputTable:
    """What each level of accuracy costs, and by how many standard errors it moves each parameter."""
    names = list(dict.fromkeys(name for level in table for name in level.shift_in_standard_errors or {}))
    rows = []
    for level in table:
        left = [abs(error) for error in (level.left_in_standard_errors or {}).values() if error is not None]
        shift = level.shift_in_standard_errors or {}
        shifts = (Cell(value, number(value, 2)) for value in map(shift.get, names))
        error = Cell(max(left), f"{number(max(left), 2)} SE") if left else Cell()
        head = Cell(level.accuracy, note="" if shift else "did not solve")
        rows.append(
            (head, Cell(level.seconds, number(level.seconds, 3)), level.iterations, level.steps, error, *shifts)
        )
    heads = ("accuracy", "seconds", "iterations", "steps", "error left", *map(plain_symbol, names))
    return OutputTable("What accuracy costs", heads, tuple(rows))


def effects_table(reasons: Sequence[EffectReason]) -> OutputTable:
    """Which effects and why: one row per effect that was looked at; columns that nobody fills are left out."""
    columns = {
        "group": [
            Cell(finite(r.value), note=r.group) if finite(r.value) is not None else _cell(r.value) for r in reasons
        ],
        "error without it": [
            Cell(e, "" if e is None else f"{number(100 * e, 2)} %") for e in (r.error for r in reasons)
        ],
        "costs": [_cell(r.cost) for r in reasons],
        "gain in the data": [_cell(r.statistic) for r in reasons],
    }
    columns = {head: cells for head, cells in columns.items() if any(c.value not in (None, "") for c in cells)}
    rows: tuple[Row, ...] = tuple(
        (
            reason.effect.replace("_", " "),
            Cell("yes" if reason.kept else "no", kind="" if reason.kept else "doubt"),
            *(cells[k] for cells in columns.values()),
            Cell(reason.sentence, kind="words"),
        )
        for k, reason in enumerate(reasons)
    )
    return OutputTable("Effects: which and why", ("effect", "kept", *columns, "why"), rows)


def _cell(value: object) -> Cell:
    """Anything of a document as a cell: numbers with three digits."""
    shown = finite(value)
    if shown is not None:
        return Cell(shown, number(shown, 3))
    return Cell("yes" if value else "no") if isinstance(value, bool) else Cell(None if value is None else str(value))


def sensitivity_table(sensitivity: Mapping[str, Mapping[str, Shift]]) -> OutputTable:
    """What an error of 1 % in a rig quantity (rows) would do to each parameter (columns)."""
    names = list(dict.fromkeys(name for shifts in sensitivity.values() for name in shifts))
    rows: tuple[Row, ...] = tuple(
        (f"{rig.replace('_', ' ')} + 1 %", *(_shift(shifts.get(name)) for name in names))
        for rig, shifts in sensitivity.items()
    )
    return OutputTable("What an error of the rig would do", ("", *map(plain_symbol, names)), rows)


def _shift(entry: Shift | None) -> Cell:
    if entry is None or entry.shift is None:
        return Cell()
    text, errors = f"{'+' * (entry.shift >= 0)}{quantity(entry.shift, entry.unit, 2)}", entry.in_standard_errors
    if errors is None:
        return Cell(text)
    return Cell(text, note=f"{number(abs(errors), 2)} SE", kind="strong" if abs(errors) >= 1 else "")


def causes_table(causes: Sequence[CauseResult]) -> OutputTable:
    """What a misfit may come of: the score of every quantity that noise does not explain, by class."""
    rows: tuple[Row, ...] = tuple(
        (
            cause.quantity.replace("_", " "),
            Cell(cause.log or "all"),
            Cell(cause.number),
            *(_cell(value) for value in (cause.score, cause.stated, cause.suggested, cause.standard_error)),
        )
        for cause in causes
    )
    heads = ("quantity [SI]", "log", "class", "score", "stated", "by the data", "standard error (SE)")
    return OutputTable("What the misfit may come of", heads, rows)


def held_table(held: Mapping[str, HeldResult]) -> OutputTable:
    """Rig quantities (rows) as stated, and where the data would put them."""
    rows = []
    for name, entry in held.items():
        apart = math.sqrt(entry.squared_distance)
        numbers = ((entry.stated, 4), (entry.from_data, 4), (entry.standard_error, 2))
        cells = (Cell(value, number(value, digits)) for value, digits in numbers)
        rows.append(
            (Cell(name, note=entry.unit), *cells, Cell(apart, f"{apart:.2g} SE", kind="strong" if apart > FAR else ""))
        )
    heads = ("", "stated", "by the data", "standard error (SE)", "apart")
    return OutputTable("The rig as stated, and as the data would have it", heads, tuple(rows))


# ----------------------------------------------------------------------------------------------------------------------
# The classical table: one row per log, step and stroke in the file, turned on its side on the page.
# ----------------------------------------------------------------------------------------------------------------------

LOGS_PER_TABLE = 6
MOST_CLASSICAL_COLUMNS = 60


def classical_rows(logs: Sequence[LogResult]) -> list[tuple[int, Entry]]:
    """The rows of every log's classical table, each with the number of its log (from 1)."""
    return [(position, row) for position, log in enumerate(logs, start=1) for row in log.classical.rows]


def classical_table(logs: Sequence[LogResult]) -> OutputTable:
    """The classical table of all logs (SI, units in the column names); an empty cell where a value is missing."""
    rows = classical_rows(logs)
    columns = list(dict.fromkeys(name for _, row in rows for name in row))
    body = tuple((n, logs[n - 1].path, *(_value(row.get(name)) for name in columns)) for n, row in rows)
    return OutputTable("Classical table", ("log", "path", *columns), body, "classical")


def _value(entry: object) -> Value:
    return entry if entry is None or isinstance(entry, str | int | float) else str(entry)


def classical_pages(logs: Sequence[LogResult]) -> tuple[OutputTable, ...]:
    """The classical table turned on its side: one column per log, step and stroke, one row per quantity.

    Several tables where there are many columns, so that they fit a sheet; at most 60 columns in all.
    """
    whole = classical_table(logs)
    rows = [dict(zip(whole.columns, row, strict=True)) for row in whole.rows[:MOST_CLASSICAL_COLUMNS]]
    names = [n for n in whole.columns[2:] if any(row[n] not in (None, "") and row[n] == row[n] for row in rows)]
    keys = [key for key in ("step", "stroke", "direction") if key in names]
    tables = []
    for first in range(0, len(rows), LOGS_PER_TABLE):
        part = rows[first : first + LOGS_PER_TABLE]
        heads = [", ".join([f"log {row['log']}", *(f"{k} {row[k]}" for k in keys if row[k])]) for row in part]
        body = tuple(_classical_row(name, [row[name] for row in part]) for name in names if name not in keys)
        tables.append(OutputTable("Classical table", ("", *heads), body))
    return tuple(tables)


def _classical_row(key: str, values: Sequence[object]) -> tuple[Cell, ...]:
    name, unit = split_key(key)
    numbers = sorted(abs(shown) for value in values if (shown := finite(value)) is not None)
    scale = scale_for(numbers[len(numbers) // 2] if numbers else None, unit)
    cells = (
        Cell(shown, number(shown / scale.factor)) if (shown := finite(value)) is not None else _cell(value)
        for value in values
    )
    return (Cell(RECORD_WORDS.get(name, name), note=scale.unit), *cells)


def definitions(logs: Sequence[LogResult]) -> list[tuple[str, str]]:
    """What each row of the classical table is, as the document says it: (name, sentence)."""
    out: dict[str, str] = {}
    for log in logs:
        for name, sentence in log.classical.definitions.items():
            words = split_key(name)[0]
            out.setdefault(RECORD_WORDS.get(words, words), sentence)
    return list(out.items())


# ----------------------------------------------------------------------------------------------------------------------
# Derived quantities of several logs side by side: any nesting of entries {"value", "unit", "interval", "validity"}.
# ----------------------------------------------------------------------------------------------------------------------

WORDS = {**OUTCOMES, **SLIPS}
SHOWN = ("omega_n", "zeta", "tau_cr", "v_cr", "v_acr", "gamma_0", "w")
NOTHING = 1e-9  # a pure number below this is shown as next to nothing


def answer_table(columns: Sequence[tuple[str, Entry]], title: str = "") -> OutputTable:
    """A table with one column per (heading, entries) and one row per quantity.

    Nested mappings become parts of the table; plain numbers, texts and truth values are taken too, lists and
    whole sentences (key "text") are not. What all entries of a part say of their validity stands once.
    """
    found = [dict(_leaves(entries)) for _, entries in columns]
    paths = list(dict.fromkeys(path for entries in found for path in entries))
    rows: list[tuple[Cell, ...]] = []
    for part in sorted(dict.fromkeys(path[:-1] for path in paths), key=_rank):
        inside = [path for path in paths if path[:-1] == part]
        validities = {str(column[path].get("validity") or "") for path in inside for column in found if path in column}
        shared = next(iter(validities)) if len(validities) == 1 and len(inside) > 1 else ""
        if part:
            rows.append((Cell(" · ".join(_word(name) for name in part), note=shared),))
        rows += [_answer_row(path[-1], [column.get(path) for column in found], shared) for path in inside]
    return OutputTable(title, (title, *(head for head, _ in columns)), tuple(rows))


def _answer_row(key: str, entries: Sequence[Entry | None], shared: str) -> tuple[Cell, ...]:
    known = [entry for entry in entries if entry is not None]
    label = next((str(entry["label"]) for entry in known if entry.get("label")), _word(key))
    meaning = next((str(entry["meaning"]) for entry in known if entry.get("meaning")), "")
    return (Cell(label, note=meaning), *(_answer(entry, shared) for entry in entries))


def _answer(entry: Entry | None, shared: str) -> Cell:
    """Value with unit; below it the interval and how far it may be trusted."""
    if entry is None:
        return Cell()
    value, unit, validity = entry.get("value"), str(entry.get("unit") or ""), str(entry.get("validity") or "")
    shown, ends = finite(value), entry.get("interval")
    if shown is not None and not unit and 0.0 < abs(shown) < NOTHING:
        return Cell("below 10⁻⁹")
    interval = ""
    if shown is not None and isinstance(ends, Sequence) and len(ends) == 2 and any(e is not None for e in ends):
        interval = interval_text((finite(ends[0]), finite(ends[1])), scale_for(shown, unit))
    notes = (interval, "" if validity == shared else validity, str(entry.get("reason") or ""))
    kind = "doubt" if "not valid" in validity.lower() else ""
    text = quantity(shown, unit) if shown is not None else WORDS.get(str(value)) or _cell(value).shown
    return Cell(text, note=" · ".join(filter(None, notes)), kind=kind)


def _leaves(entries: Entry, above: KeyPath = ()) -> Iterator[tuple[KeyPath, Entry]]:
    for key, entry in entries.items():
        if isinstance(entry, Mapping) and "value" not in entry:
            yield from _leaves(entry, (*above, str(key)))
        elif isinstance(entry, Mapping):
            yield (*above, str(key)), entry
        elif key == "sliding_unstable_between" and isinstance(entry, list):
            spans = [" to ".join(speed(finite(end)) for end in span) for span in entry]
            yield (*above, str(key)), {"value": ", ".join(spans) or "nowhere", "unit": ""}
        elif key == "windows" and isinstance(entry, list):
            yield (*above, str(key)), {"value": _windows(entry), "unit": ""}
        elif not isinstance(entry, list) and key != "text":
            yield (*above, str(key)), {"value": entry, "unit": split_key(str(key))[1]}


def _windows(windows: Sequence[Entry]) -> str:
    """What holds over which drive speeds, in rising order."""
    words = [WINDOWS.get(str(window["outcome"]), str(window["outcome"])).split(",")[0] for window in windows]
    ends = [f" up to {speed(finite(window['to']))}" for window in windows[:-1]]
    return "; ".join(word + end for word, end in zip(words, [*ends, " above" if ends else ""], strict=True))


def _rank(part: KeyPath) -> tuple[int, int]:
    known = ANSWER_ORDER.index(part[0]) if part and part[0] in ANSWER_ORDER else len(ANSWER_ORDER)
    return (known if part else -1, len(part))


def _word(key: str) -> str:
    return ANSWER_WORDS.get(key) or split_key(key)[0]


OUTLOOK = (("amplitude", "drop"), ("amplitude", "period"), ("stability", "critical_speed"))


def outlook_of(derived: Entry) -> Entry:
    """Of what follows from the parameters at one log the three numbers that are asked for first."""
    parts = {part: derived.get(part) for part, _ in OUTLOOK}
    return {key: found[key] for part, key in OUTLOOK if isinstance(found := parts[part], Mapping) and key in found}


def without_groups_of(entries: Entry, elsewhere: Entry) -> Entry:
    """The entries of a log without what stands in another table as well; of the dimensionless groups those that say
    something of the pair and the rig, while result.json holds all that the closed forms are made of."""
    groups = entries.get("groups")
    if not isinstance(groups, Mapping):
        return entries
    return {**entries, "groups": {key: entry for key, entry in groups.items() if key in SHOWN and key not in elsewhere}}


def of_record(figures: Mapping[str, QualityFigure]) -> Entry:
    """Figures of the data quality of one log, named as what the record alone shows."""
    return {
        key: {**({"label": RECORD_WORDS[key]} if key in RECORD_WORDS else {}), **to_dict(figure)}
        for key, figure in figures.items()
    }


def sentences(entries: Entry, several: bool = False) -> tuple[str, ...]:
    """What the entries say in whole sentences (key "text" of their parts, or their own); of several logs not what is
    nearly the same for all of them, and stands in the table: the stability."""
    silent = ("closed_forms", *(("stability",) if several and "amplitude" in entries else ()))
    parts = [part for name, part in entries.items() if isinstance(part, Mapping) and name not in silent]
    texts = [str(part["text"]) for part in parts if part.get("text")]
    return tuple(texts or [line for line in str(entries.get("text") or "").splitlines() if line])
