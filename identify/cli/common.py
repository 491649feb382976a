"""What all commands share: the answer, the terminal they write to, options and how they are read."""

from __future__ import annotations

import os
from argparse import ArgumentParser, Namespace, _ArgumentGroup
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from identify.base.progress import ProgressBar, Style, write_line
from identify.cli.interrupt import check_interrupted

if TYPE_CHECKING:
    from data_io import Record

DONE, DEFECT, WRONG_INPUT, NOT_SUCCEEDED, INTERRUPTED = 0, 1, 2, 3, 130
LONG = 30_000_000  # bytes of a log from which on reading shows its progress
Options = Mapping[str, "str | Options"]


class CommandLineError(Exception):
    """The command line asks for something that cannot be; the text is the whole sentence."""


@dataclass(frozen=True)
class Answer:
    """What a command gives back: the exit code, and the document that --json prints."""

    code: int = DONE
    document: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Terminal:
    """Where words for people go: standard output, or standard error while --json is on.

    `notes` is a stream that keeps nothing with --quiet; `progress`: how that of long work is shown there.
    """

    words: TextIO
    notes: TextIO
    progress: Style = "shown"

    def say(self, text: str = "") -> None:
        """Words that are the answer."""
        write_line(text, self.words)

    def note(self, text: str) -> None:
        """Words beside the answer: progress, warnings."""
        write_line(text, self.notes)

    def bar(self) -> Progress:
        """The progress of long work, a context."""
        return Progress(self.notes, self.progress)


class Progress(ProgressBar):
    """The bar of the command line: ends the work with KeyboardInterrupt if it was interrupted meanwhile."""

    def __call__(self, stage: str, share: float | None = None) -> None:
        """The work is at this stage."""
        check_interrupted()
        super().__call__(stage, share)


@dataclass(frozen=True)
class Command:
    """A command: its name, a line of help, its options as `add_options` takes them, and what it does."""

    name: str
    help: str
    options: Options
    run: Callable[[Namespace, Terminal], Answer]


# ----------------------------------------------------------------------------------------------------------------------
# Declaring options.
# ----------------------------------------------------------------------------------------------------------------------


def add_options(parser: ArgumentParser | _ArgumentGroup, options: Options) -> None:
    """Declare arguments and options by "name METAVAR" and help, or a group of them by its title.

    An option without METAVAR is a switch, N is a whole number, {a,b} a choice. Marks behind an option's METAVAR:
    ! needed, + repeatable, * repeatable with several words at a time, ? may have no value; behind an argument's those
    of argparse.
    """
    for words, text in options.items():
        if not isinstance(text, str):
            add_options(parser.add_argument_group(words), text)
            continue
        name, _, metavar = words.partition(" ")
        mark = metavar[-1] if metavar.endswith(("!", "+", "*", "?")) else ""
        metavar = metavar.removesuffix(mark)
        more: dict[str, Any] = {"help": text.replace("%", "%%")}
        if not metavar:
            more["action"] = "store_true"
        elif metavar.startswith("{"):
            more["choices"] = metavar[1:-1].split(",")
        else:
            more["metavar"] = metavar
        if metavar == "N":
            more["type"] = int
        if mark and not name.startswith("-"):
            more["nargs"] = mark
        elif mark:
            marked: dict[str, dict[str, Any]] = {
                "!": {"required": True},
                "+": {"action": "append", "default": []},
                "*": {"action": "extend", "default": [], "nargs": "+"},
                "?": {"nargs": "?", "const": ""},
            }
            more |= marked[mark]
        parser.add_argument(name, **more)


SET: Options = {"--set KEY=VALUE+": 'such as rig.mass="0.3 kg"'}
READING: Options = {
    "how to read the logs": {
        "--step N": "use this step of the run (default: all, on one clock)",
        "--run N": "use this run, where a log has several",
        "--columns NAME=COLUMN,…": "such as time=T,friction_force=Fx,normal_force=Fz",
        "--units NAME=UNIT,…": "such as friction_force=N,time=s",
        "--normal-force FORCE": 'constant, where the log has none: "3 N"',
        "--rate HZ": 'sampling rate, where the log has no clock: "4 Hz"',
    }
}
PART: Options = {
    "how much of the logs to read": {
        "--window START,STOP": 'from the first row on, such as "100 s,2 min"',
        "--channels NAME,…": "which of the other columns to keep; none keeps none",
    }
}


