"""The force of one simulated cycle as a function of time: stick line, slip, stick line."""

from __future__ import annotations

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


def waveform(force: Array, h: Array, duration: Array, end_force: Array, slope: Array, t: Array) -> tuple[Array, Array]:
    """Stick line, slip, stick line at times t (n, b) from the onset: values and slopes; cubic between steps."""
    u = np.clip(t / h[:, None], 0.0, force.shape[1] - 1.000001)
    i = u.astype(int)
    rows = np.arange(force.shape[0])[:, None]
    f0, f1 = force[rows, i], force[rows, i + 1]
    # Cubic through the neighbours' slopes: the steps are coarse.
    before, after = force[rows, np.maximum(i - 1, 0)], force[rows, np.minimum(i + 2, force.shape[1] - 1)]
    d0, d1 = 0.5 * (f1 - before), 0.5 * (after - f0)
    w = u - i
    cubic = f0 * (1 + 2 * w) * (1 - w) ** 2 + f1 * w**2 * (3 - 2 * w) + d0 * w * (1 - w) ** 2 - d1 * w**2 * (1 - w)
    rate = (6 * w * (w - 1) * (f0 - f1) + d0 * (1 - 4 * w + 3 * w**2) + d1 * (3 * w**2 - 2 * w)) / h[:, None]
    s = slope[:, None]
    early, late = t < 0.0, t > duration[:, None]
    value = np.where(
        early, force[:, :1] + s * t, np.where(late, end_force[:, None] + s * (t - duration[:, None]), cubic)
    )
    return value, np.where(early | late, s, rate)
