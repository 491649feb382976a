"""What each group does at the common operating points: stick-slip, its probability and size, the way to its end.

The nonlinear model is evaluated at the means. Intervals of the mean carry the covariance of the mean parameters,
widened as Student's t asks for few people; what one more run of one more person would do carries the scatter between
people and runs as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import IdentifyError
from identify.base.quantiles import LEVEL, NORMAL, student, student_below
from identify.base.result import Number
from identify.model.model import RIG_PARAMETERS
from identify.prediction.draws import DRAWS, OperatingPoint
from identify.prediction.predict import NoAnswer, PointPrediction, predictions
from identify.scene import Scene
from identify.studies.compare import CompareError, Comparison
from identify.studies.pooled import joint

if TYPE_CHECKING:
    from identify.model.model import Model

Array = NDArray[np.float64]
Pair = tuple[float, float]

MOST_SPEEDS = 4  # those that most logs have
DIGITS = 3
UNLIKE = 0.02  # of a rig quantity
MOST_GROUPS = 12
LEAST_DF = 1.0


@dataclass(frozen=True)
class Common:
    """The common ground: model of most fits, rig and other parameters [SI] (median of the fits), drive speeds [m/s]
    and normal force [N]; spread: rig quantities that differ by more than 2 % between fits; others: fits with other
    effects."""

    model: Model
    values: Mapping[str, float]
    speeds: tuple[float, ...]
    normal_force: float
    spread: tuple[str, ...]
    others: tuple[str, ...]


@dataclass(frozen=True)
class Figure:
    """One number of a group: value in SI, interval of the mean and interval of 95 % of people and runs (None: open
    or none), and why where there is none."""

    value: float | None
    interval: Pair | None = None
    people: Pair | None = None
    reason: str = ""


@dataclass(frozen=True)
class AtSpeed:
    """A group at one drive speed [m/s]: outcome in words of the model, fall of the force from peak to valley [N],
    period [s], probability that one more run of one more person sticks and slips."""

    speed: float
    outcome: str
    fall: Figure
    period: Figure
    probability: float | None


@dataclass(frozen=True)
class GroupAnswer:
    """What a group does; `reason` says why where there is no answer."""

    group: str
    critical_speed: Figure
    at: tuple[AtSpeed, ...]
    reason: str = ""


NOTHING = Figure(None)


@dataclass(frozen=True)
class Answers:
    """What follows at common operating points: the ground they stand on, the answers, and why there are none."""

    ground: Common | None
    groups: tuple[GroupAnswer, ...]
    reason: str = ""


def answered(comparison: Comparison, speeds: Sequence[float] = (), normal_force: float | None = None) -> Answers:
    """The answers of the nonlinear model of every group at common points; a reason where there are none."""
    try:
        ground = common(comparison, speeds, normal_force)
        return Answers(ground, group_answers(comparison, ground))
    except IdentifyError as error:
        return Answers(None, (), str(error))


def common(comparison: Comparison, speeds: Sequence[float] = (), normal_force: float | None = None) -> Common:
    """The common operating points of a comparison; speeds [m/s] and normal force [N] as given, else from the logs.

    Raises:
        CompareError: no fit states enough of its rig.
    """
    entries = comparison.selected.entries
    effects = Counter(entry.result.effects.names for entry in entries).most_common(1)[0][0]
    alike = [entry for entry in entries if entry.result.effects.names == effects]
    once = {entry.folder: entry for entry in alike}.values()  # a fit of several parts has one scene
    scenes = []
    for entry in once:
        with suppress(IdentifyError, KeyError, TypeError, ValueError):  # one that cannot be read counts for nothing
            scenes.append(Scene.from_document(entry.result.scene).with_effects(effects))
    if not scenes or not effects:
        raise CompareError("no fit has the scene it was made with; expected provenance in result.json: fit again")
    tables = [scene.values(scene.logs[0] if scene.logs else None) for scene in scenes]
    known = [name for name in tables[0] if all(table.get(name) is not None for table in tables)]
    columns = {name: np.array([float(table[name]) for table in tables]) for name in known}
    logs = list({id(log): log for entry in alike for log in entry.fitted_logs}.values())
    loads = [log.normal_force_N for log in logs if log.normal_force_N is not None]
    load = normal_force or (float(np.median(loads)) if loads else None)
    rounded = [float(f"{abs(v):.{DIGITS}g}") for v in (log.drive_speed_m_per_s for log in logs) if v]
    chosen = tuple(speeds) or tuple(sorted(speed for speed, _ in Counter(rounded).most_common(MOST_SPEEDS)))
    if load is None or not chosen:
        raise CompareError("the fits have no normal force or no drive speed; give them: --load and --speeds")
    return Common(
        model=scenes[0].model,
        values={name: float(np.median(column)) for name, column in columns.items()},
        speeds=chosen,
        normal_force=float(load),
        spread=tuple(n for n, c in columns.items() if n in RIG_PARAMETERS and np.ptp(c) > UNLIKE * np.max(np.abs(c))),
        others=tuple(dict.fromkeys(entry.whole for entry in entries if entry.result.effects.names != effects)),
    )


def group_answers(comparison: Comparison, ground: Common) -> tuple[GroupAnswer, ...]:
    """The answers of every group, in natural order; the first MOST_GROUPS of them are calculated."""
    names = [name for name in comparison.answered if name in ground.model.parameter_names]
    out = []
    for place, group in enumerate(comparison.groups):
        reason = "" if place < MOST_GROUPS else f"only the first {MOST_GROUPS} groups are calculated"
        reason = reason or _lacking(comparison, ground, group, names)
        answer = GroupAnswer(group, NOTHING, (), reason)
        out.append(answer if reason or not names else _answer(comparison, ground, group, names))
    return tuple(out)


def _lacking(comparison: Comparison, ground: Common, group: str, names: Sequence[str]) -> str:
    """Why a group has no answer: parameters of the model that its fits neither determine nor fix."""
    missing = {name for name in names if group not in comparison.answered[name].groups}
    entries = comparison.selected.entries
    searched = {name for entry in entries for name in (*entry.result.parameters, *entry.elsewhere)}
    for name in searched & set(ground.values) & set(ground.model.parameter_names) - set(names):
        if {p.verdict for e in entries if (p := e.result.parameters.get(name)) is not None} != {"fixed"}:
            missing.add(name)
    why_not = {q.quantity.name: q.reason for q in comparison.quantities if q.pooled is None}
    mine = [i for i, g in enumerate(comparison.selected.setting.group) if g == group]
    shared = {name for i in mine for name in entries[i].elsewhere}
    known = np.any(np.isfinite(comparison.values.y[mine]), axis=0)
    with_value = {q.name for q, any_ in zip(comparison.values.quantities, known, strict=True) if any_}
    by_reason: dict[str, list[str]] = {}
    for name in sorted(missing):
        reason = why_not.get(name, "") if name in with_value else ""
        if not reason:
            several = f"its fits have one value for several {comparison.question.by}s"
            reason = several if name in shared else "its fits do not determine it"
        by_reason.setdefault(reason, []).append(name)
    return "; ".join(f"no mean of {', '.join(listed)}: {reason}" for reason, listed in by_reason.items())


def _answer(comparison: Comparison, ground: Common, group: str, names: Sequence[str]) -> GroupAnswer:
    """The model at the means of a group, with the covariances (m, m) [SI] of its mean and of one more person's run."""
    quantities = {q.name: q for q in comparison.values.quantities}
    pooled = [comparison.answered[name] for name in names]
    means = [p.mean_of(group) for p in pooled]
    shown = {name: quantities[name].shown(mean.value) for name, mean in zip(names, means, strict=True)}
    values = {**ground.values, **shown}
    slope = np.array([shown[name] if quantities[name].logarithmic else 1.0 for name in names])
    further_df = np.maximum([p.further_df for p in pooled], LEAST_DF)
    ends = []
    for covariance, df in zip(joint(pooled, group), (np.array([m.df for m in means]), further_df), strict=True):
        scale = slope * student(0.5 + LEVEL / 2, np.maximum(df, LEAST_DF)) / NORMAL
        points = [
            OperatingPoint(values, speed, ground.normal_force, covariance * np.outer(scale, scale))
            for speed in ground.speeds
        ]
        ends.append(predictions(ground.model, points, tuple(names), DRAWS))
    mean, people = ends
    if isinstance(mean[0], NoAnswer):
        return GroupAnswer(group, NOTHING, (), mean[0].text)
    spread = Number(None) if isinstance(people[0], NoAnswer) else people[0].stability.critical_speed
    df = float(np.min(further_df))
    at = tuple(_at(speed, m, p, df) for speed, m, p in zip(ground.speeds, mean, people, strict=True))
    return GroupAnswer(group, _figure(mean[0].stability.critical_speed, spread), at)


