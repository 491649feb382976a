"""What all commands share: the answer, the terminal they write to, the options they declare; nothing heavy."""

from __future__ import annotations

from argparse import ArgumentParser, _ArgumentGroup
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, TextIO

from identify.base.progress import ProgressBar, Style, write_line
from identify.cli.interrupt import check_interrupted

Options = Mapping[str, "str | Options"]


class Exit(IntEnum):
    """The exit codes."""

    DONE, DEFECT, WRONG_INPUT, NOT_SUCCEEDED, INTERRUPTED = 0, 1, 2, 3, 130


class CommandLineError(Exception):
    """The command line asks for something that cannot be; the text is the whole sentence, `details` lines before it."""

    def __init__(self, sentence: str, details: Sequence[str] = ()) -> None:
        super().__init__(sentence)
        self.details = tuple(details)


@dataclass(frozen=True)
class Answer:
    """What a command gives back: the exit code, and the document that --json prints."""

    code: Exit = Exit.DONE
    document: Mapping[str, object] = field(default_factory=dict)

    @staticmethod
    def of(succeeded: bool, document: Mapping[str, object]) -> Answer:
        """The answer of work that ran."""
        return Answer(Exit.DONE if succeeded else Exit.NOT_SUCCEEDED, document)


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


MARKS: Mapping[str, Mapping[str, Any]] = {
    "!": {"required": True},
    "+": {"action": "append", "default": []},
    "*": {"action": "extend", "default": [], "nargs": "+"},
    "?": {"nargs": "?", "const": ""},
}


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
        mark = metavar[-1] if metavar.endswith(tuple(MARKS)) else ""
        metavar = metavar.removesuffix(mark)
        more: dict[str, Any] = {"help": text.replace("%", "%%") + "; repeatable" * (mark == "+" and name[0] == "-")}
        if not metavar:
            more["action"] = "store_true"
        elif metavar.startswith("{"):
            more["choices"] = metavar[1:-1].split(",")
        else:
            more["metavar"] = metavar
        if metavar == "N":
            more["type"] = int
        if mark:
            more |= MARKS[mark] if name.startswith("-") else {"nargs": mark}
        parser.add_argument(name, **more)
