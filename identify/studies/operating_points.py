"""What each group does at the common operating points: the nonlinear model at the means of the group.

Intervals carry the covariance of the mean parameters, widened as Student's t asks for few people.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from identify.base.errors import IdentifyError
from identify.base.quantiles import LEVEL, NORMAL, student
from identify.model.model import RIG_PARAMETERS
from identify.prediction.draws import DRAWS, OperatingPoint
from identify.prediction.predict import NoAnswer, PointPrediction, predictions
from identify.scene import Scene
from identify.studies.compare import CompareError, Comparison
from identify.studies.pooled import joint

if TYPE_CHECKING:
    from identify.model.model import Model

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
class GroupAnswer:
    """What a group does at every common drive speed; `reason` says why where there is no answer."""

    group: str
    at: tuple[PointPrediction | NoAnswer, ...] = ()
    reason: str = ""


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
    scenes = []
    for entry in alike:
        with suppress(IdentifyError, KeyError, TypeError, ValueError):  # one that cannot be read counts for nothing
            scenes.append(Scene.from_document(entry.result.scene).with_effects(effects))
    if not scenes or not effects:
        raise CompareError("no fit has the scene it was made with; expected provenance in result.json: fit again")
    tables = [scene.values(scene.logs[0] if scene.logs else None) for scene in scenes]
    columns = {name: np.array([float(table[name]) for table in tables]) for name in tables[0]}
    logs = [log for entry in alike for log in entry.fitted_logs]
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
        others=tuple(entry.name for entry in entries if entry.result.effects.names != effects),
    )


def group_answers(comparison: Comparison, ground: Common) -> tuple[GroupAnswer, ...]:
    """The answers of every group, in natural order; the first MOST_GROUPS of them are calculated."""
    tables = [entry.result.parameters for entry in comparison.selected.entries]
    searched = {name for table in tables for name in table} & {*ground.model.parameter_names}
    fixed = {n for n in searched if {table[n].verdict for table in tables if n in table} == {"fixed"}}
    pooled = {name: comparison.answered.get(name) for name in searched - fixed}
    out = []
    for place, group in enumerate(comparison.groups):
        missing = sorted(name for name, q in pooled.items() if q is None or group not in q.groups)
        reason = f"no mean of {', '.join(missing)}: its fits do not determine it" if missing else ""
        reason = reason if place < MOST_GROUPS else f"only the first {MOST_GROUPS} groups are calculated"
        out.append(GroupAnswer(group, (), reason) if reason else _answer(comparison, ground, group))
    return tuple(out)


def _answer(comparison: Comparison, ground: Common, group: str) -> GroupAnswer:
    """The model at the means of a group, with the covariance (m, m) [SI] of these."""
    quantities = {q.name: q for q in comparison.values.quantities}
    names = [name for name in comparison.answered if name in ground.model.parameter_names]
    pooled = [comparison.answered[name] for name in names]
    means = [p.mean_of(group) for p in pooled]
    shown = {name: quantities[name].shown(mean.value) for name, mean in zip(names, means, strict=True)}
    slope = np.array([shown[name] if quantities[name].logarithmic else 1.0 for name in names])
    df = np.maximum([mean.df for mean in means], LEAST_DF)
    scale = slope * student(0.5 + LEVEL / 2, df) / NORMAL
    covariance, values = joint(pooled, group) * np.outer(scale, scale), {**ground.values, **shown}
    points = [OperatingPoint(values, speed, ground.normal_force, covariance) for speed in ground.speeds]
    answers = predictions(ground.model, points, tuple(names), DRAWS)
    failed = next((each.text for each in answers if isinstance(each, NoAnswer)), "")
    every = all(isinstance(each, NoAnswer) for each in answers)
    return GroupAnswer(group, () if every else tuple(answers), failed if every else "")
