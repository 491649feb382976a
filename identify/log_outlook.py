"""Stability and amplitude of the fitted pair, at the speed and load of every log and with its own parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.findings import Findings
from identify.layout import kept_parameters
from identify.outcome import Status
from identify.outlook import OperatingPoint, outlooks
from identify.prepare import Prepared

Array = NDArray[np.float64]


def outlooks_of(prepared: list[Prepared], found: Findings) -> list[dict[str, Any]]:
    """Stability and amplitude of the fitted pair at every log's speed and load; empty where there is no answer."""
    if found.status is not Status.CONVERGED or found.attempt is None or found.covariance is None:
        return [{} for _ in prepared]
    unknowns = found.unknowns
    free = np.flatnonzero(unknowns.free)
    # What these data do not tell has no variance to carry on: the curvature at one point says nothing of it.
    untold = {e.name for e in found.estimates if e.verdict == "not identifiable"}
    whole = found.covariance.copy()
    for i, index in enumerate(free.tolist()):
        if unknowns.names[index] in untold:
            whole[i, i] = np.inf
    points = []
    for number, log in enumerate(prepared):
        theta, covariance = _of_log(number, found, whole)
        p = unknowns.values(theta, log.data.base)
        slope = np.where(unknowns.logarithmic, p, 1.0)[free]
        values = dict(zip(unknowns.names, p.tolist(), strict=True))
        load = log.mean_load
        points.append(OperatingPoint(values, log.data.drive_speed, load, covariance * np.outer(slope, slope)))
    names = [unknowns.names[i] for i in free]
    if found.sure is not None and found.sure.of_groups:  # what points have in common is only shared within a pair
        return [answer for point in points for answer in outlooks(unknowns.model, [point], names)]
    return outlooks(unknowns.model, points, names)


def _of_log(number: int, found: Findings, covariance: Array) -> tuple[Array, Array]:
    """Theta (n_p,) of one log and the covariance (f, f) of its free parameters, its own group's among them."""
    attempt, sure = found.attempt, found.sure
    assert attempt is not None
    theta = attempt.solved.theta
    if number not in attempt.logs or sure is None or not sure.of_groups:
        return theta, covariance
    place = attempt.logs.index(number)
    free = np.flatnonzero(found.unknowns.free)
    order = np.arange(free.size)
    own = kept_parameters(attempt.solved.problem.layout)[free.size :].tolist()
    for i, index in enumerate(free.tolist()):
        unknown = int(attempt.solved.problem.layout.places[place].own[index])
        if unknown in own and found.unknowns.grouped[index]:
            order[i] = free.size + own.index(unknown)
    mine = sure.joint[np.ix_(order, order)].copy()
    open_ = ~np.isfinite(np.diag(covariance))
    mine[open_, open_] = np.inf
    return attempt.solved.guesses[place].theta(theta), mine
