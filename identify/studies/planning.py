"""The whole check before the first fit: every row and every group becomes a job, or a complaint."""

from __future__ import annotations

import copy
import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from data_io.source import file_sha256
from identify.base.errors import SceneError
from identify.base.progress import Progress, to_nobody
from identify.scene import Scene
from identify.scene.rig import located
from identify.scene.tables import LOG, is_number, nearest
from identify.scene.toml import TOP, put, read_toml
from identify.studies.job import BatchError, Job, LogFile, content_key, folder_names, numerics

# ----------------------------------------------------------------------------------------------------------------------
# What a batch is made of: the rows of a manifest, or the files of a folder.
# ----------------------------------------------------------------------------------------------------------------------

OWN = ("path", "group", "drive_speed")
NOT_LOGS = (".toml", ".json", ".md", ".py", ".pdf", ".png", ".jpg", ".jpeg", ".svg", ".html", ".docx", ".pptx", ".ini")
LOG_KEYS = tuple(key for key in LOG if key not in ("path", "labels"))
MOST_COLUMNS, MOST_ROWS = 1000, 50_000
MOST_GONE = 50  # rows without a log whose scene is built for complaints: as many as the command shows
_DOTTED = re.compile(r"\w+(\.\w+)+")


@dataclass(frozen=True)
class ManifestRow:
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

    rows: tuple[ManifestRow, ...]
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
        inner = sorted(path.name for path in source.iterdir() if path.is_dir() and not path.name.startswith("."))
        below = f" ({', '.join(inner[:3])}{', …' if inner[3:] else ''} in it are not looked into)" if inner else ""
        raise BatchError(
            [
                f"{source}: the folder holds no log{below}; expected one file per log: choose another folder, or "
                "write a manifest with the path of each"
            ]
        )
    # Bytes of a name that are no UTF-8 come as surrogates, which no encoding takes.
    foreign = [path for path in files if path.name != path.name.encode("utf-8", "ignore").decode()]
    if foreign:
        raise BatchError([f"{source}: the file name {path.name!r} is not UTF-8; rename it" for path in foreign])
    stems = [_stem(path) for path in files]
    names = [stem if stems.count(stem) == 1 else path.name for path, stem in zip(files, stems, strict=True)]
    return Listing(tuple(ManifestRow(path.name, path, name) for path, name in zip(files, names, strict=True)))


def _stem(path: Path) -> str:
    """The name without its endings: slow.txt.gz is slow, and 0.1_mm_per_s.txt is 0.1_mm_per_s."""
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    return plain.stem


def _manifest(source: Path) -> Listing:
    table = _table(source)
    if not table:
        raise BatchError([f"{source}: the manifest is empty; expected a heading such as path,group,drive_speed"])
    heading = [name.strip() for name in table[0][1]]
    if len(heading) > MOST_COLUMNS or len(table) - 1 > MOST_ROWS:
        raise BatchError(
            [
                f"{source}: the manifest has {len(heading)} columns and {len(table) - 1} rows; at most {MOST_COLUMNS} "
                f"and {MOST_ROWS} were expected; check that it is one, or split it"
            ]
        )
    complaints, notes = _heading_complaints(source, heading)
    if complaints:
        raise BatchError(complaints)
    rows: list[ManifestRow] = []
    for line, cells in table[1:]:
        read = _row(source, line, heading, cells)
        complaints += [read] if isinstance(read, str) else []
        rows += [read] if isinstance(read, ManifestRow) else []
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
    first = next((line for line in text.splitlines() if line.strip()), "")
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
        for name, times in Counter(heading).items()
        if name and times > 1
    ]
    missing = {own.replace("_", ""): own for own in OWN if own not in heading}
    for name in heading:
        top, _, rest = name.partition(".")
        plain = "".join(c for c in name.casefold() if c.isalnum())  # "Drive speed", "drivespeed"
        if _DOTTED.fullmatch(name) and top not in TOP:
            complaints.append(
                f"{source}: the column {name!r} is no path into a scene; did you mean {nearest(top, TOP)}.{rest}? "
                "A label has no dot"
            )
        elif name.startswith("logs.") and rest.partition(".")[0] not in LOG_KEYS:
            complaints.append(
                f"{source}: the column {name!r} is no key of a log; did you mean logs.{nearest(rest, LOG_KEYS)}?"
            )
        elif name not in OWN and (meant := missing.get(plain)):
            complaints.append(f"{source}: the column {name!r} would be a label; did you mean {meant}? Rename it")
        elif name in (*LOG_KEYS, *TOP) and name not in OWN:
            keys = f"logs.{name}" if name in LOG_KEYS else f"a column of its keys, such as {name}.…"
            notes.append(f"the column {name!r} is taken as a label; it would take {keys} to set the scene")
    return complaints, notes


def _row(source: Path, line: int, heading: Sequence[str], cells: Sequence[str]) -> ManifestRow | str:
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
    return ManifestRow(where, path, said.get("group", _stem(path)), overrides, labels)


