"""What each group does at the common operating points: stick-slip, its probability and size, the way to its end.

The nonlinear model is evaluated at the means. Intervals of the mean carry the covariance of the mean parameters,
widened as Student's t asks for few people; what one more run of one more person would do carries the scatter between
people and runs as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import IdentifyError
from identify.base.quantiles import LEVEL, NORMAL, student, student_below
from identify.base.result import Number
from identify.model.model import RIG_PARAMETERS
from identify.prediction.draws import DRAWS, OperatingPoint
from identify.prediction.point_prediction import NoAnswer, PointPrediction
from identify.prediction.predict import predictions
from identify.scene import Scene
from identify.simulation.sliding import slidings
from identify.studies.compare import Comparison
from identify.studies.fits import FitEntry
from identify.studies.labels import CompareError
from identify.studies.pooled import joint

if TYPE_CHECKING:
    from identify.model.model import Model

# ----------------------------------------------------------------------------------------------------------------------
# Where groups are compared: drive speeds and normal force that the fits have in common, rig and model of the fits.
# ----------------------------------------------------------------------------------------------------------------------

MOST_SPEEDS = 4  # those that most logs have
DIGITS = 3
UNLIKE = 0.02  # of a rig quantity


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


def common(comparison: Comparison, speeds: Sequence[float] = (), normal_force: float | None = None) -> Common:
    """The common operating points of a comparison; speeds [m/s] and normal force [N] as asked, else from the logs.

    Raises:
        CompareError: no fit says enough of its rig.
    """
    entries = comparison.taken.entries
    effects = Counter(effects_of(entry) for entry in entries).most_common(1)[0][0]
    alike = [entry for entry in entries if effects_of(entry) == effects]
    once = {entry.folder: entry for entry in alike}.values()  # a fit of several parts has one scene
    scenes = [found for entry in once if (found := scene_of(entry, effects)) is not None]
    if not scenes or not effects:
        raise CompareError("no fit tells the scene it was made with; expected provenance in result.json: fit again")
    tables = [scene.values(scene.logs[0] if scene.logs else None) for scene in scenes]
    known = [name for name in tables[0] if all(table.get(name) is not None for table in tables)]
    columns = {name: np.array([float(table[name]) for table in tables]) for name in known}
    logs = list({id(log): log for entry in alike for log in entry.taken}.values())
    loads = [log.normal_force_N for log in logs if log.normal_force_N is not None]
    load = normal_force or (float(np.median(loads)) if loads else None)
    rounded = [float(f"{abs(v):.{DIGITS}g}") for v in (log.drive_speed_m_per_s for log in logs) if v]
    usual = sorted(speed for speed, _ in Counter(rounded).most_common(MOST_SPEEDS))
    chosen = tuple(speeds) or tuple(usual)
    if load is None or not chosen:
        raise CompareError("the fits tell no normal force or no drive speed; give them: --load and --speeds")
    return Common(
        model=scenes[0].model,
        values={name: float(np.median(column)) for name, column in columns.items()},
        speeds=chosen,
        normal_force=float(load),
        spread=tuple(n for n, c in columns.items() if n in RIG_PARAMETERS and np.ptp(c) > UNLIKE * np.max(np.abs(c))),
        others=tuple(dict.fromkeys(entry.whole for entry in entries if effects_of(entry) != effects)),
    )


def effects_of(entry: FitEntry) -> tuple[str, ...]:
    """The effects a fit was made with."""
    return entry.result.effects.names


def scene_of(entry: FitEntry, effects: tuple[str, ...]) -> Scene | None:
    """The scene of a fit with its effects settled; None where it cannot be read."""
    try:
        scene = Scene.from_document(entry.result.scene)
        return scene.with_effects(effects) if scene.effects != effects else scene
    except (IdentifyError, KeyError, TypeError, ValueError):
        return None


Array = NDArray[np.float64]

MOST_GROUPS = 12
LEAST_DF = 1.0
CURVE_POINTS = 41
AMPLITUDE_POINTS = 15
CURVE_DRAWS = 100  # for the bands of a curve
STEP = 1e-5


@dataclass(frozen=True)
class Figure:
    """One number of a group: value in SI, interval of the mean and interval of 95 % of people and runs (None: open
    or none), and what there is to say."""

    value: float | None
    interval: tuple[float, float] | None = None
    people: tuple[float, float] | None = None
    reason: str = ""


@dataclass(frozen=True)
class AtSpeed:
    """A group at one drive speed [m/s]: outcome in words of the model, fall of the force from peak to valley [N],
    period [s], probability that one more run of one more person sticks and slips, and drive speed at which stick-slip
    ends over this one."""

    speed: float
    outcome: str
    fall: Figure
    period: Figure
    probability: float | None
    margin: Figure


@dataclass(frozen=True)
class SpeedCurve:
    """A curve over drive speed [m/s] with the band of its mean and the band of people and runs, NaN where none."""

    speed: Array
    value: Array
    low: Array
    high: Array
    people_low: Array
    people_high: Array


@dataclass(frozen=True)
class GroupAnswer:
    """What a group does; `reason` says why where there is no answer."""

    group: str
    critical_speed: Figure
    at: tuple[AtSpeed, ...]
    friction: SpeedCurve | None
    amplitude: SpeedCurve | None
    reason: str = ""


NOTHING, NO_NUMBER = Figure(None), Number(None)


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


def group_answers(comparison: Comparison, ground: Common) -> tuple[GroupAnswer, ...]:
    """The answers of every group, in natural order; the first MOST_GROUPS of them are calculated."""
    names = [name for name in comparison.answered if name in ground.model.parameter_names]
    out = []
    for place, group in enumerate(comparison.groups):
        reason = "" if place < MOST_GROUPS else f"only the first {MOST_GROUPS} groups are calculated"
        reason = reason or _lacking(comparison, ground, group, names)
        if reason or not names:
            out.append(GroupAnswer(group, NOTHING, (), None, None, reason))
            continue
        out.append(_answer(comparison, ground, group, names))
    return tuple(out)


def _lacking(comparison: Comparison, ground: Common, group: str, names: Sequence[str]) -> str:
    """Why a group has no answer: parameters of the model that its fits neither tell nor fix, or that its fits tell and
    nobody could pool."""
    missing = [name for name in names if group not in comparison.answered[name].groups]
    entries = comparison.taken.entries
    tried = {name for entry in entries for name in (*entry.result.parameters, *entry.elsewhere)}
    verdicts = {n: {p.verdict for e in entries if (p := e.result.parameters.get(n)) is not None} for n in tried}
    lost = [n for n in tried if n in ground.values and n not in names and verdicts[n] != {"fixed"}]
    lost = [n for n in lost if n in ground.model.parameter_names]
    reasons = {q.quantity.name: q.reason for q in comparison.quantities if q.pooled is None}
    mine = [i for i, g in enumerate(comparison.taken.setting.group) if g == group]
    by, common = comparison.question.by, {name for i in mine for name in entries[i].elsewhere}
    some = np.any(np.isfinite(comparison.values.y[mine]), axis=0)
    told = {q.name for q, any_ in zip(comparison.values.quantities, some, strict=True) if any_}
    apart: dict[str, list[str]] = {}
    for name in sorted(set(missing + lost)):
        why = reasons.get(name) if name in told else None
        why = why or (f"its fits tell one value for several {by}s" if name in common else "")
        apart.setdefault(why, []).append(name)
    sentences = [
        f"{', '.join(found)} {'is' if len(found) == 1 else 'are'} not pooled: {why}"
        if why
        else f"its fits do not tell {', '.join(found)}"
        for why, found in apart.items()
    ]
    return "; ".join(sentences)


@dataclass(frozen=True)
class _Spreads:
    """Values [SI] of a group and the covariances (m, m) [SI] of its mean and of one more person's run."""

    values: dict[str, float]
    names: tuple[str, ...]
    mean: Array
    people: Array
    df: float


