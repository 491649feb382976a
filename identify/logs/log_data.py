"""What a fit takes of one log."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_io.arrays import thinned_steps
from identify.simulation.drive import Drive, NormalForce

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StickLoading:
    """How the sticks of a log load, as its cycles show it: friction over normal force at an onset, rate of the force
    [N/s]; and how long a slip takes [s]."""

    coefficient: float
    rate: float
    slip: float


def own_or(shared: Array, own: Array) -> Array:
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
        return own_or(shared, self.own)

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