def _figure(mean: Number, people: Number) -> Figure:
    reason = mean.reason or (mean.validity if mean.value is None else "")
    return Figure(mean.value, _closed(mean), _closed(people), reason)


def _closed(entry: Number) -> Pair | None:
    low, high = entry.ends
    return None if low is None or high is None else (low, high)


def _at(speed: float, mean: PointPrediction | NoAnswer, people: PointPrediction | NoAnswer, df: float) -> AtSpeed:
    if isinstance(mean, NoAnswer) or isinstance(people, NoAnswer):
        return AtSpeed(speed, mean.text if isinstance(mean, NoAnswer) else "no answer", NOTHING, NOTHING, None)
    own, others = mean.amplitude.numbers, people.amplitude.numbers
    fall, period = (_figure(own[name], others[name]) for name in ("peak_to_valley", "period"))
    limit, spread = mean.stability.critical_speed.value, _closed(people.stability.critical_speed)
    return AtSpeed(speed, mean.stability.outcome, fall, period, probability(speed, limit, spread, df))


def probability(speed: float, limit: float | None, people: Pair | None, df: float) -> float | None:
    """That the drive speed at which stick-slip ends lies above `speed` for one more run of one more person.

    `people`: its 95 % interval over people and runs; the logarithm follows Student's t. None without an interval.
    """
    if limit is None or people is None or not 0.0 < people[0] < people[1]:
        return None
    half = 0.5 * float(np.log(people[1] / people[0]))
    quantile = float(student(0.5 + LEVEL / 2, df))
    return student_below(quantile * float(np.log(limit / speed)) / half, df)
