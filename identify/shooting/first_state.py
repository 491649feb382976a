"""How a motion that is followed begins: the elongation from the first samples, and a contact that is half aged, or so
aged that the first slips come where the log shows them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.shooting import lanes
from identify.shooting.along import Along

Array = NDArray[np.float64]

BRIEF_LOADING = 4.0  # half periods: a first stick that is shorter has no peak of its own
FIRST_SWINGS = 8.0  # half periods
ABOUT, PLACES = 2.0, 33  # half periods about the place of a first slide, and onsets in them that are tried


def first_state(along: Along) -> Array:
    """State at the begin of the window: the elongation from the first samples, the contact half aged or such that
    the first peak comes when it is seen."""
    log, model = along.log, along.model
    peak = along.data.first_peak(along.moving_from(log.begin))
    until = along.data.first_rise(peak)
    mine = (log.time >= log.begin) & (log.time <= until) & (log.weight > 0)
    if not np.any(mine):
        mine = np.arange(log.time.size) == np.searchsorted(log.time, log.begin)
    moved = np.array([along.drive_motion(t) for t in log.time[mine]])
    level = float(np.median(log.force[mine] - along.values["stiffness"] * moved))
    x = lanes.at_force(model, np.array([level]), along.p[None], along.inputs(log.begin)[None])[0]
    if model.clamped is None:
        return x
    candidates = np.linspace(0.0, 1.0, 41)
    onsets = np.full(candidates.size, np.nan)
    for i, value in enumerate(candidates):
        x[model.clamped] = value
        onsets[i] = along.onset(log.begin, x)[0]
    x[model.clamped] = 0.5
    if np.nanmin(onsets, initial=np.inf) - log.begin < BRIEF_LOADING * along.half:
        # Its peak is one swing among others: the first slide as a whole tells how aged the contact was.
        until = min(log.begin + FIRST_SWINGS * along.half, along.data.change_after(log.begin))
        misfits = [misfit_of_first(along, x, g, log.begin, until) for g in candidates[::2].tolist()]
        x[model.clamped] = candidates[int(np.argmin(misfits)) * 2]
    elif np.any(np.isfinite(onsets)) and np.ptp(onsets[np.isfinite(onsets)]) > 1e-3 * (peak - log.begin):
        x[model.clamped] = candidates[int(np.nanargmin(np.abs(onsets - peak)))]
        x[model.clamped] = aged_until_seen(along, x, candidates, onsets)
    return x


def aged_until_seen(along: Along, x: Array, candidates: Array, onsets: Array) -> float:
    """The ageing (a candidate, or between two) of the contact at the begin with which the first slips lie on the
    data: of a slow slip the force is highest long after the mass began to move, and how the mass comes to rest
    after it hangs on when it began. Looked for about the place where the slide from x does.

    Args:
        candidates, onsets: ageings (k,) and the onset of each (k,) [s], NaN where there is none.
    """
    log, found, aged = along.log, np.isfinite(onsets), float(x[along.model.clamped])
    onset, at_onset, _ = along.onset(log.begin, x)
    try:
        seen = along.placed(log.begin, onset, at_onset)
    except SimulationError:
        return aged
    order = np.argsort(onsets[found])
    places = seen + along.half * np.linspace(-ABOUT, ABOUT, PLACES)
    ages = np.unique(np.interp([seen, *places], onsets[found][order], candidates[found][order]))
    since, until = float(places[0]), min(seen + FIRST_SWINGS * along.half, along.data.change_after(log.begin))
    misfits = [misfit_of_first(along, x, age, since, until) for age in ages.tolist()]
    return float(ages[int(np.argmin(misfits))]) if np.any(np.isfinite(misfits)) else aged


def misfit_of_first(along: Along, x: Array, gamma: float, since: float, until: float) -> float:
    """Mean square of the residuals in noise variances between two times [s], from a contact this aged."""
    log, model = along.log, along.model
    x = x.copy()
    x[model.clamped] = gamma
    mine = np.flatnonzero((log.time >= max(since, log.begin)) & (log.time < until) & (log.weight > 0))
    if mine.size == 0:
        return np.inf
    try:
        shown = along.motion(log.begin, x, until - log.begin).sample(log.time[mine] - log.begin)["force"]
    except SimulationError:
        return np.inf
    return float(np.mean(log.weight[mine] * (log.force[mine] - shown) ** 2))
