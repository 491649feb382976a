"""Several files that are one test: strokes or steps exported one by one, found by folder or pattern."""

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Final

from data_io.errors import LogError
from data_io.frozen import Finding
from data_io.packing import members
from data_io.part import Contents, Part

_PATTERN: Final = re.compile(r"[*?\[]")
_SUFFIXES: Final = (
    ".txt", ".csv", ".tsv", ".dat", ".asc", ".log", ".lvm", ".h5", ".hdf5", ".mat", ".tdms", ".xlsx", ".gz", ".zip",
)  # fmt: skip
_BESIDE = re.compile(r"(read[ _-]?me|licen[cs]e|copying|notice|changelog)", re.IGNORECASE)  # texts about logs
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
        found = [
            p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file() and not _BESIDE.match(p.name)
        ]
    elif is_series(path):
        anchor = Path(path.anchor) if path.anchor else Path()
        try:
            found = [p for p in anchor.glob(str(path.relative_to(path.anchor))) if p.is_file()]
        except (ValueError, OSError, NotImplementedError) as error:
            raise LogError(
                f"{path}: the pattern cannot be read ({error}); one such as stroke_*.txt was expected; correct it"
            ) from error
    elif path.suffix.lower() == ".zip" and path.is_file():
        found = [path / name for name in members(path)]
    else:
        return [path]
    found = [p for p in found if not p.name.startswith(".")]
    if not found:
        what = "the folder holds no log" if path.is_dir() else "no file fits the pattern"
        raise LogError(f"{path}: {what}; files such as {', '.join(_SUFFIXES[:3])} were expected; check it")
    return sorted(found, key=lambda p: _natural(str(p)))


def joined_contents(path: Path, read: Sequence[tuple[Path, Contents]]) -> Contents:
    """Return the files of one test as one run, its steps one after the other by their starting times or file numbers.

    Raises `LogError` where the files do not look like one test.
    """
    forms = sorted({contents.form for _, contents in read})
    if len(forms) > 1:
        raise LogError(
            f"{path}: the files are of several formats ({', '.join(forms)}); one test was expected; name one"
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
        _check_names(path, [p for p, _ in read])
        order = "the numbers in their names"
    if len(read) > 1:
        findings.append(Finding("joined_files", "info", f"{len(read)} files were joined in the order of {order}"))
    numbered = [_numbered(p, part, number) for number, (p, part) in enumerate(parts, start=1)]
    first = read[0][1]
    metadata = {**first.metadata, "files": ", ".join(p.name for p, _ in read)[:2000]}
    return Contents(first.form, numbered, metadata, findings, first.settled, first.drive_speed)


def _check_names(path: Path, paths: Sequence[Path]) -> None:
    """Refuse files that may well be separate tests: without starting times their names must count up by one."""
    numbers = [_DIGITS.findall(p.name) for p in paths]
    stems = {_DIGITS.sub("#", p.name) for p in paths}
    varying = [i for i in range(len(numbers[0])) if len({n[i] for n in numbers}) > 1] if len(stems) == 1 else []
    counted = [int(n[varying[0]]) for n in numbers] if len(varying) == 1 else []
    if len(paths) > 1 and (not counted or counted != list(range(counted[0], counted[0] + len(paths)))):
        names = ", ".join(p.name for p in paths[:4]) + (", ..." if len(paths) > 4 else "")
        raise LogError(
            f"{path}: {len(paths)} files were found ({names}) that neither say when they were started nor count up by "
            "one in their names; the files of one test were expected; name single files"
        )


def _numbered(path: Path, part: Part, number: int) -> Part:
    parameters = {**part.parameters, "file": path.name}
    if part.number != number:
        parameters["step in file"] = str(part.number)
    return replace(part, run=1, number=number, parameters=parameters)


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a key by which stroke_9 stands before stroke_10."""
    return [(int(piece), "") if piece.isdecimal() else (-1, piece) for piece in re.split(r"(\d{1,18})", name)]
