"""Profile likelihood: how far a parameter can be moved while all others follow, before the data object.

There the log-likelihood need be no parabola, and a small standard error from its curvature at one point can be false.
Every point is solved again, warm from its neighbour; a failed point shortens the step and is never counted; a better
optimum is handed back. A bound that the scene gives ends an interval; a bound of the model leaves it open.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.progress import Progress, to_nobody
from identify.base.quantiles import LEVEL, chi_square
from identify.estimation.covariance import WEAK
from identify.estimation.profile_line import ProfileLine, ProfilePoint
from identify.estimation.residual_autocorrelation import NoiseAutocorrelation
from identify.estimation.strategies import no_time_for
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import rhythmic
from identify.shooting.passes import Solved

# ----------------------------------------------------------------------------------------------------------------------
# One side of a profile: from the best point until the data object.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

CRITICAL = chi_square(LEVEL, 1)  # of 2 (cost - smallest cost), one degree of freedom
REACH = 1.15 * float(np.log(WEAK))  # of a logarithm: beyond a factor of three nothing more is asked
REACH_LINEAR = 0.9  # of mu_s - mu_k0, for coefficients, and for those that are judged by themselves
REACH_SHARE = 1.05 * (1.0 - 1.0 / WEAK)  # of their value, where that is more
POINTS = 28  # of one side, those that fail included: a winding ridge is followed in short steps
FAILURES = 4  # of the solver in a row, each with half the step, before a walk is given up
LEAP = 3.0  # standard intervals: where an end is looked for past a stretch on which the solver fails
LEAST = 0.002  # of what a step is measured by: the first one of what is known very well
CLOSE = 1.25  # of the root of the loss that ends a side: near enough to interpolate from
AIM = 1.03  # of a standard interval: where the first step goes
BEYOND = 0.1  # of a side: farther past its end than the interpolation can be off
BENT = 0.05  # of a side, by which it is longer or shorter than the covariance has it: its ridge bends
PAST = 1.7  # of a side: where one more point shows how the ridge bends


@dataclass(frozen=True)
class Side:
    """One end of a profile interval in theta; None: open (the data never object, or `failed` points); walled: it ends
    at a bound that the scene gives, before the data object."""

    end: float | None
    failed: bool
    walled: bool = False


@dataclass(frozen=True)
class ProfileBranch:
    """One side of a profile, and the last point before its end."""

    side: Side
    last: ProfilePoint


def walk_one_way(
    line: ProfileLine, index: int, sign: float, first: float, begin: ProfilePoint, wait: float, steps: int = 1
) -> ProfileBranch:
    """Walk one way from `begin` until the data object; the end by interpolation of the root of what they lose."""
    centre = float(line.best.theta[index])
    reach, walled = _room(line, index, sign)
    here, failures, objects = begin, 0, np.inf
    done = float(sign * (begin.theta[index] - centre))
    done_root = line.loss_root(begin)
    limit = float(np.sqrt(CRITICAL * wait))
    length = float(np.clip(AIM * limit * first, LEAST * _scale(line, index), 0.3 * _scale(line, index)))
    length = min(length, AIM * limit * first / steps) if first > 0 else length
    longest = length if steps > 1 else np.inf
    tight = 0.02 * length
    if reach <= 0.0:
        return ProfileBranch(Side(centre if walled else None, False, walled), here)
    for _ in range(POINTS + steps):
        target = min(done + length, reach)
        point = line.point(here, index, centre + sign * target)
        if point is None:
            failures += 1
            length *= 0.4
            if failures > FAILURES:
                break
            continue
        failures = 0
        root = line.loss_root(point)
        if root >= limit:
            if root < CLOSE * limit or target - done < tight:
                return ProfileBranch(Side(centre + sign * _crossing(done, done_root, target, root, limit), False), here)
            length = (target - done) * max(0.3, (limit - done_root) / (root - done_root))
            objects = min(objects, target)
            continue
        if target >= reach:
            return ProfileBranch(Side(centre + sign * reach if walled else None, False, walled), point)
        slope = (root - done_root) / (target - done)
        length = float(np.clip(1.1 * (limit - root) / max(slope, 1e-9), 0.05 * length, min(2.5 * length, longest)))
        done, done_root, here = target, root, point
    # The solver failed on the way to an end: the far side of it is the cautious one.
    if not np.isfinite(objects):
        target = min(done + LEAP * limit * first, reach)
        point = line.point(here, index, centre + sign * target)
        objects = target if point is not None and line.loss_root(point) >= limit else objects
    if np.isfinite(objects):
        return ProfileBranch(Side(centre + sign * objects, False), here)
    return ProfileBranch(Side(None, True), here)


def mark_past(line: ProfileLine, index: int, sign: float, walk: ProfileBranch) -> None:
    """One more point of the ridge, past the end of a side: where it bends, the covariance is to hold that too."""
    if walk.side.end is not None and not walk.side.walled:
        centre = float(line.best.theta[index])
        far = min(PAST * abs(walk.side.end - centre), _room(line, index, sign)[0])
        line.point(walk.last, index, centre + sign * far)


def _room(line: ProfileLine, index: int, sign: float) -> tuple[float, bool]:
    """How far a side can go from the answer, and whether a bound of the scene stops it there."""
    unknowns, centre = line.unknowns, float(line.best.theta[index])
    bound = unknowns.lower[index] if sign < 0 else unknowns.upper[index]
    room, reach = max(float(sign * (bound - centre)), 0.0), _reach(line, index)
    return (room, bool(unknowns.walls[0 if sign < 0 else 1, index])) if room < reach else (reach, False)


def _reach(line: ProfileLine, index: int) -> float:
    """How far from the answer a profile asks, in theta: as far as the verdict may need."""
    unknowns, theta = line.unknowns, line.best.theta
    own = REACH_SHARE * abs(float(theta[index])) if unknowns.names[index] in ("mu_s", "mu_k0") else 0.0
    return max(_scale(line, index), own)


def _scale(line: ProfileLine, index: int) -> float:
    """What a step is measured by, in theta."""
    return REACH if line.unknowns.logarithmic[index] else REACH_LINEAR * _step(line.unknowns, line.best.theta)


def _step(unknowns: Unknowns, theta: Array) -> float:
    """mu_s - mu_k0, the size coefficients are judged by."""
    names = unknowns.names
    return float(abs(theta[names.index("mu_s")] - theta[names.index("mu_k0")])) or 0.1


def _crossing(done: float, done_root: float, target: float, root: float, limit: float) -> float:
    """Where the root of the loss reaches its limit: it is straight where the likelihood is a parabola."""
    if root < CLOSE * limit and done == 0.0:
        return target * limit / root
    return done + (target - done) * (limit - done_root) / max(root - done_root, 1e-12)


BETTER = 0.5  # how much smaller 2 cost must become for another optimum to count
FARTHEST = 4.0  # standard deviations: where the truth may lie, once in a while


@dataclass(frozen=True)
class Curve:
    """The profile of one parameter: theta (k,), rising, and what the data object there (k,): 2 (cost - smallest), for
    white noise."""

    theta: Array
    loss: Array


@dataclass(frozen=True)
class Profiles:
    """Interval ends and curves per parameter name, the point of a better optimum where one was met, the
    likelihood-ratio statistic by which it is better, theta (n_p,) at the middle of the walks and the cost there, the
    points met that the data hardly object to, from there (m, f), the squared distance (m,) at which each should lie,
    and these points."""

    ends: dict[str, tuple[Side, Side]]
    better: ProfilePoint | None
    curves: Mapping[str, Curve] = field(default_factory=dict)
    gain: float = 0.0
    middle: Array = field(default_factory=lambda: np.empty(0))
    cost: float = np.inf
    likely: Array = field(default_factory=lambda: np.empty((0, 0)))
    objection: Array = field(default_factory=lambda: np.empty(0))
    met: tuple[ProfilePoint, ...] = ()

    @property
    def clear(self) -> float:
        """What the memory of the noise leaves of the gain."""
        return 0.0 if self.better is None else self.better.change.objection(self.gain)

    def outside(self, unknowns: Unknowns, theta: Array) -> list[tuple[int, float]]:
        """The sides of intervals beyond which a place (n_p,) lies: index of the parameter, -1 below or 1 above."""
        out = []
        for name, (low, high) in self.ends.items():
            index = unknowns.names.index(name)
            out += [(index, -1.0)] if low.end is not None and theta[index] < low.end else []
            out += [(index, 1.0)] if high.end is not None and theta[index] > high.end else []
        return out

    def joined(self, other: Profiles, unknowns: Unknowns) -> Profiles:
        """With the walks from another optimum that the data do not rule out: intervals that hold both, or the lower
        place that these walks met."""
        lowest = min(other.met, key=lambda point: point.cost, default=None)
        gain = 0.0 if lowest is None else 2.0 * (self.cost - lowest.cost)
        if gain > BETTER:
            return replace(self, better=lowest, gain=gain)
        ends = {
            name: (_farther(self.ends[name][0], low, min), _farther(self.ends[name][1], high, max))
            for name, (low, high) in other.ends.items()
        }
        above = max(2.0 * (other.cost - self.cost), 0.0)
        moved = (other.middle - self.middle)[unknowns.free]
        return replace(
            self,
            ends=self.ends | ends,
            likely=np.concatenate([self.likely, other.likely + moved]),
            objection=np.concatenate([self.objection, other.objection + above]),
            met=(*self.met, *other.met),
        )

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


@dataclass(frozen=True)
class ProfileNoise:
    """The noise that profiles allow for: covariance (f, f) of the free theta for white noise, for the first steps;
    noise of all logs: with a memory it objects later; memory (f,): by how much that widens the variance of each; beside
    (f,): by how much all else that is allowed for widens it. None: by nothing."""

    covariance: Array
    noise: NoiseAutocorrelation
    memory: Array | None = None
    beside: Array | None = None


@dataclass(frozen=True)
class ProfileOptions:
    """Which profiles are taken, and how.

    steps: of a side, at least: one finds the ends, more draw the curve. only: indices of parameters, where not all are
    asked; sides: of these, where not both of each are: one that is not walked ends at the farthest point met. optima:
    other places that count as points met, as far as the data do not object to them. before: points met by walks from
    another answer of the same samples; their change of the curves is from there.
    """

    steps: int = 1
    only: Sequence[int] | None = None
    sides: Collection[tuple[int, float]] | None = None
    optima: Sequence[Solved] = ()
    before: Sequence[ProfilePoint] = ()


EVERY_PROFILE = ProfileOptions()


def profile(
    logs: tuple[Prepared, ...],
    solved: Solved,
    unknowns: Unknowns,
    noise: ProfileNoise,
    asked: ProfileOptions = EVERY_PROFILE,
    progress: Progress = to_nobody,
) -> Profiles:
    """Profile every free parameter of a solution but for those of harmonics, whose curvature tells all."""
    sizes = np.sqrt(np.diag(noise.covariance))
    line = ProfileLine.at(logs, solved, unknowns, sizes, noise.noise)
    line.seen.extend(asked.before)
    for optimum in asked.optima:
        line.settled(optimum.theta, optimum.trajectories)
    beats, searched = rhythmic(unknowns), np.flatnonzero(unknowns.free)
    free = [i for i in searched.tolist() if not beats[i] and (asked.only is None or i in asked.only)]
    place = {index: number for number, index in enumerate(searched.tolist())}
    wait = {i: 1.0 if noise.beside is None else float(noise.beside[place[i]]) for i in free}
    wide = sizes if noise.memory is None else sizes * np.sqrt(noise.memory)
    sides = [(i, sign) for i in free for sign in (-1.0, 1.0) if asked.sides is None or (i, sign) in asked.sides]
    walks = _walks(line, sides, {i: float(wide[place[i]]) for i in free}, wait, asked.steps, progress)
    for (index, sign), walk in walks.items():
        straight = float(np.sqrt(CRITICAL * wait[index])) * float(wide[place[index]])
        end = walk.side.end
        if end is not None and abs(abs(end - line.best.theta[index]) / straight - 1.0) > BENT:
            mark_past(line, index, sign, walk)
    lowest = min(line.seen, key=lambda point: point.cost, default=line.best)
    gain = max(0.0, 2 * (line.answer - lowest.cost))
    better = lowest if gain > BETTER else None
    ends, curves = {}, {}
    for i in free:
        if asked.sides is None and not ((i, -1.0) in walks and (i, 1.0) in walks):
            continue  # no time: the covariance gives its interval
        inside = [point.theta[i] for point in line.seen if line.loss_root(point) ** 2 < CRITICAL * wait[i]]
        inside.append(line.best.theta[i])
        here = ProfileBranch(Side(float(line.best.theta[i]), False), line.best)
        ends[unknowns.names[i]] = (
            _stretched(walks.get((i, -1.0), here).side, min(inside), min),
            _stretched(walks.get((i, 1.0), here).side, max(inside), max),
        )
        curves[unknowns.names[i]] = _curve(line, i, wait[i])
    slow = max(wait.values(), default=1.0)
    likely = [point for point in line.seen if line.loss_root(point) < FARTHEST * np.sqrt(slow)]
    away = np.array([point.theta[searched] for point in likely]).reshape(-1, searched.size) - line.best.theta[searched]
    objection = np.array([max(line.loss_root(point) ** 2 / slow, CRITICAL) for point in likely])
    return Profiles(ends, better, curves, gain, line.best.theta, line.best.cost, away, objection, tuple(likely))


def _walks(
    line: ProfileLine,
    asked: Sequence[tuple[int, float]],
    sizes: Mapping[int, float],
    wait: Mapping[int, float],
    steps: int,
    progress: Progress,
) -> dict[tuple[int, float], ProfileBranch]:
    """The sides asked for, by parameter and sign, from the best point; on from a point beyond an end, where the data
    object to neither: behind a rise of the likelihood lies another optimum, and the side ends behind that."""
    walks: dict[tuple[int, float], ProfileBranch] = {}
    for index, sign in asked:
        progress(f"profile of {line.unknowns.names[index]}", None)
        walk = walk_one_way(line, index, sign, sizes[index], line.best, wait[index], steps)
        if time_is_up():
            no_time_for("profiles")
            break
        walks[index, sign] = walk
    for (index, sign), walk in walks.items():
        beyond = _beyond(line, index, sign, walk.side, wait[index])
        if beyond is not None:
            walks[index, sign] = walk_one_way(line, index, sign, sizes[index], beyond, wait[index])
    return walks


def _beyond(line: ProfileLine, index: int, sign: float, side: Side, wait: float) -> ProfilePoint | None:
    """The farthest point met that the data do not object to, where it lies clearly past this end."""
    if side.end is None or side.walled:
        return None
    likely = [point for point in line.seen if line.loss_root(point) ** 2 < CRITICAL * wait]
    farthest = max(likely, key=lambda point: sign * point.theta[index], default=line.best)
    past = BEYOND * abs(side.end - line.best.theta[index])
    return farthest if sign * (farthest.theta[index] - side.end) > past else None


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


def _farther(one: Side, other: Side, farther: Callable[[float, float], float]) -> Side:
    """The end of an interval that holds two; open where one of them is."""
    if one.end is None or other.end is None:
        return one if one.end is None else other
    return one if farther(one.end, other.end) == one.end else other


def _stretched(side: Side, farthest: float, farther: Callable[[float, float], float]) -> Side:
    """The end, stretched over every point of any walk that the data do not object to."""
    return side if side.end is None else replace(side, end=float(farther(side.end, farthest)))
