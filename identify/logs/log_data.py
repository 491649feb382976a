"""What a fit takes of one log: its samples, and its normal force as the model takes it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from data_io.arrays import kept, thinned, thinned_steps
from identify.base.errors import FitError
from identify.base.quantiles import chi_square, chi_square_exceeded
from identify.simulation.drive import Drive, NormalForce

Array = NDArray[np.float64]

SEGMENTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
BINS = 2048  # means of samples that a course is fitted to: enough for the finest spline
WORTH = 3.0  # what one more knot must gain in 2 ln(likelihood): more than Akaike's 2, so that noise stays out
NEIGHBOURS = (3, 9, 27, 81)  # frequencies over which a spectrum is averaged: a pulse is a line, a jitter a band
FALSE_ALARMS = 0.01  # lines per log that white noise alone may show
FEWEST_OF_SPECTRUM, EVEN = 64, 0.05  # samples, and share of an interval that intervals may differ, of a spectrum
PER_PERIOD, MOST_DRAWN = 20, 60_000  # straight pieces per period of the fastest line, and of all of them
WAVES, ROUNDS, PER_WAVE = 4, 4, 100  # sinusoids of a load at most, steps to a frequency, straight pieces per period
ALIKE, UNLIKE = 6, 1.5  # cycles along a course that count as alike, at most, and times their lowest speed the highest
JITTER = 0.3  # [s]: what has shorter periods is another one at the end of a slip than at its onset


def own_or(shared: Array, own: Array) -> Array:
    """What a log has for itself, and what it shares where that is NaN; all is shared where own is empty."""
    return shared if own.size == 0 else np.where(np.isfinite(own), own, shared)


@dataclass(frozen=True)
class LogData:
    """One log as the estimator sees it: samples in the fitted window, rig and what acts from outside.

    time, force (n,) [s], [N] (sign of sliding positive), weight (n,) 1/variance [1/N^2], 0 where masked (the
    force there is finite, and says nothing);
    base (n_p,) base values of the parameters; own (n_p,) where the search starts a parameter that differs from log to
    log (NaN: as for all; empty: none does); groups (n_p): the group of logs it shares each parameter with, "" for none;
    drive_speed [m/s], the mean along a course; programme: the drive where it changes its speed within the window (None:
    drive_speed throughout);
    normal_force, known to within normal_force_sd [N] (0: exact), jitter_sd [N] of it in periods below JITTER (0: none);
    strength_sd: of mu_s from stick to stick (0: the same in all); begin, end of the fitted window [s].
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
    jitter_sd: float = 0.0
    strength_sd: float = 0.0

    def theta(self, shared: Array) -> Array:
        """Theta (n_p,) of this log before the search."""
        return own_or(shared, self.own)

    def speed_at(self, time: float) -> float:
        """Drive speed at a time [m/s]."""
        return self.drive_speed if self.programme is None else self.programme.at(time)

    @property
    def on_course(self) -> bool:
        """Whether the drive changes its speed gradually."""
        return self.programme is not None and self.programme.accelerates

    def acceleration_at(self, time: float) -> float:
        """Acceleration of the drive just after a time [m/s^2]."""
        return 0.0 if self.programme is None else self.programme.line(time)[1]

    def moved(self, times: Array) -> Array:
        """How far the drive has moved at times (n,) [m], from where it is at 0 s."""
        return self.drive_speed * times if self.programme is None else self.programme.motion(times)[0]

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


def at_speeds(log: LogData, slip_times: Array) -> list[tuple[LogData, Array]]:
    """A log with its cycles (c,); along a course those in a row at about one speed, with that."""
    if not log.on_course:
        return [(log, slip_times)]
    groups = list[list[float]]()
    for fall in slip_times.tolist():
        speeds = [log.speed_at(t) for t in [*groups[-1], fall]] if groups else []
        if speeds and len(speeds) <= ALIKE and max(speeds) <= UNLIKE * min(speeds):
            groups[-1].append(fall)
        else:
            groups.append([fall])
    pairs = [np.array(own) for own in groups if len(own) > 1]
    ways = [float(np.ptp(log.moved(own)) / np.ptp(own)) for own in pairs]
    return [(replace(log, drive_speed=v, programme=None), own) for v, own in zip(ways, pairs, strict=True)]


# The normal force over time.


@dataclass(frozen=True)
class LoadSpline:
    """A measured normal force as a line over time; sd [N] by which it may be off (0: exact); jitter_sd [N], the part of
    it that has periods below JITTER."""

    force: NormalForce
    sd: float = 0.0
    jitter_sd: float = 0.0


