"""The whole check before the first fit: every row and every group becomes a job, or a complaint."""

from __future__ import annotations

import copy
import csv
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from data_io.source import file_sha256
from identify.base.errors import SceneError
from identify.base.progress import Progress, to_nobody
from identify.scene import Scene
from identify.scene.tables import is_number
from identify.scene.toml import located, put, read_toml
from identify.studies.batch_store import BatchError, Document, Job, LogFile, content_key, folder_names, numerics

OWN = ("path", "group", "drive_speed")
NOT_LOGS = (".toml", ".json", ".md", ".py", ".pdf", ".png", ".jpg", ".jpeg", ".svg", ".html", ".docx", ".pptx", ".ini")
PER_LOG = ("mass", "stiffness", "damping", "normal_force", "noise", "drive_speed")  # of [rig]; a log may have its own
PARTS = ("logs.step", "logs.run", "logs.window", "logs.columns")  # which part of a file a row means
MOST_LOGS = 1000  # of a group
NAMED = 5  # rows or groups that a complaint names before it counts
_DOTTED = re.compile(r"\w+(\.\w+)+")


@dataclass(frozen=True)
class ManifestRow:
    """One log of a batch: where it stands in the source, its file, its group.

    overrides: text by dotted scene path ("rig.mass", "logs.step"); labels: free words by name.
    """

    where: str
    path: Path
    group: str
    overrides: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class BatchPlan:
    """A checked batch: where it comes from, its jobs in the order of the source, label columns."""

    source: Path
    scene: Path
    overrides: tuple[str, ...]
    numerics: str
    jobs: tuple[Job, ...]
    labels: tuple[str, ...]


def plan(source: Path, scene: Path, overrides: Sequence[str] = (), progress: Progress = to_nobody) -> BatchPlan:
    """Check everything that can be checked without fitting, and make the jobs.

    Args:
        source: manifest (CSV), or a folder of logs, each a group of its own. scene: the scene file of defaults.
        overrides: KEY=VALUE each, for all groups. progress: called as progress(stage, share) while logs are hashed.

    Raises:
        BatchError: everything that is wrong, one sentence each.
    """
    progress("checking the manifest", None)
    try:
        defaults = read_toml(scene, overrides)
    except SceneError as error:
        raise BatchError(f"{scene}: {error}") from None
    if not source.exists():
        raise BatchError(f"{source}: there is no such manifest or folder; check its path")
    rows, labels = (_folder(source), ()) if source.is_dir() else _manifest(source)
    complaints = []
    groups: dict[str, list[ManifestRow]] = {}
    for row in rows:
        exists = False
        with suppress(OSError, ValueError):  # a name that no file can have
            exists = row.path.is_file()
        if exists:
            groups.setdefault(row.group, []).append(row)
        else:
            complaints.append(f"{row.where}: there is no log {row.path}; check its path")
    for group in [group for group, members in groups.items() if len(members) > MOST_LOGS]:
        number = len(groups.pop(group))
        complaints.append(f"group {group!r} has {number} logs; one fit takes {MOST_LOGS} at most: split it")
    folders = folder_names(list(groups))
    scenes: dict[str, Document] = {}
    refused: dict[str, list[str]] = {}  # places by the sentence that refuses them
    for group, members in groups.items():
        built = _scene(folders[group], members, defaults, scene)
        if isinstance(built, Scene):
            scenes[group] = built.as_document()
            continue
        alone = {row.where: _scene(folders[group], [row], defaults, scene) for row in members}
        wrong = {where: each for where, each in alone.items() if isinstance(each, str)}
        for where, sentence in (wrong or {f"group {group!r}": built}).items():
            refused.setdefault(sentence, []).append(where)
    for sentence, places in refused.items():
        others = f" and {len(places) - NAMED} others" if len(places) > NAMED else ""
        complaints.append(f"{', '.join(places[:NAMED])}{others}: {sentence}")
    if complaints:
        raise BatchError(*complaints)
    digests: dict[str, tuple[str, int]] = {}  # SHA-256 and bytes of every log, by absolute path
    for number, row in enumerate(rows):
        progress("hashing the logs", number / len(rows))
        path = row.path.absolute()
        try:
            if str(path) not in digests:
                digests[str(path)] = file_sha256(path), path.stat().st_size
        except OSError as error:
            complaints.append(f"{row.where}: {path} cannot be read ({error.strerror}); check its permissions")
    if complaints:
        raise BatchError(*complaints)
    jobs = tuple(_job(group, folders[group], document, digests) for group, document in scenes.items())
    return BatchPlan(source.absolute(), scene.absolute(), tuple(overrides), numerics(), jobs, labels)


