"""What all commands share: the answer, the terminal they speak to, and the options of a log."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from identify.cli.progress import HowToTell, Progress, write_line

if TYPE_CHECKING:
    from data_io import Record

DONE, DEFECT, WRONG_INPUT, NOT_SUCCEEDED, INTERRUPTED = 0, 1, 2, 3, 130


class CommandLineError(Exception):
    """The command line asks for something that cannot be; the text is the whole sentence."""


@dataclass(frozen=True)
class Answer:
    """What a command gives back: the exit code, and the document that --json prints."""

    code: int = DONE
    document: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Terminal:
    """Where words for people go: standard output, or standard error while --json is on.

    `notes` is a stream that keeps nothing with --quiet; `progress`: how that of long work is told there: "shown" as
    fits the stream, "verbose" as lines with the seconds, "json" as a JSON document in each line.
    """

    words: TextIO
    notes: TextIO
    progress: HowToTell = "shown"

    def say(self, text: str = "") -> None:
        """Words that are the answer."""
        write_line(text, self.words)

    def note(self, text: str) -> None:
        """Words beside the answer: progress, warnings."""
        write_line(text, self.notes)


@dataclass(frozen=True)
class Command:
    """A command that shares its file with others; a module with these names is one, too."""

    NAME: str
    HELP: str
    add_arguments: Callable[[ArgumentParser], None]
    run: Callable[[Namespace, Terminal], Answer]


LONG = 30_000_000  # bytes of a log from which on reading shows its progress
MEASURED = "a measured log"
PICTURES = (".png", ".svg", ".pdf")


def picture(path: str | None) -> Path | None:
    """The file of --plot, asked for before the work.

    Raises:
        CommandLineError: an ending that is no picture.
    """
    if path is not None and Path(path).suffix.lower() not in PICTURES:
        raise CommandLineError(
            f"--plot {path} is no picture; expected a name that ends in {', '.join(PICTURES)}: rename it"
        )
    return None if path is None else file_to_write(path, "--plot")


def file_to_write(path: str, option: str) -> Path:
    """The file an option names; whether it can be written is asked before the work, not after it.

    Raises:
        CommandLineError: no folder to write it to, or a folder itself.
    """
    out = Path(path)
    if out.is_dir():
        raise CommandLineError(f"{option} {path} is a folder; expected the name of a file: add one")
    if not out.parent.is_dir():
        raise CommandLineError(f"{option} {path}: its folder does not exist; create it or choose another one")
    if not os.access(out.parent, os.W_OK | os.X_OK):
        raise CommandLineError(f"{option} {path}: nothing may be written in its folder; choose another one")
    return out


def new_file(path: str, option: str, holding: str) -> Path:
    """The file an option names, which must not be there yet: nothing that was measured or edited is written over.

    Args:
        holding: what such a file may hold, in words.

    Raises:
        CommandLineError: as `file_to_write`, or a file that is there.
    """
    out = file_to_write(path, option)
    if out.exists():
        raise CommandLineError(f"{option} {out} exists and may hold {holding}; choose another name")
    return out


def add_log_options(parser: ArgumentParser) -> None:
    """The options of every command that takes logs."""
    group = parser.add_argument_group("how to read the logs")
    group.add_argument("--step", type=int, metavar="N", help="use this step of the run (default: all, on one clock)")
    group.add_argument("--run", type=int, metavar="N", dest="test_run", help="use this run, where a log holds several")
    group.add_argument("--columns", metavar="NAME=COLUMN,…", help="such as time=T,friction_force=Fx,normal_force=Fz")
    group.add_argument("--units", metavar="NAME=UNIT,…", help="such as friction_force=N,time=s")
    group.add_argument("--normal-force", metavar="FORCE", help='constant, where the log has none: "3 N"')
    group.add_argument("--rate", metavar="HZ", help='sampling rate, where the log has no clock: "4 Hz"')


def add_part_options(parser: ArgumentParser) -> None:
    """The options of the commands that may read only a part of a log."""
    group = parser.add_argument_group("how much of the logs to read")
    group.add_argument("--window", metavar="START,STOP", help='from the first row on, such as "100 s,2 min"')
    group.add_argument("--channels", metavar="NAME,…", help="which of the other columns to keep; none keeps none")


def part_options(arguments: Namespace) -> dict[str, Any]:
    """The options of `add_part_options` as `data_io.read_log` takes them.

    Raises:
        CommandLineError: no two times.
    """
    window, channels = getattr(arguments, "window", None), getattr(arguments, "channels", None)
    times = None if window is None else [part for part in window.split(",") if part.strip()]
    if times is not None and len(times) != 2:
        raise CommandLineError(f"--window has {window!r}; expected two times: write --window 100,200")
    names = None if channels is None else [name.strip() for name in channels.split(",") if name.strip()]
    return {
        "window": None if times is None else tuple(quantity(time, "s", "--window") for time in times),
        "channels": [] if names == ["none"] else names,
    }


def pairs(items: str | Sequence[str] | None, option: str, example: str) -> dict[str, str] | None:
    """ "time=T,friction_force=Fx", or several words of that form, as a table; None stays None.

    Raises:
        CommandLineError: an item without "=".
    """
    if items is None:
        return None
    out = {}
    for item in items.split(",") if isinstance(items, str) else items:
        name, equals, value = (part.strip() for part in item.partition("="))
        if item.strip() and not (equals and name and value):
            raise CommandLineError(f"{option} has {item!r}; expected KEY=VALUE: write {option} {example}")
        if name:
            out[name] = value
    return out


def log_options(arguments: Namespace) -> dict[str, Any]:
    """The options of a log as `data_io.read_log` takes them.

    Raises:
        CommandLineError: an option that cannot be read.
    """
    return {
        "step": arguments.step,
        "run": arguments.test_run,
        "columns": pairs(arguments.columns, "--columns", "time=T,friction_force=Fx"),
        "units": pairs(arguments.units, "--units", "friction_force=N,time=s"),
        "normal_force": arguments.normal_force,
        "rate": arguments.rate,
    }


def read(path: str, arguments: Namespace, terminal: Terminal | None = None) -> Record:
    """Read one log with the options of the command line; a long one shows its progress on the terminal.

    Raises:
        LogError, CommandLineError: one sentence each.
    """
    from data_io import read_log

    options = {**log_options(arguments), **part_options(arguments)}
    if terminal is None or _size(path) < LONG:
        return read_log(path, **options)
    with Progress(terminal.notes, terminal.progress) as progress:
        return read_log(path, **options, progress=lambda share: progress(f"reading {Path(path).name}", share))


def _size(path: str) -> int:
    try:
        return Path(path).stat().st_size
    except OSError:
        return 0  # reading it says why


def quantity(text: str, unit: str, option: str) -> float:
    """A quantity of the command line in SI: a number, or text with a unit. SceneError: it cannot be read."""
    from identify.scene.tables import quantity as read_quantity

    return read_quantity(text, unit, option)


def positive(text: str, unit: str, option: str) -> float:
    """As `quantity`, above zero. SceneError: it is not."""
    from identify.scene.tables import POSITIVE, Key, check

    value = quantity(text, unit, option)
    check(option, Key(unit, sign=POSITIVE), value)
    return value


def share(text: str, option: str, most: float = float("inf")) -> float:
    """ "15 %" or 0.15 as 0.15.

    Raises:
        CommandLineError: no number from 0 to below `most`.
    """
    from identify.scene.tables import part

    value = part(text, "", option)
    if not 0.0 <= value < most:
        raise CommandLineError(f'{option} is {text!r}; expected a share from 0 to below {most:g}, such as "1 %"')
    return value


def positives(text: str | None, unit: str, option: str) -> tuple[float, ...]:
    """Positive quantities in SI of a list with commas, "0.1 mm/s,1 mm/s"; none of None."""
    return tuple(positive(item.strip(), unit, option) for item in (text or "").split(",") if item.strip())


def standard_terminal(json_mode: bool, *, quiet: bool = False, progress: HowToTell = "shown") -> Terminal:
    """Standard output for words, or standard error while standard output is kept for the JSON document."""
    notes = open(os.devnull, "w", encoding="utf-8") if quiet else sys.stderr  # noqa: PTH123, SIM115 - until the end
    return Terminal(words=sys.stderr if json_mode else sys.stdout, notes=notes, progress=progress)
