"""Reading what was given on the command line, and where may be written: a CommandLineError, a SceneError or a LogError
of one sentence where that cannot be."""

from __future__ import annotations

import itertools
import os
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from data_io import Record, read_log
from identify.base.document import RESULT_FILES, read_json
from identify.cli.common import CommandLineError, Terminal
from identify.cli.interrupt import check_interrupted, unfinished
from identify.scene.tables import POSITIVE, Key, check, quantity

LONG = 30_000_000  # bytes of a log from which on reading shows its progress
MEASURED = "a measured log"


def pairs(text: str | Sequence[str] | None, option: str, example: str) -> dict[str, str]:
    """ "time=T,friction_force=Fx", or several words of that form, as a table."""
    out = {}
    for item in text.split(",") if isinstance(text, str) else text or ():
        name, equals, value = (part.strip() for part in item.partition("="))
        if item.strip() and not (equals and name and value):
            raise CommandLineError(f"{option} has {item!r}; expected KEY=VALUE: write {option} {example}")
        if name:
            out[name] = value
    return out


def listed(text: str | None) -> tuple[str, ...]:
    """The words of a list with commas; none of None."""
    return tuple(item.strip() for item in (text or "").split(",") if item.strip())


def positives(text: str | None, unit: str, option: str) -> tuple[float, ...]:
    """Positive quantities in SI of a list with commas, "0.1 mm/s,1 mm/s"; none of None."""
    values = tuple(quantity(item, unit, option) for item in listed(text))
    for value in values:
        check(option, Key(unit, sign=POSITIVE), value)
    return values


def positive(text: str | None, unit: str, option: str) -> float | None:
    """One positive quantity in SI; None of None."""
    if text is not None and len(listed(text)) != 1:
        raise CommandLineError(f'{option} has {text!r}; expected one quantity: write {option} "1 {unit}"')
    return next(iter(positives(text, unit, option)), None)


def log_options(arguments: Namespace) -> dict[str, Any]:
    """Those options of a log that are given, as `data_io.read_log` takes them."""
    options = {name: getattr(arguments, name) for name in ("step", "run", "normal_force", "rate", "arm", "area")}
    options["columns"] = pairs(arguments.columns, "--columns", "time=T,friction_force=Fx")
    options["units"] = pairs(arguments.units, "--units", "friction_force=N,time=s")
    return {name: value for name, value in options.items() if value not in (None, {})}


def read(path: str, arguments: Namespace, terminal: Terminal) -> Record:
    """Read one log with the options of READING and PART."""
    options = log_options(arguments)
    if arguments.window is not None:
        times = listed(arguments.window)
        if len(times) != 2:
            raise CommandLineError(f"--window has {arguments.window!r}; expected two times: write --window 100,200")
        options["window"] = tuple(quantity(time, "s", "--window") for time in times)
    if arguments.channels is not None:
        options["channels"] = [name for name in listed(arguments.channels) if name != "none"]
    if not Path(path).is_file() or Path(path).stat().st_size < LONG:
        return read_log(path, **options)
    with terminal.bar() as progress:
        return read_log(path, **options, progress=lambda share: progress(f"reading {Path(path).name}", share))


def file_to_write(path: str, option: str, endings: Sequence[str] = ()) -> Path:
    """The file an option names, in a folder that can be written to, with one of these endings; for a call before the
    work."""
    out = Path(path)
    if endings and out.suffix.lower() not in endings:
        raise CommandLineError(f"{option} {path} ends in {out.suffix!r}; expected {' or '.join(endings)}: rename it")
    if out.is_dir():
        raise CommandLineError(f"{option} {path} is a folder; expected the name of a file: add one")
    if not out.parent.is_dir() or not os.access(out.parent, os.W_OK | os.X_OK):
        what = "nothing may be written in its folder" if out.parent.is_dir() else "its folder does not exist"
        raise CommandLineError(f"{option} {path}: {what}; choose another one")
    return out


def picture(path: str | None) -> Path | None:
    """The file of --plot."""
    return None if path is None else file_to_write(path, "--plot", (".png", ".svg", ".pdf"))


def new_file(path: str, holding: str, endings: Sequence[str] = ()) -> Path:
    """As `file_to_write`, of an --out that must not be there; holding: what such a file may hold, in words."""
    out = file_to_write(path, "--out", endings)
    if out.exists():
        raise CommandLineError(f"--out {out} exists and may hold {holding}; choose another name")
    return out


# The output folder: replaced only if it holds a result of ours, and never left half-written.

# The names of everything that a folder of ours holds; the first is the document of it.
RESULT = (*RESULT_FILES, "scene.toml", ".DS_Store")
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
    if inside and not {"schema", "status"} <= set(read_json(out / names[0]) or ()):
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
