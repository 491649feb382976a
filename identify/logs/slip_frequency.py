"""The free oscillation within slips: the natural frequency of a rig from a fast stick-slip record.

While the mass slides, friction changes little beside what the spring gives back: the force is a level and a swing of
the natural frequency, whose damping holds the weakening of friction as well and tells nothing of the rig. All slips of
a record share frequency and damping, each has its own level and phase; the error is the jackknife's over the slips.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from identify.base.quantiles import NORMAL, student
from identify.logs.segment import Segmentation

Array = NDArray[np.float64]

FEWEST = 6  # slips
RESOLVED = 16.0  # samples from the peak of a slip to its valley
MOST = 60  # slips that are fitted
EDGE = 0.08  # of a slip at either end: there the contact ages, and onsets are rounded
GROUPS = 10  # of the jackknife
INERTIAL = 0.1  # of the way of a slip, that the drive moves on in it: slower, friction gives way too gradually
CONSTANT = 0.015  # relative error of the frequency in simulated pairs, as friction is not constant within a slip


def slip_frequency(time: Array, force: Array, found: Segmentation, slope: float) -> tuple[float, float] | None:
    """Natural frequency [rad/s] and its relative standard error, what varying friction does to it included; None where
    fewer than six slips are resolved, or they are not inertial.

    Args:
        time (n,) [s]; force (n,) [N], its sign that of sliding forward; found: sticks and slips in it; slope: of the
            sticks [N/s].
    """
    cycles = found.cycles
    if cycles.count < FEWEST or found.samples_per_slip < RESOLVED:
        return None
    lasts = cycles.arrest - cycles.onset
    if slope * float(np.median(lasts)) < INERTIAL * float(np.median(cycles.drop)):
        return None
    usual = np.flatnonzero(np.abs(lasts / np.median(lasts) - 1.0) < 0.5)
    chosen = usual[np.unique(np.linspace(0, usual.size - 1, min(usual.size, MOST)).round().astype(int))]
    slips = [
        (time[mine] - cycles.onset[i], force[mine])
        for i in chosen.tolist()
        if np.count_nonzero(mine := _inside(time, force, cycles.onset[i], lasts[i]) & ~found.spikes) >= 0.5 * RESOLVED
    ]
    if len(slips) < FEWEST:
        return None
    begin = np.array([np.pi / float(np.median(lasts)), 0.0])
    whole, slopes, pulls = _shared(slips, begin)
    count = min(GROUPS, len(slips))
    without = [
        whole[0] + np.linalg.solve(slopes.sum(axis=0) - slopes[group::count].sum(axis=0), pulls[group::count].sum(0))[0]
        for group in range(count)
    ]
    spread = float(np.sqrt((count - 1) * np.var(np.log(without))))
    frequency = float(np.hypot(*whole))
    return frequency, float(np.hypot(spread * float(student(0.975, count - 1)) / NORMAL, CONSTANT))


def _inside(time: Array, force: Array, onset: float, lasts: float) -> NDArray[np.bool_]:
    edge = EDGE * lasts
    return (time > onset + edge) & (time < onset + lasts - edge) & np.isfinite(force)


def _shared(slips: Sequence[tuple[Array, Array]], begin: Array) -> tuple[Array, Array, Array]:
    """Damped frequency and decay [1/s], (2,), that fit all slips best, each with its own level, size and phase; of
    each slip the normal matrix (n, 2, 2) and the gradient of its misfit (n, 2) there.

    Without some slips the answer is a Gauss-Newton step away, in which theirs are left out (one-step jackknife).
    """
    scale = float(np.pi / np.median([t[-1] - t[0] for t, _ in slips]))

    def off(x: Array) -> Array:
        out = []
        for t, f in slips:
            decay = np.exp(-x[1] * scale * t)
            basis = np.column_stack(
                [decay * np.cos(x[0] * scale * t), decay * np.sin(x[0] * scale * t), np.ones_like(t)]
            )
            out.append(f - basis @ np.linalg.lstsq(basis, f, rcond=None)[0])
        return np.concatenate(out)

    bounds = ([0.4, -1.0], [2.5, 1.0])
    start = np.clip(begin / scale, np.array(bounds[0]) + 1e-3, np.array(bounds[1]) - 1e-3)
    found = least_squares(off, start, bounds=bounds)
    ends = np.cumsum([t.size for t, _ in slips])[:-1]
    slopes, misfits = np.split(found.jac / scale, ends), np.split(found.fun, ends)
    normal = np.array([own.T @ own for own in slopes])
    return found.x * scale, normal, np.array([own.T @ e for own, e in zip(slopes, misfits, strict=True)])
