"""Operating points of a scene or of a finished fit: every log's own, or the one that --at asks for."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from identify.base.result import LogResult, Result
from identify.cli.common import CommandLineError, pairs, quantity
from identify.diagnosis.effect_choice import choose_from_numbers
from identify.prediction.axes import Site
from identify.prediction.draws import OperatingPoint
from identify.prediction.orbit import check_calculable
from identify.prediction.sources import (
    Groups,
    Origins,
    Pair,
    Tested,
    assumed,
    groups_of,
    named,
    pair_of,
    stated,
    ties_of,
    with_tied,
)
from identify.report.stored_result import read_result, scene_of
from identify.scene import LogEntry, Scene
from identify.scene.tables import NOT_NEGATIVE, POSITIVE, Key, check, nearest
from identify.scene.values import EACH_LOG

Array = NDArray[np.float64]
POINT = {"drive_speed": Key("m/s", sign=NOT_NEGATIVE), "normal_force": Key("N", sign=POSITIVE)}


@dataclass(frozen=True)
class PairAtPoint:
    """One operating point, and how well it is known.

    site: model, every parameter [SI], drive speed [m/s], normal force [N] and the contact's nominal area under it;
    covariance (f, f) of `names` (parameters, "drive_speed") [SI], None where it is unknown; groups: of the log, by what
    the parameters of a fit differ by; untold: why the fit has no values for it, empty where it has; origins: where the
    values come from.
    """

    name: str
    site: Site
    covariance: Array | None
    names: tuple[str, ...]
    groups: Groups = ()
    untold: str = ""
    origins: Origins = field(default_factory=Origins)

    @property
    def title(self) -> str:
        """Its name, with its group where there are several."""
        return f"{self.name} ({named(self.groups)})" if self.groups else self.name

    @property
    def at(self) -> OperatingPoint:
        """The point as predictions take it."""
        return OperatingPoint(self.site.values, self.site.drive_speed, self.site.normal_force, self.covariance)

    @property
    def setting(self) -> dict[str, float]:
        """What the logs of a fit test."""
        at = {"drive_speed": self.site.drive_speed, "normal_force": self.site.normal_force}
        return at | {"stiffness": self.site.values["stiffness"]}


def operating_points(arguments: Namespace) -> tuple[list[PairAtPoint], Tested | None, Scene]:
    """One point per log, changed by --at; a drive speed given there makes it one point, of every group where parameters
    differ between groups. With the range of what the logs tested, None where there are none, and the scene.

    Raises:
        CommandLineError, SceneError, SimulationError, LogError: one sentence each.
    """
    result: Result | None = None
    if arguments.result:
        result = read_result(Path(arguments.result))
        if not result.converged:
            raise CommandLineError(f"{arguments.result}: this fit has no values ({result.status}); mend the fit first")
        source = scene_of(result, arguments.result)
    else:
        source = Scene.from_toml(arguments.scene)
    settled = _settled(source, result)
    for name in arguments.without:
        if name not in settled.model.effects:
            raise CommandLineError(
                f"--without names {name!r}, which is not among the effects of the scene; did you mean "
                f"{nearest(name, settled.model.effects)!r}?"
            )
    scene = settled
    if arguments.without:
        scene = settled.with_effects([name for name in settled.model.effects if name not in arguments.without])
    check_calculable(scene.model)
    changes = at_values(arguments.at, scene)
    points = _of_groups(arguments.group, _points(scene, changes, result))
    for values in (point.site.values for point in points if changes):
        static, slow, change = values["mu_s"], values["mu_k0"], values.get("delta_mu_k", 0.0)
        if not slow + change > 0.0 or not slow < static:
            raise CommandLineError(
                f"mu_k0 is {slow:g} here, with mu_s {static:g} and delta_mu_k {change:g}; expected mu_k0 below mu_s, "
                "and mu_k0 + delta_mu_k above 0: change --at"
            )
    same = len({(p.site.drive_speed, p.site.normal_force, p.groups, p.untold) for p in points}) == 1
    if len(points) > 1 and ("drive_speed" in changes or same):
        first = {point.groups: point for point in reversed(points) if not point.untold}
        points = [replace(point, name="the operating point") for point in reversed(first.values())] or points[:1]
    tested = None if result is None else Tested.of_result(result)
    if result is None and source.logs:
        tested = Tested.of(point.setting for point in _points(settled, {}, None))
    return points, tested, source


def points_of(scene: Scene, result: Result) -> list[PairAtPoint]:
    """The operating point of every log of a finished fit; several where a log has a programme of speeds."""
    return _points(_settled(scene, result), {}, result)


def _settled(scene: Scene, result: Result | None) -> Scene:
    """The scene with the effects that were chosen for a result, else by its numbers, where it left them open."""
    if scene.effects != "auto":
        return scene
    chosen = () if result is None else result.effects.names
    return scene.with_effects(chosen or choose_from_numbers(scene).effects)


def at_values(items: Sequence[str], scene: Scene) -> dict[str, float]:
    """ "drive_speed=1 mm/s" and the like as SI numbers by name.

    Raises:
        CommandLineError, SceneError: no KEY=VALUE, an unknown key, or a value that cannot be read or be.
    """
    declared = {p.name: p for p in scene.model.parameters}
    keys = POINT | {p.name: Key(p.unit) for p in declared.values()}
    values = {}
    for name, text in pairs(items, "--at", 'drive_speed="1 mm/s"').items():
        if name not in keys:
            raise CommandLineError(
                f"--at names {name!r}, which is not known; did you mean {nearest(name, keys)!r}? "
                f"Known are {', '.join(keys)}"
            )
        values[name] = quantity(text, keys[name].unit, f"--at {name}")
        if name in POINT:
            check(f"--at {name}", keys[name], values[name])
        elif not (p := declared[name]).lower <= values[name] <= p.upper:
            raise CommandLineError(
                f"--at {name} is {values[name]:g}; the model admits {p.lower:g} to {p.upper:g} {p.unit}".rstrip()
                + ": move it there"
            )
    return values


def _points(scene: Scene, changes: Mapping[str, float], result: Result | None) -> list[PairAtPoint]:
    parameters = {key: value for key, value in changes.items() if key not in POINT}
    declared = scene.model.parameter_names
    points = []
    for entry, place in _logs(scene, result):
        log = result.logs[place] if result and place is not None else LogResult()
        pair = pair_of(result, scene, place or 0) if result else Pair()
        names, covariance = pair.names, pair.covariance
        estimates = {key: value for key, value in pair.values.items() if key in declared}
        values = scene.values(entry) | estimates | parameters
        load = _normal_force(scene, entry, changes, log)
        for speed in _speeds(scene, entry, changes):
            scene.check_ranges(None, speed, [load], values)
            guessed = assumed(scene, values, (*changes, *pair.values))
            if result is None:
                known = stated(scene, values, speed) or ((), np.zeros((0, 0)))
                variances = np.append(np.diag(known[1]), np.square(list(guessed.values())))
                names, covariance = (*known[0], *guessed), np.diag(variances) if variances.size else None
                if covariance is not None:
                    names, covariance = with_tied(names, covariance, ties_of(scene))
            measured = tuple(n for n in declared if n in names and result is not None and n not in changes)
            kept = [i for i, n in enumerate(names) if n not in changes and (n in declared or n in POINT)]
            elsewhere = tuple(n for n in declared if n not in measured and n not in guessed)
            area, exponent = scene.contact.area_at(load), scene.contact.exponent or 0.0
            points.append(
                PairAtPoint(
                    name=entry.path.name if entry else "the rig of the scene",
                    site=Site(scene.model, values, speed, load, area, exponent),
                    covariance=covariance[np.ix_(kept, kept)] if covariance is not None and kept else None,
                    names=tuple(names[i] for i in kept),
                    groups=pair.groups,
                    untold=pair.untold,
                    origins=Origins(measured, elsewhere, tuple(guessed)),
                )
            )
    return points


def _logs(scene: Scene, result: Result | None) -> list[tuple[LogEntry | None, int | None]]:
    """The logs of a scene, and where a result has each: once, and once for each group where parts of it are of
    several. (None, None): the rig alone."""
    if result is None or not scene.logs:
        return [(entry, None) for entry in scene.logs or (None,)]
    out: list[tuple[LogEntry | None, int | None]] = []
    for number, entry in enumerate(scene.logs):
        first = {groups_of(result, place): place for place in reversed(result.places(number))}
        out += [(entry, place) for place in sorted(first.values())]
    return out


def _speeds(scene: Scene, entry: LogEntry | None, changes: Mapping[str, float]) -> list[float]:
    """The drive speeds [m/s] of a log: one, or those of its programme that move."""
    speed = changes.get("drive_speed", (scene.rig_for(entry) if entry else scene.rig).drive_speed)
    if speed is None:
        raise CommandLineError('the scene gives no drive speed; give one: --at drive_speed="1 mm/s"')
    speeds = [v for _, v in speed] if isinstance(speed, tuple) else [speed]
    moving = list(dict.fromkeys(abs(v) for v in speeds if v))
    if not moving:
        raise CommandLineError('the drive speed is zero; give one that moves: --at drive_speed="1 mm/s"')
    return moving


def _normal_force(scene: Scene, entry: LogEntry | None, changes: Mapping[str, float], log: LogResult) -> float:
    """The normal force [N] of a log: as asked, as fitted, as the scene says, else the median of the log itself."""
    rig = scene.rig_for(entry) if entry else scene.rig
    for force in (changes.get("normal_force"), log.normal_force_N, rig.normal_force):
        if force is not None:
            return float(force)
    if entry is None:
        raise CommandLineError('the scene gives no normal force; give one: --at normal_force="1 N"')
    from data_io import read_log
    from identify.logs.scene_records import unused

    left_out = unused(entry)
    record = read_log(
        entry.path, entry.step, entry.units, entry.columns, run=entry.run, rate=entry.rate, exclude=left_out
    )
    return float(np.nanmedian(record.normal_force))


# ----------------------------------------------------------------------------------------------------------------------
# Points of several groups.
# ----------------------------------------------------------------------------------------------------------------------


def _of_groups(wanted: Sequence[str], points: list[PairAtPoint]) -> list[PairAtPoint]:
    """The points of the groups that --group names, each as VALUE or LABEL=VALUE; all of them where it names none."""
    kept = points
    for item in wanted:
        kept = [p for p in kept if item in [t for per, value in p.groups for t in (value, f"{per}={value}")]]
    if kept:
        return kept
    known = _listed(points)
    raise CommandLineError(
        f"--group names {' and '.join(map(repr, wanted))}; the logs are of {known}: name one of these"
        if known
        else f"--group names {wanted[0]!r}, but no parameter differs between groups of logs here: leave it out"
    )


def one_pair(points: Sequence[PairAtPoint], option: str) -> list[PairAtPoint]:
    """The points that have values, for an option that shows a single pair.

    Raises:
        CommandLineError: points of several groups, or none with values.
    """
    kept = [p for p in points if not p.untold]
    if not kept:
        raise CommandLineError(f"{option} has nothing to show: {points[0].untold}")
    if len({p.groups for p in kept}) > 1:
        per, value = kept[0].groups[0]
        choice = f'--group "{value}"' if per == EACH_LOG else f'--group "{per}={value}"'
        raise CommandLineError(
            f"{option} shows one pair, and the parameters differ between {_listed(kept)}: choose one, as by {choice}"
        )
    return kept


def _listed(points: Sequence[PairAtPoint]) -> str:
    """The groups of these points in words, each once."""
    return "; ".join(dict.fromkeys(named(p.groups) for p in points if p.groups))
