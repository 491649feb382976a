"""Stability and amplitude of the fitted pair, at the speed and load of every log and with its own parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.diagnosis.findings import Findings
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.prediction.predict import OperatingPoint, predictions
from identify.prediction.sources import with_tied
from identify.scene.values import Tie

Array = NDArray[np.float64]


def outlooks_of(prepared: list[Prepared], found: Findings) -> list[dict[str, Any]]:
    """Stability and amplitude of the fitted pair at every log's speed and load; empty where there is no answer."""
    if found.status is not Status.CONVERGED or found.attempt is None or found.covariance is None:
        return [{} for _ in prepared]
    unknowns = found.unknowns
    free = np.flatnonzero(unknowns.free)
    names, ties = [unknowns.names[i] for i in free], _ties(unknowns)
    points: list[OperatingPoint | str] = []
    for number, log in enumerate(prepared):
        mine = of_log(number, log, found)
        if isinstance(mine, str):
            points.append(mine)
            continue
        theta, covariance = mine
        p = unknowns.values(theta, log.data.base)
        slope = np.where(unknowns.logarithmic, p, 1.0)[free]
        values = dict(zip(unknowns.names, p.tolist(), strict=True))
        told, covariance = with_tied(names, covariance * np.outer(slope, slope), ties)
        points.append(OperatingPoint(values, log.data.drive_speed, log.mean_load, covariance))
    told = (*names, *ties)
    if found.sure is not None and found.sure.of_groups:  # what points have in common is only shared within a pair
        return [
            {"text": point} if isinstance(point, str) else predictions(unknowns.model, [point], told)[0]
            for point in points
        ]
    return predictions(unknowns.model, [point for point in points if not isinstance(point, str)], told)


def _ties(unknowns: Unknowns) -> dict[str, Tie]:
    """The tied parameters by name, as far as their errors go: a factor, or none where they differ by an offset."""
    return {
        unknowns.names[i]: Tie(unknowns.names[to], factor=base if unknowns.logarithmic[i] else 1.0)
        for i, to, base in unknowns.ties
    }


def of_log(number: int, log: Prepared, found: Findings) -> tuple[Array, Array] | str:
    """Theta (n_p,) of one log and the covariance (f, f) of its free parameters, its own group's among them; a sentence
    where the log took no part and its group has no values."""
    attempt, sure, names = found.attempt, found.sure, found.unknowns.names
    assert attempt is not None and found.covariance is not None
    free = np.flatnonzero(found.unknowns.free)
    theta, covariance = attempt.solved.theta, found.covariance.copy()
    verdicts = {e.name: e.verdict for e in found.estimates}
    if sure is not None and sure.of_groups:
        if number in attempt.logs:
            theta = attempt.solved.guesses[attempt.logs.index(number)].theta(theta)
        theta, order = theta.copy(), np.arange(free.size)
        for i, index in enumerate(free.tolist()):
            if not found.unknowns.grouped[index]:
                continue
            group = log.data.groups[index] or f"log {number + 1}"
            share = next((s for s in sure.shares if (s.index, s.group) == (index, group)), None)
            if share is None:
                return f"No answer: this log took no part, and no other log tells {names[index]} of {group}."
            theta[index] = share.theta
            if share.place >= 0:
                order[i] = free.size + share.place
                verdicts[names[index]] = next(e.verdict for other, e in sure.of_groups if other == share)
        covariance = sure.joint[np.ix_(order, order)].copy()
    # What these data do not tell has no variance to carry on: the curvature at one point says nothing of it.
    open_ = np.array([verdicts.get(names[index]) == "not identifiable" for index in free.tolist()], dtype=bool)
    covariance[open_, open_] = np.inf
    return theta, covariance
