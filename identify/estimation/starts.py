"""Where a search starts: thetas from the features of the logs, from the user's values, and by lot about both."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import stage
from identify.estimation.attempt import HORIZONS, place_on
from identify.logs.prepare import Prepared, beginning
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import quieted
from identify.shooting.features import Features, extract, extract_one_by_one
from identify.shooting.grid import COARSE_GRID
from identify.shooting.shooting import shooting_problem
from identify.shooting.starts import GOOD, Start, candidates, fit_features, level_starts, random_starts

# ----------------------------------------------------------------------------------------------------------------------
# Starts in the order in which they deserve a solve: how well the motion that follows from each fits before any is.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

MISSING = 1e6  # cost per residual of a log on which a start cannot be placed


def ranked(prepared: list[Prepared], unknowns: Unknowns, tried: Iterable[Array]) -> list[Start]:
    """Thetas (n_p,) by the cost per residual of the motions that follow from them, of courses by that of their first
    beginning; those that can be placed on fewer logs last, those that can on none left out."""
    prepared = [beginning(log, HORIZONS[0]) if log.fit_mode.name == "continuous" else log for log in prepared]
    out = []
    for theta in tried:
        at = replace(unknowns, start=theta)
        placed = place_on(prepared, list(range(len(prepared))), at)
        if placed:
            logs = [log.data for _, log, _ in placed]
            problem = shooting_problem(logs, [trajectory for _, _, trajectory in placed], at, COARSE_GRID)
            cost = problem.evaluate(problem.start, derivatives=False).cost / max(problem.samples, 1)
            out.append(Start(theta, float(cost) + MISSING * (len(prepared) - len(placed))))
    return sorted(out, key=lambda start: start.cost)


Sources = Literal["data", "user", "both"]

RANDOM = (48, 96)  # random starts, where the data's own do not fit the features
WORTH = 0.7  # of the cost before: what random starts must gain for more of them to be tried
SAME = 0.02  # of the spread: starts closer than that are one


def own_starts(prepared: list[Prepared], unknowns: Unknowns) -> Iterator[Array]:
    """Starts (n_p,) from the data alone, in the order in which they deserve a try; none drawn by lot."""
    return starts_of(prepared, unknowns, "data", 0, True, np.inf)


def starts_of(
    prepared: list[Prepared],
    unknowns: Unknowns,
    sources: Sources,
    seed: int,
    uneven: bool,
    worst: float,
) -> Iterator[Array]:
    """Starts (n_p,) in the order in which they deserve a try, up to a `worst` cost per residual; random ones where the
    data's own are not good, or, with such a limit, all beyond it."""
    with stage("start"):
        starts = _in_order(prepared, unknowns, sources, seed, uneven, worst)
        if sources == "user":  # one more start, never the only one
            starts = [*starts, *_in_order(prepared, unknowns, "data", seed, uneven, worst)]
    yield from _distinct(starts, unknowns)


def _in_order(
    prepared: list[Prepared], unknowns: Unknowns, sources: Sources, seed: int, uneven: bool, worst: float
) -> Sequence[Start]:
    features, bases = features_of(prepared)
    if not features:
        made = [level_starts(prepared, unknowns)] if sources != "user" else []
        tried = np.concatenate([unknowns.start[None, :], *made]) if sources != "data" else made[0]
        return ranked(prepared, unknowns, tried)
    own = [unknowns.start[None, :]] if sources != "data" else []
    made = [candidates(unknowns, features, bases)] if sources != "user" else []
    if made and not any(f.settled for f in features):  # slips that are all unlike tell no level of their own
        made.append(level_starts(prepared, unknowns))
    tried = np.concatenate(own + made)
    settled = quieted(unknowns)
    starts = fit_features(settled, features, bases, tried)
    before, enough = np.inf, GOOD if np.isinf(worst) else worst
    for count in RANDOM:
        if starts[0].cost < enough or uneven or starts[0].cost > WORTH * before:
            break
        before = starts[0].cost
        more = random_starts(unknowns, starts[0].theta, count, seed)
        if sources != "user":
            more = np.concatenate([more[: count // 2], random_starts(unknowns, tried[0], count // 2, seed + 1)])
        starts = sorted(starts + fit_features(settled, features, bases, more), key=lambda s: s.cost)
    # What is explicit in time was held still: it starts where the sticks say, and keeps the value that the scene fixes.
    return [replace(s, theta=np.where(settled.free, s.theta, unknowns.start)) for s in starts if s.cost <= worst]


def features_of(prepared: Sequence[Prepared]) -> tuple[list[Features], list[Array]]:
    """What the logs show of repeating cycles, and of each slip of a drive programme; with the base values (n_p,) of the
    log of each."""
    features: list[Features] = []
    bases: list[Array] = []
    for log in prepared:
        found = list[Features | None]()
        if log.fit_mode.name == "cycles":
            found = [extract(log.data, log.falls, log.rig.half_period)]
        elif slips_one_by_one(log):
            found = [*extract_one_by_one(log.data, log.segmentation.cycles, log.rig.half_period)]
        features += [f for f in found if f is not None]
        bases += [log.data.base] * sum(f is not None for f in found)
    return features, bases


def slips_one_by_one(log: Prepared) -> bool:
    """Whether a drive programme shows slips that follow others, so that each tells what the rest before it did."""
    return log.fit_mode.name == "continuous" and log.data.programme is not None and log.segmentation.count > 1


def _distinct(starts: Sequence[Start], unknowns: Unknowns) -> Iterator[Array]:
    return apart((start.theta for start in starts), np.where(unknowns.free, SAME * unknowns.spread, np.inf))


def apart(thetas: Iterable[Array], reach: Array) -> Iterator[Array]:
    """Those of some thetas (n_p,) that are farther than `reach` (n_p,) from each one before in one parameter
    at least; infinite: not compared."""
    seen = list[Array]()
    compared = np.isfinite(reach)  # a parameter that is held at nought has no logarithm
    for theta in thetas:
        if all(np.any(np.abs(theta[compared] - other[compared]) > reach[compared]) for other in seen):
            seen.append(theta)
            yield theta
