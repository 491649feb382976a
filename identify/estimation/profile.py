"""Profile likelihood: how far a parameter can be moved while all others follow, before the data object.

There the log-likelihood need be no parabola, and a small standard error from its curvature at one point can be false.
Every point is solved again, warm from its neighbour; a failed point shortens the step and is never counted; a better
optimum is handed back. A bound that the scene gives ends an interval; a bound of the model leaves it open.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.progress import Progress
from identify.estimation.objection import Remembering
from identify.estimation.profile_ground import ProfilePoint
from identify.estimation.profile_line import ProfileLine
from identify.estimation.profile_side import (
    CRITICAL,
    Side,
    Walk,
    follow_open_end,
    gone_further,
    look_behind,
    mark_past,
    retried,
    walk_one_way,
)
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import Solved
from identify.shooting.vibration import rhythmic

Array = NDArray[np.float64]

BETTER = 0.5  # how much smaller 2 cost must become for another optimum to count
ROUNDS = 2  # in which they do once more
FARTHEST = 4.0  # standard deviations: where the truth may lie, once in a while
ALIKE = 0.02  # of a standard interval: a side that has this length by its curvature needs no second opinion


@dataclass(frozen=True)
class Curve:
    """The profile of one parameter: theta (k,), rising, and what the data object there (k,): 2 (cost - smallest), for
    white noise."""

    theta: Array
    loss: Array


@dataclass(frozen=True)
class Profiles:
    """Interval ends and curves per parameter name, the point of a better optimum where one was met, the
    likelihood-ratio statistic by which it is better, theta (n_p,) at the middle of the walks, the points met that the
    data hardly object to, from there (m, f), the squared distance (m,) at which each should lie, and these points."""

    ends: dict[str, tuple[Side, Side]]
    better: ProfilePoint | None
    curves: Mapping[str, Curve] = field(default_factory=dict)
    gain: float = 0.0
    middle: Array = field(default_factory=lambda: np.empty(0))
    likely: Array = field(default_factory=lambda: np.empty((0, 0)))
    objection: Array = field(default_factory=lambda: np.empty(0))
    met: tuple[ProfilePoint, ...] = ()

    @property
    def clear(self) -> float:
        """What the memory of the noise leaves of the gain."""
        return 0.0 if self.better is None else self.better.change.objection(self.gain)

    def seen_from(self, unknowns: Unknowns, answer: Array) -> Profiles:
        """The same points seen from an answer (n_p,) that is not their middle: what they say where no walk comes to an
        end. An interval that does not hold the answer is open on its side."""
        if not self.middle.size:
            return replace(self, better=None)
        ends = {}
        for name, (low, high) in self.ends.items():
            at = answer[unknowns.names.index(name)]
            below = low.end if low.end is not None and low.end <= at else None
            above = high.end if high.end is not None and high.end >= at else None
            ends[name] = (replace(low, end=below), replace(high, end=above))
        moved = (answer - self.middle)[np.flatnonzero(unknowns.free)]
        away = self.likely - moved if self.likely.size else self.likely
        return replace(self, ends=ends, better=None, middle=answer, likely=away)


def profile(
    logs: tuple[Prepared, ...],
    solved: Solved,
    unknowns: Unknowns,
    covariance: Array,
    progress: Progress,
    noise: Remembering,
    *,
    memory: Array | None = None,
    beside: Array | None = None,
    steps: int = 1,
    only: Sequence[int] | None = None,
    valleys: Sequence[Solved] = (),
    before: Sequence[ProfilePoint] = (),
) -> Profiles:
    """Profile every free parameter of a solution but for those of harmonics, whose curvature tells all.

    Args:
        covariance: (f, f) of the free theta for white noise, for the first steps.
        noise: of all logs: with a memory it objects later.
        memory: (f,) by how much that memory widens the variance of each; beside: (f,) by how much all else that is
            allowed for widens it.
        steps: of a side, at least: one finds the ends, more draw the curve.
        only: indices of parameters, where not all are asked.
        valleys: other places that count as points met, as far as the data do not object to them.
        before: points met by walks from another answer of the same samples; their change of the curves is from there.
    """
    sizes = np.sqrt(np.diag(covariance))
    line = ProfileLine.at(logs, solved, unknowns, sizes, noise)
    line.seen.extend(before)
    for valley in valleys:
        line.settled(valley.theta, valley.guesses)
    beats, searched = rhythmic(unknowns), np.flatnonzero(unknowns.free)
    free = [i for i in searched.tolist() if not beats[i] and (only is None or i in only)]
    place = {index: number for number, index in enumerate(searched.tolist())}
    wait = {i: 1.0 if beside is None else float(beside[place[i]]) for i in free}
    wide = sizes if memory is None else sizes * np.sqrt(memory)
    walks = _walks(line, {i: float(wide[place[i]]) for i in free}, wait, steps, progress)
    for (index, sign), walk in walks.items():
        mark_past(line, index, sign, walk)
    lowest = min(line.seen, key=lambda point: point.cost, default=line.best)
    gain = max(0.0, 2 * (line.answer - lowest.cost))
    better = lowest if gain > BETTER else None
    ends, curves = {}, {}
    for i in free:
        inside = [point.theta[i] for point in line.seen if line.loss_root(point) ** 2 < CRITICAL * wait[i]]
        inside.append(line.best.theta[i])
        ends[unknowns.names[i]] = (
            _stretched(walks[i, -1.0].side, min(inside), min),
            _stretched(walks[i, 1.0].side, max(inside), max),
        )
        curves[unknowns.names[i]] = _curve(line, i, wait[i])
    slow = max(wait.values(), default=1.0)
    likely = [point for point in line.seen if line.loss_root(point) < FARTHEST * np.sqrt(slow)]
    away = np.array([point.theta[searched] for point in likely]).reshape(-1, searched.size) - line.best.theta[searched]
    objection = np.array([max(line.loss_root(point) ** 2 / slow, CRITICAL) for point in likely])
    return Profiles(ends, better, curves, gain, line.best.theta, away, objection, tuple(likely))


def _walks(
    line: ProfileLine,
    sizes: Mapping[int, float],
    wait: Mapping[int, float],
    steps: int,
    progress: Progress,
) -> dict[tuple[int, float], Walk]:
    """Both sides of every parameter, by its index, from the best point, from points met beyond its end, and past its
    end where others know a way."""
    walks: dict[tuple[int, float], Walk] = {}
    for index, size in sizes.items():
        progress(f"profile of {line.unknowns.names[index]}", None)
        for sign in (-1.0, 1.0):
            walks[index, sign] = walk_one_way(line, index, sign, size, line.best, wait[index], steps)
    for (index, sign), walk in walks.items():
        follow_open_end(line, index, sign, walk, wait[index])
        look_behind(line, index, sign, walk, wait[index])
    progress("profiles from other points", None)
    for (index, sign), walk in walks.items():
        walks[index, sign] = gone_further(line, index, sign, walk, wait[index], sizes[index])
    for (index, sign), walk in walks.items():
        straight = np.sqrt(CRITICAL * wait[index]) * sizes[index]
        if walk.side.end is not None and not walk.side.walled:
            length = abs(walk.side.end - line.best.theta[index])
            if abs(length - straight) > ALIKE * straight:
                walks[index, sign] = retried(line, index, sign, walk, wait[index])
    for _ in range(ROUNDS):  # what one walk met may be a way on for another
        before = dict(walks)
        for (index, sign), walk in before.items():
            walks[index, sign] = gone_further(line, index, sign, walk, wait[index], sizes[index])
        if walks == before:
            break
    return walks


def _curve(line: ProfileLine, index: int, wait: float) -> Curve:
    """The points at which this parameter was held, and the best one."""
    mine = [line.best, *(point for point in line.seen if point.held == index)]
    mine.sort(key=lambda point: (float(point.theta[index]), point.cost))
    # Of a place reached twice the better point counts.
    apart = 1e-6 * line.unknowns.spread[index]
    first = np.append(True, np.diff([point.theta[index] for point in mine]) > apart)
    mine = [point for point, counts in zip(mine, first.tolist(), strict=True) if counts]
    theta = np.array([point.theta[index] for point in mine])
    return Curve(theta, np.array([line.loss_root(point) ** 2 / wait for point in mine]))


def _stretched(side: Side, farthest: float, farther: Callable[[float, float], float]) -> Side:
    """The end, stretched over every point of any walk that the data do not object to."""
    return side if side.end is None else replace(side, end=float(farther(side.end, farthest)))
