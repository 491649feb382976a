"""`stickslip inspect`: what is in a log, and what it tells without a model."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING, Any

from identify.cli.common import Answer, Terminal, add_log_options, picture, read

if TYPE_CHECKING:
    from identify.cli.inspection import Inspection

NAME = "inspect"
HELP = "what is in a log: steps, units, sampling, quality, stick and slip, the classical table"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="one or more logs")
    parser.add_argument("--plot", metavar="FILE", help="draw force and phases over time (png, svg or pdf)")
    add_log_options(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Say it for each log.

    Raises:
        CommandLineError, LogError, OSError: one sentence each.
    """
    plot = picture(arguments.plot)
    from identify.cli.inspection import document, inspection, say

    seen: list[Inspection] = []
    for path in arguments.logs:
        seen.append(inspection(path, read(path, arguments)))
        say(seen[-1], terminal)
    if plot:
        from identify.cli.inspection_plot import draw

        draw(seen, plot)
        terminal.say(f"plot: {plot}")
    logs: list[dict[str, Any]] = [document(item) for item in seen]
    return Answer(document={"status": "done", "logs": logs})
