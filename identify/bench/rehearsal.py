"""A log rehearsed before it is recorded: simulated with the fitted parameters, and what it would tell of them.

The information of a log is the integral over time of the outer product of the slopes of its force with respect to the
parameters, times samples per second, over the variance of a sample (Fisher information of white noise); what is not
known of its start and of the load in each cycle is eliminated, as in a fit. The slopes are differences of the
simulator, which locates every switch: the force has no jump that they would miss.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io.speed_steps import Programme
from identify.base.errors import SimulationError
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION
from identify.simulation.drive import Drive
from identify.simulation.plan import scales
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

CYCLES = 6  # that are simulated: of more, each tells as much as these do on average, at least
SETTLES = 60.0  # times sqrt(m/k): a mass that slides so long after an onset slides on
STEADY = 15.0  # times that: the end of it, in which it is steady
MOST_CYCLES = 30  # of a programme, each of which has a normal force of its own
DOUBLED = 6  # times the duration is doubled until there are so many cycles
IN_SLIP, IN_STICK = 48, 12  # moments of a phase at which the slopes are taken,
PER_TIME, MOST = 8, 4000  # and per sqrt(m/k) of a long slide
EARLY = 0.02  # of a stick: when the normal force of its cycle begins
SHIFT = 1e-3  # of a slip: by how much events move at most for the slopes,
SMALL = 1e-8, 1e-5  # by steps of a logarithm, and of a spread, that are as small and as large


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
class Rehearsal:
    """What a log of a design would be: its duration [s], slips in it, how long one takes [s], by how much the force
    drops in one [N] and its slopes (f,) with respect to the free theta.

    gram (f + s + c, f + s + c): integrals over time of the products of the slopes of the force, with respect to the f
    free theta, to the s unknowns of the start (how far the spring is loaded, how fresh the contact is), and to the
    normal force [N] in each of c cycles; settled (the same shape): over the time after the first slip, `lasts` [s]: the
    first stick, from an unloaded spring and a fresh contact, is another one and comes once.
    """

    design: LogDesign
    duration: float
    slips: int
    slip: float
    drop: float
    drop_slopes: Array
    gram: Array
    settled: Array
    lasts: float
    free: int
    cycles: int

    def information(self, rate: float, variance: float, load_sd: float, times: float = 1.0) -> Array:
        """Information (f, f) of the free theta.

        Args:
            rate: samples that count per second; variance: of each [N^2]; load_sd: error of the normal force [N],
                another one in each cycle (0: none); times: as long a log as so many of these.
        """
        once = self._of(self.gram, rate / variance, load_sd)
        if times <= 1.0 or self.lasts == 0.0:
            return times * once
        return once + (times - 1.0) * self.duration / self.lasts * self._of(self.settled, rate / variance, load_sd)

    def _of(self, gram: Array, density: float, load_sd: float) -> Array:
        """Information (f, f) of the free theta, with start and loads eliminated."""
        count = gram.shape[0] - (0 if load_sd > 0.0 else self.cycles)
        total = gram[:count, :count] * density
        if load_sd > 0.0:
            loads = np.arange(count - self.cycles, count)
            total[loads, loads] += load_sd**-2
        f = self.free
        scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
        scaled = total * np.outer(scale, scale)
        across, own = scaled[:f, f:], scaled[f:, f:]
        left = scaled[:f, :f] - across @ np.linalg.pinv(own, 1e-13, hermitian=True) @ across.T
        return np.asarray(left / np.outer(scale[:f], scale[:f]))


def rehearse(
    unknowns: Unknowns, theta: Array, base: Array, design: LogDesign, distance: float, longest: float
) -> Rehearsal | None:
    """The log of a design, from rest with a fresh contact; None where nothing slips within `longest` [s], the spring
    pulls the mass back after a slip, which no fit follows, or the model refuses.

    Args:
        theta (n_p,), base (n_p,): the values it is simulated with, of the rig with the spring of the design.
        distance: [m] that the drive moves in one cycle, roughly.
    """
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
        times = _moments(seen, until, time, Drive.of(design.drive).changes(0.0, until))
        arrests = seen.arrests[seen.arrests <= until]
        lengths = arrests - seen.onsets[: arrests.size]
        slip = float(np.median(lengths)) if arrests.size else 2.0 * np.pi * time
        small = float(np.clip(SHIFT * slip * design.speed / elongation, *SMALL))

        def slope(up: Trajectory, down: Trajectory, step: float) -> Array:
            return np.asarray((up.sample(times)["force"] - down.sample(times)["force"]) / step)

        slopes, drop_slopes = [], []
        for index in np.flatnonzero(unknowns.free).tolist():
            step = np.zeros(theta.size)
            step[index] = small * (1.0 if unknowns.logarithmic[index] else unknowns.spread[index])
            up, down = motion(theta + step, normal_force), motion(theta - step, normal_force)
            slopes.append(slope(up, down, 2 * step[index]))
            drop_slopes.append((_drop(up) - _drop(down)) / (2 * step[index]))
        for i, state in enumerate(model.states):
            if i == ELONGATION or state.lower is not None:
                # The spring can only be loaded already, and the contact only be older.
                ahead = small * (elongation if i == ELONGATION else 1.0)
                slopes.append(slope(motion(theta, normal_force, {state.name: state.start + ahead}), seen, ahead))
        begun = len(slopes)
        for at, on in _cycle_by_cycle(seen, until):
            more, less = (motion(theta, (at, normal_force * (1.0 + sign * small * on))) for sign in (1.0, -1.0))
            slopes.append(slope(more, less, 2.0 * small * normal_force))
    except SimulationError:
        return None
    moves, weights = np.column_stack(slopes), _weights(times)
    if not arrests.size:  # of a log that slides a fit may take the level only
        weights[times < until - STEADY * time] = 0.0
    gram = moves.T @ (moves * weights[:, None])
    if not np.all(np.isfinite(gram)):
        return None
    begin = float(arrests[0]) if arrests.size > 1 else until
    after = moves[times >= begin]
    settled = after.T @ (after * weights[times >= begin, None])
    return Rehearsal(
        design,
        until,
        int(arrests.size),
        slip,
        _drop(seen),
        np.array(drop_slopes),
        gram,
        settled,
        until - begin,
        len(drop_slopes),
        len(slopes) - begun,
    )


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


def _moments(seen: Trajectory, until: float, time: float, changes: Sequence[float]) -> Array:
    """Rising times [s] that follow every phase until there, and the changes of the drive."""
    out = [np.array([0.0, *changes, until])]
    for phase in seen.phases:
        if phase.start >= until:
            break
        fewest = IN_STICK if phase.mode == "stick" else int(PER_TIME * phase.duration / time)
        count = fewest if phase.mode == "stick" else min(max(IN_SLIP, fewest), MOST)
        out.append(np.linspace(phase.start, min(phase.start + phase.duration, until), count))
    return np.unique(np.concatenate(out))


def _weights(times: Array) -> Array:
    """Weights [s] of the trapezoidal rule."""
    steps = np.diff(times)
    return np.concatenate([[0.5 * steps[0]], 0.5 * (steps[1:] + steps[:-1]), [0.5 * steps[-1]]])
