"""The command `stickslip`: finds the command, runs it, and turns every end into an exit code and one sentence."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import traceback
import warnings
from argparse import SUPPRESS, ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, NoReturn

from identify.base.errors import IdentifyError
from identify.base.packages import check_data_io
from identify.cli.common import (
    DEFECT,
    INTERRUPTED,
    WRONG_INPUT,
    Answer,
    CommandLineError,
    standard_terminal,
)
from identify.cli.interrupt import check_interrupted, interrupted, interruptible, taken_as_handled
from identify.cli.progress import HowToTell, silence

STOPPED = "interrupted; no half-written result is left behind"
LONGEST = 400  # characters of a sentence that ends a command
DESCRIPTION = "From tribometer logs of stick-slip to friction parameters, stability, amplitude and a report."
EPILOG = """\
first steps:
  stickslip demo                          the main job on the example logs
  stickslip inspect LOG                   what is in a log of yours
  stickslip scene LOG… --out SCENE.toml   a first scene file from your logs
  stickslip fit --scene SCENE.toml        the friction parameters, and a report

exit codes: 0 done, 2 wrong input, 3 ran without success, 130 interrupted, 1 a defect of ours
"""


class _Parser(ArgumentParser):
    """Complains by raising, so that a wrong command line ends like every other error; takes no shortened options."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(allow_abbrev=False, **arguments)

    def error(self, message: str) -> NoReturn:
        raise CommandLineError(f"{message}; see: {self.prog} --help")


COMMANDS = """
demo inspect logs rig plan fit verify batch compare simulate calculators app cache
""".split()


def commands() -> list[Any]:
    """Every command, in the order of the help: those that a module lists, or the module itself.

    They bring NumPy and pandas, a good part of a second: imported within `main`, which an interruption ends in words.
    """
    modules = [import_module(f"identify.cli.{name}") for name in COMMANDS]
    return [command for module in modules for command in getattr(module, "COMMANDS", (module,))]


def build_parser() -> _Parser:
    """The parser of all commands."""
    parser = _Parser(
        prog="stickslip", description=DESCRIPTION, epilog=EPILOG, formatter_class=RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="store_true", help="print the version and stop")
    known = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=_Parser)
    for command in commands():
        sub = known.add_parser(command.NAME, help=command.HELP, description=command.HELP)
        command.add_arguments(sub)
        sub.set_defaults(run=command.run)
    for place in (parser, *known.choices.values()):
        place.add_argument("--json", action="store_true", help="one JSON document on standard output, words on stderr")
        place.add_argument("--debug", action="store_true", help="show the traceback of an error")
        place.add_argument("--quiet", action="store_true", help="no progress and no notes: the answer alone")
        place.add_argument("--verbose", action="store_true", help="every stage of the work with its seconds")
        place.add_argument("--progress", choices=("shown", "json"), default=SUPPRESS, help="json: one document a line")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: the arguments (default: those of the process).

    Returns:
        the exit code: 0 done, 2 wrong input, 3 ran without success, 130 interrupted, 1 a defect.
    """
    # Before numpy loads: threads of small solves wait for each other longer than they work.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    given = list(sys.argv[1:] if argv is None else argv)
    json_mode, debug = "--json" in given, "--debug" in given
    _open_streams()
    with interruptible(_last_words(json_mode) if argv is None else None):
        answer = _ended(given, json_mode, debug)
    try:
        _print_document(answer, json_mode)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has left; the exit code is that of the work
        silence(sys.stdout)
    except OSError as error:
        answer = _failed(WRONG_INPUT, _sentence(error), debug)
    return answer.code


def _open_streams() -> None:
    """Standard output and standard error take every word: UTF-8 everywhere, nothing where they were closed (`>&-`)."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:  # else the next file would take the place of a closed one
        pass
    os.close(number)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115 - until the process ends
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="replace")


