"""The force of one simulated cycle as a function of time: stick line, slip, stick line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def middle_of_fall(force: Array, h: Array, duration: Array) -> Array:
    """Time of the mid-fall crossing of each lane's simulated force (n, steps) [s]."""
    steps = np.arange(force.shape[1])[None, :]
    inside = steps * h[:, None] <= duration[:, None] + h[:, None]
    shown = np.where(inside, force, np.nan)
    rows = np.arange(force.shape[0])
    with np.errstate(all="ignore"):
        top = np.nanargmax(np.where(np.isnan(shown), -np.inf, shown), axis=1)
        level = 0.5 * (np.nanmax(shown, axis=1) + np.nanmin(shown, axis=1))
    below = (force <= level[:, None]) & (steps > top[:, None]) & inside
    after = np.maximum(np.argmax(below, axis=1), 1)
    f0, f1 = force[rows, after - 1], force[rows, after]
    w = np.clip(np.where(f0 > f1, (f0 - level) / np.where(f0 > f1, f0 - f1, 1.0), 0.5), 0.0, 1.0)
    return np.asarray((after - 1 + w) * h)


@dataclass(frozen=True)
class Waves:
    """The force of simulated cycles as a function of time from their onset: stick line, slip, stick line.

    h (n,) step lengths [s]; duration (n,) of the slips [s]; start, end (n,) force at their ends [N]; slope (n,) of the
    sticks [N/s]; cubics (4, n * s): coefficients of the powers of the share of every step that has passed.
    """

    h: Array
    duration: Array
    start: Array
    end: Array
    slope: Array
    cubics: Array

    @staticmethod
    def of(force: Array, h: Array, duration: Array, end: Array, slope: Array) -> Waves:
        """From the force at the steps (n, s + 1); cubic through the neighbours' slopes: the steps are coarse."""
        around = np.concatenate([force[:, :1], force, force[:, -1:]], axis=1)
        tilt = 0.5 * (around[:, 2:] - around[:, :-2])
        rise, first, last = np.diff(force, axis=1), tilt[:, :-1], tilt[:, 1:]
        bends = [force[:, :-1], first, 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise]
        return Waves(h, duration, force[:, 0], end, slope, np.stack(bends).reshape(4, -1))

    def values(self, t: Array) -> Array:
        """Force (n, b) at times t (n, b) from the onset of each cycle."""
        return self._shown(t, *self._within(t))

    def with_rates(self, t: Array) -> tuple[Array, Array]:
        """Force (n, b) at times t (n, b) from the onset of each cycle, and its rates [N/s]."""
        c, w = self._within(t)
        rate = ((3.0 * c[3] * w + 2.0 * c[2]) * w + c[1]) / self.h[:, None]
        return self._shown(t, c, w), np.where((t < 0.0) | (t > self.duration[:, None]), self.slope[:, None], rate)

    def _within(self, t: Array) -> tuple[Array, Array]:
        """The coefficients (4, n, b) of the step in which each time is, and the share of it that has passed."""
        lanes = self.h.size
        steps = self.cubics.shape[1] // lanes
        u = np.clip(t / self.h[:, None], 0.0, steps - 1e-6)
        i = u.astype(np.int64)
        w = u - i
        i += steps * np.arange(lanes)[:, None]
        return np.take(self.cubics, i, axis=1), w

    def _shown(self, t: Array, c: Array, w: Array) -> Array:
        """The force (n, b) in the slip, by what `_within` gives, and on the lines before and after it."""
        slip = ((c[3] * w + c[2]) * w + c[1]) * w + c[0]
        s = self.slope[:, None]
        late = t - self.duration[:, None]
        value = np.where(late > 0.0, self.end[:, None] + s * late, slip)
        return np.where(t < 0.0, self.start[:, None] + s * t, value)