def _folder(source: Path) -> tuple[ManifestRow, ...]:
    files = sorted(path for path in source.iterdir() if path.is_file() and not path.name.startswith("."))
    files = [path for path in files if path.suffix.lower() not in NOT_LOGS]
    if not files:
        raise BatchError(
            f"{source}: the folder holds no log (folders in it are not searched); expected one file per log: choose "
            "another folder, or write a manifest with the path of each"
        )
    # Bytes of a name that are no UTF-8 come as surrogates, which no encoding takes.
    foreign = [path for path in files if path.name != path.name.encode("utf-8", "ignore").decode()]
    if foreign:
        raise BatchError(*(f"{source}: the file name {path.name!r} is not UTF-8; rename it" for path in foreign))
    times = Counter(map(_stem, files))
    names = [_stem(path) if times[_stem(path)] == 1 else path.name for path in files]
    return tuple(ManifestRow(path.name, path, name) for path, name in zip(files, names, strict=True))


def _stem(path: Path) -> str:
    """The name without its endings: slow.txt.gz is slow, and 0.1_mm_per_s.txt is 0.1_mm_per_s."""
    return (path.with_suffix("") if path.suffix.lower() == ".gz" else path).stem


def _manifest(source: Path) -> tuple[tuple[ManifestRow, ...], tuple[str, ...]]:
    """The rows, and the names of the label columns."""
    table = _table(source)
    heading = [name.strip() for name in table[0][1]]
    twice = [name for name, times in Counter(heading).items() if name and times > 1]
    complaints = [f"{source}: the heading names {name!r} twice; rename one column" for name in twice]
    if "path" not in heading:
        named = ", ".join(heading[:6])
        complaints.append(f"{source}: the heading has no column path ({named}); expected path,group,drive_speed,…")
    dotted = tuple(name for name in heading if _DOTTED.fullmatch(name))
    labels = tuple(name for name in heading if name and name not in OWN and name not in dotted)
    missing = {own.replace("_", ""): own for own in OWN if own not in heading}
    for name in labels:
        meant = missing.get("".join(c for c in name.casefold() if c.isalnum()))  # "Drive speed", "drivespeed"
        if meant is not None:
            complaints.append(f"{source}: the column {name!r} would be a label; did you mean {meant}? Rename it")
    if complaints:
        raise BatchError(*complaints)
    rows: list[ManifestRow] = []
    seen: dict[tuple[object, ...], ManifestRow] = {}
    for line, cells in table[1:]:
        row = _row(source, line, heading, cells, dotted)
        if isinstance(row, str):
            complaints.append(f"{source.name} line {line}: {row}")
            continue
        rows.append(row)
        # the same part of the same log, twice in one group, would count its samples twice
        first = seen.setdefault((row.group, str(row.path), *(row.overrides.get(name) for name in PARTS)), row)
        if first is not row:
            duplicate = f"stands in group {row.group!r} already ({first.where})"
            complaints.append(f"{row.where}: {row.path.name} {duplicate}; drop one")
    if not rows and not complaints:
        complaints.append(f"{source}: the manifest lists no log; expected one row per log under its heading")
    if complaints:
        raise BatchError(*complaints)
    return tuple(rows), labels


def _table(source: Path) -> list[tuple[int, list[str]]]:
    """The rows that hold anything, each with its line number; commas, semicolons or tabs between the cells."""
    try:
        text = source.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise BatchError(f"{source}: this is not UTF-8 text; save the manifest as CSV in UTF-8") from None
    first = next((line for line in text.splitlines() if line.strip()), "")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=max(",;\t", key=first.count), strict=True)
    try:
        rows = [(reader.line_num, cells) for cells in reader if any(map(str.strip, cells))]
    except csv.Error as error:
        raise BatchError(f"{source} line {reader.line_num}: this is no CSV ({error}); correct that line") from None
    if not rows:
        raise BatchError(f"{source}: the manifest is empty; expected a heading such as path,group,drive_speed")
    return rows


