"""What a reader found in a log, one file or several: steps, the choice among them, and a list of them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Final

from data_io.columns import Header, Name, find_column, shown, words
from data_io.source import Request, Source, file_sha256, members, sha256_of_several, split_member
from data_io.values import COLUMN_ROLES, Finding, FloatArray, LogError, Scalar, listed

# Steps as readers find them, and the choice among runs and steps that the user makes.


@dataclass(frozen=True)
class Part:
    """One step as its reader found it: columns by index of the header, raw, all of one length; items of its run.

    clocks: where channels bring clocks of their own, the time column of each; empty: the places of columns tell.
    """

    run: int
    number: int
    header: Header
    columns: Mapping[int, FloatArray]
    parameters: Mapping[str, str] = field(default_factory=dict)
    started: datetime | None = None
    run_items: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[int, int] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return min((column.size for column in self.columns.values()), default=0)


def with_column(part: Part, role: str, name: Name, values: FloatArray) -> Part:
    """Return a step with one column (rows,) more, which carries a role."""
    index = len(part.header.names)
    header = replace(part.header, names=(*part.header.names, name), roles={**part.header.roles, role: index})
    return replace(part, header=header, columns={**part.columns, index: values})


def unit_of(request: Request, header: Header, index: int) -> str | None:
    """Return the unit of a column: as the user gives it by role or name, else as the file says it, None where none."""
    name = header.names[index]
    roles = [role for role, place in header.roles.items() if place == index]
    given = (request.units.get(key) for key in (*roles, name.name, name.raw))
    return next(filter(None, given), None) or name.unit


@dataclass(frozen=True)
class Contents:
    """What a reader found in a log: the steps, what the file says besides, what was noticed; form: name of the format.

    settled: the format is ours, compression is positive and every column is kept. drive_speed [m/s]: what the file
    says outside its columns.
    """

    parts: Sequence[Part]
    metadata: Mapping[str, Scalar] = field(default_factory=dict)
    findings: Sequence[Finding] = ()
    settled: bool = False
    drive_speed: float | None = None
    form: str = ""


def of_run(source: Source, request: Request, parts: Sequence[Part]) -> list[Part]:
    """Return the steps of the run that was asked for, or of the only one. Raises the source's `LogError`."""
    runs = sorted({part.run for part in parts})
    if request.run is None and request.step is not None:
        runs = sorted({part.run for part in parts if part.number == request.step}) or runs
    if request.run is not None and request.run not in runs:
        raise source.error(f"run {request.run} was asked for; runs in the log: {listed(runs)}; choose one of them")
    if request.run is None and len(runs) > 1:
        places = {part.run: part.run_items["table"] for part in parts if "table" in part.run_items}
        named = [f"{run} ({places[run]})" if run in places else str(run) for run in runs]
        beside = ", tables that stand side by side" if places else ""
        raise source.error(f"runs in the log: {listed(named)}{beside}; one was expected; choose one with --run")
    run = [part for part in parts if part.run == (runs[0] if request.run is None else request.run)]
    if not any(part.rows for part in run):
        raise source.error("no rows of numbers were found below the header; at least two were expected; export again")
    return run


def chosen(source: Source, request: Request, run: Sequence[Part]) -> list[Part]:
    """Return the step that was asked for, or all that hold rows. Raises the source's `LogError`."""
    if request.step is None:
        return [part for part in run if part.rows]
    chosen_parts = [part for part in run if part.number == request.step]
    if not chosen_parts:
        steps = listed([part.number for part in run])
        raise source.error(f"step {request.step} was asked for; steps in the log: {steps}; choose one of them")
    if not chosen_parts[0].rows:
        raise source.error(f"step {request.step} holds no rows; at least two were expected; choose another step")
    return chosen_parts


def check_request(source: Source, request: Request, header: Header) -> None:
    """Raise the source's `LogError` where the user names a column that the header does not have."""
    names = shown(name.name for name in header.names)
    twice = [column for column in request.columns.values() if list(request.columns.values()).count(column) > 1]
    if twice:
        raise source.error(f"the column {twice[0]!r} was named for two purposes; one was expected; name another one")
    for role, column in request.columns.items():
        if find_column(header.names, column) is None:
            raise source.error(f"no column {column!r} was found for {words(role)}; there are {names}; name one of them")
    for key in request.units:
        if key not in COLUMN_ROLES and key not in request.columns and find_column(header.names, key) is None:
            raise source.error(
                f"a unit was given for {key!r}, which is no column; {', '.join(COLUMN_ROLES[:3])} or one of {names} "
                "was expected; correct the name"
            )


# Several files that are one test: strokes or steps exported one by one, found by folder or pattern.

_PATTERN: Final = re.compile(r"[*?\[]")
_SUFFIXES: Final = (
    ".txt", ".csv", ".tsv", ".dat", ".asc", ".log", ".lvm", ".h5", ".hdf5", ".mat", ".tdms", ".parquet", ".xlsx",
    ".gz", ".zip",
)  # fmt: skip
_BESIDE = re.compile(r"(read[ _-]?me|licen[cs]e|copying|notice|changelog)", re.IGNORECASE)  # texts about logs
_ANY_DEPTH = re.compile(r"(?:\*\*/){2,}")
_DIGITS = re.compile(r"\d{1,18}")


