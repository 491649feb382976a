"""Where a search starts: thetas from the features of the logs, from the user's values, and drawn about both."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import stage
from identify.estimation.attempt import HORIZONS, place_on
from identify.logs.log_data import at_speeds
from identify.logs.prepare import Prepared, at_drive, beginning
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import quieted
from identify.shooting.passes import first_grid
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
FOLLOWED = 6  # starts whose motions are compared along a course, and speeds of its cycles that they are taken from
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
            settled = quieted(unknowns)
            starts = fit_features(settled, features, bases, tried)
            if seed is not None and starts[0].cost >= (GOOD if np.isinf(worst) else worst):
                half = random_starts(unknowns, starts[0].theta, DRAWN // 2, seed)
                more = np.concatenate([half, random_starts(unknowns, tried[0], DRAWN // 2, seed + 1)])
                starts = sorted(starts + fit_features(settled, features, bases, more), key=attrgetter("cost"))
            if any(log.data.on_course for log in prepared):  # no cycle is like the next: the motions decide
                followed = [*(start.theta for start in starts[:FOLLOWED]), *level_starts(prepared, unknowns)]
                return _by_motion(prepared, unknowns, followed)
            # What is explicit in time was held still: it starts where the sticks say, and keeps what the scene fixes.
            return [
                replace(s, theta=np.where(settled.free, s.theta, unknowns.start)) for s in starts if s.cost <= worst
            ]

        groups = {"data": [made], "user": [own, made], "both": [np.concatenate([own, made])]}[sources]
        starts = [start for group in groups for start in ordered(group)]
    yield from apart((start.theta for start in starts), np.where(unknowns.free, SAME * unknowns.spread, np.inf))


def _by_motion(prepared: list[Prepared], unknowns: Unknowns, tried: Iterable[Array]) -> list[Start]:
    """Thetas (n_p,) by the cost per residual of the motions that follow from them, of programmes by that of their
    beginning; those that can be placed on fewer logs last, those that can on none left out."""
    programmes = [log.fit_mode.name == "continuous" and not log.data.on_course for log in prepared]
    logs = [beginning(log, HORIZONS[0]) if cut else log for cut, log in zip(programmes, prepared, strict=True)]
    out = []
    for theta in tried:
        at = replace(unknowns, start=theta)
        placed = place_on(logs, list(range(len(logs))), at)
        if placed:
            data, motion = [log.data for _, log, _ in placed], [trajectory for _, _, trajectory in placed]
            problem = shooting_problem(data, motion, at, first_grid(data, motion, at))
            cost = problem.evaluate(problem.start, derivatives=False).cost / max(problem.samples, 1)
            out.append(Start(theta, float(cost) + MISSING * (len(logs) - len(placed))))
    return sorted(out, key=attrgetter("cost"))


def features_of(prepared: Sequence[Prepared]) -> tuple[list[Features], list[Array]]:
    """What the logs show of repeating cycles, with the base values (n_p,) of the log of each."""
    cycling = [part for log in prepared for part in log.one_way if part.fit_mode.name == "cycles"]
    each = [
        (extract(*alike, log.rig.half_period), log.data.base)
        for log in cycling
        for alike in at_speeds(at_drive(log), log.slip_times)
    ]
    shown = [(features, base) for features, base in each if features is not None]
    if any(log.data.on_course for log in cycling) and len(shown) > FOLLOWED:  # as many speeds tell as much as all
        shown.sort(key=lambda one: one[0].drive_speed)
        shown = [shown[i] for i in np.linspace(0, len(shown) - 1, FOLLOWED).astype(int)]
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