def _row(
    source: Path, line: int, heading: Sequence[str], cells: Sequence[str], dotted: Sequence[str]
) -> ManifestRow | str:
    """One row, or what is wrong with it; dotted: the columns that are scene paths."""
    texts = {name: text for name, cell in zip(heading, cells, strict=False) if (text := cell.strip())}
    if texts.pop("", "") or any(map(str.strip, cells[len(heading) :])):
        return f"a cell stands under no heading; expected {len(heading)} cells: quote texts with a comma"
    if "path" not in texts:
        return "the row has no path; give the log's path, relative to the manifest"
    if "group" in heading and "group" not in texts:
        return "the row has no group; give one, the same for logs that are fitted jointly"
    if "\0" in texts["path"]:
        return "the path holds a zero byte; correct it"
    path, speed = located(source.parent, texts["path"]), texts.get("drive_speed")
    overrides = {name: texts.pop(name) for name in dotted if name in texts}
    if speed is not None:
        if is_number(speed.replace(",", ".")):
            return f'drive_speed is {speed!r}, without a unit; write for instance "{speed} mm/s"'
        overrides["logs.drive_speed"] = speed
    labels = {name: text for name, text in texts.items() if name not in OWN}
    return ManifestRow(f"{source.name} line {line}", path, texts.get("group", _stem(path)), overrides, labels)


def _scene(name: str, rows: Sequence[ManifestRow], defaults: Document, scene: Path) -> Scene | str:
    """The scene of a group, or why it cannot be built; a log without a drive speed is refused before hours of fits."""
    rows = sorted(rows, key=lambda row: (str(row.path), sorted(row.overrides.items())))
    document: Document = copy.deepcopy({key: value for key, value in defaults.items() if key != "logs"})
    keys = dict.fromkeys(key for row in rows for key in row.overrides)
    stated = {key: {row.overrides.get(key, "nothing") for row in rows} for key in keys}
    # Keys of [rig] that become the logs' own, because not all rows of the group state the same.
    own = [f"rig.{key}" for key in PER_LOG if len(stated.get(f"rig.{key}", ())) > 1]
    for key, texts in stated.items():
        if len(texts) > 1 and key not in own and not key.startswith("logs."):
            several = " and ".join(sorted(texts)[:3])
            return (
                f"the rows state {several} for {key}; expected one value for logs that are fitted jointly: make them "
                "equal, or split the group"
            )
    try:
        for key, texts in stated.items():
            if key not in own and not key.startswith("logs."):
                put(document, f"{key}={next(iter(texts))}")
        document |= {"name": name, "logs": [entry for row in rows for entry in _entries(row, own, defaults, scene)]}
        built = Scene.from_document(document, scene.parent)
    except SceneError as error:
        return str(error)
    for number, log in enumerate(built.logs, 1):
        if built.rig_for(log).drive_speed is None and not {"drive_speed", "position"} & set(log.columns or {}):
            which = f"log {number} ({log.path.name}) has" if len(built.logs) > 1 else "has"
            return (
                f"{which} no drive speed; give drive_speed in the manifest or under [rig], or name the column that has"
                ' it: columns = { drive_speed = "…" } or { position = "…" } in [[logs]] (without a path: of all logs)'
            )
    return built


def _entries(row: ManifestRow, own: Sequence[str], defaults: Document, scene: Path) -> list[Document]:
    """The [[logs]] of a row: what the scene states of all logs (a table without a path), what it lists for that file,
    if it does, and what the row states otherwise."""
    path, listed = row.path.absolute(), defaults.get("logs", [])
    logs = [log for log in listed if isinstance(log, Mapping)] if isinstance(listed, list) else []
    common = {key: value for log in logs if "path" not in log for key, value in log.items()}
    same = []
    for log in logs:
        at = log.get("path")
        if isinstance(at, str) and "\0" not in at and located(scene.parent, at).resolve() == path.resolve():
            same.append(log)
    entries: list[Document] = [copy.deepcopy({**common, **log}) for log in same or [{}]]
    for entry in entries:
        for key, text in row.overrides.items():
            top, _, rest = key.partition(".")
            if top == "logs" or key in own:
                put(entry, f"{rest}={text}")
        labels = entry.get("labels", {})
        entry["labels"] = {**(labels if isinstance(labels, Mapping) else {}), **row.labels}
        entry["path"] = str(path)
    return entries


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