def is_series(path: Path) -> bool:
    """Tell whether a path means several files: a folder, or a pattern (`stroke_*.txt`) that is no file itself."""
    try:
        return path.is_dir() or (_PATTERN.search(str(path)) is not None and not path.exists())
    except (OSError, ValueError):
        return False


def logs_at(path: Path) -> list[Path]:
    """Return the logs that a path means: itself, those in a folder or zip archive, or those that fit a pattern.

    In the order of the numbers in their names. Raises `LogError` where there is none.
    """
    if path.is_dir():
        paths = [
            p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file() and not _BESIDE.match(p.name)
        ]
    elif is_series(path):
        anchor = Path(path.anchor) if path.anchor else Path()
        once = _ANY_DEPTH.sub("**/", str(path.relative_to(path.anchor)))  # each further one multiplies the work
        try:
            paths = [p for p in anchor.glob(once) if p.is_file()]
        except (ValueError, OSError, NotImplementedError, RecursionError) as error:
            raise LogError(
                f"{path}: the pattern cannot be read ({error}); one such as stroke_*.txt was expected; correct it"
            ) from error
    elif path.suffix.lower() == ".zip" and path.is_file():
        paths = [path / name for name in members(path)]
    else:
        return [path]
    paths = [p for p in paths if not p.name.startswith(".")]
    if not paths:
        what = "the folder holds no log" if path.is_dir() else "no file fits the pattern"
        raise LogError(f"{path}: {what}; files such as {', '.join(_SUFFIXES[:3])} were expected; check it")
    return sorted(  # stroke_9 before stroke_10
        paths,
        key=lambda p: [(int(t), "") if t.isdecimal() else (-1, t) for t in re.split(r"(\d{1,18})", str(p))],
    )


def joined_contents(path: Path, read: Sequence[tuple[Path, Contents]]) -> Contents:
    """Return the files of one test as one run, its steps one after the other by their starting times or file numbers.

    Raises `LogError` where the files do not look like one test.
    """
    forms = sorted({contents.form for _, contents in read})
    if len(forms) > 1:
        raise LogError(
            f"{path}: the files are of several formats ({', '.join(forms)}), so they are no strokes of one test; name "
            f"each of them to look at it by itself, as a shell does with {path / '*' if path.is_dir() else path}"
        )
    several = [p for p, contents in read if len({part.run for part in contents.parts}) > 1]
    if several:
        raise LogError(f"{path}: {several[0].name} holds several runs; files of one run were expected; read it alone")
    findings = [replace(f, message=f"{p.name}: {f.message}") for p, contents in read for f in contents.findings]
    parts = [(p, part) for p, contents in read for part in contents.parts]
    if all(part.started is not None for _, part in parts if part.rows):
        parts.sort(key=lambda item: item[1].started or datetime.max)
        order = "their starting times"
    else:
        # Files that may well be separate tests are refused: their names must count up by one.
        digits = [_DIGITS.findall(p.name) for p, _ in read]
        alike = len({_DIGITS.sub("#", p.name) for p, _ in read}) == 1
        varying = [i for i in range(len(digits[0])) if len({d[i] for d in digits}) > 1] if alike else []
        counted = [int(d[varying[0]]) for d in digits] if len(varying) == 1 else []
        if len(read) > 1 and (not counted or counted != list(range(counted[0], counted[0] + len(read)))):
            names = listed((p.name for p, _ in read), most=4)
            raise LogError(
                f"{path}: {len(read)} files were found ({names}) that neither say when they were started nor count up "
                "by one in their names; the files of one test were expected; name single files"
            )
        order = "the numbers in their names"
    if len(read) > 1:
        findings.append(Finding("joined_files", "info", f"{len(read)} files were joined in the order of {order}"))
    numbered = []
    for number, (p, part) in enumerate(parts, start=1):
        own = {} if part.number == number else {"step in file": str(part.number)}
        numbered.append(replace(part, run=1, number=number, parameters={**part.parameters, "file": p.name, **own}))
    first = read[0][1]
    metadata = {**first.metadata, "files": ", ".join(p.name for p, _ in read)[:2000]}
    return Contents(numbered, metadata, findings, first.settled, first.drive_speed, form=first.form)


# Whether a log lies where a path says (a file, a folder, a pattern, a file in an archive), and its SHA-256.


def log_is_at(path: Path) -> bool:
    """Tell whether there is something to read at a path; what it holds is another matter."""
    try:
        archive, member = split_member(path)
        if member is not None:
            return member in members(archive)
        return bool(logs_at(path)) if is_series(path) else path.is_file()
    except (LogError, OSError, ValueError):
        return False


def digest_of(path: Path) -> str:
    """SHA-256 of a log, as `Record.metadata` has it: of its file or archive, of several files that of their digests.

    Raises `LogError` or `OSError` where they cannot be read.
    """
    if is_series(path):
        return sha256_of_several(file_sha256(split_member(each)[0]) for each in logs_at(path))
    return file_sha256(split_member(path)[0])
