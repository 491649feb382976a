"""`--map`: stability and amplitude over one or two quantities, as words, picture and data."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identify.base.wording import wrapped
from identify.cli.common import Answer, CommandLineError, Terminal, file_to_write, pairs, picture, quantity
from identify.prediction.axes import Site, axis, known_axes
from identify.prediction.draws import POINT, Draws
from identify.prediction.maps import (
    AnswerChange,
    Chart,
    LineMap,
    around,
    chart,
    check_data_path,
    line_map,
    write_map,
)
from identify.prediction.wording import said
from identify.report.report_wording import OUTCOMES
from identify.scene.tables import nearest

if TYPE_CHECKING:
    from identify.cli.points import PairAtPoint
    from identify.prediction.sources import Tested

GRID, LINE = 60, 120  # nodes along each of two quantities, and along one
Range = tuple[float, float] | None


def map_answer(
    arguments: Namespace, terminal: Terminal, part: str, points: Sequence[PairAtPoint], tested: Tested | None
) -> Answer:
    """Map one or two quantities around the first operating point; say it, draw it, store it.

    Raises:
        CommandLineError, SimulationError: one sentence each.
    """
    plot = picture(arguments.plot)
    data = None if arguments.data is None else file_to_write(arguments.data, "--data")
    if data is not None:
        check_data_path(data)
    point = points[0]
    site = point.site
    names = tuple(_named(name, site) for name in arguments.map)
    if len(names) > 2:
        raise CommandLineError(f"--map names {len(names)} quantities; expected one or two: leave some out")
    ranges = _ranges(arguments.range, names, points)
    drawn = None
    if point.covariance is not None:
        at = dict(zip(POINT, (site.drive_speed, site.normal_force), strict=True))
        drawn = Draws.of(site.model, dict(site.values) | at, point.names, point.covariance)
    if len(names) == 1:
        answer = line_map(site, names[0], ranges[0], LINE if arguments.points is None else arguments.points, drawn)
        document = _line_document(answer)
        terminal.say(wrapped(document["text"], "", ""))
        if plot:
            from identify.report.draw_map import draw_line

            draw_line(answer, plot, part)
        files = [] if data is None else write_map(answer, data)
    else:
        n = GRID if arguments.points is None else arguments.points
        made = chart(site, (names[0], names[1]), ranges, (n, n))
        document = _chart_document(made)
        terminal.say(wrapped(document["text"], "", ""))
        if plot:
            from identify.report.draw_map import Marks, draw_map

            others = [tuple(axis(p.site, name).value for name in names) for p in points[1:]]
            draw_map(made, plot, part, Marks([(a, b) for a, b in others], drawn, tested, point.title))
        files = [] if data is None else write_map(made, data)
    if plot:
        terminal.say(f"plot: {plot}")
    for file in files:
        terminal.say(f"data: {file}")
    return Answer(document={"status": "done", "map": document})


def draw_over_speed(points: Sequence[PairAtPoint], part: str, path: Path) -> None:
    """The picture of `--plot` without a map: that of the map over drive speed, around every operating point."""
    from identify.report.draw_map import draw_line

    draw_line(line_map(points[0].site, "drive_speed", _around("drive_speed", points), LINE, None), path, part)


def _named(name: str, site: Site) -> str:
    known = known_axes(site.model)
    if name not in known:
        raise CommandLineError(
            f"--map names {name!r}, which is not known; did you mean {nearest(name, known)!r}? Known are "
            f"{', '.join(known)}"
        )
    return name


def _ranges(items: Sequence[str], names: Sequence[str], points: Sequence[PairAtPoint]) -> list[Range]:
    """ "stiffness=500 N/m:5 kN/m" as SI pairs, in the order of the names; else around every operating point."""
    site = points[0].site
    found = {name: _around(name, points) for name in names}
    example = 'drive_speed="0.1 mm/s:10 mm/s"'
    for name, text in (pairs(items, "--range", example) or {}).items():
        low, colon, high = text.partition(":")
        if not colon:
            raise CommandLineError(f"--range has {text!r}; expected NAME=LOW:HIGH: write --range {example}")
        if name not in found:
            raise CommandLineError(f"--range names {name!r}, which --map does not; it has {', '.join(names)}")
        unit = axis(site, name).unit
        found[name] = quantity(low, unit, f"--range {name}"), quantity(high, unit, f"--range {name}")
    return [found[name] for name in names]


def _around(name: str, points: Sequence[PairAtPoint]) -> Range:
    spans = [around(axis(p.site, name)) for p in points]
    return min(low for low, _ in spans), max(high for _, high in spans)


def chart_text(made: Chart) -> str:
    """Shares of a map by outcome, and where it was looked at."""
    plane = made.plane
    spans = [
        f"{q.label} from {said(float(v[0]), q.unit)} to {said(float(v[-1]), q.unit)}"
        for q, v in ((plane.x, plane.x_values), (plane.y, plane.y_values))
    ]
    shares = ", ".join(f"{100 * share:.0f} % {OUTCOMES.get(word, word)}" for word, share in made.shares.items())
    return f"Map of {' and '.join(spans)}, {plane.shape[1]} x {plane.shape[0]} points: {shares}."


def _chart_document(made: Chart) -> dict[str, Any]:
    plane = made.plane
    return {
        "x": {"name": plane.x.name, "unit": plane.x.unit, "values": plane.x_values.tolist()},
        "y": {"name": plane.y.name, "unit": plane.y.unit, "values": plane.y_values.tolist()},
        "shares": made.shares,
        "outcomes": made.outcomes.tolist(),
        "end_of_stick_slip": [points.tolist() for points in made.values_of(made.sticking)],
        "loss_of_stability": [points.tolist() for points in made.values_of(made.unstable)],
        "text": chart_text(made),
    }


def _line_document(answer: LineMap) -> dict[str, Any]:
    """One quantity alone: where answers change."""
    changes = {
        key: [_change(change, answer.quantity.unit) for change in found]
        for key, found in (("end_of_stick_slip", answer.ends), ("loss_of_stability", answer.losses))
    }
    q = answer.quantity
    return {
        "x": {"name": q.name, "unit": q.unit, "values": answer.values.tolist()},
        "outcomes": answer.chart.outcomes[0].tolist(),
        "figures": {name: values.tolist() for name, (values,) in answer.chart.figures.items()},
        **changes,
        "text": _line_text(answer, changes),
    }


def _change(change: AnswerChange, unit: str) -> dict[str, Any]:
    """A place where an answer changes, with its interval."""
    entry: dict[str, Any] = {"value": change.value, "unit": unit, "interval": None}
    entry["holds"] = "below" if change.below else "above"
    if change.interval is not None:
        entry["interval"] = [change.interval.low, change.interval.high]
        if change.interval.reason:
            entry["reason"] = f"interval open: {change.interval.reason}"
    return entry


def _line_text(answer: LineMap, changes: Mapping[str, list[dict[str, Any]]]) -> str:
    q = answer.quantity
    low, high = (said(float(v), q.unit) for v in answer.values[[0, -1]])
    sentences = [f"Over {q.label} from {low} to {high}:"]
    for key, words in (("end_of_stick_slip", "stick-slip exists"), ("loss_of_stability", "steady sliding is unstable")):
        told = [f"{entry['holds']} {_told(entry)}" for entry in changes[key]]
        sticks = key.startswith("end")
        everywhere = np.isfinite(answer.chart.figures["drop"]) if sticks else answer.chart.growth >= 0.0
        none = "everywhere" if np.all(everywhere) else "nowhere" if not np.any(everywhere) else "in places"
        sentences.append(f"{words} {' and '.join(told) or none};")
    return " ".join(sentences)[:-1] + "."


def _told(entry: Mapping[str, Any]) -> str:
    low, high = entry["interval"] or (None, None)
    value = said(entry["value"], entry["unit"])
    if low is None or high is None:
        return value
    return f"{value} (95 %: {said(low, entry['unit'])} to {said(high, entry['unit'])})"