def _last_words(json_mode: bool) -> Callable[[], None]:
    """What is said where the command had to be ended from outside."""
    out = sys.stdout  # while a command runs, its words may be sent elsewhere

    def say() -> None:
        with contextlib.redirect_stdout(out):
            _print_document(_failed(INTERRUPTED, STOPPED, False), json_mode)

    return say


def _ended(given: list[str], json_mode: bool, debug: bool) -> Answer:
    """Run, and turn every kind of end into an answer."""
    try:
        _check_packages()
        answer = _run(given, json_mode)
        check_interrupted()
        return answer
    except KeyboardInterrupt:
        taken_as_handled()
        return _failed(INTERRUPTED, STOPPED, debug)
    except Exception as error:  # noqa: BLE001 - the last resort: a defect is said, never shown as a traceback
        if interrupted():  # a library made an error of its own out of the KeyboardInterrupt
            taken_as_handled()
            return _failed(INTERRUPTED, STOPPED, debug)
        if _mendable(error):
            return _failed(WRONG_INPUT, _sentence(error), debug)
        words = f"{type(error).__name__}: {error}".strip()
        return _failed(DEFECT, f"a defect of ours ({words}); run again with --debug and report what it prints", debug)


def _run(given: list[str], json_mode: bool) -> Answer:
    parser = build_parser()
    # whatever a library prints must not spoil the document
    with contextlib.redirect_stdout(sys.stderr) if json_mode else contextlib.nullcontext():
        try:
            arguments: Namespace = parser.parse_args(given)
        except SystemExit:  # help was asked for and printed
            return Answer(document={"status": "done"})
        how: HowToTell = "verbose" if "--verbose" in given else getattr(arguments, "progress", "shown")
        terminal = standard_terminal(json_mode, quiet="--quiet" in given, progress=how)
        if arguments.version:
            from importlib.metadata import version

            installed = version("stick-slip-workbench")
            terminal.say(f"stickslip {installed}")
            return Answer(document={"status": "done", "version": installed})
        if arguments.command is None:
            raise CommandLineError(f"no command was given; expected one of {', '.join(c.NAME for c in commands())}")
        with warnings.catch_warnings():
            if not arguments.debug:
                warnings.simplefilter("ignore")  # of libraries, for developers; what users must know is in the answer
            answer: Answer = arguments.run(arguments, terminal)
    return answer


def _check_packages() -> None:
    """Look whether a file of the user hides a package of ours.

    Raises:
        CommandLineError: one does.
    """
    try:
        check_data_io()
    except ImportError as hidden:
        raise CommandLineError(str(hidden)) from None


def _mendable(error: Exception) -> bool:
    """Whether the user can mend it, and its text is a sentence for the user."""
    if isinstance(error, CommandLineError):
        return True
    from data_io.values import LogError, UnitError

    return isinstance(error, (IdentifyError, LogError, UnitError, OSError))


def _sentence(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        name = f"{error.filename}: " if error.filename else ""
        return f"{name}{error.strerror}; check the path, its permissions and the space left"
    return " ".join(str(error).split())


def _failed(code: int, message: str, debug: bool) -> Answer:
    if debug:
        traceback.print_exc()
    if len(message) > LONGEST:  # it echoes a long argument
        message = f"{message[: LONGEST // 2]}…{message[-LONGEST // 2 :]}"
    with contextlib.suppress(OSError):  # where errors cannot be written, nobody can be told
        print(f"stickslip: {message}", file=sys.stderr, flush=True)
    return Answer(code, {"schema": 1, "status": "error", "message": message})


def _print_document(answer: Answer, json_mode: bool) -> None:
    if json_mode and answer.code in (DEFECT, WRONG_INPUT, INTERRUPTED):
        print(json.dumps(answer.document, ensure_ascii=False))
    elif json_mode:
        from identify.report.stored_result import plain

        document = {"schema": 1, **plain(answer.document)}
        print(json.dumps(document, ensure_ascii=False, allow_nan=False))
