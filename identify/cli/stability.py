"""`stickslip stability`: does it stick and slip here, and up to which drive speed."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from identify.cli.common import Answer, Terminal
from identify.cli.point_options import add_point_arguments

NAME = "stability"
HELP = "does the pair stick and slip at an operating point, and up to which drive speed"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    add_point_arguments(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Say it for each operating point.

    Raises:
        CommandLineError, SceneError, SimulationError, LogError: one sentence each.
    """
    from identify.cli.operating import answers

    return answers(arguments, terminal, "stability")
