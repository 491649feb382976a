"""What the calculators say beyond the outlook where it is asked for: advice, and how sure the answers are."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from typing import Any

from identify.cli.common import CommandLineError, quantity
from identify.cli.point import Point
from identify.prediction.sources import Tested

Further = Callable[[Point, Tested | None], dict[str, Any]]
MOST_DRAWS = 100_000


def asked_further(arguments: Namespace) -> Further:
    """A function of an operating point and the tested range that gives {"sureness": …, "advice": …}, as asked for.

    Raises:
        CommandLineError: a margin or a number of draws without meaning.
    """
    margin = None if arguments.advice is None else quantity(arguments.advice, "", "--advice")
    if margin is not None and not 0.0 < margin < 10.0:
        raise CommandLineError(f'--advice is {arguments.advice!r}; expected a share above zero: write --advice "20 %"')
    draws = arguments.draws
    if draws is not None and not 1 <= draws <= MOST_DRAWS:
        raise CommandLineError(f"--draws is {draws}; expected 1 to {MOST_DRAWS}: write --draws 400")

    def further(point: Point, tested: Tested | None) -> dict[str, Any]:
        from identify.prediction.probability import probability_document
        from identify.prediction.stabilising import stabilising_changes

        found: dict[str, Any] = {}
        at = (point.model, point.values, point.drive_speed, point.normal_force, point.covariance, point.names)
        if draws is not None:
            found["sureness"] = probability_document(*at, draws)
        if margin is not None:
            found["advice"] = stabilising_changes(*at, tested, margin)
        return found

    return further
