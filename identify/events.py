"""Slips that were missed or invented: found by the steps of the force against the placed start, put in or taken out.

A missed slip leaves the force a whole drop below the curve from there on, an invented one above it; the next slip mends
it. What a change is worth is told by placing the log again: no solve is spent on a wrong number of events.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.guess import Guess
from identify.passes import COARSE
from identify.placing import place
from identify.prepare import Prepared
from identify.shooting import transcribe
from identify.unknowns import Unknowns

Array = NDArray[np.float64]

MOST = 12  # events that are changed in one log
WORTH = 0.8  # of the misfit before: what a change must bring
TOO_BAD = 4.0  # times the noise variance per sample: a start that is worse has an event wrong, or is no start
BESIDE = 0.5  # of half a period: on each side of a step
TRIED = 3  # steps each way that are looked at


@dataclass(frozen=True)
class _Placed:
    """The start on one log: falls (c,) [s], misfit per sample in noise variances, curve (n,) [N]."""

    falls: Array
    misfit: float
    curve: Array
    guess: Guess


def with_events_mended(log: Prepared, unknowns: Unknowns) -> Prepared:
    """The log with slips put in or taken out as long as the start (unknowns.start) then fits it better; the log itself
    where nothing does."""
    if log.manner.name != "cycles" or log.falls.size == 0:
        return log
    now = _placed(log, log.falls, unknowns)
    if now is None or now.misfit < TOO_BAD:
        return log
    for _ in range(MOST):
        tries = [_placed(log, falls, unknowns) for falls in _changes(log, now)]
        best = min((made for made in tries if made is not None), key=lambda made: made.misfit, default=None)
        if best is None or best.misfit > WORTH * now.misfit:
            break
        now = best
    return log if now.falls is log.falls else replace(log, falls=now.falls)


def _placed(log: Prepared, falls: Array, unknowns: Unknowns) -> _Placed | None:
    p = unknowns.values(log.data.theta(unknowns.start), log.data.base)
    guess = place(unknowns.model, [log.data], [p], [falls], COARSE).guesses[0]
    ends = None if guess is None else np.append(guess.onset[1:], log.data.end)
    if guess is None or ends is None or not (guess.onset[0] > log.data.begin and np.all(ends > guess.arrest)):
        return None
    problem = transcribe([log.data], [guess], unknowns, COARSE)
    misfit = 2.0 * problem.evaluate(problem.start, derivatives=False).cost / max(problem.samples, 1)
    return _Placed(falls, float(misfit), problem.fitted(problem.start)[0], guess)


def _changes(log: Prepared, now: _Placed) -> list[Array]:
    """Falls with one more where the force steps down against the curve, or one less where it steps up."""
    data = log.data
    used = np.flatnonzero((data.weight > 0) & np.isfinite(now.curve))
    t, off = data.time[used], data.force[used] - now.curve[used]
    interval = data.interval
    half = max(log.rig.half_period, 4.0 * interval)
    width = max(round(BESIDE * half / interval), 2)
    if t.size < 4 * width:
        return []
    summed = np.concatenate([[0.0], np.cumsum(off)])
    means = (summed[width:] - summed[:-width]) / width
    # Between the two stretches lies the slip itself.
    steps = means[2 * width :] - means[: -2 * width]
    at = t[width - 1 + np.arange(steps.size) + width // 2]
    out = []
    for sign in (-1.0, 1.0):
        size = sign * steps
        for _ in range(TRIED):
            place_ = int(np.argmax(size))
            if size[place_] <= 0.0:
                break
            moment = float(at[place_])
            size = np.where(np.abs(at - moment) < 2.0 * half, -np.inf, size)
            nearest = int(np.argmin(np.abs(now.falls - moment)))
            if sign < 0.0 and abs(now.falls[nearest] - moment) > 0.5 * half:
                out.append(np.sort(np.append(now.falls, moment)))
            elif sign > 0.0 and now.falls.size > 1:
                out.append(np.delete(now.falls, nearest))
    return out
