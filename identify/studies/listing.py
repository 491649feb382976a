"""What a batch is made of: the rows of a manifest, or the files of a folder."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from identify.scene.logs import LOG, located
from identify.scene.tables import is_number, nearest
from identify.scene.toml import TOP
from identify.studies.refusal import BatchError

OWN = ("path", "group", "drive_speed")
NOT_LOGS = (".toml", ".json", ".md", ".py", ".pdf", ".png", ".jpg", ".jpeg", ".svg", ".html", ".docx", ".pptx", ".ini")
LOG_KEYS = tuple(key for key in LOG if key not in ("path", "labels"))
_DOTTED = re.compile(r"\w+(\.\w+)+")


@dataclass(frozen=True)
class Row:
    """One log of a batch: where it stands in the source, its file, its group, and what it says otherwise.

    overrides: text by dotted scene path ("rig.mass", "logs.step"); labels: free words by name.
    """

    where: str
    path: Path
    group: str
    overrides: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Listing:
    """The rows of a source, the names of its label columns, and notes for the user."""

    rows: tuple[Row, ...]
    labels: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_source(source: Path) -> Listing:
    """The rows behind SOURCE: a manifest (CSV), or a folder of logs, each a group of its own.

    Raises:
        BatchError: nothing there, no manifest, or rows that cannot be meant; all complaints at once.
    """
    if source.is_dir():
        return _folder(source)
    if not source.exists():
        raise BatchError([f"{source}: there is no such manifest or folder; check its path"])
    return _manifest(source)


def _folder(source: Path) -> Listing:
    files = sorted(path for path in source.iterdir() if path.is_file() and not path.name.startswith("."))
    files = [path for path in files if path.suffix.lower() not in NOT_LOGS]
    if not files:
        raise BatchError([f"{source}: the folder holds no log; expected one file per log: choose another folder"])
    foreign = [path for path in files if not _is_text(path.name)]
    if foreign:
        raise BatchError([f"{source}: the file name {path.name!r} is not UTF-8; rename it" for path in foreign])
    stems = [_stem(path) for path in files]
    names = [stem if stems.count(stem) == 1 else path.name for path, stem in zip(files, stems, strict=True)]
    return Listing(tuple(Row(path.name, path, name) for path, name in zip(files, names, strict=True)))


def _is_text(name: str) -> bool:
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def _stem(path: Path) -> str:
    """The name without its endings: slow.txt.gz is slow, and 0.1_mm_per_s.txt is 0.1_mm_per_s."""
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    return plain.stem


def _manifest(source: Path) -> Listing:
    table = _table(source)
    if not table:
        raise BatchError([f"{source}: the manifest is empty; expected a heading such as path,group,drive_speed"])
    heading = [name.strip() for name in table[0][1]]
    complaints, notes = _heading_complaints(source, heading)
    if complaints:
        raise BatchError(complaints)
    rows: list[Row] = []
    for line, cells in table[1:]:
        read = _row(source, line, heading, cells)
        complaints += [read] if isinstance(read, str) else []
        rows += [read] if isinstance(read, Row) else []
    complaints += _twice(rows)
    if not rows and not complaints:
        complaints.append(f"{source}: the manifest lists no log; expected one row per log under its heading")
    if complaints:
        raise BatchError(complaints)
    labels = [name for name in heading if _is_label(name)]
    return Listing(tuple(rows), tuple(labels), tuple(notes))


def _table(source: Path) -> list[tuple[int, list[str]]]:
    """The rows that hold anything, each with its line number; commas, semicolons or tabs between the cells."""
    try:
        text = source.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise BatchError([f"{source}: this is not UTF-8 text; save the manifest as CSV in UTF-8"]) from None
    lines = text.splitlines()
    first = next((line for line in lines if line.strip()), "")
    between = max(",;\t", key=first.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=between, strict=True)
    try:
        return [(reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells)]
    except csv.Error as error:
        raise BatchError([f"{source} line {reader.line_num}: this is no CSV ({error}); mend that line"]) from None


def _is_label(name: str) -> bool:
    return bool(name) and name not in OWN and not _DOTTED.fullmatch(name)


def _heading_complaints(source: Path, heading: Sequence[str]) -> tuple[list[str], list[str]]:
    """What is wrong with the heading, and what should be noted of it."""
    complaints, notes = [], []
    if "path" not in heading:
        complaints.append(
            f"{source}: the heading has no column path ({', '.join(heading[:6])}); expected path,group,drive_speed,…"
        )
    complaints += [
        f"{source}: the heading names {name!r} twice; rename one column"
        for name in dict.fromkeys(heading)
        if name and heading.count(name) > 1
    ]
    for name in heading:
        top, _, rest = name.partition(".")
        if _DOTTED.fullmatch(name) and top not in TOP:
            complaints.append(
                f"{source}: the column {name!r} is no path into a scene; did you mean {nearest(top, TOP)}.{rest}? "
                "A label has no dot"
            )
        elif name.startswith("logs.") and rest.partition(".")[0] not in LOG_KEYS:
            complaints.append(
                f"{source}: the column {name!r} is no key of a log; did you mean logs.{nearest(rest, LOG_KEYS)}?"
            )
        elif meant := _meant(name, heading):
            complaints.append(f"{source}: the column {name!r} would be a label; did you mean {meant}? Rename it")
        elif name in (*LOG_KEYS, *TOP) and name not in OWN:
            keys = f"logs.{name}" if name in LOG_KEYS else f"a column of its keys, such as {name}.…"
            notes.append(f"the column {name!r} is taken as a label; it would take {keys} to set the scene")
    return complaints, notes


def _meant(name: str, heading: Sequence[str]) -> str:
    """The column that a heading spells otherwise ("Drive speed", "drivespeed"); "" where there is none."""
    plain = {_plain(own): own for own in OWN if own not in heading}
    return "" if name in OWN else plain.get(_plain(name), "")


def _plain(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum())


def _row(source: Path, line: int, heading: Sequence[str], cells: Sequence[str]) -> Row | str:
    """One row, or what is wrong with it."""
    where = f"{source.name} line {line}"
    said = {name: cell.strip() for name, cell in zip(heading, cells, strict=False) if name and cell.strip()}
    if any(cell.strip() for i, cell in enumerate(cells) if i >= len(heading) or not heading[i]):
        return f"{where}: a cell stands under no heading; expected {len(heading)} cells: quote texts with a comma"
    if "path" not in said:
        return f"{where}: the row has no path; give the log's path, relative to the manifest"
    if "group" in heading and "group" not in said:
        return f"{where}: the row has no group; give one, the same for logs that are fitted jointly"
    if "\0" in said["path"]:
        return f"{where}: the path holds a zero byte; correct it"
    path = located(source.parent, said["path"])
    speed = said.get("drive_speed")
    if speed is not None and is_number(speed.replace(",", ".")):
        return f'{where}: drive_speed is {speed!r}, without a unit; write for instance "{speed} mm/s"'
    overrides = {name: text for name, text in said.items() if _DOTTED.fullmatch(name)}
    if speed is not None:
        overrides["logs.drive_speed"] = speed
    labels = {name: text for name, text in said.items() if _is_label(name)}
    return Row(where, path, said.get("group", _stem(path)), overrides, labels)


def _twice(rows: Sequence[Row]) -> Iterator[str]:
    """The same part of the same log, twice in one group, would count its samples twice."""
    seen: dict[tuple[str, str, tuple[tuple[str, str], ...]], Row] = {}
    for row in rows:
        parts = ("logs.step", "logs.run", "logs.window", "logs.columns")
        what = tuple((name, row.overrides[name]) for name in parts if name in row.overrides)
        before = seen.setdefault((row.group, str(row.path), what), row)
        if before is not row:
            yield f"{row.where}: {row.path.name} stands in group {row.group!r} already ({before.where}); drop one"
