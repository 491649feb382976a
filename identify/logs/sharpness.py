"""How sharp the slips of a log are: the lag that a sensor has put on them, and how near the swing is to a sine."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from data_io.arrays import kept
from identify.logs.segment import Segmentation

Array = NDArray[np.float64]

FEWEST_SLIPS = 4
FEWEST_SAMPLES = 5.0  # per slip: with fewer, its shape is not seen
BEFORE, AFTER = 1.0, 2.0  # of a slip, that are looked at about its middle
OF_STICK = 0.6  # of a stick, that may follow the slip
PER_SAMPLE = 2  # points of the mean slip
MOST_CYCLES = 60  # that are compared with a sine
MOST_SAMPLES = 1000  # of each of them
START = 0.15  # of a slip: the lag from which the search starts
MOVED = 1e-6  # of the scales of the search, for its slopes
SETTLED = 1e-4  # relative: a lag is told to two digits
MOST_POINTS = 160  # of the mean slip


@dataclass(frozen=True)
class Sharpness:
    """lag: time constant of a first-order lag [s]; duration: of the slip in front of it [s]; slips averaged."""

    lag: float
    duration: float
    slips: int

    @property
    def share(self) -> float:
        """The lag as share of the slip."""
        return self.lag / self.duration


def sharpness(time: Array, force: Array, found: Segmentation) -> Sharpness | None:
    """The lag of the sensor, as far as the mean slip tells it; None with too few slips or samples.

    A mass on a spring slips along half a cosine, alike at its beginning and at its end; a sensor that lags draws its
    end out into an exponential tail. Half a cosine behind a first-order lag is fitted to the mean slip. Damping and
    friction that weakens with speed draw the end out too, by about 5 % of a slip: less than that says nothing.

    Args:
        time, force: (n,) [s], [N], sliding positive; force may hold NaN.
        found: its phases.
    """
    slip = found.cycles.arrest - found.cycles.onset
    if found.count < FEWEST_SLIPS or found.samples_per_slip < FEWEST_SAMPLES:
        return None
    seen = _mean_slip(time, force, found, float(np.median(slip)))
    return None if seen is None else _fitted(*seen, float(np.median(slip)), found.sample_interval)


def harmonic_share(time: Array, force: Array, found: Segmentation) -> float | None:
    """Which part of the swing is its first harmonic, 0.61 for a saw-tooth, 1 for a sine; None with too few slips.

    The median over cycles, the noise taken off; arguments as `sharpness`.
    """
    fall = found.cycles.fall
    shares = []
    for i in range(0, fall.size - 1, max(fall.size // MOST_CYCLES, 1)):
        first, last = np.searchsorted(time, [fall[i], fall[i + 1]]).tolist()
        rows = slice(first, last, max((last - first) // MOST_SAMPLES, 1))
        good = np.isfinite(force[rows]) & ~found.spikes[rows]
        t, swing = time[rows][good], force[rows][good]
        if swing.size < 2 * FEWEST_SAMPLES:
            continue
        phase = 2 * math.pi * (t - fall[i]) / (fall[i + 1] - fall[i])
        sine = np.column_stack([np.ones_like(phase), np.cos(phase), np.sin(phase)])
        left = swing - sine @ np.linalg.lstsq(sine, swing, rcond=None)[0]
        noise = swing.size * found.noise**2
        whole = float(np.sum((swing - np.mean(swing)) ** 2)) - noise
        shares.append(1.0 - max(float(np.sum(left**2)) - noise, 0.0) / whole if whole > 0 else 0.0)
    return float(np.median(shares)) if len(shares) >= FEWEST_SLIPS - 1 else None


def _mean_slip(time: Array, force: Array, found: Segmentation, slip: float) -> tuple[Array, Array, int] | None:
    """Time about the middle of the fall, mean force there without the stick slope, and how many slips."""
    cycles = found.cycles
    step = max(found.sample_interval / PER_SAMPLE, (BEFORE + AFTER) * slip / MOST_POINTS)
    stick = float(np.median(cycles.onset[1:] - cycles.arrest[:-1]))
    grid = np.arange(-BEFORE * slip, min(AFTER * slip, 0.5 * slip + OF_STICK * stick), step)
    good = np.isfinite(force) & ~found.spikes
    sound, there = kept(time, good), kept(force, good)
    falls = [t for t in cycles.fall[1:] if t + grid[0] >= time[0] and t + grid[-1] <= time[-1]]
    if len(falls) < FEWEST_SLIPS - 1:
        return None
    slope = found.stick_slope[0] if found.stick_slope else 0.0
    about = np.searchsorted(sound, np.add.outer(falls, [grid[0], grid[-1]])).tolist()
    near = [slice(max(first - 1, 0), last + 1) for first, last in about]  # np.interp reads all that it is given
    mean = np.mean([np.interp(t + grid, sound[i], there[i]) for t, i in zip(falls, near, strict=True)], axis=0)
    return grid, mean - slope * grid, len(falls)


def _fitted(grid: Array, force: Array, slips: int, slip: float, interval: float) -> Sharpness:
    line = np.linalg.qr(np.column_stack([np.ones_like(grid), grid]))[0]
    off_line = _off(force / float(np.ptp(force)), line)  # the search stops by absolute numbers

    def residuals(p: Array) -> Array:
        """Of several sets of parameters (k, 3), shape (k, n)."""
        step = _off(_lagged_fall(grid, p[:, :1], np.exp(p[:, 1:2]), np.exp(p[:, 2:])), line)
        size = np.sum(step**2, axis=1, keepdims=True)
        share = np.divide(step @ off_line[:, None], size, out=np.zeros_like(size), where=size > 0.0)
        return np.asarray(off_line - share * step)

    def slopes(p: Array) -> Array:
        moved = residuals(p + np.vstack([np.zeros(3), np.diag(moves)]))
        return np.asarray((moved[1:] - moved[0]).T / moves)

    lower = [2 * grid[0], math.log(0.5 * interval), math.log(1e-3 * slip)]
    upper = [grid[-1], math.log(4 * slip), math.log(3 * slip)]
    start = [-0.5 * slip, math.log(slip * (1 - START)), math.log(START * slip)]
    scale = np.array([0.1 * slip, 0.1, 0.3])
    moves = MOVED * scale
    best = least_squares(
        lambda p: residuals(p[None])[0],
        start,
        jac=slopes,
        bounds=(lower, upper),
        x_scale=scale,
        ftol=SETTLED,
        xtol=SETTLED,
    )
    return Sharpness(math.exp(best.x[2]), math.exp(best.x[1]), slips)


def _off(curve: Array, line: Array) -> Array:
    """Curves (..., n) without what of them lies along some orthonormal columns (n, k)."""
    return np.asarray(curve - (curve @ line) @ line.T)


def _lagged_fall(time: Array, begin: Array, duration: Array, lag: Array) -> Array:
    """Half a cosine from 0 to 1 behind a first-order lag: the solution of lag y' + y = x from rest, shape (k, n); the
    arguments but the time (n,) are of shape (k, 1)."""
    omega = math.pi / duration
    share = (omega * lag) ** 2
    inside = np.clip(time - begin, 0.0, duration)
    swing = (np.cos(omega * inside) + omega * lag * np.sin(omega * inside)) / (1 + share)
    rising = 0.5 * (1 - swing - share / (1 + share) * np.exp(-inside / lag))
    end = 0.5 * (1 + 1 / (1 + share) - share / (1 + share) * np.exp(-duration / lag))
    settling = 1 - (1 - end) * np.exp(-np.clip(time - begin - duration, 0.0, None) / lag)
    return np.where(time - begin > duration, settling, rising)
