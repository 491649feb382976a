"""What scenes and finished fits say of operating points: groups, several fits as one, tolerances, the tested range."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_io import read_log
from identify.base.errors import SceneError, SimulationError
from identify.base.result import Correlation, LogResult, Result
from identify.logs.scene_records import unused
from identify.model.model import RIG_PARAMETERS
from identify.prediction.axes import Site
from identify.prediction.wording import listed, shown
from identify.scene import LogEntry, Scene
from identify.scene.parts import default_spec
from identify.scene.values import EACH_LOG
from identify.simulation.drive import Drive

Array = NDArray[np.float64]

# How well an operating point is known where nothing was fitted: by the tolerances and priors its scene states.


def stated(scene: Scene, values: Mapping[str, float], drive_speed: float) -> dict[str, float]:
    """Standard deviations [SI] of what a scene says is not exact.

    Args:
        values: every parameter of the model at the operating point, SI. drive_speed: [m/s].

    The tolerances of the rig are relative standard deviations, that of the drive speed among them; a prior of a
    parameter is its standard deviation, in SI. They are independent.
    """
    size = {**values, "drive_speed": drive_speed}
    deviations = {name: share * abs(size[name]) for name, share in scene.rig.tolerances.items() if name in size}
    deviations |= {name: spec.prior_sd or 0.0 for name, spec in scene.parameters.items() if name in values}
    return {name: sd for name, sd in deviations.items() if sd > 0.0}


def assumed(scene: Scene, values: Mapping[str, float], given: Iterable[str] = ()) -> dict[str, float]:
    """Standard deviations [SI] of the parameters that nobody measured or stated: the spread that is documented of each.

    Args:
        values: every parameter of the model, SI. given: names that were stated elsewhere.
    """
    out = {}
    for p in scene.declared:
        spec = scene.parameters.get(p.name)
        fixed = p.kind == "rig" or p.name in given or (spec is not None and spec.states_value)
        if not fixed and p.name in values:
            out[p.name] = p.spread * (abs(values[p.name]) if p.scale == "log" else 1.0)
    return out


@dataclass(frozen=True)
class Origins:
    """Names of the parameters by where their values come from: logs, the scene or the command, the built-in values."""

    measured: tuple[str, ...] = ()
    stated: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """One line."""
        parts = [f"{kind}: {', '.join(names)}" for kind, names in vars(self).items() if names]
        usual = " (built-in values, over their usual ranges)" if self.assumed else ""
        line = "; ".join(parts)
        return f"{line[:1].upper()}{line[1:]}{usual}."


def existing_result(scene: Scene) -> Path | None:
    """The result of a fit of a scene where `fit` leaves it, beside the scene; None where there is none."""
    if scene.source is None:
        return None
    path = scene.source.parent / f"stickslip-{scene.name}" / "result.json"
    return path if path.is_file() else None


# The operating points of a log.


def scenes_at(scene: Scene, entry: LogEntry | None, log: LogResult, given: Mapping[str, float]) -> list[Scene]:
    """The scenes of a log's operating points, one for each speed of its drive: no logs, every parameter fixed at its
    value, drive speed and normal force under [rig].

    Args:
        entry: the log; None for the rig of the scene. log: what a result says of it, empty where there is none.
        given: parameters, drive_speed and normal_force [SI] in place of those of the scene.

    Raises:
        SceneError: values that no pair has, or nothing states the drive speed or the normal force.
    """
    rig, values = scene.rig_for(entry) if entry else scene.rig, {**scene.values(entry), **given}
    drive = given.get("drive_speed", rig.drive_speed or log.drive_speed_m_per_s or 0.0)
    loads = (given.get("normal_force"), log.normal_force_N, rig.normal_force)
    load = next((float(force) for force in loads if force is not None), None)
    speeds = dict.fromkeys(abs(speed) for _, speed in Drive.of(drive).paces if speed)
    if load is None and entry is not None and speeds:
        part = {"run": entry.run, "rate": entry.rate, "exclude": unused(entry)}
        record = read_log(entry.path, entry.step, entry.units, entry.columns, **part)  # type: ignore[arg-type]
        load = float(np.nanmedian(record.normal_force))
    for what, known, at in (("drive speed that moves", speeds, "drive_speed"), ("normal force", load, "normal_force")):
        if not known:
            raise SceneError(f"the scene states no {what}; give {at} under [rig] or at the operating point")
    fixed = {p.name: replace(default_spec(p), fixed=values[p.name]) for p in scene.declared if p.kind != "rig"}
    mass, stiffness, damping = (values.get(name, getattr(rig, name)) for name in RIG_PARAMETERS)
    rig = replace(rig, mass=mass, stiffness=stiffness, damping=damping, normal_force=load)
    return [replace(scene, rig=replace(rig, drive_speed=speed), parameters=fixed, logs=()) for speed in speeds]


def site_of(scene: Scene) -> Site:
    """The operating point that a scene states, such as those of `scenes_at`.

    Raises:
        SimulationError: it states none.
    """
    load, speed = scene.rig.normal_force, scene.rig.drive_speed
    if not isinstance(speed, float) or not speed or not load:
        raise SimulationError("the scene gives no single drive speed or no normal force; state both under [rig]")
    area, exponent = scene.contact.area_at(load), scene.contact.exponent or 0.0
    return Site(scene.model, scene.values(), abs(speed), load, area, exponent)


# Whose values hold for a log of a finished fit: those of its own group where parameters differ from group to group.

Groups = tuple[tuple[str, str], ...]
UNEVEN = (
    "the cycles of this pair differ, and no one friction pair describes them: their distributions hold at the drive "
    "speed, stiffness and load of the record alone"
)


@dataclass(frozen=True)
class Pair:
    """What a result says of one log's pair.

    groups: (label, value) of all that parameters differ by, (EACH_LOG, "log 2") of what every log has for itself;
    values [SI] by parameter; covariance (f, f) [SI] of `names`, variances infinite where something is not identifiable;
    refusal: why there are no values, empty where there are.
    """

    groups: Groups = ()
    values: Mapping[str, float] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    covariance: Array | None = None
    refusal: str = ""


def pair_of(result: Result, log: int) -> Pair:
    """The pair of a log of a result; `log` counts from 0."""
    groups = groups_of(result, log)
    if result.estimator == "uneven":
        return Pair(groups, refusal=UNEVEN)
    mine, entries = dict(groups), result.parameters
    own = {key: entry.parameter or key for key, entry in entries.items()}
    keys = {own[key]: key for key, entry in entries.items() if not entry.per or entry.group == mine[entry.per]}
    missing = [name for name in dict.fromkeys(own.values()) if name not in keys]
    if missing:
        known = [entry for key, entry in entries.items() if own[key] == missing[0]]
        others, group = ", ".join(entry.group for entry in known), mine.get(known[0].per, "") or "no such group"
        refusal = f"this fit has {missing[0]} of {others} only, and this log is of {group}"
        return Pair(groups, refusal=f"{refusal}; fit it again with a log of this group that takes part")
    values = {name: value for name, key in keys.items() if (value := entries[key].value) is not None}
    return Pair(groups, values, *_covariance(result, keys))


def groups_of(result: Result, log: int) -> Groups:
    """Which group a log (from 0) of a result belongs to, by everything that its parameters differ by."""
    labels = result.logs[log].labels
    every = dict.fromkeys(entry.per for entry in result.parameters.values() if entry.per)
    return tuple((per, f"log {log + 1}" if per == EACH_LOG else labels.get(per, "")) for per in every)


def named(groups: Groups) -> str:
    """A group in words: "volunteer V08", "log 2"."""
    return ", ".join(value if per == EACH_LOG else f"{per} {value}" for per, value in groups)


def _covariance(result: Result, keys: Mapping[str, str]) -> tuple[tuple[str, ...], Array | None]:
    """Names and covariance [SI] of what was estimated of a pair; variances are infinite without a standard error."""
    known = result.correlation or Correlation()
    names = tuple(name for name, key in keys.items() if key in known.names)
    if not names:
        return (), None
    open_ = np.array([result.parameters[keys[name]].standard_error is None for name in names])
    places = [known.names.index(keys[name]) for name in names]
    errors = known.standard_errors or [result.parameters[name].standard_error for name in known.names]
    sd = np.array([errors[i] for i in places], dtype=float)
    matrix = np.outer(sd, sd) * np.array(known.matrix, dtype=float)[np.ix_(places, places)]
    matrix[open_, :] = matrix[:, open_] = 0.0
    matrix[open_, open_] = np.inf
    return (names, matrix) if not np.any(np.isnan(matrix)) else ((), None)


# The range of speed, load and stiffness in which a pair was tested: what lies outside is extrapolated.

SLACK = 1.1  # beyond the range by this factor still counts as inside
UNITS = {"drive_speed": "m/s", "normal_force": "N", "stiffness": "N/m"}


@dataclass(frozen=True)
class Tested:
    """Lowest and highest value [SI] by name (UNITS); a name that is absent was not tested at any known value."""

    ranges: Mapping[str, tuple[float, float]]

    @staticmethod
    def of(points: Iterable[Mapping[str, float]]) -> Tested:
        """The range of tests, each given by its values."""
        given = list(points)
        seen = {name: [abs(p[name]) for p in given if name in p] for name in UNITS}
        return Tested({name: (min(values), max(values)) for name, values in seen.items() if values})

    @staticmethod
    def of_result(result: Result) -> Tested:
        """The range of the logs that took part in a finished fit."""
        scene, points = Scene.from_document(result.scene), []
        for number, log in zip(result.numbers, result.logs, strict=True):
            rig = scene.rig_for(scene.logs[number]) if number < len(scene.logs) else scene.rig
            values = log.drive_speed_m_per_s, log.normal_force_N, rig.stiffness
            if not log.reason_left_out:
                points.append({name: value for name, value in zip(UNITS, values, strict=True) if value})
        return Tested.of(points)

    def beyond(self, values: Mapping[str, float]) -> str:
        """A sentence on what of these values [SI] was not tested; "" where all of it was."""
        out = []
        for name, (low, high) in self.ranges.items():
            if name in values and self.extrapolated(name, values[name]):
                ends = " to ".join(dict.fromkeys(shown(end, UNITS[name]) for end in (low, high)))
                out.append(f"a {name.replace('_', ' ')} of {shown(abs(values[name]), UNITS[name])} ({ends} tested)")
        return f"Extrapolated: the logs did not test {listed(out)}." if out else ""

    def reach(self, name: str) -> tuple[float, float] | None:
        """From where to where a quantity counts as tested [SI]; None for what no test is about, or was never known."""
        low, high = self.ranges.get(name, (np.nan, np.nan))
        return (low / SLACK, high * SLACK) if high > 0.0 else None

    def extrapolated(self, name: str, value: float) -> bool:
        """Whether a value [SI] lies outside the tested range by more than a tenth; False for what is no such name."""
        low, high = self.reach(name) or (np.inf, np.inf)
        return name in UNITS and not low <= abs(value) <= high