def _spreads(comparison: Comparison, ground: Common, group: str, names: Sequence[str]) -> _Spreads:
    quantities = {q.name: q for q in comparison.values.quantities}
    pooled = [comparison.answered[name] for name in names]
    values = dict(ground.values)
    slope = np.ones(len(names))
    for k, name in enumerate(names):
        values[name] = quantities[name].shown(pooled[k].mean_of(group).value)
        slope[k] = values[name] if quantities[name].logarithmic else 1.0
    of_mean, of_further = joint(pooled, group)
    further_df = np.maximum([p.further_df for p in pooled], LEAST_DF)
    wide = slope * student(0.5 + LEVEL / 2, np.maximum([p.mean_of(group).df for p in pooled], LEAST_DF)) / NORMAL
    further = slope * student(0.5 + LEVEL / 2, further_df) / NORMAL
    mean, people = of_mean * np.outer(wide, wide), of_further * np.outer(further, further)
    return _Spreads(values, tuple(names), mean, people, float(np.min(further_df)))


def _answer(comparison: Comparison, ground: Common, group: str, names: Sequence[str]) -> GroupAnswer:
    spreads = _spreads(comparison, ground, group, names)
    # the curve of amplitudes: a decade around the common drive speeds
    curve = np.geomspace(min(ground.speeds) / 3.0, max(ground.speeds) * 10.0, AMPLITUDE_POINTS).tolist()
    mean, people = (
        [
            *_ask(ground, spreads, ground.speeds, covariance, DRAWS),
            *_ask(ground, spreads, curve, covariance, CURVE_DRAWS),
        ]
        for covariance in (spreads.mean, spreads.people)
    )
    here, ahead = mean[0], people[0]
    if isinstance(here, NoAnswer):
        return GroupAnswer(group, NOTHING, (), _friction(ground, spreads), None, here.text)
    spread = NO_NUMBER if isinstance(ahead, NoAnswer) else ahead.stability.critical_speed
    critical = _figure(here.stability.critical_speed, spread)
    count = len(ground.speeds)
    at = tuple(
        _at(speed, m, p, spreads.df) for speed, m, p in zip(ground.speeds, mean[:count], people[:count], strict=True)
    )
    amplitude = _amplitude(curve, mean[count:], people[count:])
    return GroupAnswer(group, critical, at, _friction(ground, spreads), amplitude)


