"""A log rehearsed before it is recorded: simulated with the fitted parameters, and what it would tell of them.

The information of a log is the integral over time of the outer product of the slopes of its force with respect to the
parameters, times samples per second, over the variance of a sample (Fisher information of white noise); what is not
known of its start and of the load in each cycle is eliminated, as in a fit. The slopes are differences of the
simulator, which locates every switch. Motions are compared at the same share of the way from switch to switch, where
nothing kinks, and the slope at a fixed time follows from how far that moment has moved: compared at fixed times, a
switch that passes one bends the difference, and combinations of parameters that the log hardly tells look known.

A few cycles are simulated, and a longer log goes on with the last of them over and over: what moves the length of a
cycle moves the later ones by as much more each time. That the times of many slips tell their period better than slips
one by one is most of what a longer log tells of strength and ageing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io.speed_steps import Programme
from identify.base.budget import time_is_up
from identify.base.errors import SimulationError
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION
from identify.shooting.transcription import BOUNDED_START_SD
from identify.simulation.drive import Drive
from identify.simulation.plan import scales
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

CYCLES = 8  # that are simulated; the later ones are like the last
FOLLOWED = 40  # of those later ones, one by one: of more, each tells as much as these do on average, at least
SETTLES = 60.0  # times sqrt(m/k): a mass that slides so long after an onset slides on
STEADY = 15.0  # times that: the end of it, in which it is steady
MOST_CYCLES = 30  # of a programme, each of which has a normal force of its own
DOUBLED = 6  # times the duration is doubled until there are so many cycles
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(12)  # of a phase, at which the slopes are taken,
PIECE, MOST = 2.0, 400  # times sqrt(m/k): and of each piece of a long slide
EARLY = 0.02  # of a stick: when the normal force of its cycle begins
STEP = 1e-5  # of a logarithm, and of a spread, for the slopes
INSET = 5e-3  # of half a piece: the first point is twice that away from its end


@dataclass(frozen=True)
class LogDesign:
    """How a log is recorded: drive: its speed [m/s], or a programme of (start [s], speed [m/s]) that lasts `duration`
    [s] (0: as long as its cycles take); normal_force [N]; stiffness [N/m] of the spring, None: that of the rig."""

    drive: float | Programme
    normal_force: float
    stiffness: float | None = None
    duration: float = 0.0

    @property
    def speed(self) -> float:
        """The fastest [m/s]."""
        return max(speed for _, speed in self.drive) if isinstance(self.drive, tuple) else self.drive

    @property
    def holds(self) -> tuple[float, ...]:
        """How long the drive stands in between [s]."""
        if not isinstance(self.drive, tuple):
            return ()
        ends = [*(start for start, _ in self.drive[1:]), self.duration]
        return tuple(end - start for (start, speed), end in zip(self.drive, ends, strict=True) if speed == 0.0)


@dataclass(frozen=True)
class Again:
    """How a log goes on: with its last cycle from moment `since` (of the t) on, of `period` [s], again and again.

    later (l, f + s): what a further cycle adds to the slopes with respect to theta and start, as a cycle that is longer
    puts off all that comes after it.
    """

    since: int
    period: float
    later: Array

    def followed(self, slopes: Array, weights: Array, shared: int, count: int) -> tuple[Array, Array]:
        """Slopes and weights with so many cycles more, of which `shared` columns belong to all of the log.

        The normal force of a cycle acts on those after it as that of an earlier one does on the last that was
        simulated: it moves them, all by the same.
        """
        last, long = slopes[self.since :], slopes.shape[1] - shared
        out = np.zeros((slopes.shape[0] + count * len(last), slopes.shape[1] + count))
        out[: slopes.shape[0], : slopes.shape[1]] = slopes
        for i in range(1, count + 1):
            rows = slice(slopes.shape[0] + (i - 1) * len(last), slopes.shape[0] + i * len(last))
            out[rows, :shared] = last[:, :shared] + i * self.later
            # Loads long past move all that comes alike; that of the first cycle, which is another one, by its own.
            columns = np.maximum(np.arange(long + i) - i, 1)
            columns[0] = 0
            out[rows, shared : shared + long + i] = last[:, shared + columns]
        return out, np.concatenate([weights, np.tile(weights[self.since :], count)])


@dataclass(frozen=True)
class Rehearsal:
    """What a log of a design would be: its duration [s], slips in it, how long one takes [s], by how much the force
    drops in one [N] and its slopes (f,) with respect to the free theta.

    slopes (t, f + s + c): of the force with respect to the f free theta, to the s unknowns of the start (how far the
    spring is loaded, how fresh the contact is), and to the normal force [N] in each of c cycles; weights (t,): seconds
    that each counts for; start_sd (s,): what a fit takes the unknowns of the start to be within; again: how it goes on,
    None where it does not repeat.
    """

    design: LogDesign
    duration: float
    slips: int
    slip: float
    drop: float
    drop_slopes: Array
    slopes: Array
    weights: Array
    start_sd: Array
    again: Again | None

    def information(self, rate: float, variance: float, load_sd: float, times: float = 1.0) -> Array:
        """Information (f, f) of the free theta.

        Args:
            rate: samples that count per second; variance: of each [N^2]; load_sd: error of the normal force [N],
                another one in each cycle (0: none); times: as long a log as so many of these.
        """
        slopes, weights, duration = self.slopes, self.weights, self.duration
        if self.again is not None and times > 1.0:
            count = min(round((times - 1.0) * duration / self.again.period), FOLLOWED)
            slopes, weights = self.again.followed(slopes, weights, self.shared, count)
            duration += count * self.again.period
        return times * self.duration / duration * self._of(slopes, weights * (rate / variance), load_sd)

    @property
    def shared(self) -> int:
        """Columns of the slopes that are no normal force of a cycle: f + s."""
        return self.drop_slopes.size + self.start_sd.size

    def _of(self, slopes: Array, weights: Array, load_sd: float) -> Array:
        """Information (f, f) of the free theta, with start and loads eliminated."""
        f, first = self.drop_slopes.size, self.shared
        count = slopes.shape[1] if load_sd > 0.0 else first
        total = slopes[:, :count].T @ (slopes[:, :count] * weights[:, None])
        total[np.arange(f, first), np.arange(f, first)] += self.start_sd**-2
        total[np.arange(first, count), np.arange(first, count)] += load_sd**-2 if load_sd > 0.0 else 0.0
        scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
        scaled = total * np.outer(scale, scale)
        across, own = scaled[:f, f:], scaled[f:, f:]
        left = scaled[:f, :f] - across @ np.linalg.pinv(own, 1e-13, hermitian=True) @ across.T
        return np.asarray(left / np.outer(scale[:f], scale[:f]))


def rehearse(
    unknowns: Unknowns, theta: Array, base: Array, design: LogDesign, distance: float, longest: float
) -> Rehearsal | None:
    """The log of a design, from rest with a fresh contact; None where nothing slips within `longest` [s], the spring
    pulls the mass back after a slip, which no fit follows, the model refuses, or the time is up.

    Args:
        theta (n_p,), base (n_p,): the values it is simulated with, of the rig with the spring of the design.
        distance: [m] that the drive moves in one cycle, roughly.
    """
    if time_is_up():
        return None
    model, normal_force, told = unknowns.model, design.normal_force, bool(design.duration)

    def motion(at: Array, load: float | tuple[Array, Array], start: dict[str, float] | None = None) -> Trajectory:
        values = dict(zip(unknowns.names, unknowns.values(at, base).tolist(), strict=True))
        return run(model, values, design.drive, load, duration, start=start)

    typical = scales(model, unknowns.values(theta, base), normal_force)
    time, elongation = typical.time, float(typical.state[ELONGATION])
    duration = design.duration or min(CYCLES * distance / design.speed, longest)
    try:
        for _ in range(DOUBLED):
            seen = motion(theta, normal_force)
            if told or seen.onsets.size > CYCLES or _slides_on(seen, time) or duration == longest:
                break
            duration = min(2.0 * duration, longest)
        if not seen.onsets.size or not _in_turn(seen) or (told and seen.onsets.size > MOST_CYCLES):
            return None
        until = seen.duration if told else _end(seen, time)
        arrests = seen.arrests[seen.arrests <= until]
        lengths = arrests - seen.onsets[: arrests.size]
        slip = float(np.median(lengths)) if arrests.size else 2.0 * np.pi * time
        drive = Drive.of(design.drive).changes(0.0, until)
        times, weights, beside = _moments(seen, until, time, drive)
        before, force, after = (seen.sample(at)["force"] for at in (times - beside, times, times + beside))
        rate = (after - before) / (2.0 * beside)

        def slope(other: Trajectory, step: float, changes: Sequence[float] = ()) -> Array:
            there = _same_moments(seen, other, times, until, (*drive, *changes))
            return np.asarray((other.sample(there)["force"] - force - rate * (there - times)) / step)

        def lengthens(other: Trajectory, step: float) -> float:
            return (_period(other) - _period(seen)) / step

        slopes, periods, drop, drop_slopes, start_sd = list[Array](), list[float](), _drop(seen), [], []
        for index in np.flatnonzero(unknowns.free).tolist():
            at = theta.copy()
            step = STEP * (1.0 if unknowns.logarithmic[index] else float(unknowns.spread[index]))
            at[index] += step
            other = motion(at, normal_force)
            slopes.append(slope(other, step))
            periods.append(lengthens(other, step))
            drop_slopes.append((_drop(other) - drop) / step)
        for i, state in enumerate(model.states):
            if i == ELONGATION or state.lower is not None:
                # The spring can only be loaded already, and the contact only be older.
                step = STEP * (elongation if i == ELONGATION else 1.0)
                other = motion(theta, normal_force, {state.name: state.start + step})
                slopes.append(slope(other, step))
                periods.append(lengthens(other, step))
                start_sd.append(np.inf if i == ELONGATION else BOUNDED_START_SD)
        for changes, on in _cycle_by_cycle(seen, until):
            other = motion(theta, (changes, normal_force * (1.0 + STEP * on)))
            slopes.append(slope(other, STEP * normal_force, changes.tolist()))
    except SimulationError:
        return None
    moves = np.column_stack(slopes)
    if not arrests.size:  # of a log that slides a fit may take the level only
        weights[times < until - STEADY * time] = 0.0
    if not np.all(np.isfinite(moves)):
        return None
    again = None
    if not told and seen.onsets.size > CYCLES:
        since = int(np.searchsorted(times, seen.onsets[CYCLES - 1]))
        again = Again(since, _period(seen), -np.outer(rate[since:], periods))
    return Rehearsal(
        design,
        until,
        int(arrests.size),
        slip,
        drop,
        np.array(drop_slopes),
        moves,
        weights,
        np.array(start_sd),
        again,
    )


def at_rest(unknowns: Unknowns, theta: Array, base: Array, design: LogDesign, times: Array) -> Array:
    """How far times (n,) [s] after the last step of a drive are from the slips before and after, as shares of the stick
    that they lie in (n,); 0 while nothing has slipped since, within a slip, and where the model refuses.

    Args:
        theta (n_p,), base (n_p,): as in `rehearse`.
    """
    values = dict(zip(unknowns.names, unknowns.values(theta, base).tolist(), strict=True))
    assert isinstance(design.drive, tuple)
    try:
        seen = run(unknowns.model, values, design.drive, design.normal_force, float(times[-1]))
    except SimulationError:
        return np.zeros(times.size)
    arrests = seen.arrests[seen.arrests > design.drive[-1][0]]
    last = np.searchsorted(arrests, times) - 1
    began = np.where(last >= 0, np.append(arrests, np.inf)[last], np.inf)
    ends = np.append(seen.onsets, np.inf)[np.searchsorted(seen.onsets, began)]
    ends = np.minimum(ends, seen.duration)
    with np.errstate(invalid="ignore"):
        share = np.minimum(times - began, ends - times) / (ends - began)
    return np.asarray(np.where(np.isfinite(began), np.clip(np.nan_to_num(share), 0.0, 0.5), 0.0))


def _period(seen: Trajectory) -> float:
    """How long the last cycle takes that counts [s]; 0 where there are fewer."""
    return float(seen.onsets[CYCLES] - seen.onsets[CYCLES - 1]) if seen.onsets.size > CYCLES else 0.0


def _drop(seen: Trajectory) -> float:
    """Mean force at onsets above that at the arrests after them [N]; 0 without a slip."""
    count = min(seen.onsets.size, seen.arrests.size)
    first = 1 if count > 1 else 0  # the one from a fresh contact is another one
    peaks, valleys = (seen.sample(times[first:count])["force"] for times in (seen.onsets, seen.arrests))
    return float(np.mean(peaks - valleys)) if count else 0.0


def _cycle_by_cycle(seen: Trajectory, until: float) -> list[tuple[Array, Array]]:
    """For every cycle, times [s] and what is added to the normal force there: 1 within it, 0 outside. It changes early
    in a stick, where the force does not feel it."""
    arrests = seen.arrests[seen.arrests < until]
    ends = np.append(seen.onsets, seen.duration)[1 : arrests.size + 1]
    changes = [(a + EARLY * (end - a), a + 2.0 * EARLY * (end - a)) for a, end in zip(arrests, ends, strict=True)]
    out = []
    for i in range(len(changes) + 1):
        at, on = ([0.0], [1.0]) if i == 0 else ([0.0, *changes[i - 1]], [0.0, 0.0, 1.0])
        if i < len(changes):
            at, on = [*at, *changes[i]], [*on, 1.0, 0.0]
        out.append((np.array(at), np.array(on)))
    return out


def _in_turn(seen: Trajectory) -> bool:
    """Whether every slip ends in the stick after it; a mass that is pulled back comes to rest more than once."""
    onsets, arrests = seen.onsets, seen.arrests
    late = onsets[1 : arrests.size + 1]
    return bool(
        arrests.size in (onsets.size, onsets.size - 1)
        and np.all(arrests > onsets[: arrests.size])
        and np.all(arrests[: late.size] < late)
    )


def _slides_on(seen: Trajectory, time: float) -> bool:
    """Whether the mass has been sliding for so long that it will not come to rest."""
    if not seen.onsets.size or seen.arrests.size == seen.onsets.size:
        return False
    return bool(seen.duration - seen.onsets[-1] > SETTLES * time)


def _end(seen: Trajectory, time: float) -> float:
    """The end of the log [s]: an onset, the end of what a slide tells, or that of the simulation."""
    if seen.onsets.size > CYCLES:
        return float(seen.onsets[CYCLES])
    if _slides_on(seen, time):
        return float(seen.onsets[-1] + SETTLES * time)
    return seen.duration


def _moments(seen: Trajectory, until: float, time: float, changes: Sequence[float]) -> tuple[Array, Array, Array]:
    """Rising times [s] within the stretches between switches and changes of the drive, until there; their weights [s]
    of Gauss's rule; and for how long about each the motion is smooth [s], at least."""
    starts = np.array([phase.start for phase in seen.phases])
    ends = np.unique([0.0, until, *changes, *starts[starts < until]])
    pieces = []
    for begin, end in itertools.pairwise(ends.tolist()):
        stick = seen.phases[int(np.searchsorted(starts, begin, side="right")) - 1].mode == "stick"
        count = 1 if stick else min(math.ceil((end - begin) / (PIECE * time)), MOST)
        pieces.append(np.linspace(begin, end, count + 1))
    edges = np.unique(np.concatenate(pieces))
    half = 0.5 * np.diff(edges)[:, None]
    times, weights = edges[:-1, None] + half * (1.0 + POINTS), half * WEIGHTS
    return times.ravel(), weights.ravel(), np.broadcast_to(INSET * half, times.shape).ravel()


def _same_moments(seen: Trajectory, other: Trajectory, times: Array, until: float, changes: Sequence[float]) -> Array:
    """The moments of another motion [s] that correspond to times of this one: as far on the way from switch to switch,
    and to what changes at a set time.

    Raises:
        SimulationError: the other one does not switch alike.
    """
    ours, theirs = ([(p.start + p.duration, p.ended_by) for p in m.phases if p.ended_by] for m in (seen, other))
    count = sum(at < until for at, _ in ours) + 1
    knots = []
    for switches in (ours[:count], theirs[: len(ours[:count])]):
        fixed = [(at, None) for at in {0.0, seen.duration, *changes}]
        knots.append(sorted([*switches, *fixed], key=lambda knot: knot[0]))
    (at, what), (there, alike) = (zip(*knot, strict=True) for knot in knots)
    if what != alike:
        raise SimulationError("a motion that is a little off has other switches")
    return np.interp(times, at, there)
