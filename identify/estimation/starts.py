"""Where a search starts: thetas from the features of the logs, from the user's values, and drawn about both; and what
the first of them shows over the data (the preview of a fit)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.base.budget import stage
from identify.base.errors import FitError
from identify.estimation.attempt import HORIZONS, as_far_as_placed, place_on
from identify.estimation.fit_wording import prefit_warnings, wrong_unit
from identify.logs.prepare import Prepared, beginning
from identify.logs.scene_records import prepare_scene
from identify.logs.unknowns import Unknowns, user_start
from identify.logs.vibration import quieted
from identify.scene import Scene
from identify.shooting.layout import COARSE_GRID
from identify.shooting.placing import place
from identify.shooting.shooting import shooting_problem
from identify.shooting.starts import (
    GOOD,
    Features,
    Start,
    candidates,
    extract,
    fit_features,
    level_starts,
    random_starts,
)

Array = NDArray[np.float64]
Sources = Literal["data", "user", "both"]

DRAWN = 96  # random starts, where the data's own do not fit the features
SAME = 0.02  # of the spread: starts closer than that are one
MISSING = 1e6  # cost per residual of a log on which a start cannot be placed


def starts_of(
    prepared: list[Prepared],
    unknowns: Unknowns,
    sources: Sources = "data",
    *,
    seed: int | None = None,
    worst: float = np.inf,
) -> Iterator[Array]:
    """Starts (n_p,) in the order in which they deserve a solve.

    Args:
        sources: the data, the values of the user (unknowns.start) before those of the data, or both as one.
        seed: of random starts, which are drawn where the others are not good; None draws none.
        worst: cost per residual of one cycle beyond which a start is left out.
    """
    own = unknowns.start[None, :]
    with stage("start"):
        features, bases = features_of(prepared)
        made = level_starts(prepared, unknowns) if not features else candidates(unknowns, features, bases)

        def ordered(tried: Array) -> list[Start]:
            if not features:
                return _by_motion(prepared, unknowns, tried)
            starts = fit_features(quieted(unknowns), features, bases, tried)
            if seed is not None and starts[0].cost >= (GOOD if np.isinf(worst) else worst):
                half = random_starts(unknowns, starts[0].theta, DRAWN // 2, seed)
                more = np.concatenate([half, random_starts(unknowns, tried[0], DRAWN // 2, seed + 1)])
                starts = sorted(starts + fit_features(quieted(unknowns), features, bases, more), key=_cost)
            # What is explicit in time was held still: it starts where the sticks say, and keeps what the scene fixes.
            free = quieted(unknowns).free
            return [replace(s, theta=np.where(free, s.theta, unknowns.start)) for s in starts if s.cost <= worst]

        if sources == "user":
            starts = [*ordered(own), *ordered(made)]
        else:
            starts = ordered(made if sources == "data" else np.concatenate([own, made]))
    yield from apart((start.theta for start in starts), np.where(unknowns.free, SAME * unknowns.spread, np.inf))


def _cost(start: Start) -> float:
    return start.cost


def _by_motion(prepared: list[Prepared], unknowns: Unknowns, tried: Iterable[Array]) -> list[Start]:
    """Thetas (n_p,) by the cost per residual of the motions that follow from them, of programmes by that of their
    beginning; those that can be placed on fewer logs last, those that can on none left out."""
    logs = [beginning(log, HORIZONS[0]) if log.fit_mode.name == "continuous" else log for log in prepared]
    out = []
    for theta in tried:
        at = replace(unknowns, start=theta)
        placed = place_on(logs, list(range(len(logs))), at)
        if placed:
            data, motion = [log.data for _, log, _ in placed], [trajectory for _, _, trajectory in placed]
            problem = shooting_problem(data, motion, at, COARSE_GRID)
            cost = problem.evaluate(problem.start, derivatives=False).cost / max(problem.samples, 1)
            out.append(Start(theta, float(cost) + MISSING * (len(logs) - len(placed))))
    return sorted(out, key=_cost)


def features_of(prepared: Sequence[Prepared]) -> tuple[list[Features], list[Array]]:
    """What the logs show of repeating cycles, with the base values (n_p,) of the log of each."""
    cycling = [log for log in prepared if log.fit_mode.name == "cycles"]
    each = [(extract(log.data, log.falls, log.rig.half_period), log.data.base) for log in cycling]
    shown = [(features, base) for features, base in each if features is not None]
    return [features for features, _ in shown], [base for _, base in shown]


def apart(thetas: Iterable[Array], reach: Array) -> Iterator[Array]:
    """Those of some thetas (n_p,) that are farther than `reach` (n_p,) from each one before in one parameter
    at least; infinite: not compared."""
    seen = list[Array]()
    compared = np.isfinite(reach)  # a parameter that is held at nought has no logarithm
    for theta in thetas:
        if all(np.any(np.abs(theta[compared] - other[compared]) > reach[compared]) for other in seen):
            seen.append(theta)
            yield theta


# ----------------------------------------------------------------------------------------------------------------------
# Preview: before anything is fitted, the detected cycles, and what the start would show, over the data.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PreviewLog:
    """One log before the fit: name, drive speed [m/s]; time [s], force [N] (sliding positive), used (n,); the force of
    the start trajectory (n,) [N], NaN where there is none and behind the last slip that it is placed on; onsets and
    arrests (c,) [s] as detected; a sentence."""

    name: str
    drive_speed: float
    time: Array
    force: Array
    used: NDArray[np.bool_]
    trajectory: Array
    onset: Array
    arrest: Array
    told: str


@dataclass(frozen=True)
class Preview:
    """What a fit would start from: where the start comes from, its parameters (SI) by name, units by name, the logs;
    notices: sentences on rig and scatter."""

    source: str
    parameters: dict[str, float]
    units: dict[str, str]
    logs: list[PreviewLog]
    notices: list[str]


def preview(scene: Scene, records: Sequence[Record]) -> Preview:
    """Detect the cycles of every log and place the start on them; nothing is fitted but one folded cycle.

    Raises:
        FitError, SceneError: as the fit itself; and where no fit can succeed.
    """
    made = prepare_scene(scene, records)
    prepared, unknowns = made.logs, made.unknowns
    if refused := wrong_unit(prepared):
        raise FitError(refused)
    able = [log for log in prepared if log.left_out is None]
    theta, source = unknowns.start, "the defaults: no log shows enough cycles to start from"
    if user_start(made.scene):
        source = "the start values of the scene"
    elif features_of(able)[0]:
        theta, source = next(starts_of(able, unknowns)), "the mean cycle of each log"
    logs = [_previewed(log, unknowns, theta) for log in prepared]
    values = dict(zip(unknowns.names, unknowns.values(theta, prepared[0].data.base).tolist(), strict=True))
    units = {q.name: q.unit for q in unknowns.model.parameters}
    return Preview(source, values, units, logs, prefit_warnings(prepared))


def _previewed(log: Prepared, unknowns: Unknowns, theta: Array) -> PreviewLog:
    cycles, record = log.segmentation.cycles, log.record
    trajectory, text = np.full(record.time.size, np.nan), log.left_out or ""
    if log.left_out is None:
        p = unknowns.values(log.data.theta(theta), log.data.base)
        placed = place(unknowns.model, [log.data], [p], [log.falls], COARSE_GRID)[0]
        text = "with these values the model does not stick and slip here"
        if placed is not None:
            at_start = replace(unknowns.with_weak_priors(), start=placed.theta(theta))
            problem = shooting_problem([as_far_as_placed(log, placed).data], [placed], at_start, COARSE_GRID)
            trajectory = problem.fitted(problem.start)[0]
            inside = np.isfinite(trajectory) & log.used
            off = float(np.sqrt(np.mean((trajectory - log.force)[inside] ** 2))) if np.any(inside) else float("nan")
            text = f"the start is off by {1e3 * off:.3g} mN (rms); the noise is {1e3 * log.data.noise:.3g} mN"
    text = f"{cycles.count} cycles found" + (f"; {text}" if text else "")
    curves = (record.time, log.force, log.used, trajectory)
    return PreviewLog(log.name, log.data.drive_speed, *curves, cycles.onset, cycles.arrest, text)