def _ask(
    ground: Common, spreads: _Spreads, speeds: Sequence[float], covariance: Array, draws: int
) -> list[PointPrediction | NoAnswer]:
    points = [OperatingPoint(spreads.values, speed, ground.normal_force, covariance) for speed in speeds]
    return predictions(ground.model, points, spreads.names, draws)


def _pair(entry: Number) -> tuple[float, float] | None:
    low, high = entry.ends
    return None if low is None or high is None else (low, high)


def _figure(mean: Number, people: Number) -> Figure:
    reason = mean.reason or (mean.validity if mean.value is None else "")
    return Figure(mean.value, _pair(mean), _pair(people), reason)


def _at(speed: float, mean: PointPrediction | NoAnswer, people: PointPrediction | NoAnswer, df: float) -> AtSpeed:
    if isinstance(mean, NoAnswer) or isinstance(people, NoAnswer):
        return AtSpeed(speed, mean.text if isinstance(mean, NoAnswer) else "no answer", NOTHING, NOTHING, None, NOTHING)
    end, spread = mean.stability.critical_speed, people.stability.critical_speed
    limit, margin = end.value, NOTHING
    if limit is not None:
        scaled = [None if pair is None else (pair[0] / speed, pair[1] / speed) for pair in (_pair(end), _pair(spread))]
        margin = Figure(limit / speed, scaled[0], scaled[1])
    jump, further = mean.amplitude.numbers, people.amplitude.numbers
    return AtSpeed(
        speed,
        mean.stability.outcome,
        _figure(jump["peak_to_valley"], further["peak_to_valley"]),
        _figure(jump["period"], further["period"]),
        probability(speed, limit, _pair(spread), df),
        margin,
    )


def probability(speed: float, limit: float | None, people: tuple[float, float] | None, df: float) -> float | None:
    """That the drive speed at which stick-slip ends lies above `speed` for one more run of one more person.

    `people`: its 95 % interval over people and runs; the logarithm follows Student's t. None without an interval.
    """
    if limit is None or people is None or not 0.0 < people[0] < people[1]:
        return None
    half = 0.5 * float(np.log(people[1] / people[0]))
    quantile = float(student(0.5 + LEVEL / 2, df))
    return student_below(quantile * float(np.log(limit / speed)) / half, df)


def _amplitude(
    speeds: Sequence[float],
    mean: Sequence[PointPrediction | NoAnswer],
    people: Sequence[PointPrediction | NoAnswer],
) -> SpeedCurve:
    rows = []
    for m, p in zip(mean, people, strict=True):
        if isinstance(m, NoAnswer) or isinstance(p, NoAnswer):
            rows.append([np.nan] * 5)
            continue
        figure = _figure(m.amplitude.numbers["peak_to_valley"], p.amplitude.numbers["peak_to_valley"])
        rows.append([figure.value or np.nan, *(figure.interval or [np.nan] * 2), *(figure.people or [np.nan] * 2)])
    return SpeedCurve(np.array(speeds), *np.array(rows, dtype=float).T)


def _friction(ground: Common, spreads: _Spreads) -> SpeedCurve:
    """Friction coefficient of steady sliding over drive speed."""
    low, high = min(ground.speeds) / 30.0, max(ground.speeds) * 30.0
    speeds = np.geomspace(low, high, CURVE_POINTS)
    names = ground.model.parameter_names
    p = np.array([spreads.values[name] for name in names])
    places = [names.index(name) for name in spreads.names]
    steps = STEP * np.where(p[places] == 0.0, 1e-3, np.abs(p[places]))
    moved = np.repeat(p[None, :], 1 + 2 * len(places), axis=0)
    for k, place in enumerate(places):
        moved[1 + 2 * k, place] += steps[k]
        moved[2 + 2 * k, place] -= steps[k]
    everything = np.repeat(moved, len(speeds), axis=0)
    points = np.column_stack([np.full(len(everything), ground.normal_force), np.tile(speeds, len(moved))])
    found = slidings(ground.model, np.append(everything, points, axis=1))
    mu = np.array([s.force for s in found]).reshape(len(moved), len(speeds)) / ground.normal_force
    slopes = (mu[1::2] - mu[2::2]) / (2.0 * steps[:, None])
    bands = [NORMAL * np.sqrt(np.einsum("kv,kl,lv->v", slopes, C, slopes)) for C in (spreads.mean, spreads.people)]
    return SpeedCurve(speeds, mu[0], mu[0] - bands[0], mu[0] + bands[0], mu[0] - bands[1], mu[0] + bands[1])
