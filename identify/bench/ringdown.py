"""A tap on the rig, ringing down: natural frequency and damping ratio with their errors.

With the drive at rest and the specimen lifted off, the force is an offset, a drift and A exp(-zeta w t) cos(w_d t +
phi), w_d = w sqrt(1 - zeta^2). A guide that rubs with a constant force adds a term: the swings then die along a
straight line, about a level that changes its side with each half swing (Den Hartog 1931); it is taken where the data
ask for it. A lag of the sensor, of any order, changes amplitude and phase only, and adds what dies out with its own
time constants: the beginning is dropped until it fits like the rest. The error is that of least squares, with the power
of the residual around the frequency of the ringing in place of its variance: noise with a memory or a second mode
widen it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import periodogram

from identify.base.errors import IdentifyError
from identify.base.quantiles import NORMAL, student

Array = NDArray[np.float64]

FEWEST_SAMPLES = 4.0  # in a swing: with fewer, a frequency above half the sampling rate looks the same
FEWEST_SWINGS = 2.0  # that are seen above the noise
LOUDER = 2.0  # times the swing before it: a tap
SEEN = 4.0  # times the noise: a swing
EXPLAINED = 0.9  # share of the power of a ring-down that a damped swing holds
WORSE = 1.5  # times the mean square of the rest: a swing that does not fit like it
SLOWEST = 3.0  # periods in the record: what is slower is drift
DAMPINGS = (0.003, 0.01, 0.03, 0.1, 0.25)  # damping ratios that a fit starts from
TURNS = (0.0, 0.125, 0.25, 0.375)  # periods since the turning point, of half of which the amplitude changes its sign
RUBS = 9.0  # by how much dry friction lowers chi square, at least: three standard errors of its force
BAND = 0.5, 2.0  # times the frequency: where the residual's power counts


@dataclass(frozen=True)
class RingDown:
    """frequency: natural one, undamped [rad/s]; zeta: damping ratio; frequency_error, zeta_error: standard errors,
    relative; dry: friction force of a guide that rubs [N], 0 where none is seen; time, force, fitted (n,) [s, N] of the
    part that was fitted."""

    frequency: float
    zeta: float
    frequency_error: float
    zeta_error: float
    dry: float
    time: Array
    force: Array
    fitted: Array

    @property
    def swings(self) -> float:
        """In the part that was fitted."""
        return float(self.time[-1] - self.time[0]) * self.frequency / (2.0 * np.pi)


def ring_downs(time: Array, force: Array) -> list[RingDown]:
    """Every tap of a record that rings down, in order; none where nothing rings.

    Args:
        time: (n,) [s]; force: (n,) [N], what is not finite is left out.

    Raises:
        IdentifyError: the ringing has too few samples per swing to distinguish it from a faster one.
    """
    good = np.isfinite(force)
    time, force = time[good], force[good]
    if time.size < 16:
        return []
    interval = float(np.median(np.diff(time)))
    frequency, power = periodogram(force, 1.0 / interval, detrend="linear", nfft=4 * force.size)
    power[frequency < SLOWEST / (time[-1] - time[0])] = 0.0
    strongest = float(frequency[int(np.argmax(power))])
    if not strongest > 0.0:
        return []
    period = 1.0 / strongest
    taps = [
        fit
        for first, last in _taps(time, force, period)
        if (fit := _fitted(time[first:last], force[first:last], period))
    ]
    samples = period / interval
    if taps and samples < FEWEST_SAMPLES:
        raise IdentifyError(
            f"the ringing has {samples:.2g} samples per swing, so that a faster one could look the same; expected "
            f"{FEWEST_SAMPLES:.0f} or more, better 20: sample at {20.0 / period:.0f} Hz or more"
        )
    return taps


def _taps(time: Array, force: Array, period: float) -> Iterator[tuple[int, int]]:
    """First row and end of what follows each tap: from its highest swing to the next tap, or the end."""
    swings = np.floor((time - time[0]) / period)
    rows = np.flatnonzero(np.diff(swings, prepend=-1.0))  # a pause of the recording holds none
    if rows.size < 3:
        return
    ends = [*rows[1:].tolist(), time.size]
    swing = np.array([np.ptp(force[a:b]) if b - a > 1 else 0.0 for a, b in zip(rows, ends, strict=True)])
    before = np.concatenate([[swing.min()], np.minimum(swing[:-1], np.append(swing[0], swing[:-2]))])
    quiet = 1.5 * float(np.quantile(swing, 0.1))
    loud = np.flatnonzero((swing > LOUDER * before) & (swing > max(quiet, 0.05 * swing.max())))
    first = [int(i) for n, i in enumerate(loud) if n == 0 or i > loud[n - 1] + 1]
    for number, i in enumerate(first):
        end = rows[first[number + 1]] if number + 1 < len(first) else time.size
        begun = force[rows[i] : min(ends[min(i + 1, rows.size - 1)], end)]
        yield int(rows[i] + np.argmax(np.abs(begun - np.median(begun)))), int(end)


def _fitted(time: Array, force: Array, period: float) -> RingDown | None:
    """The damped swing of what follows one tap; None where there is none."""
    begin, end = time[0] + 0.25 * period, time[-1]
    while True:
        mine = (time >= begin) & (time <= end)
        if np.count_nonzero(mine) < 12 or end - begin < FEWEST_SWINGS * period:
            return None
        fit = _least_squares(time[mine], force[mine], period)
        if fit is None:
            return None
        residual, early = fit.force - fit.fitted, fit.time < begin + period
        noise = float(np.std(residual)) or 1e-300
        amplitude = 0.5 * float(np.ptp(fit.fitted[fit.time <= fit.time[0] + 2.0 * np.pi / fit.frequency]))
        # What has died out informs no more, and drifts: lost in the noise, or two swings before dry friction stops it;
        # the envelope is (A + line) exp(-zeta w t) - line. What has not settled yet does not fit like the rest.
        line, least = 2.0 / np.pi * fit.dry / fit.zeta, max(0.3 * noise, 4.0 * fit.dry)
        left = max((amplitude + line) / (least + line), np.e if not line else 1.0 + 1e-9)
        dies = fit.time[0] + float(np.log(left)) / (fit.zeta * fit.frequency)
        squares = [float(np.mean(residual[part] ** 2)) for part in (early, ~early) if part.any()]
        if dies < end - period:
            end = dies
        elif len(squares) == 2 and squares[0] > WORSE * squares[1] and end - begin > (FEWEST_SWINGS + 1.0) * period:
            begin += 0.5 * period
        else:
            break
    swung = fit.force - np.mean(fit.force)
    explained = 1.0 - float(np.sum(residual**2) / np.sum(swung**2))
    clear = amplitude > SEEN * noise and (fit.zeta_error < 1.0 or fit.dry > 0.0)
    return fit if explained > EXPLAINED and clear else None


def _least_squares(time: Array, force: Array, period: float) -> RingDown | None:
    """The best damped swing through all rows, with dry friction where they ask for it."""
    # From turning point n on the mass swings about s F, s = (-1)^n: x = s F + (x_n - s F) d, x_0 = A and x_n+1 =
    # s F (1 + q) - q x_n, q = exp(-pi zeta/sqrt(1 - zeta^2)); frequency, zeta and the turning point before the first
    # row are searched, A, F, level and drift follow from them (variable projection; Golub and Pereyra 1973).
    t, size = time - time[0], float(np.std(force)) or 1.0

    def basis(x: Array) -> Array:
        frequency, zeta, turned = 2.0 * np.pi / period * np.exp(x[0]), np.exp(x[1]), x[2] * period
        root = np.sqrt(max(1.0 - zeta**2, 1e-12))
        half = np.floor((t - turned) * frequency * root / np.pi)
        since, q = t - turned - half * np.pi / (frequency * root), np.exp(-np.pi * zeta / root)
        angle = frequency * root * since
        swing = np.exp(-zeta * frequency * since) * (np.cos(angle) + zeta / root * np.sin(angle))
        lost, side = (1.0 + q) * (1.0 - q**half) / (1.0 - q), 1.0 - 2.0 * (half % 2.0)
        return np.column_stack([side * q**half * swing, np.ones_like(t), t, side * (1.0 - (1.0 + lost) * swing)])

    def best(columns: int, starts: Iterable[tuple[float, float, float]]) -> OptimizeResult:
        def off(x: Array) -> Array:
            mine = basis(x)[:, :columns]
            return np.asarray(force - mine @ np.linalg.lstsq(mine, force, rcond=None)[0]) / size

        start = min(starts, key=lambda x: float(np.sum(off(np.array(x)) ** 2)))
        low, high = (-0.7, np.log(1e-6), start[2] - 0.5), (0.7, np.log(0.9), min(start[2] + 0.5, 0.0))
        return least_squares(off, np.clip(start, low, high), bounds=(low, high), x_scale=(0.1, 1.0, 0.1))

    def variance(fit: OptimizeResult, unknowns: int) -> float:
        """Of the residual, with the power around the frequency where that is more than at all: noise with a memory."""
        square, power = float(fit.fun @ fit.fun), np.abs(np.fft.rfft(fit.fun)) ** 2
        at = np.fft.rfftfreq(t.size, (t[-1] - t[0]) / (t.size - 1)) * period / np.exp(fit.x[0])
        near = (at >= BAND[0]) & (at <= BAND[1])
        memory = max(1.0, float(np.mean(power[near])) / square) if near.any() and square > 0.0 else 1.0
        return square / max(t.size - unknowns, 1) * memory

    dampings = np.log(DAMPINGS)
    viscous = best(3, [(0.0, damping, -turn) for damping in dampings for turn in TURNS])
    rubbed = best(4, [(viscous.x[0], damping, viscous.x[2]) for damping in dampings])
    columns = basis(rubbed.x)
    amplitude, _, _, friction = np.linalg.lstsq(columns, force, rcond=None)[0]
    dry = float(friction * np.sign(amplitude))
    rubs = dry > 0.0 and 2.0 * (viscous.cost - rubbed.cost) > RUBS * variance(rubbed, 7)
    fit, unknowns = (rubbed, 7) if rubs else (viscous, 6)
    information, freedom = fit.jac.T @ fit.jac, time.size - unknowns
    scales = np.sqrt(np.diag(information))
    if freedom < 4 or not np.all(scales > 0.0):
        return None
    inverse = np.linalg.inv(information / np.outer(scales, scales)) / np.outer(scales, scales)
    errors = np.sqrt(variance(fit, unknowns) * np.diag(inverse)) * float(student(0.975, freedom)) / NORMAL
    frequency, zeta = 2.0 * np.pi / period * float(np.exp(fit.x[0])), float(np.exp(fit.x[1]))
    fitted = force - size * fit.fun
    return RingDown(frequency, zeta, float(errors[0]), float(errors[1]), dry if rubs else 0.0, time, force, fitted)
