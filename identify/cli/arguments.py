"""Reading what was given on the command line, and where may be written: a CommandLineError, a SceneError or a LogError
of one sentence where that cannot be."""

from __future__ import annotations

import os
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from data_io import Record, read_log
from identify.cli.common import CommandLineError, Terminal
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
