"""What acts on the oscillator from outside: drive speed and normal force over time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.errors import SimulationError
from identify.scene.tables import Course
from identify.scene.values import DriveSpeed

Array = NDArray[np.float64]


PIECES = 1500  # of a period of a sine: its position is then off by 1e-9 of the amplitude
FITTED_PIECES = 120  # of one that is fitted: by 1e-6


@dataclass(frozen=True)
class Drive:
    """Drive speed, piecewise linear: `speeds[i]` [m/s] holds from `starts[i]` [s] on (starts[0] = 0), and changes by
    `accelerations[i]` [m/s^2] until the next start; without accelerations (empty) it is piecewise constant."""

    starts: tuple[float, ...]
    speeds: tuple[float, ...]
    accelerations: tuple[float, ...] = ()

    @staticmethod
    def of(speed: DriveSpeed | Drive, until: float = 0.0, pieces: int = PIECES) -> Drive:
        """A constant speed [m/s], a programme of (start [s], speed [m/s]) pairs, or a course up to a time [s], a period
        of a sine in so many pieces.

        Raises:
            SimulationError: a programme that does not begin at 0 s, whose starts do not rise, or that is not finite.
        """
        if isinstance(speed, Drive):
            return speed
        if isinstance(speed, Course):
            return Drive._along(speed, until, pieces)
        if not isinstance(speed, tuple):
            speed = ((0.0, float(speed)),)
        starts = tuple(float(pair[0]) for pair in speed)
        if not starts or starts[0] != 0.0 or any(b <= a for a, b in pairwise(starts)):
            raise SimulationError(
                f"the drive programme starts at {starts} s; expected rising times from 0: begin it with [0, speed]"
            )
        speeds = tuple(float(pair[1]) for pair in speed)
        if not np.all(np.isfinite([*starts, *speeds])):
            raise SimulationError(f"the drive runs at {speeds} m/s from {starts} s; expected finite numbers")
        return Drive(starts, speeds)

    @staticmethod
    def _along(course: Course, until: float, pieces: int) -> Drive:
        """The speeds of a course on knots, joined by straight lines; those of a sine are such that its position is met
        at every knot."""
        if course.sine is None:
            starts, speeds = (np.array(column) for column in zip(*course.ramps, strict=True))
        else:
            amplitude, frequency, phase = course.sine
            half = np.pi / pieces
            starts = np.arange(int(np.ceil(until * frequency * pieces)) + 2) / (frequency * pieces)
            peak = amplitude * 2.0 * np.pi * frequency * np.tan(half) / half
            speeds = peak * np.cos(2.0 * np.pi * frequency * starts + phase)
        accelerations = np.append(np.diff(speeds) / np.diff(starts), 0.0)
        return Drive(tuple(starts.tolist()), tuple(speeds.tolist()), tuple(accelerations.tolist()))

    @property
    def constant(self) -> bool:
        """Whether one speed holds throughout."""
        return len(self.speeds) == 1

    @property
    def paces(self) -> tuple[tuple[float, float], ...]:
        """Pairs of start [s] and speed [m/s]; of a course its highest speed alone."""
        if self.accelerates:
            return ((0.0, max(map(abs, self.speeds))),)
        return tuple(zip(self.starts, self.speeds, strict=True))

    @property
    def accelerates(self) -> bool:
        """Whether the speed changes gradually, and not by steps."""
        return any(self.accelerations)

    def at(self, t: float) -> float:
        """Speed [m/s] at time t [s] (at a start: the new speed)."""
        return self.line(t)[0]

    def line(self, t: float) -> tuple[float, float]:
        """Speed [m/s] and acceleration [m/s^2] just after t [s]."""
        if len(self.speeds) == 1:
            return self.speeds[0], 0.0
        i = bisect_right(self.starts, t) - 1
        if not self.accelerations:
            return self.speeds[i], 0.0
        return self.speeds[i] + self.accelerations[i] * (t - self.starts[i]), self.accelerations[i]

    @cached_property
    def knots(self) -> tuple[Array, Array, Array, Array]:
        """Starts [s], speeds [m/s] and accelerations [m/s^2] there, and positions [m] from that at 0 s, as arrays."""
        starts, speeds = np.array(self.starts), np.array(self.speeds)
        accelerations = np.array(self.accelerations or np.zeros(starts.size))
        spans = np.diff(starts)
        moved = (speeds[:-1] + 0.5 * accelerations[:-1] * spans) * spans
        return starts, speeds, accelerations, np.concatenate([[0.0], np.cumsum(moved)])

    def motion(self, t: ArrayLike) -> tuple[Array, Array]:
        """Position [m] from that at 0 s, and speed [m/s], at times t [s], any shape."""
        starts, speeds, accelerations, positions = self.knots
        times = np.asarray(t, float)
        i = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        past = times - starts[i]
        moved = positions[i] + (speeds[i] + 0.5 * accelerations[i] * past) * past
        return moved, speeds[i] + accelerations[i] * past

    def changes(self, begin: float, end: float) -> list[float]:
        """When the speed or its rate changes between two times [s], neither of them counted."""
        return list(self.starts[bisect_right(self.starts, begin) : bisect_left(self.starts, end)])

    @property
    def turns(self) -> bool:
        """Whether it goes both ways."""
        return min(self.speeds) < 0.0 < max(self.speeds)

    def between(self, begin: float, end: float, zero: float = 0.0, sign: float = 1.0) -> Drive:
        """The course between two times [s], level before and after them; times counted from `zero` [s], speeds times a
        sign."""
        times = [begin, *self.changes(begin, end)]
        lines = [self.line(t) for t in times]
        starts, speeds = [*(t - zero for t in times), end - zero], [*(v for v, _ in lines), float(self.motion(end)[1])]
        accelerations = [*(a for _, a in lines), 0.0]
        if starts[0] > 0.0:
            starts, speeds, accelerations = [0.0, *starts], [speeds[0], *speeds], [0.0, *accelerations]
        return Drive(tuple(starts), tuple(sign * v for v in speeds), tuple(sign * a for a in accelerations))

    def within(self, begin: float, end: float) -> list[tuple[float, float]]:
        """(since [s], speed [m/s]) of what holds at `begin` (before 0 s: the first speed) and from each change on."""
        return [(begin, self.at(max(begin, 0.0))), *((t, self.at(t)) for t in self.changes(begin, end))]


@dataclass(frozen=True)
class NormalForce:
    """Normal force, continuous and piecewise linear through (times [s], values [N]), level outside them."""

    times: tuple[float, ...]
    values: tuple[float, ...]

    @staticmethod
    def of(force: float | NormalForce | tuple[ArrayLike, ArrayLike]) -> NormalForce:
        """A constant force [N], or (times, values).

        Raises:
            SimulationError: a force that is not positive and finite, or times that do not rise.
        """
        if isinstance(force, NormalForce):
            return force
        times, values = ((0.0,), (force,)) if not isinstance(force, tuple) else force
        t, f = np.atleast_1d(np.asarray(times, float)), np.atleast_1d(np.asarray(values, float))
        if t.shape != f.shape or not np.all(np.diff(t) > 0) or not np.all(np.isfinite(t)):
            raise SimulationError(f"normal force has {f.size} values at {t.size} times; give one value per rising time")
        if not np.all(np.isfinite(f)):
            raise SimulationError(f"the normal force has the value {f[~np.isfinite(f)][0]}; expected finite forces [N]")
        if np.any(f <= 0):
            raise SimulationError(
                f"the normal force falls to {np.min(f):.3g} N at {t[np.argmin(f)]:.6g} s: lift-off is not simulated; "
                "give a positive normal force"
            )
        return NormalForce(tuple(t.tolist()), tuple(f.tolist()))

    def at(self, t: ArrayLike) -> Array:
        """Force [N] at times t [s], any shape."""
        return np.asarray(np.interp(np.asarray(t, float), *self.knots))

    @cached_property
    def knots(self) -> tuple[Array, Array]:
        """Times [s] and values [N] as arrays: a measured load has tens of thousands, and is asked as often."""
        return np.array(self.times), np.array(self.values)

    def between(self, begin: float, end: float) -> tuple[Array, Array]:
        """Times and values of the knots between two times [s], neither of them counted."""
        inner = slice(bisect_right(self.times, begin), bisect_left(self.times, end))
        return self.knots[0][inner], self.knots[1][inner]

    def mean(self, begin: float, end: float) -> float:
        """Mean force [N] between two times [s], exactly."""
        if len(self.values) == 1 or end <= begin:
            return float(self.at(begin))
        times = np.array([begin, *self.between(begin, end)[0], end])
        return float(np.trapezoid(self.at(times), times) / (end - begin))

    def line(self, t: float) -> tuple[float, float]:
        """Force [N] and its slope [N/s] just after t [s]."""
        if len(self.times) == 1:
            return self.values[0], 0.0
        i = bisect_right(self.times, t) - 1
        if i < 0 or i >= len(self.times) - 1:
            return float(self.at(t)), 0.0
        return float(self.at(t)), (self.values[i + 1] - self.values[i]) / (self.times[i + 1] - self.times[i])


def breaks(drive: Drive, normal_force: NormalForce, duration: float) -> Array:
    """Times [s] within (0, duration) at which a speed or a force slope changes, rising, then the duration."""
    inner = [t for t in (*drive.starts, *normal_force.times) if 0.0 < t < duration]
    return np.array([*sorted(set(inner)), duration])