def smooth(time: Array, normal_force: Array, name: str = "the log", cycles: int = 1) -> LoadSpline:
    """A measured normal force: sinusoids, a cubic spline fitted by least squares, and what stands out of its rest
    (N. Wiener).

    A sinusoid is three numbers, where the spectrum of a record that holds no whole number of its periods has many
    lines. The number of spline segments is the one with the best information criterion: noise is averaged away, drift
    and ripple are kept (a ripple of a few thousandths that is smoothed away biases a fit of many cycles).

    Args:
        time, normal_force: (n,) [s], [N]; NaN is left out, one finite value at least.
        cycles: how many will use it, each with an error of its own: their mean must not seem better known than the
            spline is.

    Returns:
        the force as a broken line, with its standard deviation as the noise leaves it; 0 for one number throughout.

    Raises:
        FitError: a force that is not positive throughout.
    """
    t, f = _finite(time, normal_force, name)
    if np.ptp(f) == 0.0 or t.size < 16:
        return LoadSpline(_checked(NormalForce.of(float(np.mean(f))), name))
    bins = min(BINS, t.size)
    index = np.minimum(((t - t[0]) / (t[-1] - t[0]) * bins).astype(int), bins - 1)
    weights = np.bincount(index, minlength=bins).astype(float)
    filled, noise = weights > 0.0, _white(f)
    waves = _sinusoids(t, f, noise)
    f = f - _at(waves, t)
    means, centres = (np.bincount(index, v, bins)[filled] / weights[filled] for v in (f, t))
    weights = weights[filled]
    mean = float(np.average(means, weights=weights))
    best, count = NormalForce.of(mean), 1
    best_score = float(np.sum(weights * (means - mean) ** 2)) / noise**2 + WORTH
    for segments in SEGMENTS:
        if centres.size < 4 * (segments + 3):
            break
        inner = np.quantile(centres, np.linspace(0.0, 1.0, segments + 1)[1:-1])
        knots = np.concatenate([[centres[0]] * 4, inner, [centres[-1]] * 4])
        spline = scipy.interpolate.make_lsq_spline(centres, means, knots, k=3, w=np.sqrt(weights))
        score = float(np.sum(weights * (means - spline(centres)) ** 2)) / noise**2 + WORTH * (segments + 3)
        if score < best_score:
            drawn = np.linspace(centres[0], centres[-1], 8 * segments + 1)
            best, count, best_score = NormalForce.of((drawn, np.maximum(spline(drawn), 1e-9))), segments + 3, score
    one = noise**2 / t.size
    jitter = one * max(count - (t[-1] - t[0]) / JITTER, 0.0)  # of a spline of short segments
    rest = f - best.at(t)
    step = float(np.median(np.diff(t)))
    lines, share, white = np.zeros(t.size), np.zeros(t.size), noise**2
    if t.size >= FEWEST_OF_SPECTRUM and float(np.max(np.abs(np.diff(t) - step))) <= EVEN * step:
        lines = scipy.fft.dct(rest, norm="ortho")
        share, white = _share_of_lines(lines**2)
    fastest = int(np.max(np.flatnonzero(share), initial=0))
    # Stein's unbiased estimate of the error of a linear smoother (1981); lines lie no higher than twice the fastest.
    error = ((1.0 - share) ** 2 * lines**2 + (2.0 * share - 1.0) * white)[: 2 * fastest] / t.size
    stated, length = white * share / t.size, float(t[-1] - t[0])
    fast = int(2.0 * length / JITTER)
    jitter += max(float(np.sum(error[fast:])), float(np.sum(stated[fast:])))
    variance = one * (count + waves.size) + max(float(np.sum(error)), float(np.sum(stated)))
    if fastest:
        finer = int(np.clip(np.ceil(0.5 * PER_PERIOD * fastest / t.size), 1, max(MOST_DRAWN // t.size, 1)))
        wave = np.sqrt(finer) * scipy.fft.idct(np.pad(share * lines, (0, (finer - 1) * t.size)), norm="ortho")
        at = t[0] + step * ((np.arange(wave.size) + 0.5) / finer - 0.5)
        coarser = max(1, int(2.0 * wave.size / (PER_PERIOD * fastest)))
        at, wave = at[::coarser], wave[::coarser]
        places = np.unique(np.clip(np.concatenate([at, t[[0, -1]]]), t[0], t[-1]))
        best = NormalForce.of((places, np.maximum(best.at(places) + np.interp(places, at, wave), 1e-9)))
    if len(waves):
        pieces = int(np.clip(PER_WAVE * length * np.max(waves[:, 0]) / (2.0 * np.pi), 1, MOST_DRAWN))
        places = np.union1d(np.linspace(t[0], t[-1], pieces + 1), best.between(float(t[0]), float(t[-1]))[0])
        best = NormalForce.of((places, np.maximum(best.at(places) + _at(waves, places), 1e-9)))
    return LoadSpline(_checked(best, name), float(np.sqrt(max(variance, one * cycles))), float(np.sqrt(jitter)))


def _sinusoids(t: Array, f: Array, noise: float) -> Array:
    """Angular frequency, and factors of cosine and sine, of the sinusoids (w, 3) of a force at even times, beside a
    cubic: one after the other from the highest line of the spectrum of what is left, all of them by Gauss-Newton; each
    against what is left of the lines next to it (D. J. Thomson, Proc. IEEE 70, 1055, 1982), as a band has them too."""
    step, size, found = float(np.median(np.diff(t))), t.size, np.empty((0, 3))
    if size < FEWEST_OF_SPECTRUM or float(np.max(np.abs(np.diff(t) - step))) > EVEN * step:
        return found
    padded, window, at = scipy.fft.next_fast_len(4 * size), np.hanning(size), np.linspace(-1.0, 1.0, size)
    first, cubic = 2 * padded // size, np.vander(at, 4)  # of slower ones than two periods the spline takes care
    rest = f - cubic @ np.linalg.lstsq(cubic, f)[0]
    for _ in range(WAVES):
        power = np.abs(scipy.fft.rfft(window * rest, padded))
        line = 2.0 * np.pi * (first + int(np.argmax(power[first:]))) / (padded * step)
        frequencies, moves = np.append(found[:, 0], line), 0.0
        for _ in range(ROUNDS):
            frequencies = frequencies + moves
            phases = np.outer(t, frequencies)
            known = np.hstack([np.cos(phases), np.sin(phases), cubic])
            fitted = np.linalg.lstsq(known, f)[0]
            a, b = fitted[: frequencies.size], fitted[frequencies.size : 2 * frequencies.size]
            along = at[:, None] * (b * known[:, : a.size] - a * known[:, a.size : 2 * a.size])
            moves = np.linalg.lstsq(np.hstack([along, known]), f)[0][: a.size] / (0.5 * step * (size - 1))
        if abs(frequencies[-1] - line) * step * size > 2.0 * np.pi:  # no sinusoid: its frequency wanders off
            break
        left = f - known @ fitted
        places = np.abs(np.arange(power.size) - first - np.argmax(power[first:])) * size < NEIGHBOURS[1] * padded
        level = float(np.mean(np.abs(scipy.fft.rfft(window * left, padded))[places] ** 2)) / float(np.sum(window**2))
        enough = chi_square_exceeded(FALSE_ALARMS / size, 3) * max(level, noise**2)
        if np.sum(rest**2) - np.sum(left**2) < enough:
            break
        found, rest = np.column_stack([frequencies, a, b]), left
    return found


def _at(waves: Array, t: Array) -> Array:
    """The sum of sinusoids (w, 3) at times (n,)."""
    return np.sum([a * np.cos(w * t) + b * np.sin(w * t) for w, a, b in waves.tolist()] or [0.0 * t], axis=0)


def level(time: Array, normal_force: Array, name: str = "the log", cycles: int = 1) -> LoadSpline:
    """The mean of a measured normal force, and its standard error [N] as the white noise leaves it.

    Arguments and errors as `smooth`.
    """
    t, f = _finite(time, normal_force, name)
    mean = _checked(NormalForce.of(max(float(np.mean(f)), 1e-9)), name)
    if np.ptp(f) == 0.0 or t.size < 16:
        return LoadSpline(mean)
    return LoadSpline(mean, _white(f) * float(np.sqrt(max(cycles, 1) / t.size)))


def swing(force: NormalForce, begin: float, end: float) -> float:
    """By how much a force varies between two times [s]: half its range, as a share of its mean."""
    values = np.concatenate([force.at([begin, end]), force.between(begin, end)[1]])
    return float(np.ptp(values) / 2.0 / np.mean(values))


def _finite(time: Array, normal_force: Array, name: str) -> tuple[Array, Array]:
    good = np.isfinite(normal_force) & np.isfinite(time)
    t, f = kept(time, good), kept(normal_force, good)
    if np.median(thinned(f)) <= 0.0:
        raise FitError(
            f"{name} has a median normal force of {np.median(f):.3g} N; expected a positive load: "
            "check the column and its sign, or cut the window to the part under load"
        )
    return t, f


def _checked(force: NormalForce, name: str) -> NormalForce:
    if min(force.values) <= 1e-6:
        raise FitError(f"{name}: the normal force falls to zero; cut the window to the part under load")
    return force


def _white(f: Array) -> float:
    """Standard deviation of the white noise of one sample, from neighbours."""
    return max(float(np.sqrt(np.mean(np.diff(f, 2) ** 2) / 6.0)), 1e-9 * float(np.max(np.abs(f))))


def _share_of_lines(power: Array) -> tuple[Array, float]:
    """Which share of the power of every line of a cosine spectrum (n,) is no noise, and the variance of the noise."""
    noise = max(float(np.median(power)) / chi_square(0.5, 1), 1e-300)
    share, left = np.zeros(power.size), power.copy()
    for width in NEIGHBOURS:  # the narrowest mean that stands out counts, and is left out of the wider ones
        mean = scipy.ndimage.uniform_filter1d(left, width, mode="nearest")
        limit = chi_square_exceeded(FALSE_ALARMS / (power.size * len(NEIGHBOURS)), width) / width
        high = (mean > limit * noise) & (share == 0.0)
        share[high] = 1.0 - noise / mean[high]
        left[high] = noise
    share[0] = 0.0  # the level is no line
    third = 2 * power.size // 3  # from where on lines show the white noise alone
    white = float(np.mean(power[third:], where=share[third:] == 0.0)) if np.any(share[third:] == 0.0) else noise
    return share, white
