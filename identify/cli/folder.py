"""The output folder: replaced only if it holds a result of ours, and never left half-written."""

from __future__ import annotations

import itertools
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from identify.cli.common import CommandLineError
from identify.cli.interrupt import check_interrupted, unfinished

# The names of everything that a folder of ours holds; the first is the document of it.
RESULT = (
    *("result.json", "report.html", "result.h5", "figures", "classical.csv", "parameters.tex", "scene.toml"),
    *("at_50_Hz", "uneven", ".DS_Store"),
)
COMPARISON = (
    *("comparison.json", "report.html", "comparison.xlsx", "comparison.tex", "comparison.h5", "tables", ".DS_Store"),
)


def check_replaceable(out: Path, names: tuple[str, ...] = RESULT) -> None:
    """Refuse a path that must not be replaced; cheap, for a call before the work."""
    if out.is_dir() and Path.cwd().is_relative_to(out.resolve()):
        raise CommandLineError(f"--out {out} is the folder this command runs in; choose a new folder")
    if out.exists() and not out.is_dir():
        raise CommandLineError(f"--out {out} is a file; expected a folder: choose another name")
    place = next(folder for folder in Path(os.path.realpath(out)).parents if folder.exists())
    if not place.is_dir():
        raise CommandLineError(f"--out {out} stands below {place}, which is a file; choose another folder")
    try:  # a full or a special file system refuses whatever the rights say
        Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=place)).rmdir()
    except OSError:
        raise CommandLineError(f"--out {out}: nothing may be written in {place}; choose another folder") from None
    inside = sorted(item.name for item in out.iterdir()) if out.is_dir() else []
    foreign = [name for name in inside if name not in names]
    try:
        document = json.loads((out / names[0]).read_text(encoding="utf-8")) if inside else {}
        ours = not inside or (isinstance(document, dict) and "schema" in document and "status" in document)
    except (OSError, ValueError, RecursionError):
        ours = False
    if not ours:
        raise CommandLineError(f"--out {out} exists and holds no result of ours; choose another folder or empty it")
    if foreign:
        raise CommandLineError(
            f"--out {out} holds {foreign[0]!r}, which is not part of a result; move it away or choose another folder"
        )


@contextmanager
def result_folder(out: Path, names: tuple[str, ...] = RESULT) -> Iterator[Path]:
    """A temporary folder beside `out` to write into; it takes the place of `out` when all went well.

    Entered before the work, so that what another command writes to `out` meanwhile is not replaced.
    """
    check_replaceable(out, names)
    out = Path(os.path.realpath(out))
    before = out.stat().st_ino if out.exists() else None
    out.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{out.name}.{os.getpid()}.", suffix=".part", dir=out.parent))
    with unfinished(temporary):
        fresh, aside = temporary / "fresh", temporary / "before"
        fresh.mkdir()
        try:
            yield fresh
        except OSError as error:  # a full disk: named is what was to be written, not the temporary folder
            error.filename = error.filename and str(error.filename).replace(str(fresh), str(out), 1)
            raise
        check_interrupted()
        if (out.stat().st_ino if out.exists() else None) != before:
            free = next(f for i in itertools.count(2) if not (f := out.with_name(f"{out.name}-{i}")).exists())
            fresh.rename(free)
            raise CommandLineError(
                f"--out {out.name}: another command has written there meanwhile; this result stands in {free}"
            )
        if out.exists():
            out.rename(aside)
        try:
            fresh.rename(out)
        except BaseException:
            if aside.exists() and not out.exists():
                aside.rename(out)
            raise
