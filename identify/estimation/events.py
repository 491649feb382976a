"""Slips that were missed or invented, put in or taken out; and logs that join an answer of others.

Such slips are found by the steps of the force against the placed start. A missed slip leaves the force a whole drop
below the curve from there on, an invented one above it; the next slip mends it. What a change is worth is told by
placing the log again: no solve is spent on a wrong number of events. Many slips may be missed, each between its own
neighbours: all that look so are changed at once, and each is judged there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.estimation.attempt import Attempt, place_on, solve_from
from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared, settled_part
from identify.logs.unknowns import Unknowns
from identify.shooting.grid import COARSE_GRID
from identify.shooting.shooting import shooting_problem

Array = NDArray[np.float64]

ROUNDS = 12
WORTH = 0.8  # of the squares between its neighbours: what a change must leave at most
TOO_BAD = 4.0  # times the noise variance per sample: a start that is worse has an event wrong, or is no start
BESIDE = 0.5  # of half a period: on each side of a step
STANDS_OUT = 4.5  # standard deviations of a step that noise alone hardly makes in a log
TRIED, ALONE = 12, 3  # steps each way that are looked at in a round; where not all at once, one by one


@dataclass(frozen=True)
class _Placed:
    """The start on one log: falls (c,) [s]; weighted squares (n,) of its samples, NaN where none is fitted; curve
    (n,) [N]; slip: how long one takes [s]."""

    falls: Array
    squares: Array
    curve: Array
    slip: float

    @property
    def misfit(self) -> float:
        """Per sample, in noise variances; infinite where none is fitted."""
        told = self.squares[np.isfinite(self.squares)]
        return float(np.mean(told)) if told.size else np.inf


def with_events_mended(log: Prepared, unknowns: Unknowns) -> Prepared:
    """The log with slips put in or taken out as long as the start (unknowns.start) then fits it better; the log itself
    where nothing does."""
    if log.fit_mode.name != "cycles" or log.falls.size == 0:
        return log
    now = _placed(log, log.falls, unknowns)
    if now is None or now.misfit < TOO_BAD:
        return log
    for _ in range(ROUNDS):
        if time_is_up():
            break
        better = _mended(log, now, unknowns)
        if better is None:
            break
        now = better
    return log if now.falls is log.falls else replace(log, falls=now.falls)


def misfit_of_start(log: Prepared, unknowns: Unknowns) -> float:
    """How badly the start (unknowns.start) fits a log before any solve, per sample in noise variances; infinite where
    it cannot be placed."""
    placed = _placed(log, log.falls, unknowns)
    return np.inf if placed is None else placed.misfit


def _placed(log: Prepared, falls: Array, unknowns: Unknowns) -> _Placed | None:
    placed = place_on([replace(log, falls=falls)], [0], unknowns)
    if not placed:
        return None
    _, cut, trajectory = placed[0]
    problem = shooting_problem([cut.data], [trajectory], unknowns, COARSE_GRID)
    curve = problem.fitted(problem.start)[0]
    told = (log.data.weight > 0) & np.isfinite(curve)
    squares = np.where(told, log.data.weight * (log.data.force - curve) ** 2, np.nan)
    slip = float(np.median(trajectory.arrest - trajectory.onset)) if trajectory.cycles else 0.0
    return _Placed(falls, squares, curve, slip)


def _mended(log: Prepared, now: _Placed, unknowns: Unknowns) -> _Placed | None:
    """One round: what is better with the changes that are worth it; None where none is."""
    for looked_for in (_missed, _invented):
        moments = looked_for(log, now)
        for some in (moments, *([moment] for moment in moments[:ALONE] if len(moments) > 1)):
            better = _changed(log, now, some, unknowns)
            if better is not None:
                return better
    return None


def _changed(log: Prepared, now: _Placed, moments: list[float], unknowns: Unknowns) -> _Placed | None:
    """The start with those falls put in or taken out that are worth it; None where none is."""
    for _ in range(2):  # a change that is not worth it disturbs its neighbours: the others are judged again
        made = _placed(log, _with(now.falls, moments), unknowns) if moments else None
        if made is None:
            return None
        worth = [moment for moment in moments if _is_worth(moment, log.data, now, made)]
        if len(worth) == len(moments) and made.misfit < now.misfit:
            return made
        moments = worth
    return None


def _with(falls: Array, moments: list[float]) -> Array:
    """The falls without those at a moment [s], and with one at each moment where there is none."""
    return np.setxor1d(falls, moments)


def _is_worth(moment: float, data: LogData, before: _Placed, after: _Placed) -> bool:
    """Whether the squares between the falls beside a change become fewer by it."""
    earlier, later = before.falls[before.falls < moment], before.falls[before.falls > moment]
    since = float(earlier[-1]) if earlier.size else -np.inf
    until = float(later[0]) if later.size else np.inf
    near = (data.time > since) & (data.time < until) & np.isfinite(before.squares) & np.isfinite(after.squares)
    return bool(np.any(near) and np.sum(after.squares[near]) < WORTH * np.sum(before.squares[near]))


def _missed(log: Prepared, now: _Placed) -> list[float]:
    """Moments [s] where the force steps down against the curve, a slip away from any fall; the largest step first."""
    at, size, half = _steps(log, now.curve)
    free = np.min(np.abs(at[:, None] - now.falls[None, :]), axis=1, initial=np.inf) > max(now.slip, 0.5 * half)
    return _largest(at[free], -size[free], 2.0 * max(now.slip, 0.5 * half))


def _invented(log: Prepared, now: _Placed) -> list[float]:
    """Moments [s] of the falls where the force steps up against the curve; the largest step first."""
    at, size, half = _steps(log, now.curve)
    beside = np.min(np.abs(at[:, None] - now.falls[None, :]), axis=1, initial=np.inf) <= max(now.slip, 0.5 * half)
    nearest = [int(np.argmin(np.abs(now.falls - t))) for t in _largest(at[beside], size[beside], 2.0 * half)]
    return now.falls[list(dict.fromkeys(nearest))[: now.falls.size - 1]].tolist()


def _steps(log: Prepared, curve: Array) -> tuple[Array, Array, float]:
    """By how much what the force has beyond the curve steps up (m,), in standard deviations, at moments (m,) [s]; how
    long a slip takes [s]."""
    data = log.data
    half = max(log.rig.half_period, 4.0 * data.interval)
    used = np.flatnonzero((data.weight > 0) & np.isfinite(curve))
    t, off = data.time[used], data.force[used] - curve[used]
    width = max(round(BESIDE * half / data.interval), 2)
    if t.size < 4 * width:
        return np.empty(0), np.empty(0), half
    summed = np.concatenate([[0.0], np.cumsum(off)])
    means = (summed[width:] - summed[:-width]) / width
    # Between the two stretches lies the slip itself.
    size = means[2 * width :] - means[: -2 * width]
    return t[width - 1 + np.arange(size.size) + width // 2], size / (data.noise * np.sqrt(2.0 / width)), half


def _largest(at: Array, size: Array, apart: float) -> list[float]:
    """The moments (m,) [s] of the largest sizes (m,) that stand out, that far apart [s]."""
    out: list[float] = []
    while size.size and len(out) < TRIED:
        place_ = int(np.argmax(size))
        if not size[place_] > STANDS_OUT:
            break
        out.append(float(at[place_]))
        far = np.abs(at - at[place_]) >= apart
        at, size = at[far], size[far]
    return out


# ----------------------------------------------------------------------------------------------------------------------
# Some logs first: those a start describes are solved, and the others join at their answer.
# ----------------------------------------------------------------------------------------------------------------------


def join(best: Attempt, prepared: list[Prepared], late: list[int], unknowns: Unknowns) -> Attempt:
    """Solve again with the logs that took no part so far, their slips mended at the answer, where it can be placed on
    them."""
    at_answer = replace(unknowns, start=best.solved.theta)
    seen = {i: prepared[i] for i in late if prepared[i].fit_mode.low_snr}
    forms = {i: _placeable(prepared[i], at_answer) for i in late}
    prepared = [forms.get(i) or log for i, log in enumerate(prepared)]
    late = [i for i in late if forms[i] is not None]
    if not late:
        return best
    joined = solve_from(prepared, sorted([*best.log_numbers, *late]), at_answer)
    if joined is not None and joined.gate.status is Status.CONVERGED:
        return joined
    # One log that does not fit must not keep out the others, nor one that is taken up too early.
    found = _one_by_one(best, prepared, late, seen, unknowns)
    if len(late) == 1 or set(late) <= set(found.log_numbers) or time_is_up():
        return found
    other = _one_by_one(best, prepared, late[::-1], seen, unknowns)
    return other if len(other.log_numbers) > len(found.log_numbers) else found


def _one_by_one(
    best: Attempt,
    prepared: list[Prepared],
    late: list[int],
    seen: dict[int, Prepared],
    unknowns: Unknowns,
) -> Attempt:
    """The answer that the late logs join in this order, as far as they do: as they are, those of low signal-to-noise
    also as they were seen, and of a course that does not fit its steady end."""
    for i in late:
        if time_is_up():
            break
        at_best = replace(unknowns, start=best.solved.theta)
        for log in _forms(prepared[i], seen.get(i), at_best, tried=len(late) == 1):
            having = [log if j == i else other for j, other in enumerate(prepared)]
            joined = solve_from(having, sorted([*best.log_numbers, i]), at_best)
            if joined is not None and joined.gate.status is Status.CONVERGED:
                best, prepared = joined, having
                break
    return best


def _forms(log: Prepared, seen: Prepared | None, unknowns: Unknowns, *, tried: bool) -> Iterator[Prepared]:
    """The forms of a log in the order in which they deserve a try, each made when it is asked for: mending takes time.

    Args:
        seen: a log of low signal-to-noise as it was seen. tried: the log as it is has been.
    """
    if not tried:
        yield log
    if seen is not None:
        yield with_events_mended(seen, unknowns)
    settled = settled_part(log)
    if settled is not None:
        yield settled


def _placeable(log: Prepared, unknowns: Unknowns) -> Prepared | None:
    """A log with its slips mended, else its steady end: of slips that the noise hides the data tell the level; else
    followed, whatever was seen of its slips: a swing that dies out near the end of stick-slip looks like some. None
    where it can be placed as none of these."""
    made = (
        _joining_mended(log, unknowns),
        settled_part(log),
        log.as_continuous if log.fit_mode.name == "cycles" else None,
    )
    forms = (form for form in made if form is not None)
    return next((form for form in forms if place_on([form], [0], unknowns)), None)


def _joining_mended(log: Prepared, unknowns: Unknowns) -> Prepared:
    """A log with its slips mended; one whose slips the noise hides is followed, whatever was seen of them."""
    return log.as_continuous if log.fit_mode.low_snr else with_events_mended(log, unknowns)
