"""Operating points of several groups: those that --group asks for, and options that show one pair alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from identify.cli.common import CommandLineError
from identify.prediction.sources import named
from identify.scene.values import EACH_LOG

if TYPE_CHECKING:
    from identify.cli.point import Point


def of_groups(asked: Sequence[str], points: list[Point]) -> list[Point]:
    """The points of the groups that --group names, each as VALUE or LABEL=VALUE; all of them where it names none.

    Raises:
        CommandLineError: a group that no log belongs to.
    """
    kept = points
    for item in asked:
        kept = [p for p in kept if item in [t for per, value in p.groups for t in (value, f"{per}={value}")]]
    if kept:
        return kept
    known = listed_groups(points)
    raise CommandLineError(
        f"--group names {' and '.join(map(repr, asked))}; the logs are of {known}: name one of these"
        if known
        else f"--group names {asked[0]!r}, but no parameter differs between groups of logs here: leave it out"
    )


def one_pair(points: Sequence[Point], option: str) -> list[Point]:
    """The points that have values, for an option that shows a single pair.

    Raises:
        CommandLineError: points of several groups, or none with values.
    """
    told = [p for p in points if not p.untold]
    if not told:
        raise CommandLineError(f"{option} has nothing to show: {points[0].untold}")
    if len({p.groups for p in told}) > 1:
        per, value = told[0].groups[0]
        choice = f'--group "{value}"' if per == EACH_LOG else f'--group "{per}={value}"'
        raise CommandLineError(
            f"{option} shows one pair, and the parameters differ between {listed_groups(told)}: choose one, as by "
            f"{choice}"
        )
    return told


def listed_groups(points: Sequence[Point]) -> str:
    """The groups of these points in words, each once."""
    return "; ".join(dict.fromkeys(named(p.groups) for p in points if p.groups))
