"""What the calculators say at the operating points of a scene or of a finished fit."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from identify.base.errors import SimulationError
from identify.base.outcome import numbers_of
from identify.base.wording import wrapped
from identify.cli.common import Answer, CommandLineError, Terminal, picture, quantity
from identify.cli.points import PairAtPoint, one_pair, operating_points, points_of, tested_range
from identify.prediction.intervals import OperatingPoint
from identify.prediction.predict import predict, predictions
from identify.prediction.probability import probability_document
from identify.prediction.sources import Tested, groups_of
from identify.prediction.stabilising import stabilising_changes
from identify.report.finished import Fit
from identify.scene import Scene

# ----------------------------------------------------------------------------------------------------------------------
# What the calculators say beyond the outlook where it is asked for: advice, and how sure the answers are.
# ----------------------------------------------------------------------------------------------------------------------

Further = Callable[[PairAtPoint, Tested | None], dict[str, Any]]
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

    def further(point: PairAtPoint, tested: Tested | None) -> dict[str, Any]:
        from identify.prediction.probability import probability_document
        from identify.prediction.stabilising import stabilising_changes

        found: dict[str, Any] = {}
        at = OperatingPoint(point.values, point.drive_speed, point.normal_force, point.covariance)
        if draws is not None:
            found["sureness"] = probability_document(point.model, at, point.names, draws)
        if margin is not None:
            found["advice"] = stabilising_changes(point.model, at, point.names, tested, margin)
        return found

    return further


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


def _beyond(point: PairAtPoint, tested: Tested | None) -> str:
    """What of an operating point the logs did not test; "" where nothing is known of that, or all was."""
    if tested is None:
        return ""
    where = {"drive_speed": point.drive_speed, "normal_force": point.normal_force}
    return tested.beyond(where | {"stiffness": point.values["stiffness"]})


def _outlooks(points: Sequence[PairAtPoint]) -> list[dict[str, Any]]:
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


def _of_pair(points: Sequence[PairAtPoint]) -> list[dict[str, Any]]:
    if points[0].untold:
        return [{"text": f"no answer: {points[0].untold}"} for _ in points]
    at = [OperatingPoint(p.values, p.drive_speed, p.normal_force, p.covariance) for p in points]
    return predictions(points[0].model, at, points[0].names)


# ----------------------------------------------------------------------------------------------------------------------
# What a finished fit says beyond its numbers: how sure its answers are, and what to change, at one of its logs.
# ----------------------------------------------------------------------------------------------------------------------

DRAWS = 100  # some milliseconds each


def with_counsel(scene: Scene, fit: Fit) -> Fit:
    """The fit with "sureness" and "advice" among the derived quantities of the fastest log that sticks and slips (the
    nearest to where stick-slip ends), else of the fastest; as it was where there is no answer."""
    result, logs = fit.result, list(fit.result["logs"])
    answered = [i for i, log in enumerate(logs) if "stability" in (log.get("derived") or {})]
    if not fit.converged or not answered:
        return fit
    chosen = max(answered, key=lambda i: (_sticks(logs[i]["derived"]), abs(logs[i]["drive_speed_m_per_s"] or 0.0)))
    point = _point(scene, result, chosen)
    if point is None:
        return fit
    at = OperatingPoint(point.values, point.drive_speed, point.normal_force, point.covariance)
    try:
        further = {
            "sureness": probability_document(point.model, at, point.names, DRAWS),
            "advice": stabilising_changes(point.model, at, point.names, Tested.of_result(result)),
        }
    except SimulationError:
        return fit  # the answers of the logs say why
    logs[chosen] = {**logs[chosen], "derived": {**logs[chosen]["derived"], **further}}
    return replace(fit, result={**result, "logs": logs})


def _sticks(derived: Mapping[str, Any]) -> bool:
    return bool(derived["amplitude"]["drop"]["value"] is not None)


def _point(scene: Scene, result: Mapping[str, Any], place: int) -> PairAtPoint | None:
    """The operating point of a log of the result (from 0), None where it has none."""
    number, groups = numbers_of(result["logs"])[place], groups_of(result, place)
    speed = abs(result["logs"][place]["drive_speed_m_per_s"] or 0.0)
    here = [p for p in points_of(scene, result) if p.log == number and p.groups == groups and not p.untold]
    return next((p for p in here if abs(p.drive_speed - speed) <= 1e-9 * speed), None)
