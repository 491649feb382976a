"""The tables of a fit, the same for page, terminal, CSV and LaTeX, built from whatever entries the document holds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from identify.base import result as schema
from identify.base import wording
from identify.base.document import Json, finite, from_document
from identify.base.result import LogResult, ParameterResult, Result
from identify.base.table import Cell, OutputTable, Row
from identify.base.wording import DASH, Scale, decimals, interval_text, number, quantity, scale_for, value_and_interval
from identify.report import report_wording
from identify.report.report_wording import plain_symbol, with_group

FAR = 4.0  # standard errors beyond which a stated value stands out
LOGS_PER_TABLE = 6
MOST_CLASSICAL_COLUMNS = 60
CAUSE_UNITS = {"stiffness": "N/m", "drive_speed": "m/s", "force_zero": "N", "load_zero": "N", "sensor_lag": "s"}
LARGEST_ERROR = "largest error (SE)"
HEADINGS = ("run", "step", "stroke", "direction")  # of a stroke


def parameter_table(parameters: Mapping[str, ParameterResult]) -> OutputTable:
    """Value, 95 % interval and verdict of each parameter in lab units, beside them the interval of noise alone where
    there is one. The first column holds the name, its symbol for a page."""
    exact = any(entry.interval_rig_exact for entry in parameters.values())
    rows = []
    for name, entry in parameters.items():
        scale, alone = scale_for(entry.value, entry.unit), ""
        value, interval = value_and_interval(entry.value, entry.ends, scale, entry.standard_error)
        if entry.value is not None and entry.interval_rig_exact:
            halves = [abs(end - entry.value) / scale.factor for end in entry.interval_rig_exact if end is not None]
            exact_places = wording.places_for(min(halves, default=0.0) / 2, entry.value / scale.factor)
            alone = interval_text(entry.interval_rig_exact, scale, exact_places)
        interval = DASH if entry.verdict == "fixed" or not entry.interval else interval or "open"
        kind, base = report_wording.VERDICT_CLASS.get(entry.verdict, "plain"), entry.parameter or name
        symbol = with_group(plain_symbol(base), entry.group)
        verdict = f"{report_wording.VERDICT_MARK.get(entry.verdict, '')} {entry.verdict}".strip()
        rows.append(
            (
                Cell(with_group(name, entry.group), symbol, report_wording.MEANINGS.get(base, "")),
                Cell(entry.value, value, kind="doubt" if kind == "bad" else ""),
                Cell(interval),
                *([Cell(alone, kind="exact")] if exact else []),
                Cell(entry.unit, scale.unit or "1"),
                Cell(entry.verdict, verdict, entry.reason, kind),
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
        curve, part, scale = profiles.get(name), resampled.get(name), scale_for(entry.value, entry.unit)
        if curve is None and part is None:
            continue
        by_profile = by_bootstrap = Cell()
        if curve is not None:
            remarks = ["ends at a bound of the scene"] * any(curve.at_bound) + ["a point failed"] * any(curve.failed)
            by_profile = Cell(interval_text(curve.interval, scale), note=" · ".join(remarks))
        if part is not None:
            spread = part.spread_in_standard_errors
            note = "" if spread is None else f"spread {number(spread, 2)} SE"
            by_bootstrap = Cell(interval_text(part.interval, scale), note=note)
        head = Cell(plain_symbol(with_group(name, entry.group)), note=quantity(entry.value, entry.unit, 5))
        rows.append((head, Cell(interval_text(entry.ends, scale)), by_profile, by_bootstrap))
    drawn = result.bootstrap
    failed = f", {drawn.failed} did not settle" if drawn and drawn.failed else ""
    heads = ("parameter", "result", "profile", f"bootstrap, {drawn.replicates if drawn else 0} replicates{failed}")
    return OutputTable("Intervals by each method", heads, tuple(rows)).filled()


def summary(result: Result, costs: bool = False) -> str:
    """A fit in plain text of 79 columns: status, parameters with intervals and verdicts, the reasons of what is not
    identified; costs: also those of the accuracy."""
    lines = [wording.wrapped(f"{result.status.replace('_', ' ')}: {result.message}")]
    if not result.converged:
        return lines[0]
    for place, log in enumerate(result.logs, 1):
        if log.reason_left_out:
            lines.append(wording.wrapped(f"log {place} was left out: {log.reason_left_out}", "  "))
    table = parameter_table(result.parameters)
    lines += ["", table.to_text()]
    if meaning := report_wording.tolerances_text(result.tolerances or {}):
        lines.append(wording.wrapped(meaning, "  "))
    lines.append("")
    if report_wording.is_uneven(result):
        heads = ["", "median (95 % interval)", "nine of ten cycles"]
        lines += [wording.columns([heads, *map(list, report_wording.distribution_lines(result))]), ""]
        lines += [wording.wrapped(report_wording.NOT_FOR, "  "), ""]
    if result.effects.chosen == "auto":
        gone = ", ".join(reason.effect for reason in result.effects.reasons if not reason.kept)
        lines.append(wording.wrapped(f"effects chosen: {', '.join(result.effects.names)}", "  "))
        lines += [wording.wrapped(f"left out: {gone or 'none'}; why: see the report", "  "), ""]
    if costs and result.accuracy:
        lines += [accuracy_table(result.accuracy).select("accuracy", "seconds", "steps", LARGEST_ERROR).to_text(), ""]
    last = []
    for name, *_, verdict in table.cells:
        if verdict.value not in ("identified", "fixed") and verdict.note:
            last.append(f"{name.value}: {verdict.note}")
    return "\n".join([*lines, *(wording.wrapped(line, "  ") for line in last)])


def accuracy_table(accuracy: schema.AccuracyResult | None) -> OutputTable:
    """What each level of accuracy costs, what the equations and each effect take of it, and how many standard errors
    its steps leave in each parameter."""
    levels, rows = accuracy.levels if accuracy else (), list[Row]()
    names = list(dict.fromkeys(name for level in levels for name in level.left_in_standard_errors or {}))
    for level in levels:
        errors = (level.error_in_standard_errors, *map((level.left_in_standard_errors or {}).get, names))
        shown = (Cell(level.seconds, number(level.seconds, 2)), level.steps, *(Cell(e, number(e, 2)) for e in errors))
        rows.append((level.accuracy if level.estimated else f"{level.accuracy} (taken)", *shown))
        for name, seconds in {"the equations": accuracy.equations_s, **accuracy.effects_s}.items() if accuracy else ():
            if not level.estimated and seconds:
                empty = [Cell(text=" ")] * (2 + len(names))
                rows.append((f"of it {name.replace('_', ' ')}", Cell(seconds, number(seconds, 2)), *empty))
    heads = ("accuracy", "seconds", "steps", LARGEST_ERROR, *(f"{plain_symbol(name)} (SE)" for name in names))
    return OutputTable("What accuracy costs", heads, tuple(rows))


def effects_table(reasons: Sequence[schema.EffectReason]) -> OutputTable:
    """Which effects and why: one row per effect that was looked at; columns that are empty are left out."""
    rows: list[Row] = []
    for reason in reasons:
        state = Cell("yes" if reason.kept else "no", kind="" if reason.kept else "doubt")
        group = replace(_cell(reason.value), note=reason.group if reason.value is not None else "")
        error = Cell(reason.error, "" if reason.error is None else f"{number(100 * reason.error, 2)} %")
        known = (state, group, error, _cell(reason.statistic), Cell(reason.sentence, kind="words"))
        rows.append((reason.effect.replace("_", " "), *known))
    heads = ("effect", "kept", "group", "error without it", "gain in the data", "why")
    return OutputTable("Effects: which and why", heads, tuple(rows)).filled()


def _cell(value: float | None) -> Cell:
    return Cell(value, number(value, 3))


def sensitivity_table(result: Result) -> OutputTable:
    """What an error of 1 % in a rig quantity (rows) would do to each parameter (columns), in percent of its value."""
    sensitivity = result.rig_sensitivity or {}
    names = list(dict.fromkeys(name for shifts in sensitivity.values() for name in shifts))
    rows: list[Row] = []
    for rig, shifts in sensitivity.items():
        row = [Cell(f"{rig.replace('_', ' ')} + 1 %")]
        for name in names:
            entry, value = shifts.get(name), result.parameters[name].value
            if entry is None or entry.shift is None or not value:
                row.append(Cell())
                continue
            share, errors = 100.0 * entry.shift / abs(value), entry.in_standard_errors
            note = "" if errors is None else f"{number(abs(errors), 2)} SE"
            kind = "strong" if abs(errors or 0.0) >= 1 else ""
            row.append(Cell(f"{'+' * (share >= 0.005)}{decimals(share, 2)} %", note=note, kind=kind))
        rows.append(tuple(row))
    return OutputTable("What an error of the rig would do", ("", *map(plain_symbol, names)), tuple(rows))


def causes_table(causes: Sequence[schema.CauseResult]) -> OutputTable:
    """What a misfit may come of: the score of every quantity that noise does not explain, by class; gains as ratios."""
    units = {name: p.unit for name, p in report_wording.DECLARED.items()} | CAUSE_UNITS
    rows: list[Row] = []
    for cause in causes:
        whole = cause.log is None and cause.quantity == "drive_speed"  # a ratio, as gains are
        scale = scale_for(cause.stated or cause.suggested, "" if whole else units.get(cause.quantity, ""))
        values = (cause.stated, 4), (cause.suggested, 4), (cause.standard_error, 2)
        texts = [DASH if value is None else f"{number(value / scale.factor, n)} {scale.unit}" for value, n in values]
        shown = [Cell(value, text.strip()) for (value, _), text in zip(values, texts, strict=True)]
        rows.append((cause.quantity.replace("_", " "), cause.log or "all", cause.number, _cell(cause.score), *shown))
    heads = ("quantity", "log", "class", "score", "stated", "estimated", "standard error (SE)")
    return OutputTable("What the misfit may come of", heads, tuple(rows))


def held_table(held: Mapping[str, schema.HeldResult]) -> OutputTable:
    """Rig quantities (rows) as stated, and where the data would put them."""
    rows: list[Row] = []
    for name, entry in held.items():
        apart = math.sqrt(entry.squared_distance)
        shown = [quantity(value, entry.unit) for value in (entry.stated, entry.from_data)]
        far = Cell(apart, f"{apart:.2g} SE", kind="strong" * (apart > FAR))
        rows.append((name.replace("_", " "), *shown, quantity(entry.standard_error, entry.unit, 2), far))
    heads = ("", "stated", "estimated", "standard error (SE)", "apart")
    return OutputTable("The rig as stated and as estimated", heads, tuple(rows))


def classical_table(logs: Sequence[LogResult]) -> OutputTable:
    """The classical table of all logs (SI, units in the column names); an empty cell where a value is missing."""
    rows = [(position, log.path, row) for position, log in enumerate(logs, start=1) for row in log.classical.rows]
    names = list(dict.fromkeys(name for *_, row in rows for name in row))
    body = []
    for position, path, row in rows:
        values = (v if isinstance(v, str | int | float) or v is None else str(v) for v in map(row.get, names))
        body.append((position, path, *values))
    return OutputTable("Classical table", ("log", "path", *names), tuple(body), "classical")


def stroke_table(strokes: Sequence[tuple[str, Mapping[str, Json]]], title: str = "") -> OutputTable:
    """The classical figures, a column per (heading, stroke) and a row per quantity with its unit: value ± standard
    deviation; without what no stroke has."""
    rows: list[Row] = []
    keys = dict.fromkeys(key for _, stroke in strokes for key in stroke)
    spreads = {key.replace("_sd", "", 1): key for key in keys if "_sd" in key}
    for key in keys:
        values = [finite(stroke.get(key)) for _, stroke in strokes]
        known = sorted(abs(value) for value in values if value is not None)
        name, unit = wording.split_key(key)
        if not known or key in (*HEADINGS, *spreads.values()):
            continue
        name, scale = report_wording.RECORD_WORDS.get(name, name), scale_for(known[len(known) // 2], unit)
        sds = [finite(stroke.get(spreads.get(key, ""))) for _, stroke in strokes]
        cells = [Cell(value, with_sd(value, sd, scale.factor)) for value, sd in zip(values, sds, strict=True)]
        rows.append((Cell(f"{name} ({scale.unit})" if scale.unit else name, name, scale.unit), *cells))
    return OutputTable("Classical table", (title, *(head for head, _ in strokes)), tuple(rows))


def with_sd(value: float | None, sd: float | None, factor: float = 1.0) -> str:
    """A value ± its standard deviation in a unit of this size, with the decimals of the latter, at least three digits
    of the value."""
    if value is None or not sd:
        return number(None if value is None else value / factor)
    places = wording.places_of_positive(sd / factor, value / factor)
    return f"{decimals(value / factor, places)} ± {decimals(sd / factor, places)}"


def classical_pages(logs: Sequence[LogResult]) -> tuple[OutputTable, ...]:
    """The classical table with one column per log, step and stroke; several where there are many columns, so that they
    fit a sheet; at most 60 columns in all."""
    strokes = [
        (", ".join([f"log {place}", *(f"{k} {number(finite(row[k]))}" for k in ("step", "stroke") if row.get(k))]), row)
        for place, log in enumerate(logs, start=1)
        for row in log.classical.rows
    ][:MOST_CLASSICAL_COLUMNS]
    return tuple(stroke_table(strokes[i : i + LOGS_PER_TABLE]) for i in range(0, len(strokes), LOGS_PER_TABLE))


def definitions(logs: Sequence[LogResult]) -> list[tuple[str, str]]:
    """What each row of the classical table is, as the document says it: (name, sentence)."""
    named = ((wording.split_key(key)[0], words) for log in logs for key, words in log.classical.definitions.items())
    return list({report_wording.RECORD_WORDS.get(name, name): words for name, words in named}.items())


def answer_table(columns: Sequence[tuple[str, LogResult]]) -> OutputTable:
    """What follows at each log, a column per (heading, log): drop, period, critical speed; below a value its interval
    and how far it may be trusted."""
    rows: list[Row] = []
    for part, key in (("amplitude", "drop"), ("amplitude", "period"), ("stability", "critical_speed")):
        numbers = [from_document(schema.Number, _of(_of(log.derived, part), key)) for _, log in columns]
        known = sorted(abs(entry.value) for entry in numbers if entry.value is not None)
        unit = next((entry.unit for entry in numbers if entry.unit), "")
        scale = scale_for(known[len(known) // 2] if known else None, unit)
        if any(entry != schema.Number() for entry in numbers):
            head = Cell(report_wording.ANSWER_WORDS.get(key, key), note=scale.unit)
            rows.append((head, *(_answer(entry, scale) for entry in numbers)))
    return OutputTable("", ("", *(head for head, _ in columns)), tuple(rows))


def _of(entries: Mapping[str, Json], key: str) -> Mapping[str, Json]:
    """A part of a document; empty where there is none."""
    return entry if isinstance(entry := entries.get(key), Mapping) else {}


def _answer(entry: schema.Number, scale: Scale) -> Cell:
    text, interval = value_and_interval(entry.value, (None, None) if entry.value is None else entry.ends, scale)
    doubt = entry.validity if "not valid" in entry.validity else ""
    notes = filter(None, (interval, doubt, entry.reason))
    return Cell(text, note=" · ".join(notes), kind="doubt" if doubt else "")
