"""What the calculators say at the operating points of a scene or of a finished fit."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence

from identify.base.document import Json, to_dict
from identify.base.wording import wrapped
from identify.cli.common import Answer, CommandLineError, Terminal, picture, quantity
from identify.cli.points import PairAtPoint, one_pair, operating_points, tested_range
from identify.prediction.point_prediction import NoAnswer, PointPrediction
from identify.prediction.predict import predict, predictions
from identify.prediction.sources import existing_result
from identify.prediction.stabilising import stabilising_changes
from identify.prediction.wording import ranges_text
from identify.scene import Scene


def answers(arguments: Namespace, terminal: Terminal, part: str) -> Answer:
    """Say one part ("stability" or "amplitude") of the outlook of every operating point; plot it where asked.

    Raises:
        CommandLineError, SceneError, SimulationError, LogError: one sentence each.
    """
    plot = picture(arguments.plot)
    margin = None if arguments.advice is None else quantity(arguments.advice, "", "--advice")
    if margin is not None and not 0.0 < margin < 10.0:
        raise CommandLineError(f'--advice is {arguments.advice!r}; expected a share above zero: write --advice "20 %"')
    points = operating_points(arguments)
    origins = points[0].origins
    terminal.say(wrapped(origins.text, "", ""))
    offered = None if arguments.result else existing_result(Scene.from_toml(arguments.scene))
    if offered is not None:
        terminal.say(wrapped(f"A fit of this scene stands beside it: --result {offered} takes its parameters.", "", ""))
    if arguments.map:
        from identify.cli.maps import map_answer

        return map_answer(arguments, terminal, part, one_pair(points, "--map"), tested_range(arguments))
    if arguments.data or arguments.range or arguments.points is not None:
        raise CommandLineError("--data, --range and --points belong to a map; name its quantities: --map drive_speed")
    shown = one_pair(points, "--plot") if plot else points
    tested = tested_range(arguments)
    documents = []
    for point, prediction in zip(points, _predictions(points), strict=True):
        terminal.say(f"{point.title}:")
        group = {"group": dict(point.groups)} if point.groups else {}
        document: dict[str, Json] = {"name": point.name, **group, **to_dict(prediction)}
        texts = [prediction.text]  # alone: no answer
        if isinstance(prediction, PointPrediction):
            own = prediction.stability.text if part == "stability" else prediction.amplitude.text
            if origins.assumed:  # values that nobody measured make ranges, not one number
                own = ranges_text(prediction, part)
            texts = [own] if origins.assumed else [own, prediction.closed_forms.text]
            if margin is not None:
                advice = stabilising_changes(point.model, point.at, point.names, tested, margin)
                document["advice"] = to_dict(advice)
                texts.append(advice.text)
            where = {"drive_speed": point.drive_speed, "normal_force": point.normal_force}
            where["stiffness"] = point.values["stiffness"]
            if tested is not None and (beyond := tested.beyond(where)):
                document["extrapolated"] = beyond
                texts.insert(0, beyond)
        for line in (line for text in texts for line in text.splitlines()):
            terminal.say(wrapped(line, "  ", ""))
        documents.append(document)
    if plot:
        from identify.cli.maps import draw_over_speed

        draw_over_speed(shown, part, plot)
        terminal.say(f"plot: {plot}")
    whole: dict[str, Json] = {"status": "done", "assumed": list(origins.assumed), "points": documents}
    return Answer(document=whole if offered is None else whole | {"existing_result": str(offered)})


def _predictions(points: Sequence[PairAtPoint]) -> list[PointPrediction | NoAnswer]:
    """The answers at each point; points of one pair share what they have in common.

    Raises:
        SimulationError: no answer at the only point.
    """
    if len(points) == 1 and not points[0].untold:
        p = points[0]
        return [predict(p.model, p.values, p.drive_speed, p.normal_force, p.covariance, p.names)]
    answered: dict[int, PointPrediction | NoAnswer] = {}
    for groups in {p.groups for p in points}:
        mine = [i for i, p in enumerate(points) if p.groups == groups]
        first = points[mine[0]]
        if first.untold:
            answered |= dict.fromkeys(mine, NoAnswer(f"no answer: {first.untold}"))
        else:
            answered |= zip(mine, predictions(first.model, [points[i].at for i in mine], first.names), strict=True)
    return [answered[i] for i in range(len(points))]
