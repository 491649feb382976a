"""`stickslip amplitude`: how large and how often the jumps of stick-slip are."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from identify.cli.common import Answer, Terminal
from identify.cli.point_options import add_point_arguments

NAME = "amplitude"
HELP = "how large, how fast and how often the jumps of stick-slip are at an operating point"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    add_point_arguments(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Say it for each operating point.

    Raises:
        CommandLineError, SceneError, SimulationError, LogError: one sentence each.
    """
    from identify.cli.operating import answers

    return answers(arguments, terminal, "amplitude")
