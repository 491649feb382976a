"""The command `stickslip`: finds the command, runs it, and turns every end into an exit code and one sentence."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import traceback
import warnings
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

import identify
from identify.base.document import to_dict
from identify.base.errors import IdentifyError
from identify.base.progress import silence
from identify.cli.commands import COMMANDS, OPTIONS, SAID
from identify.cli.common import Answer, CommandLineError, Exit, Terminal, add_options
from identify.cli.interrupt import check_interrupted, interrupted, interruptible, taken_as_handled

STOPPED = "interrupted; no half-written result is left behind"
LONGEST = 400  # characters of a sentence that ends a command
MOST_DETAILS = 50  # lines shown before it
DESCRIPTION = "From tribometer logs of stick-slip to friction parameters, stability, amplitude\nand a report."
EPILOG = """\
first steps:
  stickslip demo                          the main job on the example logs
  stickslip inspect LOG                   what is in a log of yours
  stickslip scene LOG… --out SCENE.toml   a first scene file from your logs
  stickslip fit --scene SCENE.toml        the friction parameters, and a report

exit codes: 0 done, 2 wrong input, 3 ran without success, 130 interrupted,
            1 a defect of ours
"""


class _Parser(ArgumentParser):
    """Complains by raising, so that a wrong command line ends like every other error; takes no shortened options."""

    def error(self, message: str) -> NoReturn:
        raise CommandLineError(f"{message}; see: {self.prog} --help")


def build_parser() -> ArgumentParser:
    """The parser of all commands."""
    shape = RawDescriptionHelpFormatter
    parser = _Parser("stickslip", None, DESCRIPTION, EPILOG, formatter_class=shape, allow_abbrev=False)
    parser.add_argument("--version", action="store_true", help="print the version and stop")
    known = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=_Parser)
    for name, (work, text) in COMMANDS.items():
        sub = known.add_parser(name, help=text, description=text, allow_abbrev=False)
        add_options(sub, OPTIONS[name])
        add_options(sub, SAID)
        sub.set_defaults(work=work)
    add_options(parser, SAID)
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
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:  # else the next file would take the place of a closed one
        pass
    os.close(number)
    for name in ("stdout", "stderr"):  # UTF-8 everywhere, nothing where they were closed (`>&-`)
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115 - until the process ends
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="replace")
    out = sys.stdout  # while a command runs, its words may be sent elsewhere

    def last_words() -> None:
        with contextlib.redirect_stdout(out):
            _print_document(_failed(Exit.INTERRUPTED, STOPPED), json_mode)

    with interruptible(last_words if argv is None else None):
        answer = _answer(given, json_mode, debug)
    try:
        _print_document(answer, json_mode)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has left; the exit code is that of the work
        silence(sys.stdout)
    except OSError as error:
        answer = _failed(Exit.WRONG_INPUT, _sentence(error))
    return answer.code


def _answer(given: list[str], json_mode: bool, debug: bool) -> Answer:
    """Run, and turn every kind of end into an answer."""
    try:
        # whatever a library prints must not spoil the document
        with contextlib.redirect_stdout(sys.stderr) if json_mode else contextlib.nullcontext():
            answer = _run(given, json_mode)
        check_interrupted()
        if answer.code == Exit.WRONG_INPUT:  # of several logs some were read, of a batch some groups were fitted
            _failed(answer.code, str(answer.document["message"]))
        return answer
    except BaseException as error:  # noqa: BLE001 - a defect is a sentence, never a traceback
        if debug:
            traceback.print_exc()
        if interrupted() or isinstance(error, KeyboardInterrupt):  # a library may make an error of its own out of one
            taken_as_handled()
            return _failed(Exit.INTERRUPTED, STOPPED)
        if isinstance(error, CommandLineError):
            return _failed(Exit.WRONG_INPUT, _sentence(error), error.details)
        from data_io.values import LogError, UnitError

        if isinstance(error, IdentifyError | OSError | LogError | UnitError):
            return _failed(Exit.WRONG_INPUT, _sentence(error))
        words = f"{type(error).__name__}: {error}".strip()
        return _failed(Exit.DEFECT, f"a defect of ours ({words}); run again with --debug and report what it prints")


def _run(given: list[str], json_mode: bool) -> Answer:
    """The answer of the command that is given."""
    try:
        identify.check_data_io()
    except ImportError as hidden:
        raise CommandLineError(str(hidden)) from None
    try:
        arguments = build_parser().parse_args(given)
    except SystemExit:  # help was wanted and printed
        return Answer(document={"status": "done"})
    terminal = Terminal(
        words=sys.stderr if json_mode else sys.stdout,
        notes=open(os.devnull, "w", encoding="utf-8") if arguments.quiet else sys.stderr,  # noqa: PTH123, SIM115
        progress="verbose" if arguments.verbose else arguments.progress or "shown",
    )
    if arguments.version:
        from importlib.metadata import version

        terminal.say(f"stickslip {version('stick-slip-workbench')}")
        return Answer(document={"status": "done", "version": version("stick-slip-workbench")})
    if arguments.command is None:
        raise CommandLineError(f"no command was given; expected one of {', '.join(COMMANDS)}")
    with warnings.catch_warnings():
        if not arguments.debug:
            warnings.simplefilter("ignore")  # of libraries, for developers; what users must know is in the answer
        module, name = arguments.work.split(".")
        answer: Answer = getattr(import_module(f"identify.cli.{module}"), name)(arguments, terminal)
    return answer


def _sentence(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        name = f"{error.filename}: " if error.filename else ""
        return f"{name}{error.strerror}; check the path, its permissions and the space left"
    return " ".join(str(error).split())


def _failed(code: Exit, message: str, details: Sequence[str] = ()) -> Answer:
    if len(message) > LONGEST:  # it echoes a long argument
        message = f"{message[: LONGEST // 2]}…{message[-LONGEST // 2 :]}"
    with contextlib.suppress(OSError):  # where errors cannot be written, nobody reads them
        for line in details[:MOST_DETAILS]:
            print(f"  {line}", file=sys.stderr)
        if len(details) > MOST_DETAILS:
            print(f"  and {len(details) - MOST_DETAILS} more", file=sys.stderr)
        print(f"stickslip: {message}", file=sys.stderr, flush=True)
    errors = {"errors": list(details)} if details else {}
    return Answer(code, {"schema": 1, "status": "error", "message": message, **errors})


def _print_document(answer: Answer, json_mode: bool) -> None:
    document = dict(answer.document)
    if json_mode and answer.code in (Exit.DONE, Exit.NOT_SUCCEEDED):
        document = {"schema": 1, **to_dict(document)}
    if json_mode:
        print(json.dumps(document, ensure_ascii=False))
