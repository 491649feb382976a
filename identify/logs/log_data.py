"""What a fit takes of one log, and the trajectory behind it: event times and states at the shooting nodes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_io.arrays import thinned_steps
from identify.simulation.drive import Drive, NormalForce

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Grid:
    """Shooting intervals and RK4 steps per interval in the two parts of a slip: while the bounded state
    falls (`slip`), and once it is at its bound (`saturated`)."""

    slip: int = 8
    saturated: int = 4
    steps: int = 6


@dataclass(frozen=True)
class StickLoading:
    """How the sticks of a log load, as its cycles show it: friction over normal force at an onset, rate of the force
    [N/s]; and how long a slip takes [s]."""

    coefficient: float
    rate: float
    slip: float


def _own_or(shared: Array, own: Array) -> Array:
    """What a log has for itself, and what it shares where that is NaN; all is shared where own is empty."""
    return shared if own.size == 0 else np.where(np.isfinite(own), own, shared)


@dataclass(frozen=True)
class LogData:
    """One log as the estimator sees it: samples in the fitted window, rig and what acts from outside.

    time, force (n,) [s], [N] (sign of sliding positive), weight (n,) 1/variance [1/N^2], 0 where masked (the
    force there is finite, and says nothing);
    base (n_p,) base values of the parameters; own (n_p,) where the search starts a parameter that differs from log to
    log (NaN: as for all; empty: none does); drive_speed [m/s]; normal_force its slow course, known to within
    normal_force_sd [N] (0: exact), over time sd_course (None: the same throughout), tremor_sd [N] of it in fast rhythms
    (0: none), calm: these were taken out, blurred: for the reason that the measurement blurs them, expected [N]: where
    the normal force then lies about its course at the onset and at the end of a slip; loose [N]: by how much more it
    may be off at an onset, before which the mass may have moved unseen; strength_sd: of mu_s from stick to stick
    (0: the same in all); pull (None: no cycles were seen); the fitted window [s]; groups (n_p): the group of logs
    it shares each parameter with, "" for none; programme: the drive where it changes its speed within the window
    (None: drive_speed throughout).
    """

    time: Array
    force: Array
    weight: Array
    base: Array
    drive_speed: float
    normal_force: NormalForce
    normal_force_sd: float
    begin: float
    end: float
    own: Array = field(default_factory=lambda: np.empty(0))
    groups: tuple[str, ...] = ()
    programme: Drive | None = None
    tremor_sd: float = 0.0
    calm: bool = False
    blurred: bool = False
    sd_course: NormalForce | None = None
    loose: float = 0.0
    strength_sd: float = 0.0
    expected: tuple[float, float] = (0.0, 0.0)
    pull: StickLoading | None = None

    def theta(self, shared: Array) -> Array:
        """Theta (n_p,) of this log before the search."""
        return _own_or(shared, self.own)

    def speed_at(self, time: float) -> float:
        """Drive speed at a time [m/s]."""
        return self.drive_speed if self.programme is None else self.programme.at(time)

    def load_sd_at(self, time: ArrayLike) -> Array:
        """By how much the course of the normal force may be off at times [s], any shape [N]."""
        known = self.sd_course
        return np.full(np.shape(time), self.normal_force_sd) if known is None else known.at(time)

    def onset_load_sd_at(self, time: ArrayLike) -> Array:
        """By how much it may be off at onsets at times [s], any shape [N]."""
        return np.hypot(self.load_sd_at(time), self.loose)

    @property
    def noise(self) -> float:
        """Standard deviation of the noise of a sample that counts [N]."""
        return float(1.0 / np.sqrt(max(float(np.max(self.weight)), 1e-300)))

    @cached_property
    def interval(self) -> float:
        """How far samples lie apart [s]."""
        return float(np.median(thinned_steps(self.time)))

    @property
    def samples(self) -> int:
        """Number of samples that count."""
        return int(np.count_nonzero(self.weight[(self.time >= self.begin) & (self.time <= self.end)]))

    @property
    def mean_normal_force(self) -> float:
        """Mean normal force over the window [N]."""
        return float(np.mean(self.normal_force.at(np.linspace(self.begin, self.end, 101))))


@dataclass(frozen=True)
class Stretch:
    """One stretch of a motion that is no whole cycle: a rest, a part of a slide, or steady sliding.

    kind; until: its end [s]; ended_by: the guard that falls to zero there, or "time" where it is a time that is given
    (the drive changes, the window ends); nodes (n + 1, n_x) from its start to its end; of steady sliding (2 n, n_x),
    start and end of each of n pieces.
    """

    kind: Literal["rest", "slip", "saturated", "steady", "steady_saturated"]
    until: float
    ended_by: Literal["onset", "saturation", "release", "arrest", "time"]
    nodes: Array

    @property
    def steady(self) -> bool:
        """Whether the mass slides as fast as the drive."""
        return self.kind.startswith("steady")


@dataclass(frozen=True)
class ShootingTrajectory:
    """Event times and node states of one log, c cycles.

    start (n_x,): state at the begin of the window; onset, saturation, arrest (c,) [s], saturation NaN where
    the bounded state never reaches its bound; deviation (c,) of the normal force from its measured course [N];
    slip_deviation (s,): that in every slip from rest (`slip_parts`), where it has one of its own (empty: as at the
    onset);
    slip (c, n1 + 1, n_x) nodes from onset to
    saturation (or to arrest); saturated (c, n2 + 1, n_x) nodes from saturation to arrest; own (n_p,): search variables
    this log has for itself (NaN: shared with the others; empty: all are); tail: what follows the last cycle where that
    is not a rest up to the end (deviation then goes on, one for each slide); strength: theta of mu_s in every part
    (empty: as for all).
    """

    start: Array
    onset: Array
    saturation: Array
    arrest: Array
    deviation: Array
    slip: Array
    saturated: Array
    own: Array = field(default_factory=lambda: np.empty(0))
    tail: tuple[Stretch, ...] = ()
    slip_deviation: Array = field(default_factory=lambda: np.empty(0))
    strength: Array = field(default_factory=lambda: np.empty(0))

    def theta(self, shared: Array) -> Array:
        """Theta (n_p,) of this log."""
        return _own_or(shared, self.own)

    @property
    def cycles(self) -> int:
        """Number of slips."""
        return self.onset.size

    @property
    def times(self) -> Array:
        """When each phase after the first rest begins, and the last one ends [s], in the order of the motion."""
        times = np.stack([self.onset, self.saturation, self.arrest], axis=1)
        there = np.ones(times.shape, dtype=bool)
        there[:, 1] = self.saturates
        return np.concatenate([times[there], [stretch.until for stretch in self.tail]])

    @property
    def sticks(self) -> Array:
        """How long the mass sticks between slips (c - 1,) [s]."""
        return self.onset[1:] - self.arrest[:-1]

    @property
    def slips(self) -> Array:
        """How long the mass slides from an onset to the arrest after it [s]; of every slip that has both."""
        followed, begun = list[float](), np.nan
        for stretch in self.tail:
            if stretch.ended_by == "onset":
                begun = stretch.until
            elif stretch.ended_by == "arrest":
                followed.append(stretch.until - begun)
        told = np.array(followed)
        return np.concatenate([self.arrest - self.onset, told[np.isfinite(told)]])

    @property
    def arrests(self) -> int:
        """How often the mass comes to rest."""
        return self.cycles + sum(stretch.ended_by == "arrest" for stretch in self.tail)

    @cached_property
    def units(self) -> list[int]:
        """Number (from 0) of the part of the record that each stretch of the tail is in: a rest begins a new one."""
        out: list[int] = []
        for i, stretch in enumerate(self.tail):
            follows = i > 0 and not (stretch.kind == "rest" and self.tail[i - 1].kind != "rest")
            out.append(self.cycles if not out else out[-1] if follows else out[-1] + 1)
        return out

    @property
    def parts(self) -> int:
        """Number of parts of the record that are judged one by one: cycles, then slides."""
        return self.units[-1] + 1 if self.tail else self.cycles

    @property
    def loaded_at(self) -> Array:
        """When the deviation of the normal force counts in every part (p,) [s]: at the onset, or early in a slide."""
        first = {unit: stretch.until for unit, stretch in zip(self.units[::-1], self.tail[::-1], strict=True)}
        return np.append(self.onset, [first[unit] for unit in sorted(first)])

    @property
    def saturates(self) -> NDArray[np.bool_]:
        """Per cycle, whether the bounded state reaches its bound."""
        return np.isfinite(self.saturation)

    @property
    def sliding_deviation(self) -> Array:
        """Deviation of the normal force in every part (p,) [N] while the mass slides."""
        out, own = self.deviation.copy(), self.slip_deviation
        out[self.slip_parts[: own.size]] = own
        return out

    @property
    def own_slips(self) -> list[int]:
        """Places in the tail of the slips from rest in which the normal force may have a deviation of its own."""
        ends, tail = ("saturation", "arrest"), self.tail
        begun = [i for i in range(1, len(tail)) if tail[i - 1].ended_by == "onset"]
        return [i for i in begun if tail[i].kind == "slip" and tail[i].ended_by in ends]

    @property
    def slip_parts(self) -> NDArray[np.int64]:
        """Number of the part of the record of each such slip (s,), those of the cycles first."""
        units = self.units
        return np.array([*range(self.cycles), *(units[i] for i in self.own_slips)], dtype=np.int64)

    @property
    def slid_at(self) -> Array:
        """When the deviation of its own counts in each of them (s,) [s]."""
        return np.append(self.arrest, [self.tail[i].until for i in self.own_slips])