# ----------------------------------------------------------------------------------------------------------------------
# Reading what was given; whatever cannot be is a CommandLineError, a SceneError or a LogError of one sentence.
# ----------------------------------------------------------------------------------------------------------------------


def pairs(items: str | Sequence[str] | None, option: str, example: str) -> dict[str, str]:
    """ "time=T,friction_force=Fx", or several words of that form, as a table."""
    out = {}
    for item in items.split(",") if isinstance(items, str) else items or ():
        name, equals, value = (part.strip() for part in item.partition("="))
        if item.strip() and not (equals and name and value):
            raise CommandLineError(f"{option} has {item!r}; expected KEY=VALUE: write {option} {example}")
        if name:
            out[name] = value
    return out


def listed(text: str | None) -> tuple[str, ...]:
    """The words of a list with commas; none of None."""
    return tuple(item.strip() for item in (text or "").split(",") if item.strip())


def log_options(arguments: Namespace) -> dict[str, Any]:
    """Those options of a log that are given, as `data_io.read_log` takes them."""
    options = {
        "step": arguments.step,
        "run": arguments.run,
        "columns": pairs(arguments.columns, "--columns", "time=T,friction_force=Fx"),
        "units": pairs(arguments.units, "--units", "friction_force=N,time=s"),
        "normal_force": arguments.normal_force,
        "rate": arguments.rate,
    }
    return {name: value for name, value in options.items() if value not in (None, {})}


def read(path: str, arguments: Namespace, terminal: Terminal) -> Record:
    """Read one log with the options of READING and PART."""
    from data_io import read_log

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


def quantity(text: str, unit: str, option: str) -> float:
    """A quantity of the command line in SI: a number, or text with a unit."""
    from identify.scene.tables import quantity as read_quantity

    return read_quantity(text, unit, option)


def positive(text: str, unit: str, option: str) -> float:
    """As `quantity`, above zero."""
    from identify.scene.tables import POSITIVE, Key, check

    value = quantity(text, unit, option)
    check(option, Key(unit, sign=POSITIVE), value)
    return value


def positives(text: str | None, unit: str, option: str) -> tuple[float, ...]:
    """Positive quantities in SI of a list with commas, "0.1 mm/s,1 mm/s"; none of None."""
    return tuple(positive(item, unit, option) for item in listed(text))


# ----------------------------------------------------------------------------------------------------------------------
# Files to write; whether they can be is checked before the work, not after it.
# ----------------------------------------------------------------------------------------------------------------------

MEASURED = "a measured log"


def file_to_write(path: str, option: str, endings: Sequence[str] = ()) -> Path:
    """The file an option names, in a folder that can be written to, with one of these endings."""
    out = Path(path)
    if endings and out.suffix.lower() not in endings:
        raise CommandLineError(f"{option} {path} ends in {out.suffix!r}; expected {' or '.join(endings)}: rename it")
    if out.is_dir():
        raise CommandLineError(f"{option} {path} is a folder; expected the name of a file: add one")
    if not out.parent.is_dir():
        raise CommandLineError(f"{option} {path}: its folder does not exist; create it or choose another one")
    if not os.access(out.parent, os.W_OK | os.X_OK):
        raise CommandLineError(f"{option} {path}: nothing may be written in its folder; choose another one")
    return out


def picture(path: str | None) -> Path | None:
    """The file of --plot."""
    return None if path is None else file_to_write(path, "--plot", (".png", ".svg", ".pdf"))


def new_file(path: str, option: str, holding: str, endings: Sequence[str] = ()) -> Path:
    """As `file_to_write`, of a file that must not be there; holding: what such a file may hold, in words."""
    out = file_to_write(path, option, endings)
    if out.exists():
        raise CommandLineError(f"{option} {out} exists and may hold {holding}; choose another name")
    return out