def _twice(rows: Sequence[ManifestRow]) -> Iterator[str]:
    """The same part of the same log, twice in one group, would count its samples twice."""
    seen: dict[tuple[str, str, tuple[tuple[str, str], ...]], ManifestRow] = {}
    for row in rows:
        parts = ("logs.step", "logs.run", "logs.window", "logs.columns")
        what = tuple((name, row.overrides[name]) for name in parts if name in row.overrides)
        before = seen.setdefault((row.group, str(row.path), what), row)
        if before is not row:
            yield f"{row.where}: {row.path.name} stands in group {row.group!r} already ({before.where}); drop one"


PER_LOG = ("mass", "stiffness", "damping", "normal_force", "noise", "drive_speed")  # of [rig]; a log may have its own
NAMED = 5  # groups or rows that a complaint names before it counts

Document = dict[str, Any]


@dataclass(frozen=True)
class BatchPlan:
    """A checked batch: where it comes from, its jobs in the order of the source, label columns, notes."""

    source: Path
    scene: Path
    overrides: tuple[str, ...]
    numerics: str
    jobs: tuple[Job, ...]
    labels: tuple[str, ...]
    notes: tuple[str, ...]


def plan(source: Path, scene: Path, overrides: Sequence[str] = (), told: Progress = to_nobody) -> BatchPlan:
    """Check everything that can be checked without fitting, and make the jobs.

    Args:
        source: manifest or folder. scene: the scene file of defaults. overrides: KEY=VALUE each, for all groups.
        told: called as told(stage, share) while logs are hashed.

    Raises:
        BatchError: everything that is wrong, one sentence each.
    """
    told("checking the manifest", None)
    try:
        defaults = read_toml(scene, overrides)
    except SceneError as error:
        raise BatchError([f"{scene}: {error}"]) from None
    listing = read_source(source)
    groups: dict[str, list[ManifestRow]] = {}
    for row in listing.rows:
        groups.setdefault(row.group, []).append(row)
    checked = _Check(scene, defaults)
    folders = folder_names(list(groups))
    gone = [row for row in listing.rows if not _is_there(row)]
    missing = [f"{row.where}: there is no log {row.path}; check its path" for row in gone]
    # What else is wrong with them is said at once; of more than these, one mistake made them all.
    where = {row.where for row in gone[MOST_GONE:]}
    there = {group: [row for row in rows if row.where not in where] for group, rows in groups.items()}
    scenes = {group: checked.scene_of(group, folders[group], rows) for group, rows in there.items() if rows}
    complaints = missing + checked.complaints()
    if complaints:
        raise BatchError(complaints)
    documents = {group: made.as_document() for group, made in scenes.items() if made is not None}
    digests = _hashed(listing, told)
    jobs = tuple(_job(group, folders[group], document, digests) for group, document in documents.items())
    return BatchPlan(
        source.absolute(),
        scene.absolute(),
        tuple(overrides),
        numerics(),
        jobs,
        listing.labels,
        (*listing.notes, *_unused(defaults, scene, listing)),
    )


def _is_there(row: ManifestRow) -> bool:
    try:
        return row.path.is_file()
    except OSError:  # a name that no file can have
        return False


class _Check:
    """Builds the scene of every group and gathers what is wrong, the same complaint once for all whom it concerns."""

    def __init__(self, scene: Path, defaults: Mapping[str, Any]) -> None:
        self._scene, self._defaults = scene, defaults
        self._said: dict[str, list[str]] = {}
        listed = defaults.get("logs", [])
        self._listed = [log for log in listed if isinstance(log, Mapping)] if isinstance(listed, list) else []
        self._of_all = [log for log in self._listed if "path" not in log]

    def complaints(self) -> list[str]:
        """One sentence per thing to mend: "a.csv line 2, a.csv line 3 and 17 others: …"."""
        out = []
        for sentence, places in self._said.items():
            others = f" and {len(places) - NAMED} others" if len(places) > NAMED else ""
            out.append(f"{', '.join(places[:NAMED])}{others}: {sentence}")
        return out

    def scene_of(self, group: str, name: str, rows: Sequence[ManifestRow]) -> Scene | None:
        """The scene of a group; None, and complaints, where it cannot be built."""
        rows = sorted(rows, key=lambda row: (str(row.path), sorted(row.overrides.items())))
        try:
            return self._build(name, rows)
        except SceneError as error:
            sentence = str(error)
        # Each row on its own, so that all wrong rows are told and not the first alone.
        wrong = []
        for row in rows if len(rows) > 1 else ():
            try:
                self._build(name, [row])
            except SceneError as error:
                wrong.append((str(error), row.where))
        place = rows[0].where if len(rows) == 1 else f"group {group!r}"
        for said, where in wrong or [(sentence, place)]:
            self._said.setdefault(said, []).append(where)
        return None

    def _build(self, name: str, rows: Sequence[ManifestRow]) -> Scene:
        document: Document = copy.deepcopy({key: value for key, value in self._defaults.items() if key != "logs"})
        # Keys of [rig] that become the logs' own, because not all rows of the group say the same.
        keys = [f"rig.{name}" for name in PER_LOG]
        own = [key for key in keys if len({row.overrides.get(key) for row in rows}) > 1]
        for key, text in _shared(rows, own).items():
            put(document, f"{key}={text}")
        document |= {"name": name, "logs": [entry for row in rows for entry in self._entries(row, own)]}
        scene = Scene.from_document(document, self._scene.parent)
        _refuse_no_drive(scene)
        return scene

    def _entries(self, row: ManifestRow, own: Sequence[str]) -> list[Document]:
        """The [[logs]] of a row: what the scene says of all logs (a table without a path), what it lists for that file,
        if it does, and what the row says otherwise."""
        path = row.path.absolute()
        same = [log for log in self._listed if _place(log, self._scene) == path.resolve()]
        common = {key: value for log in self._of_all for key, value in log.items()}
        made: list[Document] = [copy.deepcopy({**common, **log}) for log in same or [{}]]
        for entry in made:
            for key, text in row.overrides.items():
                top, _, rest = key.partition(".")
                if top == "logs" or key in own:
                    put(entry, f"{rest}={text}")
            said = entry.get("labels", {})
            entry["labels"] = {**(said if isinstance(said, Mapping) else {}), **row.labels}
            entry["path"] = str(path)
        return made


