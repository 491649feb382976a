"""How far each parameter can be moved before the data object, from the true motion: profile likelihood by brute force.

The truth that verdicts are compared with. It starts from the true values, the true falls and the true noise, so it
needs no detection, no features and no search; every parameter is held in turn on one fixed grid of steps, and
everything else is solved again at each. No covariance, no walk of adaptive steps, no linearisation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from data_io import Record
from experiments.study_problem import NOISE
from identify.logs.log_data import LogData
from identify.logs.prepare import LAST_STICK, REPEATABLE
from identify.logs.unknowns import Unknowns, from_scene
from identify.scene import Scene
from identify.shooting.grid import COARSE_GRID
from identify.shooting.passes import solve_in_passes
from identify.shooting.placing import place
from identify.shooting.shooting import shooting_problem
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.solve import solve
from identify.simulation.drive import NormalForce
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]
Claims = Mapping[str, tuple[Sequence[Array], Sequence[Array]]]

OBJECTS = float(chi2.ppf(0.95, 1))
LOGARITHMS = (0.05, 0.17, 0.4, 0.75, 1.12, 1.38)  # steps of a logarithm
FARTHER = (2.4, 3.4, 4.4, 5.4)  # more steps of a logarithm that is open: another may be free only out there
SHARES = (0.02, 0.08, 0.19, 0.35, 0.55, 0.7, 0.84)  # steps of a coefficient, of its size
STEPS = 4  # RK4 steps per interval: their error is common to all points
PATIENCE = 30
ONE_VALLEY = 0.1  # of the spread of the parameters
ROUNDS = 2  # in which walks go on from points of each other
FURTHER = 1.05  # times its end: from where a point of another walk is a way on
SHORTER = 0.1  # of a step that fails: what is known well objects long before its end
CLOSED = 1e-6  # largest row of a point that counts
FINE = 400  # samples of a slip in which its middle is looked for
IDENTIFIED, WEAK = 0.20, 3.0  # the verdicts as they are promised: within 20 %, within a factor of three
ROOM = 1.25  # factor on the length of either side: what lies that near to a limit may be called either way


@dataclass(frozen=True)
class Truth:
    """The profile of one parameter (SI): best value, ends of its 95 % interval (None: open), its size; unclear: the
    solver failed on the way; logarithmic: judged by factors; sizes: the smallest and the largest that the data allow,
    where what delta_mu_k is judged by is itself not told."""

    value: float
    low: float | None
    high: float | None
    size: float
    logarithmic: bool
    unclear: bool
    sizes: tuple[float, float] | None = None

    def verdict(self, room: float = 1.0, size: float | None = None) -> str:
        """The verdict, both sides longer by a factor, judged by another size if one is given."""
        size = self.size if size is None else size
        if self.low is None or self.high is None:
            return "not identifiable"
        if self.logarithmic:
            low, high = (self.value * (end / self.value) ** room for end in (self.low, self.high))
        else:
            low, high = (self.value + room * (end - self.value) for end in (self.low, self.high))
        widest = max(self.value - low, high - self.value)
        if widest <= IDENTIFIED * size:
            return "identified"
        if self.logarithmic:
            return "weak" if high <= WEAK * self.value and low >= self.value / WEAK else "not identifiable"
        return "weak" if widest <= (1.0 - 1.0 / WEAK) * size else "not identifiable"

    @property
    def allowed(self) -> tuple[str, ...]:
        """What may be said: more than one verdict where an end lies near a limit, the data leave open what it is judged
        by, or the profile is unclear."""
        if self.unclear:
            return ("identified", "weak", "not identifiable")
        sizes = (self.size, *(self.sizes or ()))
        return tuple(dict.fromkeys(self.verdict(room, size) for size in sizes for room in (1.0, 1.0 / ROOM, ROOM)))


@dataclass(frozen=True)
class _Point:
    theta: Array
    trajectories: list[ShootingTrajectory]
    cost: float


def _logs(
    records: Sequence[Record], motions: Sequence[Trajectory], speeds: Sequence[float], base: Array
) -> list[LogData]:
    """The records as the estimator takes them, with the true noise; the drive moves from the first sample on."""
    out = []
    for record, motion, speed in zip(records, motions, speeds, strict=True):
        onsets, arrests = _slips(motion)
        stick = float(np.median(onsets[1:] - arrests[:-1])) if onsets.size > 1 else float(onsets[0])
        end = min(float(record.time[-1]), float(arrests[-1]) + LAST_STICK * stick)
        load = float(np.mean(record.normal_force))
        weight = np.full(record.time.size, 1.0 / NOISE**2)
        course = NormalForce.of(load)
        force = np.asarray(record.friction_force)
        out.append(LogData(record.time, force, weight, base, speed, course, REPEATABLE * load, 0.0, end))
    return out


def _slips(motion: Trajectory) -> tuple[Array, Array]:
    """Onsets and arrests of the complete slips (c,) [s]."""
    arrests = np.asarray(motion.arrests)
    onsets = np.asarray(motion.onsets)[: arrests.size]
    return onsets, arrests


def _falls(motion: Trajectory) -> Array:
    """Where the force crosses the middle of each fall (c,) [s]."""
    out = []
    for onset, arrest in zip(*_slips(motion), strict=True):
        times = np.linspace(onset, arrest, FINE)
        force = np.asarray(motion.sample(times)["force"])
        peak, valley = int(np.argmax(force)), int(np.argmin(force))
        middle = 0.5 * (force[peak] + force[valley])
        out.append(times[peak + int(np.argmax(force[peak : valley + 1] <= middle))])
    return np.array(out)


def true_profiles(
    scene: Scene,
    records: Sequence[Record],
    motions: Sequence[Trajectory],
    speeds: Sequence[float],
    pair: dict[str, float],
    names: Sequence[str],
    other: Array | None = None,
    claims: Claims | None = None,
) -> dict[str, Truth]:
    """The profile of each named parameter.

    Args:
        scene: what is searched; records, motions, speeds [m/s]: of the logs that take part, with the noise of the study
            problem; pair: true values of friction and rig; other: a theta (n_p,) to begin from as well: where
            likelihoods have several valleys, the deepest may not be the one of the truth; claims: per parameter thetas
            (n_p,) to which, as a fit says, the data do not object, from below and from above, the outermost first. The
            first that is found true, solved anew on the true falls with the parameter held, counts and is walked on
            from: a profile is the lowest of all there is, and no walk alone shows that the data object. Beyond one that
            the solver fails on, no end is known.

    Raises:
        RuntimeError: the motion of the true values cannot be solved.
    """
    unknowns = from_scene(scene)
    base = unknowns.base(pair)
    truth = unknowns.theta(np.array([pair[name] for name in unknowns.names]), base)
    logs, soft = _logs(records, motions, speeds, base), replace(unknowns, start=truth).with_weak_priors()
    falls = [_falls(motion) for motion in motions]
    best = _begun(soft, logs, falls, truth)
    if best is None:
        raise RuntimeError("the solver finds no answer from the truth")
    second = None if other is None else _begun(soft, logs, falls, other)
    walks = {name: _Walks(soft, logs, best, unknowns.names.index(name)) for name in names}
    if second is not None and 2.0 * (second.cost - best.cost) < OBJECTS and not _same(soft, best, second):
        if second.cost < best.cost:
            best, second = second, best
        walks = {name: _Walks(soft, logs, best, unknowns.names.index(name)) for name in names}
        for walk in walks.values():
            walk.points.append(second)
            walk.also(second)
    for walk in walks.values():
        walk.both_ways()
    for name, claimed in (claims or {}).items():
        for side in claimed:
            any(walks[name].claimed(theta, falls) for theta in side)
    # What one walk met may show another one a way on that it missed: likelihoods like these have several valleys.
    for _ in range(ROUNDS):
        seen = [point for walk in walks.values() for point in walk.points]
        went = [walk.further(seen) for walk in walks.values()]
        if not any(went):
            break
    # A walk may come across a better optimum: the lowest point of all is the best one.
    lowest = min([best, *(p for walk in walks.values() for p in walk.points)], key=lambda point: point.cost)
    seen = [best, *(p for walk in walks.values() for p in walk.points)]
    return {name: _truth(soft, logs[0], lowest, name, walk, seen) for name, walk in walks.items()}


def _begun(unknowns: Unknowns, logs: list[LogData], falls: list[Array], theta: Array) -> _Point | None:
    """The best point of the valley of a theta (n_p,); None where the model does not slip there, or the solver fails."""
    trajectories = _on_falls(unknowns, logs, falls, theta)
    if trajectories is None:
        return None
    first = solve_in_passes(logs, trajectories, replace(unknowns, start=theta))
    return _solved(unknowns, logs, first.theta, first.trajectories, None) if np.all(np.isfinite(first.theta)) else None


def _on_falls(
    unknowns: Unknowns, logs: list[LogData], falls: list[Array], theta: Array
) -> list[ShootingTrajectory] | None:
    """The motion of a theta (n_p,) placed on the true falls; None where the model does not slip there."""
    values = [unknowns.values(theta, log.base) for log in logs]
    placed = place(unknowns.model, logs, values, falls, COARSE_GRID)
    trajectories = [trajectory for trajectory in placed if trajectory is not None]
    return trajectories if len(trajectories) == len(logs) else None


def _same(unknowns: Unknowns, one: _Point, other: _Point) -> bool:
    """Whether two points are of one valley."""
    off = (np.abs(one.theta - other.theta) / unknowns.spread)[unknowns.free]
    return bool(np.max(off) < ONE_VALLEY)


def _solved(
    unknowns: Unknowns, logs: list[LogData], theta: Array, trajectories: list[ShootingTrajectory], held: int | None
) -> _Point | None:
    free = unknowns.free.copy()
    if held is not None:
        free[held] = False
    problem = shooting_problem(
        logs, trajectories, replace(unknowns, start=theta, free=free), replace(COARSE_GRID, steps=STEPS)
    )
    solution = solve(problem, mu_init=1e-6, iterations=PATIENCE, exact=True)
    if not (solution.success and solution.constraint_violation < CLOSED and np.all(np.isfinite(solution.x))):
        return None
    layout = problem.layout
    found = theta.copy()
    found[layout.free] = solution.x[: layout.free.size]
    moved = [place.read(trajectory, solution.x) for place, trajectory in zip(layout.places, trajectories, strict=True)]
    told = ((found - unknowns.prior_mean) / unknowns.prior_sd)[free]
    return _Point(found, moved, solution.cost - 0.5 * float(np.sum(told**2)))


class _Walks:
    """The walks of one parameter to either side: points that were solved, and whether a side failed."""

    def __init__(self, unknowns: Unknowns, logs: list[LogData], best: _Point, index: int) -> None:
        self.unknowns, self.logs, self.best, self.index = unknowns, logs, best, index
        size = _size(unknowns, best.theta, index)
        self.steps = LOGARITHMS if unknowns.logarithmic[index] else tuple(share * size for share in SHARES)
        self.points: list[_Point] = []
        self.failed = {-1.0: False, 1.0: False}
        self.unsettled: list[float] = []  # where a fit claims something, and the solver fails

    def also(self, point: _Point) -> None:
        """Walk to either side from the point of another valley."""
        for sign in self.failed:
            self._walk(sign, point)

    def claimed(self, theta: Array, falls: list[Array]) -> bool:
        """Walk on from a theta (n_p,), if it is true that the data do not object to it; whether it is."""
        trajectories = _on_falls(self.unknowns, self.logs, falls, theta)
        point = None if trajectories is None else _solved(self.unknowns, self.logs, theta, trajectories, self.index)
        if point is None:
            self.unsettled.append(float(theta[self.index]))
            return False
        true = self._agrees(point)
        if true:
            self._walk(float(np.sign(self._off(point, 1.0))) or 1.0, point)
        return true

    def both_ways(self) -> None:
        """Walk to either side from the best point."""
        for sign in self.failed:
            self._walk(sign, self.best)

    def further(self, seen: Sequence[_Point]) -> bool:
        """Go on from points of other walks that the data do not object to, beyond where this one ended; whether any."""
        went = False
        for sign in self.failed:
            reached = max([self._off(p, sign) for p in self.points if self._agrees(p)], default=0.0)
            reached = max(reached, 0.0)
            if reached >= self.steps[-1] or (reached == 0.0 and not self.points):
                continue
            beyond = [p for p in seen if self._agrees(p) and self._off(p, sign) > max(FURTHER * reached, self.steps[0])]
            if beyond:
                went = True
                self._walk(sign, max(beyond, key=lambda p: self._off(p, sign)))
        return went

    def _off(self, point: _Point, sign: float) -> float:
        return float(sign * (point.theta[self.index] - self.best.theta[self.index]))

    def _agrees(self, point: _Point) -> bool:
        return 2.0 * (point.cost - self.best.cost) < OBJECTS

    def _walk(self, sign: float, here: _Point) -> None:
        """Step by step from a point until the data object or the solver fails."""
        self.failed[sign] = False
        if here is not self.best:
            self.points.append(here)
        for step in [s for s in self.steps if s > self._off(here, sign)]:
            target = self.best.theta[self.index] + sign * step
            point = self._held(here, target)
            if point is None:
                short = self._held(here, here.theta[self.index] + SHORTER * (target - here.theta[self.index]))
                if short is not None:
                    self.points.append(short)
                    point = self._held(short, target) if self._agrees(short) else short
            if point is None:
                self.failed[sign] = True
                return
            self.points.append(point)
            here = point
            if 2.0 * (point.cost - self.best.cost) > OBJECTS:
                return
        self._follow(sign, here)

    def _follow(self, sign: float, here: _Point) -> None:
        """Go on past an open end of a logarithm as long as the data do not object: its verdict is known, but these
        points show other parameters ways on."""
        for step in FARTHER if self.unknowns.logarithmic[self.index] and self._agrees(here) else ():
            if step <= self._off(here, sign):
                continue
            point = self._held(here, self.best.theta[self.index] + sign * step)
            if point is None or not self._agrees(point):
                return
            self.points.append(point)
            here = point

    def _held(self, near: _Point, value: float) -> _Point | None:
        theta = near.theta.copy()
        theta[self.index] = value
        return _solved(self.unknowns, self.logs, theta, near.trajectories, self.index)


def _size(unknowns: Unknowns, theta: Array, index: int) -> float:
    names = unknowns.names
    if names[index] == "delta_mu_k":
        return float(abs(theta[names.index("mu_s")] - theta[names.index("mu_k0")]))
    return float(abs(theta[index]))


def _truth(unknowns: Unknowns, log: LogData, best: _Point, name: str, walks: _Walks, seen: Sequence[_Point]) -> Truth:
    index = unknowns.names.index(name)
    logarithmic = bool(unknowns.logarithmic[index])
    # Of other walks' points only those count that the data do not object to: the profile lies below them.
    others = [p for p in seen if 2.0 * (p.cost - best.cost) < OBJECTS]
    rows = sorted([*walks.points, *others], key=lambda point: float(point.theta[index]))
    at = np.array([point.theta[index] for point in rows])
    root = np.sqrt(np.maximum([2.0 * (point.cost - best.cost) for point in rows], 0.0))
    ends, lost = [], False
    for sign, failed in walks.failed.items():
        mine = np.flatnonzero(sign * (at - best.theta[index]) >= 0.0)
        mine = mine if sign > 0 else mine[::-1]
        end = _end(at[mine], root[mine])
        ends.append(end)
        lost |= failed if end is None else any(sign * (claim - end) > 0.0 for claim in walks.unsettled)
    low, high = (None if end is None else float(log.base[index] * np.exp(end)) if logarithmic else end for end in ends)
    value = float(log.base[index] * np.exp(best.theta[index])) if logarithmic else float(best.theta[index])
    if logarithmic:
        return Truth(value, low, high, abs(value), logarithmic, lost)
    met = [_size(unknowns, point.theta, index) for point in (best, *others)]
    sizes = (min(met), max(met)) if name == "delta_mu_k" else None
    return Truth(value, low, high, met[0], logarithmic, lost, sizes)


def _end(at: Array, root: Array) -> float | None:
    """The last place at which the data stop to agree, going outwards; None where they agree at the last one."""
    limit = np.sqrt(OBJECTS)
    agree = np.flatnonzero(root < limit)
    last = int(agree[-1]) if agree.size else 0
    if last == at.size - 1:
        return None
    share = (limit - root[last]) / (root[last + 1] - root[last])
    return float(at[last] + share * (at[last + 1] - at[last]))
