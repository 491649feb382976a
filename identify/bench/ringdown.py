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

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

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
        IdentifyError: the ringing has too few samples per swing to be told from a faster one.
    """
    good = np.isfinite(force)
    time, force = time[good], force[good]
    period = _period(time, force)
    if period is None:
        return []
    interval = float(np.median(np.diff(time)))
    found = [
        fit
        for first, last in _taps(time, force, period)
        if (fit := _fitted(time[first:last], force[first:last], period))
    ]
    samples = period / interval
    if found and samples < FEWEST_SAMPLES:
        raise IdentifyError(
            f"the ringing has {samples:.2g} samples per swing, so that a faster one could look the same; expected "
            f"{FEWEST_SAMPLES:.0f} or more, better 20: sample at {20.0 / period:.0f} Hz or more"
        )
    return found


def _period(time: Array, force: Array) -> float | None:
    """Of the strongest line of a record [s]; None where there are too few samples."""
    if time.size < 16:
        return None
    level = np.polyval(np.polyfit(time - time[0], force, 1), time - time[0])
    power = np.abs(np.fft.rfft(force - level, 4 * force.size)) ** 2
    frequency = np.fft.rfftfreq(4 * force.size, float(np.median(np.diff(time))))
    power[frequency < SLOWEST / (time[-1] - time[0])] = 0.0
    peak = float(frequency[int(np.argmax(power))])
    return 1.0 / peak if peak > 0.0 else None


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
        # What has died out informs no more, and drifts; what has not settled yet does not fit like the rest.
        dies = fit.time[0] + _dies(fit) / (fit.zeta * fit.frequency)
        residual, early = fit.force - fit.fitted, fit.time < begin + period
        squares = [float(np.mean(residual[part] ** 2)) for part in (early, ~early) if part.any()]
        if dies < end - period:
            end = dies
        elif len(squares) == 2 and squares[0] > WORSE * squares[1] and end - begin > (FEWEST_SWINGS + 1.0) * period:
            begin += 0.5 * period
        else:
            break
    swung = fit.force - np.mean(fit.force)
    explained = 1.0 - float(np.sum(residual**2) / np.sum(swung**2))
    clear = _amplitude(fit) > SEEN * _noise(fit) and (fit.zeta_error < 1.0 or fit.dry > 0.0)
    return fit if explained > EXPLAINED and clear else None


def _dies(fit: RingDown) -> float:
    """zeta w t at which a swing is lost in the noise, or has two swings left until dry friction stops it."""
    first, least = _amplitude(fit), max(0.3 * _noise(fit), 4.0 * fit.dry)
    line = 2.0 / np.pi * fit.dry / fit.zeta  # the envelope is (A + line) exp(-z) - line
    return float(np.log(max((first + line) / (least + line), np.e if not line else 1.0 + 1e-9)))


def _noise(fit: RingDown) -> float:
    return float(np.std(fit.force - fit.fitted)) or 1e-300


def _amplitude(fit: RingDown) -> float:
    """Of the first swing [N]."""
    first = fit.time <= fit.time[0] + 2.0 * np.pi / fit.frequency
    return 0.5 * float(np.ptp(fit.fitted[first]))


def _basis(t: Array, frequency: float, zeta: float) -> Array:
    """What a ring-down is a linear combination of, (n, 4): both phases of the damped swing, level and drift."""
    damped = frequency * np.sqrt(max(1.0 - zeta**2, 1e-12))
    decay = np.exp(-zeta * frequency * t)
    return np.column_stack([decay * np.cos(damped * t), decay * np.sin(damped * t), np.ones_like(t), t])


def _basis_with_friction(t: Array, frequency: float, zeta: float, turned: float) -> Array:
    """The same with dry friction, (n, 4): amplitude at the turning point `turned` [s], friction force, level and drift.

    From turning point n on the mass swings about s F, s = (-1)^n: x = s F + (x_n - s F) d, with x_0 = A and
    x_n+1 = s F (1 + q) - q x_n, q = exp(-pi zeta/sqrt(1 - zeta^2)).
    """
    damped = frequency * np.sqrt(max(1.0 - zeta**2, 1e-12))
    half = np.floor((t - turned) * damped / np.pi)
    since = t - turned - half * np.pi / damped
    swing = np.exp(-zeta * frequency * since) * (
        np.cos(damped * since) + zeta * frequency / damped * np.sin(damped * since)
    )
    q = np.exp(-np.pi * zeta * frequency / damped)
    lost = (1.0 + q) * (1.0 - q**half) / (1.0 - q)
    side = 1.0 - 2.0 * (half % 2.0)
    return np.column_stack([side * q**half * swing, side * (1.0 - (1.0 + lost) * swing), np.ones_like(t), t])


def _least_squares(time: Array, force: Array, period: float) -> RingDown | None:
    """The best damped swing through all rows, with dry friction where they ask for it."""
    t = time - time[0]
    size = float(np.std(force)) or 1.0

    def plain(x: Array) -> Array:
        return _basis(t, 2.0 * np.pi / period * np.exp(x[0]), float(np.exp(x[1])))

    def rubbing(x: Array) -> Array:
        return _basis_with_friction(t, 2.0 * np.pi / period * np.exp(x[0]), float(np.exp(x[1])), float(x[2]) * period)

    first = np.log(np.array(DAMPINGS))
    low, high, scale = [-0.7, np.log(1e-6)], [0.7, np.log(0.9)], [0.1, 1.0]
    viscous = _projected(force / size, plain, np.column_stack([0.0 * first, first]), (low, high), scale)
    phases, _, _, _ = np.linalg.lstsq(plain(viscous.x), force, rcond=None)
    turned = float(np.arctan2(phases[1], phases[0])) / (2.0 * np.pi)  # of a period, when the swing is highest
    turned -= np.ceil(turned)
    starts = np.column_stack([viscous.x[0] + 0.0 * first, first, turned + 0.0 * first])
    bounds = [*low, turned - 0.5], [*high, min(turned + 0.5, 0.0)]
    rubbed = _projected(force / size, rubbing, starts, bounds, [*scale, 0.1])
    dry = float(np.linalg.lstsq(rubbing(rubbed.x), force, rcond=None)[0][1])
    variance = _variance(t, rubbed, period, 7)
    rubs = dry > 0.0 and 2.0 * (viscous.cost - rubbed.cost) > RUBS * variance
    best, basis, unknowns = (rubbed, rubbing, 7) if rubs else (viscous, plain, 6)
    frequency, zeta = 2.0 * np.pi / period * float(np.exp(best.x[0])), float(np.exp(best.x[1]))
    freedom = time.size - unknowns
    # Variable projection: its Jacobian is that of all parameters with the linear ones eliminated (Golub, Pereyra).
    information = best.jac.T @ best.jac
    scales = np.sqrt(np.diag(information))
    if freedom < 4 or not np.all(scales > 0.0):
        return None
    inverse = np.linalg.inv(information / np.outer(scales, scales)) / np.outer(scales, scales)
    variance = _variance(t, best, period, unknowns)
    errors = np.sqrt(variance * np.diag(inverse)) * float(student(0.975, freedom)) / NORMAL
    fitted = basis(best.x) @ np.linalg.lstsq(basis(best.x), force, rcond=None)[0]
    return RingDown(frequency, zeta, float(errors[0]), float(errors[1]), dry if rubs else 0.0, time, force, fitted)


def _projected(
    force: Array,
    basis: Callable[[Array], Array],
    starts: Array,
    bounds: tuple[list[float], list[float]],
    scale: list[float],
) -> OptimizeResult:
    """The least squares over what a basis depends on, its linear coefficients eliminated, from the best of some starts
    (s, p)."""

    def off(x: Array) -> Array:
        columns = basis(x)
        return force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0]

    start = min(starts, key=lambda x: float(np.sum(off(x) ** 2)))
    return least_squares(off, start, bounds=bounds, x_scale=scale)


def _variance(t: Array, fit: OptimizeResult, period: float, unknowns: int) -> float:
    """Of the residual of a fit, with the power around its frequency in place of that of all frequencies, where that is
    more: noise with a memory."""
    residual, frequency = fit.fun, 2.0 * np.pi / period * float(np.exp(fit.x[0]))
    square, power = float(residual @ residual), np.abs(np.fft.rfft(residual)) ** 2
    at = 2.0 * np.pi * np.fft.rfftfreq(residual.size, (t[-1] - t[0]) / (t.size - 1))
    near = (at >= BAND[0] * frequency) & (at <= BAND[1] * frequency)
    memory = max(1.0, float(np.mean(power[near])) / square) if near.any() and square > 0.0 else 1.0
    return square / max(t.size - unknowns, 1) * memory