def _refuse_no_drive(scene: Scene) -> None:
    """Refuse a log without a drive speed that does not name the column that tells it: before hours, not after.

    Raises:
        SceneError: there is one.
    """
    for number, log in enumerate(scene.logs, 1):
        if scene.rig_for(log).drive_speed is None and not {"drive_speed", "position"} & set(log.columns or {}):
            which = f"log {number} ({log.path.name}) has" if len(scene.logs) > 1 else "has"
            raise SceneError(
                f"{which} no drive speed; give drive_speed in the manifest or under [rig], or name the column that has"
                ' it: columns = { drive_speed = "…" } or { position = "…" } in [[logs]] (without a path: of all logs)'
            )


def _place(log: Mapping[str, object], scene: Path) -> Path | None:
    """Where the file of a [[logs]] table of the scene lies."""
    path = log.get("path")
    return located(scene.parent, path).resolve() if isinstance(path, str) and "\0" not in path else None


def _shared(rows: Sequence[ManifestRow], own: Sequence[str]) -> dict[str, str]:
    """What all rows of a group say of its one scene.

    Raises:
        SceneError: they say different things.
    """
    out: dict[str, str] = {}
    for key in dict.fromkeys(key for row in rows for key in row.overrides):
        if key in own or key.startswith("logs."):
            continue
        texts = list(dict.fromkeys(row.overrides.get(key, "nothing") for row in rows))
        if len(texts) > 1:
            raise SceneError(
                f"the rows say {' and '.join(texts[:3])} for {key}; expected one value for logs that are fitted "
                "jointly: make them equal, or split the group"
            )
        out[key] = texts[0]
    return out


def _hashed(listing: Listing, told: Progress) -> dict[str, tuple[str, int]]:
    """SHA-256 and bytes of every log, by absolute path.

    Raises:
        BatchError: logs that cannot be read.
    """
    out: dict[str, tuple[str, int]] = {}
    complaints = []
    for number, row in enumerate(listing.rows):
        told("hashing the logs", number / len(listing.rows))
        path = row.path.absolute()
        if str(path) in out:
            continue
        try:
            out[str(path)] = (file_sha256(path), path.stat().st_size)
        except OSError as error:
            complaints.append(f"{row.where}: {path} cannot be read ({error.strerror}); check its permissions")
    if complaints:
        raise BatchError(complaints)
    return out


def _job(group: str, folder: str, document: Document, digests: Mapping[str, tuple[str, int]]) -> Job:
    logs = tuple(LogFile(log["path"], digests[log["path"]][0], dict(log.get("labels", {}))) for log in document["logs"])
    names = dict.fromkeys(name for log in logs for name in log.labels)
    return Job(
        group=group,
        folder=folder,
        key=content_key(document, [log.sha256 for log in logs], numerics()),
        numerics=numerics(),
        scene=document,
        logs=logs,
        # what its logs agree on, else their different texts
        labels={n: "; ".join(dict.fromkeys(log.labels[n] for log in logs if n in log.labels)) for n in names},
        size=sum(digests[path][1] for path in {log.path for log in logs}),
    )


def _unused(defaults: Mapping[str, Any], scene: Path, listing: Listing) -> list[str]:
    """A note where the scene lists logs that the source does not name."""
    listed = defaults.get("logs", [])
    there = {row.path.resolve() for row in listing.rows}
    gone = [log for log in listed if isinstance(log, Mapping) and "path" in log and _place(log, scene) not in there]
    return [f"{len(gone)} of the scene's own [[logs]] take no part: the source does not name them"] if gone else []
