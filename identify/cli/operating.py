"""What the calculators say at the operating points of a scene or of a finished fit, and over maps."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping, Sequence

import numpy as np

from identify.base.document import Json, to_dict
from identify.base.wording import wrapped
from identify.cli.common import Answer, CommandLineError, Terminal, file_to_write, pairs, picture, quantity
from identify.cli.points import PairAtPoint, one_pair, operating_points
from identify.prediction.axes import axis, known_axes
from identify.prediction.draws import POINT, Draws
from identify.prediction.maps import (
    Chart,
    LineMap,
    around,
    chart,
    check_data_path,
    line_map,
    stabilising_changes,
    write_map,
)
from identify.prediction.predict import NoAnswer, PointPrediction, predict, predictions
from identify.prediction.sources import Tested, existing_result
from identify.prediction.wording import ranges_text, said
from identify.report.report_wording import OUTCOMES
from identify.scene.tables import nearest

GRID, LINE = 60, 120  # nodes of a map along each of two quantities, and along one
Range = tuple[float, float] | None


def answers(arguments: Namespace, terminal: Terminal, part: str) -> Answer:
    """Say one part ("stability" or "amplitude") of the prediction at every operating point; plot it where asked.

    Raises:
        CommandLineError, SceneError, SimulationError, LogError: one sentence each.
    """
    plot = picture(arguments.plot)
    margin = None if arguments.advice is None else quantity(arguments.advice, "", "--advice")
    if margin is not None and not 0.0 < margin < 10.0:
        raise CommandLineError(f'--advice is {arguments.advice!r}; expected a share above zero: write --advice "20 %"')
    points, tested, scene = operating_points(arguments)
    origins = points[0].origins
    terminal.say(wrapped(origins.text, "", ""))
    offered = None if arguments.result else existing_result(scene)
    if offered is not None:
        terminal.say(wrapped(f"A fit of this scene stands beside it: --result {offered} takes its parameters.", "", ""))
    if arguments.map:
        return _map(arguments, terminal, part, one_pair(points, "--map"), tested)
    if arguments.data or arguments.range or arguments.points is not None:
        raise CommandLineError("--data, --range and --points belong to a map; name its quantities: --map drive_speed")
    shown = one_pair(points, "--plot") if plot else points
    documents = []
    for point, prediction in zip(points, _predictions(points), strict=True):
        terminal.say(f"{point.title}:")
        group = {"group": dict(point.groups)} if point.groups else {}
        document: dict[str, Json] = {"name": point.name, **group, **to_dict(prediction)}
        texts = [prediction.text]  # alone: no answer
        if isinstance(prediction, PointPrediction):
            own = prediction.stability.text if part == "stability" else prediction.amplitude.text
            # values that nobody measured make ranges, not one number
            texts = [ranges_text(prediction, part)] if origins.assumed else [own, prediction.closed_forms.text]
            if margin is not None:
                advice = stabilising_changes(point.site.model, point.at, point.names, tested, margin)
                document["advice"] = to_dict(advice)
                texts.append(advice.text)
            if tested is not None and (beyond := tested.beyond(point.setting)):
                document["extrapolated"] = beyond
                texts.insert(0, beyond)
        for line in (line for text in texts for line in text.splitlines()):
            terminal.say(wrapped(line, "  ", ""))
        documents.append(document)
    if plot:
        from identify.report.draw_map import draw_line

        draw_line(line_map(shown[0].site, "drive_speed", _around("drive_speed", shown), LINE, None), plot, part)
        terminal.say(f"plot: {plot}")
    whole: dict[str, Json] = {"status": "done", "assumed": list(origins.assumed), "points": documents}
    return Answer(document=whole if offered is None else whole | {"existing_result": str(offered)})


def _predictions(points: Sequence[PairAtPoint]) -> list[PointPrediction | NoAnswer]:
    """The answers at each point; points of one pair share what they have in common."""
    if len(points) == 1 and not points[0].untold:
        p, site = points[0], points[0].site
        return [predict(site.model, site.values, site.drive_speed, site.normal_force, p.covariance, p.names)]
    answered: dict[int, PointPrediction | NoAnswer] = {}
    for groups in {p.groups for p in points}:
        mine = [i for i, p in enumerate(points) if p.groups == groups]
        first = points[mine[0]]
        if first.untold:
            answered |= dict.fromkeys(mine, NoAnswer(f"no answer: {first.untold}"))
        else:
            answered |= zip(mine, predictions(first.site.model, [points[i].at for i in mine], first.names), strict=True)
    return [answered[i] for i in range(len(points))]


# ----------------------------------------------------------------------------------------------------------------------
# --map: over one or two quantities, as words, picture and data.
# ----------------------------------------------------------------------------------------------------------------------


def _map(
    arguments: Namespace, terminal: Terminal, part: str, points: Sequence[PairAtPoint], tested: Tested | None
) -> Answer:
    """Map one or two quantities around the first operating point; say it, draw it, store it."""
    plot = picture(arguments.plot)
    data = None if arguments.data is None else file_to_write(arguments.data, "--data")
    if data is not None:
        check_data_path(data)
    point, site, names = points[0], points[0].site, tuple(arguments.map)
    known = known_axes(site.model)
    for name in names:
        if name not in known:
            raise CommandLineError(
                f"--map names {name!r}, which is not known; did you mean {nearest(name, known)!r}? Known are "
                f"{', '.join(known)}"
            )
    if len(names) > 2:
        raise CommandLineError(f"--map names {len(names)} quantities; expected one or two: leave some out")
    ranges = _ranges(arguments.range, names, points)
    draws = None
    if point.covariance is not None:
        at = dict(zip(POINT, (site.drive_speed, site.normal_force), strict=True))
        draws = Draws.of(site.model, dict(site.values) | at, point.names, point.covariance)
    nodes = arguments.points if arguments.points is not None else LINE if len(names) == 1 else GRID
    made: LineMap | Chart
    if len(names) == 1:
        made = line_map(site, names[0], ranges[0], nodes, draws)
        document = _line_document(made)
    else:
        made = chart(site, (names[0], names[1]), ranges, (nodes, nodes))
        document = _chart_document(made)
    terminal.say(wrapped(str(document["text"]), "", ""))
    if plot:
        from identify.report.draw_map import Marks, draw_line, draw_map

        if isinstance(made, LineMap):
            draw_line(made, plot, part)
        else:
            others = [(axis(p.site, names[0]).value, axis(p.site, names[1]).value) for p in points[1:]]
            draw_map(made, plot, part, Marks(others, tested, point.title))
        terminal.say(f"plot: {plot}")
    for file in [] if data is None else write_map(made, data):
        terminal.say(f"data: {file}")
    return Answer(document={"status": "done", "map": document})


def _ranges(items: Sequence[str], names: Sequence[str], points: Sequence[PairAtPoint]) -> list[Range]:
    """ "stiffness=500 N/m:5 kN/m" as SI pairs, in the order of the names; else around every operating point."""
    ranges = {name: _around(name, points) for name in names}
    example = 'drive_speed="0.1 mm/s:10 mm/s"'
    for name, text in pairs(items, "--range", example).items():
        low, colon, high = text.partition(":")
        if not colon:
            raise CommandLineError(f"--range has {text!r}; expected NAME=LOW:HIGH: write --range {example}")
        if name not in ranges:
            raise CommandLineError(f"--range names {name!r}, which --map does not; it has {', '.join(names)}")
        unit = axis(points[0].site, name).unit
        ranges[name] = quantity(low, unit, f"--range {name}"), quantity(high, unit, f"--range {name}")
    return [ranges[name] for name in names]


def _around(name: str, points: Sequence[PairAtPoint]) -> Range:
    spans = [around(axis(p.site, name)) for p in points]
    return min(low for low, _ in spans), max(high for _, high in spans)


def _chart_document(made: Chart) -> dict[str, Json]:
    """Two quantities: shares of the map by outcome, and where it was computed."""
    plane = made.plane
    spans = [
        f"{q.label} from {said(float(v[0]), q.unit)} to {said(float(v[-1]), q.unit)}"
        for q, v in ((plane.x, plane.x_values), (plane.y, plane.y_values))
    ]
    shares = ", ".join(f"{100 * share:.0f} % {OUTCOMES.get(word, word)}" for word, share in made.shares.items())
    return {
        "x": {"name": plane.x.name, "unit": plane.x.unit, "values": plane.x_values.tolist()},
        "y": {"name": plane.y.name, "unit": plane.y.unit, "values": plane.y_values.tolist()},
        "shares": made.shares,
        "outcomes": made.outcomes.tolist(),
        "end_of_stick_slip": [points.tolist() for points in made.values_of(made.sticking)],
        "loss_of_stability": [points.tolist() for points in made.values_of(made.unstable)],
        "text": f"Map of {' and '.join(spans)}, {plane.shape[1]} x {plane.shape[0]} points: {shares}.",
    }


def _line_document(answer: LineMap) -> dict[str, Json]:
    """One quantity alone: where answers change, with intervals."""
    q, figures = answer.quantity, answer.chart.figures
    low, high = (said(float(v), q.unit) for v in answer.values[[0, -1]])
    document: dict[str, Json] = {
        "x": {"name": q.name, "unit": q.unit, "values": answer.values.tolist()},
        "outcomes": answer.chart.outcomes[0].tolist(),
        "figures": {name: values.tolist() for name, (values,) in figures.items()},
    }
    sentences = []
    for key, words, changes, holds in (
        ("end_of_stick_slip", "stick-slip exists", answer.ends, np.isfinite(figures["drop"])),
        ("loss_of_stability", "steady sliding is unstable", answer.losses, answer.chart.growth >= 0.0),
    ):
        entries: list[Mapping[str, Json]] = []
        texts = []
        for change in changes:
            entry: dict[str, Json] = {"value": change.value, "unit": q.unit, "interval": None}
            entry["holds"] = "below" if change.below else "above"
            text = f"{entry['holds']} {said(change.value, q.unit)}"
            if change.interval is not None:
                ends = (change.interval.low, change.interval.high)
                entry["interval"] = list(ends)
                if change.interval.reason:
                    entry["reason"] = f"interval open: {change.interval.reason}"
                if None not in ends:
                    text += f" (95 %: {said(ends[0], q.unit)} to {said(ends[1], q.unit)})"
            entries.append(entry)
            texts.append(text)
        document[key] = entries
        none = "everywhere" if np.all(holds) else "nowhere" if not np.any(holds) else "in places"
        sentences.append(f"{words} {' and '.join(texts) or none}")
    return document | {"text": f"Over {q.label} from {low} to {high}: {'; '.join(sentences)}."}
