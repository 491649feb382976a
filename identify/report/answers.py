"""Derived quantities of several logs side by side: any nesting of entries {"value", "unit", "interval", "validity"}."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from identify.base.document import Json, finite, to_dict
from identify.base.result import QualityFigure
from identify.base.wording import DASH, ends_text, number, places_for, quantity, scale_for, speed, split_key
from identify.prediction.wording import WINDOWS
from identify.report.report_tables import ReportCell, ReportTable, Row, plain_text
from identify.report.report_wording import ANSWER_ORDER, ANSWER_WORDS, OUTCOMES, RECORD_WORDS, SLIPS

Path = tuple[str, ...]
Entry = Mapping[str, Json]
Column = Mapping[Path, Entry]
WORDS = {**OUTCOMES, **SLIPS}
SHOWN = ("omega_n", "zeta", "tau_cr", "v_cr", "v_acr", "gamma_0", "w")
NOTHING = 1e-9  # a pure number below this is shown as next to nothing
SAID_ONCE = ":"  # of a long validity only what stands before this is said again


def answer_table(columns: Sequence[tuple[ReportCell, Mapping[str, Json]]], corner: str) -> ReportTable | None:
    """A table with one column per (head, entries) and one row per quantity; None without any entry.

    Nested mappings become parts of the table; plain numbers, texts and truth values are taken too, lists and
    whole sentences (key "text") are not. What all entries of a part or row say of their validity stands once.
    """
    found: list[Column] = [dict(_leaves(entries)) for _, entries in columns]
    paths = list(dict.fromkeys(path for entries in found for path in entries))
    parts = sorted(dict.fromkeys(path[:-1] for path in paths), key=_rank)
    rows: list[Row] = []
    for part in parts:
        inside = [path for path in paths if path[:-1] == part]
        rows += _part_rows(part, inside, found)
    return ReportTable(corner, tuple(head for head, _ in columns), tuple(rows)) if rows else None


def said_once(entries: Entry, elsewhere: Entry) -> Entry:
    """The entries of a log without what stands in another table as well; of the dimensionless groups those that say
    something of the pair and the rig, while result.json holds all that the closed forms are made of."""
    entries = {key: entry for key, entry in entries.items() if key != "advice"}  # has a table of its own
    groups = entries.get("groups")
    if not isinstance(groups, Mapping):
        return entries
    return {**entries, "groups": {key: entry for key, entry in groups.items() if key in SHOWN and key not in elsewhere}}


def of_record(figures: Mapping[str, QualityFigure]) -> Entry:
    """Figures of the data quality of one log, named as what the record alone tells."""
    return {
        key: {**({"label": RECORD_WORDS[key]} if key in RECORD_WORDS else {}), **to_dict(figure)}
        for key, figure in figures.items()
    }


def sentences(entries: Entry, several: bool = False) -> tuple[str, ...]:
    """What the entries say in whole sentences (key "text" of their parts, or their own); of several logs not what is
    nearly the same for all of them, and stands in the table: the stability."""
    silent = ("closed_forms", "advice", *(("stability",) if several and "amplitude" in entries else ()))
    parts = [part for name, part in entries.items() if isinstance(part, Mapping) and name not in silent]
    told = [str(part["text"]) for part in parts if part.get("text")]
    return tuple(told or [line for line in str(entries.get("text") or "").splitlines() if line])


def interval_text(interval: object, value: float | None, unit: str) -> str:
    """ "0.618 to 0.622" in the unit in which the value is shown; open ends as "above" and "below"; "" for none."""
    if not isinstance(interval, Sequence) or len(interval) != 2:
        return ""
    low, high = finite(interval[0]), finite(interval[1])
    scale = scale_for(value if value is not None else low if low is not None else high, unit)
    if low is not None and high is not None:
        low, high = low / scale.factor, high / scale.factor
        if max(abs(low), abs(high)) >= 1e6 or high - low < 1e-6:
            return f"{number(low, 5)} to {number(high, 5)}"
        places = places_for((high - low) / 4, None)
        return ends_text(low, high, places)
    if low is not None:
        return f"above {number(low / scale.factor, 3)}"
    return f"below {number(high / scale.factor, 3)}" if high is not None else ""


def _leaves(entries: Entry, above: Path = ()) -> Iterator[tuple[Path, Entry]]:
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


def _rank(part: Path) -> tuple[int, int]:
    known = ANSWER_ORDER.index(part[0]) if part and part[0] in ANSWER_ORDER else len(ANSWER_ORDER)
    return (known if part else -1, len(part))


def _part_rows(part: Path, paths: Sequence[Path], found: Sequence[Column]) -> list[Row]:
    entries = {path: [column.get(path) for column in found] for path in paths}
    said = _validities(entry for row in entries.values() for entry in row)
    shared = next(iter(said)) if len(said) == 1 and len(paths) > 1 else ""
    rows = [Row(" · ".join(_word(name) for name in part), note=shared, heading=True)] if part else []
    heard: list[set[str]] = [set() for _ in found]
    for path in paths:
        row = _row(path[-1], entries[path], shared, heard)
        if rows and _without_numbers(row) and rows[-1].cells and _without_numbers(rows[-1]) and not row.note:
            rows[-1] = replace(rows[-1], head=f"{rows[-1].head}, {row.head}")
        else:
            rows.append(row)
    return rows


def _without_numbers(row: Row) -> bool:
    return all(cell.text == DASH for cell in row.cells)


def _row(key: str, entries: Sequence[Entry | None], shared: str, heard: Sequence[set[str]]) -> Row:
    known = [entry for entry in entries if entry is not None]
    label = next((str(entry["label"]) for entry in known if entry.get("label")), _word(key))
    meaning = next((str(entry["meaning"]) for entry in known if entry.get("meaning")), "")
    said = _validities(known)
    alike = next(iter(said)) if len(said) == 1 and len(known) == len(entries) > 1 else ""
    notes = (meaning, "" if alike == shared else alike)
    cells = []
    for entry, before in zip(entries, heard, strict=True):
        validity = str(entry.get("validity") or "") if entry is not None else ""
        cells.append(_cell(entry, "" if validity in (shared, alike) else _again(validity, before), validity))
    return Row(label, tuple(cells), note=" · ".join(note for note in notes if note))


def _validities(entries: Iterable[Entry | None]) -> set[str]:
    return {str(entry.get("validity") or "") for entry in entries if entry is not None}


def _again(validity: str, heard: set[str]) -> str:
    """The validity, cut to its verdict where the same column has given the reason already."""
    if validity in heard:
        return validity.split(SAID_ONCE, 1)[0]
    heard.add(validity)
    return validity


def _cell(entry: Entry | None, said: str, validity: str) -> ReportCell:
    """Value with unit; below it the interval and how far it may be trusted."""
    if entry is None:
        return ReportCell(DASH)
    value, unit = entry.get("value"), str(entry.get("unit") or "")
    shown = finite(value)
    if shown is not None and not unit and 0.0 < abs(shown) < NOTHING:
        return ReportCell("below 10⁻⁹")
    text = quantity(shown, unit) if shown is not None else WORDS.get(str(value), plain_text(value))
    interval = interval_text(entry.get("interval"), shown, unit) if shown is not None else ""
    notes = [note for note in (interval, said, str(entry.get("reason") or "")) if note]
    return ReportCell(text, " · ".join(notes), "doubt" if "not valid" in validity.lower() else "")


def _word(key: str) -> str:
    return ANSWER_WORDS.get(key) or split_key(key)[0]
