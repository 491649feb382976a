"""What the calculators say at the operating points of a scene or of a finished fit."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from identify.base.wording import wrapped
from identify.cli.common import Answer, CommandLineError, Terminal, picture
from identify.cli.further import asked_further
from identify.cli.groups import one_pair
from identify.cli.point import Point
from identify.cli.points import operating_points, tested_range
from identify.prediction.predict import OperatingPoint, predict, predictions
from identify.prediction.sources import Tested


def answers(arguments: Namespace, terminal: Terminal, part: str) -> Answer:
    """Say one part ("stability" or "amplitude") of the outlook of every operating point; plot it where asked.

    Raises:
        CommandLineError, SceneError, SimulationError, LogError: one sentence each.
    """
    plot = picture(arguments.plot)
    points = operating_points(arguments)
    if arguments.map:
        from identify.cli.maps import map_answer

        return map_answer(arguments, terminal, part, one_pair(points, "--map"), tested_range(arguments))
    if arguments.data or arguments.range or arguments.points is not None:
        raise CommandLineError("--data, --range and --points belong to a map; name its quantities: --map drive_speed")
    shown = one_pair(points, "--plot") if plot else points
    further, tested = asked_further(arguments), tested_range(arguments)
    documents = _outlooks(points)
    for point, document in zip(points, documents, strict=True):
        terminal.say(f"{point.title}:")
        told = [document[part], document["closed_forms"]] if part in document else [document]  # alone: no answer
        if part in document:
            found = further(point, tested)
            document |= found
            told += found.values()
            if beyond := _beyond(point, tested):
                document["extrapolated"] = beyond
                told = [{"text": beyond}, *told]
        for line in (line for section in told for line in section["text"].splitlines()):
            terminal.say(wrapped(line, "  ", ""))
    if plot:
        from identify.cli.point_plot import draw

        draw(shown[0], [p.drive_speed for p in shown], part, plot)
        terminal.say(f"plot: {plot}")
    return Answer(document={"status": "done", "points": documents})


def _beyond(point: Point, tested: Tested | None) -> str:
    """What of an operating point the logs did not test; "" where nothing is known of that, or all was."""
    if tested is None:
        return ""
    where = {"drive_speed": point.drive_speed, "normal_force": point.normal_force}
    return tested.beyond(where | {"stiffness": point.values["stiffness"]})


def _outlooks(points: Sequence[Point]) -> list[dict[str, Any]]:
    """The answers at each point, as `outlook` gives them; points of one pair share what they have in common.

    Raises:
        SimulationError: no answer at the only point.
    """
    if len(points) == 1 and not points[0].untold:
        p = points[0]
        found = {p.groups: [predict(p.model, p.values, p.drive_speed, p.normal_force, p.covariance, p.names)]}
    else:
        found = {groups: _of_pair([p for p in points if p.groups == groups]) for groups in {p.groups for p in points}}
    left = {groups: iter(documents) for groups, documents in found.items()}
    return [{"name": p.name} | ({"group": dict(p.groups)} if p.groups else {}) | next(left[p.groups]) for p in points]


def _of_pair(points: Sequence[Point]) -> list[dict[str, Any]]:
    if points[0].untold:
        return [{"text": f"no answer: {points[0].untold}"} for _ in points]
    at = [OperatingPoint(p.values, p.drive_speed, p.normal_force, p.covariance) for p in points]
    return predictions(points[0].model, at, points[0].names)
