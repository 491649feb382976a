"""What the calculators say at the operating points of a scene or of a finished fit."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from identify.cli.common import Answer, CommandLineError, Terminal, picture
from identify.cli.further import asked_further
from identify.cli.points import Point, operating_points, tested_range
from identify.cli.summary import wrapped
from identify.outlook import OperatingPoint, outlook, outlooks


def answers(arguments: Namespace, terminal: Terminal, part: str) -> Answer:
    """Say one part ("stability" or "amplitude") of the outlook of every operating point; plot it where asked.

    Raises:
        CommandLineError, SceneError, SimulationError, LogError: one sentence each.
    """
    plot = picture(arguments.plot)
    points = operating_points(arguments)
    if arguments.map:
        from identify.cli.maps import map_answer

        return map_answer(arguments, terminal, part, points, tested_range(arguments))
    if arguments.data or arguments.range or arguments.points is not None:
        raise CommandLineError("--data, --range and --points belong to a map; name its quantities: --map drive_speed")
    further = asked_further(arguments)
    documents = _outlooks(points)
    for point, document in zip(points, documents, strict=True):
        terminal.say(f"{document['name']}:")
        told = [document[part], document["closed_forms"]] if part in document else [document]  # alone: no answer
        if part in document:
            found = further(point, tested_range(arguments))
            document |= found
            told += found.values()
        for line in (line for section in told for line in section["text"].splitlines()):
            terminal.say(wrapped(line, "  ", ""))
    if plot:
        from identify.cli.point_plot import draw

        draw(points[0], [p.drive_speed for p in points], part, plot)
        terminal.say(f"plot: {plot}")
    return Answer(document={"status": "done", "points": documents})


def _outlooks(points: Sequence[Point]) -> list[dict[str, Any]]:
    """The answers at each point, as `identify.outlook` gives them; they share what they have in common.

    Raises:
        SimulationError: no answer at the only point.
    """
    names, model = points[0].names, points[0].model
    at = [OperatingPoint(p.values, p.drive_speed, p.normal_force, p.covariance) for p in points]
    if len(points) == 1:
        found = [outlook(model, at[0].values, at[0].drive_speed, at[0].normal_force, at[0].covariance, names)]
    else:
        found = outlooks(model, at, names)
    return [{"name": point.name, **document} for point, document in zip(points, found, strict=True)]
