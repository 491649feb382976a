"""Operating points of a scene or of a finished fit, and what the calculators say there and over maps."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from data_io.spelling import nearest
from identify.base.document import Json, to_dict
from identify.base.errors import SceneError
from identify.base.result import LogResult, Result
from identify.base.wording import range_text, wrapped
from identify.cli.arguments import file_to_write, pairs, picture
from identify.cli.common import Answer, CommandLineError, Terminal
from identify.diagnosis.effect_choice import choose_from_numbers
from identify.prediction import maps, sources
from identify.prediction.axes import Site, axis, known_axes
from identify.prediction.cycles import check_calculable
from identify.prediction.predict import NoAnswer, PointPrediction, predictions
from identify.prediction.wording import ranges_text, shown
from identify.report.report_wording import OUTCOMES
from identify.report.stored_result import read_result, scene_of
from identify.scene import LogEntry, Scene
from identify.scene.tables import NOT_NEGATIVE, POSITIVE, Key, check, quantity
from identify.scene.values import EACH_LOG

POINT = {"drive_speed": Key("m/s", sign=NOT_NEGATIVE), "normal_force": Key("N", sign=POSITIVE)}
GRID, LINE = 60, 120  # nodes of a map along each of two quantities, and along one


@dataclass(frozen=True)
class PairAtPoint:
    """One operating point, and how well it is known.

    groups: of the log, by what the parameters of a fit differ by; refusal: why the fit has no values for it, empty
    where it has; origins: where the values come from.
    """

    name: str
    site: Site
    groups: sources.Groups = ()
    refusal: str = ""
    origins: sources.Origins = field(default_factory=sources.Origins)

    @property
    def title(self) -> str:
        """Its name, with its group where there are several."""
        return f"{self.name} ({sources.named(self.groups)})" if self.groups else self.name

    @property
    def setting(self) -> dict[str, float]:
        """What the logs of a fit test."""
        at = {"drive_speed": self.site.drive_speed, "normal_force": self.site.normal_force}
        return at | {"stiffness": self.site.values["stiffness"]}


def operating_points(arguments: Namespace) -> tuple[list[PairAtPoint], sources.Tested | None, Scene]:
    """One point per log, changed by --at; a drive speed given there makes it one point, of every group where parameters
    differ between groups. With the range of what the logs tested, None where there are none, and the scene.
    """
    if bool(arguments.result) == bool(arguments.scene):
        raise CommandLineError("expected one of --scene SCENE.toml and --result result.json; give one of them")
    result = read_result(Path(arguments.result)) if arguments.result else None
    if result is not None and not result.converged:
        raise CommandLineError(f"{arguments.result}: this fit has no values ({result.status}); correct the fit first")
    source = Scene.from_toml(arguments.scene) if result is None else scene_of(result, arguments.result)
    whole = source
    if source.effects == "auto":  # as they were chosen for the result, else by the numbers of the scene
        whole = source.with_effects((result and result.effects.names) or choose_from_numbers(source).effects)
    effects = whole.model.effects
    for name in arguments.without:
        _check_known("--without", name, effects)
    scene = whole.with_effects([n for n in effects if n not in arguments.without]) if arguments.without else whole
    check_calculable(scene.model)
    changes = _changes(arguments.at, scene)
    try:
        points = points_of(scene, result, changes)
    except SceneError as error:
        raise CommandLineError(f"--at {' '.join(arguments.at)}: {error}" if changes else str(error)) from None
    known = _groups(points) or "one pair"
    for item in arguments.group:
        points = [p for p in points if item in [t for per, value in p.groups for t in (value, f"{per}={value}")]]
        if not points:
            raise CommandLineError(
                f"--group names {item!r}; the logs are of {known}: name one of these, or leave it out"
            )
    same = len({(p.site.drive_speed, p.site.normal_force, p.groups, p.refusal) for p in points}) == 1
    if len(points) > 1 and ("drive_speed" in changes or same):
        first = {point.groups: point for point in reversed(points) if not point.refusal}
        points = [replace(point, name="the operating point") for point in reversed(first.values())] or points[:1]
    tested = None if result is None else sources.Tested.of_result(result)
    if result is None and source.logs:
        tested = sources.Tested.of(point.setting for point in points_of(whole, None))
    return points, tested, source


def _check_known(option: str, name: str, known: Collection[str]) -> None:
    if name not in known:
        guess = f"did you mean {nearest(name, known)!r}? Correct it"
        raise CommandLineError(f"{option} names {name!r}, which is not among {', '.join(known)}; {guess}")


def _changes(items: Sequence[str], scene: Scene) -> dict[str, float]:
    """ "drive_speed=1 mm/s" and the like as SI numbers by name."""
    keys = POINT | {p.name: Key(p.unit) for p in scene.model.parameters}
    values = {}
    for name, text in pairs(items, "--at", 'drive_speed="1 mm/s"').items():
        _check_known("--at", name, keys)
        values[name] = quantity(text, keys[name].unit, f"--at {name}")
        check(f"--at {name}", keys[name], values[name])
    return values


def points_of(scene: Scene, result: Result | None, changes: Mapping[str, float] = {}) -> list[PairAtPoint]:
    """The operating point of every log of a scene (or of its rig alone) or of a finished fit, with these changes [SI];
    several where a log has a programme of speeds, or parts of several groups."""
    places: list[tuple[LogEntry | None, int]] = [] if scene.logs else [(None, 0)]
    for number, log_entry in enumerate(scene.logs):
        of_entry = result.places(number) if result is not None else (0,)
        first = {result and sources.groups_of(result, place): place for place in reversed(of_entry)}
        places += [(log_entry, place) for place in sorted(first.values())]
    declared, points = scene.model.parameter_names, []
    for entry, place in places:
        log = result.logs[place] if result and entry else LogResult()
        pair = sources.pair_of(result, place) if result else sources.Pair()
        for site in map(sources.site_of, sources.scenes_at(scene, entry, log, {**pair.values, **changes})):
            names, covariance = pair.names, pair.covariance
            guessed = sources.assumed(scene, site.values, (*changes, *pair.values))
            if result is None:
                deviations = sources.stated(scene, site.values, site.drive_speed) | guessed
                names, covariance = tuple(deviations), np.diag(np.square([*deviations.values()]))
            measured = tuple(n for n in declared if n in names and result is not None and n not in changes)
            kept = [i for i, n in enumerate(names) if n not in changes and (n in declared or n in POINT)]
            elsewhere = tuple(n for n in declared if n not in measured and n not in guessed)
            points.append(
                PairAtPoint(
                    name=entry.path.name if entry else "the rig of the scene",
                    site=replace(
                        site,
                        covariance=covariance[np.ix_(kept, kept)] if covariance is not None and kept else None,
                        names=tuple(names[i] for i in kept),
                    ),
                    groups=pair.groups,
                    refusal=pair.refusal,
                    origins=sources.Origins(measured, elsewhere, tuple(guessed)),
                )
            )
    return points


def _groups(points: Sequence[PairAtPoint]) -> str:
    """The groups of these points in words, each once."""
    return "; ".join(dict.fromkeys(sources.named(p.groups) for p in points if p.groups))


def _one_pair(points: Sequence[PairAtPoint], option: str) -> list[PairAtPoint]:
    """The points that have values, for an option that shows a single pair."""
    kept = [p for p in points if not p.refusal]
    if not kept:
        raise CommandLineError(f"{option} has nothing to show: {points[0].refusal}")
    if len({p.groups for p in kept}) > 1:
        per, value = kept[0].groups[0]
        choice = value if per == EACH_LOG else f"{per}={value}"
        differ = f"{option} shows one pair, and the parameters differ between {_groups(kept)}"
        raise CommandLineError(f'{differ}: choose one, as by --group "{choice}"')
    return kept


def answers(arguments: Namespace, terminal: Terminal) -> Answer:
    """Say one part (the command: "stability" or "amplitude") of the prediction at every operating point; plot it where
    wanted.
    """
    part, plot = arguments.command, picture(arguments.plot)
    margin = None if arguments.advice is None else quantity(arguments.advice or "20 %", "", "--advice")
    if margin is not None and not 0.0 < margin < 10.0:
        raise CommandLineError(f'--advice is {arguments.advice!r}; expected a share above zero: write --advice "20 %"')
    points, tested, scene = operating_points(arguments)
    origins = points[0].origins
    terminal.say(wrapped(origins.text, "", ""))
    offered = None if arguments.result else sources.existing_result(scene)
    if offered is not None:
        terminal.say(wrapped(f"A fit of this scene stands beside it: --result {offered} takes its parameters.", "", ""))
    if arguments.map:
        return _map(arguments, terminal, _one_pair(points, "--map"), tested)
    if arguments.data or arguments.range or arguments.points is not None:
        raise CommandLineError("--data, --range and --points belong to a map; name its quantities: --map drive_speed")
    shown = _one_pair(points, "--plot") if plot else points
    documents = []
    answered = iter(predictions([point.site for point in points if not point.refusal]))
    for point in points:
        prediction = NoAnswer(f"no answer: {point.refusal}") if point.refusal else next(answered)
        terminal.say(f"{point.title}:")
        group = {"group": dict(point.groups)} if point.groups else {}
        document: dict[str, Json] = {"name": point.name, **group, **to_dict(prediction)}
        texts = [prediction.text]  # alone: no answer
        if isinstance(prediction, PointPrediction):
            own = prediction.stability.text if part == "stability" else prediction.amplitude.text
            # values that nobody measured make ranges, not one number
            texts = [ranges_text(prediction, part)] if origins.assumed else [own, prediction.closed_forms.text]
            if margin is not None:
                advice = maps.stabilising_changes(point.site, tested, margin)
                document["advice"] = to_dict(advice)
                texts.append(advice.text)
            if tested is not None and (beyond := tested.beyond(point.setting)):
                document["extrapolated"] = beyond
                texts.insert(0, beyond)
        for line in "\n".join(texts).splitlines():
            terminal.say(wrapped(line, "  ", ""))
        documents.append(document)
    if plot:
        from identify.report.draw_map import draw_map

        draw_map(maps.line_map(shown[0].site, "drive_speed", _around("drive_speed", shown), LINE), plot)
        terminal.say(f"plot: {plot}")
    whole: dict[str, Json] = {"status": "done", "assumed": list(origins.assumed), "points": documents}
    return Answer(document=whole if offered is None else whole | {"existing_result": str(offered)})


def _around(name: str, points: Sequence[PairAtPoint]) -> tuple[float, float]:
    spans = [maps.around(axis(p.site, name)) for p in points]
    return min(low for low, _ in spans), max(high for _, high in spans)


def _map(
    arguments: Namespace, terminal: Terminal, points: Sequence[PairAtPoint], tested: sources.Tested | None
) -> Answer:
    """Map one or two quantities around the first operating point; say it, draw it, store it."""
    plot, data = picture(arguments.plot), arguments.data and file_to_write(arguments.data, "--data")
    if data:
        maps.check_data_path(data)
    site, names, part = points[0].site, tuple(arguments.map), arguments.command
    for name in names:
        _check_known("--map", name, known_axes(site.model))
    if len(names) > 2:
        raise CommandLineError(f"--map names {len(names)} quantities; expected one or two: leave some out")
    ranges, example = {name: _around(name, points) for name in names}, 'drive_speed="0.1 mm/s:10 mm/s"'
    for name, text in pairs(arguments.range, "--range", example).items():
        low, colon, high = text.partition(":")
        if not colon or name not in ranges:
            raise CommandLineError(
                f"--range has {name}={text}; expected NAME=LOW:HIGH of {', '.join(names)}: write --range {example}"
            )
        unit = axis(site, name).unit
        ranges[name] = quantity(low, unit, f"--range {name}"), quantity(high, unit, f"--range {name}")
    if len(names) == 1:
        nodes = LINE if arguments.points is None else arguments.points
        drawn = maps.line_map(site, names[0], ranges[names[0]], nodes)
    else:
        nodes = GRID if arguments.points is None else arguments.points
        spans = ranges[names[0]], ranges[names[1]]
        drawn = maps.stability_map(site, names[0], names[1], *spans, nodes)
    document = _line_document(drawn) if len(names) == 1 else _chart_document(drawn)
    terminal.say(wrapped(str(document["text"]), "", ""))
    if plot:
        from identify.report.draw_map import draw_map

        others = [(axis(p.site, names[0]).value, axis(p.site, names[-1]).value) for p in points[1:]]
        draw_map(drawn, plot, part, others, tested)
        terminal.say(f"plot: {plot}")
    for file in maps.write_map(drawn, data) if data else ():
        terminal.say(f"data: {file}")
    return Answer(document={"status": "done", "map": document})


def _chart_document(drawn: maps.Chart) -> dict[str, Json]:
    """Two quantities: shares of the map by outcome, and where it was computed."""
    plane = drawn.plane
    axes = {"x": (plane.x, plane.x_values), "y": (plane.y, plane.y_values)}
    spans = [f"{q.label} from {range_text(float(v[0]), float(v[-1]), q.unit)}" for q, v in axes.values()]
    shares = ", ".join(f"{100 * share:.0f} % {OUTCOMES.get(word, word)}" for word, share in drawn.shares.items())
    return {
        **{key: {"name": q.name, "unit": q.unit, "values": v.tolist()} for key, (q, v) in axes.items()},
        "shares": drawn.shares,
        "outcomes": drawn.outcomes.tolist(),
        "end_of_stick_slip": [points.tolist() for points in drawn.values_of(drawn.sticking)],
        "loss_of_stability": [points.tolist() for points in drawn.values_of(drawn.unstable)],
        "text": f"Map of {' and '.join(spans)}, {plane.shape[1]} x {plane.shape[0]} points: {shares}.",
    }


def _line_document(drawn: maps.Chart) -> dict[str, Json]:
    """One quantity alone: where answers change, with intervals."""
    q, values, figures = drawn.plane.x, drawn.plane.x_values, drawn.figures
    document: dict[str, Json] = {
        "x": {"name": q.name, "unit": q.unit, "values": values.tolist()},
        "outcomes": drawn.outcomes[0].tolist(),
        "figures": {name: row.tolist() for name, (row,) in figures.items()},
    }
    sentences = []
    for key, words, changes, holds in (
        ("end_of_stick_slip", "stick-slip exists", drawn.changes(drawn.sticking), np.isfinite(figures["drop"])),
        ("loss_of_stability", "steady sliding is unstable", drawn.changes(drawn.unstable), drawn.growth >= 0.0),
    ):
        texts = ["everywhere" if np.all(holds) else "in places" if np.any(holds) else "nowhere"] if not changes else []
        entries: list[Mapping[str, Json]] = []
        for value, below in changes:
            side = "below" if below else "above"
            entries.append({"value": value, "unit": q.unit, "holds": side})
            texts.append(f"{side} {shown(value, q.unit)}")
        document[key] = entries
        sentences.append(f"{words} {' and '.join(texts)}")
    low, high = (shown(float(v), q.unit) for v in values[[0, -1]])
    return document | {"text": f"Over {q.label} from {low} to {high}: {'; '.join(sentences)}."}
