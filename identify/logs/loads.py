"""The normal force as the model takes it: its course or its mean, its rhythms, and a jitter that no fit can follow."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import kept, thinned
from identify.base.errors import FitError
from identify.base.quantiles import chi_square, chi_square_exceeded
from identify.logs.log_data import LogData
from identify.simulation.drive import NormalForce

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

SEGMENTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
BINS = 2048  # means of samples a spline is fitted to: enough for the finest one
WORTH = 3.0  # what one more knot must gain in 2 ln(likelihood): more than Akaike's 2, so that noise stays out
DRAWN = 8  # straight pieces per spline segment
NEIGHBOURS = (3, 9, 27, 81)  # frequencies over which a spectrum is averaged: a pulse is a line, a jitter a band
SKIRT = 3.0  # [Hz] about a line that stands out in which more of its rhythm may hide
WHITE = 3  # the fastest lines, one of so many, show the white noise alone
FALSE_ALARMS = 0.01  # rhythms per log that white noise alone may show
FEWEST_FOR_SPECTRUM, EVEN = 64, 0.05  # samples, and share of an interval that intervals may differ, of a spectrum
PER_PERIOD, MOST_DRAWN = 20, 60_000  # straight pieces per period of the fastest rhythm, and of all of them
MOST_HARMONICS = 1500  # the strongest are followed, the others count to the error
NEAR_ENDS = 64  # times near either end, and in between, at which the error of a course is stated
SMOOTHED = 0.3  # [s]: rhythms with shorter periods are taken out of a smoothed course; a pulse stays in it
SURVIVED = 0.25  # of a slip: it begins slowly, and a contact that is firm again so soon ends it
OUTRUN = 3.0  # times the loading rate: rate of a jitter from which on a contact slips a little before it slips
BLURRED = 0.4  # of a jitter: error of its measured course from which on it is not followed
JITTERS = 1e-3  # of the load: less is left in
SEEN = 5.0  # standard errors of its course from which on a normal force is said to vary


def first_passage(jitter: Array, step: float, rise: float, later: float, survived: float = 0.0) -> tuple[float, float]:
    """Return the mean of a jitter where a line that rises reaches it for the first time, and its mean `later` [s].

    A spring that loads a stick meets a jittering static limit in one of its dips: at the onset of a slip the limit is
    weaker than its mean, and half a period later, when the slip ends, stronger. A jitter that is not followed has these
    means nevertheless. The line may come from anywhere: every height at which it could start counts alike. Those that
    reach the jitter at a sample are as many as the jitter, less the rise, is lower there than ever before.

    Args:
        jitter: (n,) in units of the line, `step` [s] apart; rise: of the line [1/s]; survived [s]: a dip below the line
            that is over so soon does not count.
    """
    above = jitter - rise * step * np.arange(jitter.size)
    reached = np.append(0.0, -np.diff(np.minimum.accumulate(above)))
    after, soon = round(later / step), round(survived / step)
    if soon:
        reached[:-soon] = np.where(above[soon:] < above[:-soon], reached[:-soon], 0.0)
    whole = np.flatnonzero(reached[: max(jitter.size - after, 0)])
    if whole.size == 0:
        return 0.0, 0.0
    ends = np.average([jitter[whole], jitter[whole + after]], axis=1, weights=reached[whole])
    return float(ends[0]), float(ends[1])


@dataclass(frozen=True)
class LoadSpline:
    """A measured normal force as a line over time; sd [N] by which it may be off (0: exact); tremor_sd [N], the part of
    it that lies in fast rhythms and is another one at the end of a slip than at its onset; sd_course: the sd over
    time, where it is not the same throughout."""

    force: NormalForce
    sd: float = 0.0
    tremor_sd: float = 0.0
    sd_course: NormalForce | None = None


def as_modelled(
    record: Record, used: Bools, window: tuple[float, float], *, follows: bool, name: str, cycles: int
) -> tuple[LoadSpline, float]:
    """The normal force of a log as the model takes it: its course where the model follows it, else its mean.

    Args:
        used: (n,) samples that count; window: times [s] that are fitted; follows: what the model does; cycles: how
            many will use it.

    Returns:
        the force, and the swing that its mean hides (half its range, as a share).

    Raises:
        FitError: a force that is not positive throughout.
    """
    course = smooth(kept(record.time, used), kept(record.normal_force, used), name, cycles)
    if follows:
        return course, 0.0
    begin, end = window
    hidden = swing(course.force, begin, end)
    hidden = hidden if hidden > SEEN * course.sd / float(np.mean(course.force.values)) else 0.0
    inside = used & (record.time >= begin) & (record.time <= end)
    return level(record.time[inside], record.normal_force[inside], name, cycles), hidden


def smooth(time: Array, normal_force: Array, name: str = "the log", cycles: int = 1) -> LoadSpline:
    """The course of a measured normal force: level, or a cubic spline fitted by least squares; and its rhythms.

    The number of spline segments is the one with the best information criterion: noise is averaged away, drift
    and ripple are kept (a ripple of a few thousandths that is smoothed away biases a fit of many cycles). What is too
    fast for it but stands out of the noise, as pulse and jitter of a live finger do, is added. It is
    handed on as a broken line, DRAWN pieces per segment.

    Args:
        time, normal_force: (n,) [s], [N]; NaN is left out, one finite value at least.
        cycles: how many will use it, each with an error of its own: their mean must not seem better known than the
            course is.

    Returns:
        the course, with its standard deviation as the noise leaves it; 0 where the file says one number.

    Raises:
        FitError: a force that is not positive throughout.
    """
    t, f = _finite(time, normal_force, name)
    if np.ptp(f) == 0.0 or t.size < 16:
        return LoadSpline(_checked(NormalForce.of(float(np.mean(f))), name))
    centres, means, weights, noise = _binned(t, f)
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
            drawn = np.linspace(centres[0], centres[-1], DRAWN * segments + 1)
            best, count, best_score = NormalForce.of((drawn, np.maximum(spline(drawn), 1e-9))), segments + 3, score
    rhythms = _with_rhythms(best, t, f)
    one = noise**2 / t.size
    fast = one * max(count - (t[-1] - t[0]) / SMOOTHED, 0.0)  # of a spline of short segments
    if rhythms is None:
        return LoadSpline(_checked(best, name), float(np.sqrt(one * max(count, cycles))), float(np.sqrt(fast)))
    variance = np.maximum(one * count + rhythms.variance, one * cycles)
    over_time = NormalForce.of((rhythms.times, np.sqrt(variance)))
    sd = float(np.sqrt(np.median(variance)))
    return LoadSpline(_checked(rhythms.force, name), sd, float(np.sqrt(fast + rhythms.fast)), over_time)


def level(time: Array, normal_force: Array, name: str = "the log", cycles: int = 1) -> LoadSpline:
    """The mean of a measured normal force, and its standard error [N] as the white noise leaves it.

    Arguments and errors as `smooth`.
    """
    t, f = _finite(time, normal_force, name)
    mean = _checked(NormalForce.of(max(float(np.mean(f)), 1e-9)), name)
    if np.ptp(f) == 0.0 or t.size < 16:
        return LoadSpline(mean)
    return LoadSpline(mean, _binned(t, f)[3] * float(np.sqrt(max(cycles, 1) / t.size)))


def swing(course: NormalForce, begin: float, end: float) -> float:
    """By how much a course varies between two times [s]: half its range, as a share of its mean."""
    values = np.concatenate([course.at([begin, end]), course.between(begin, end)[1]])
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


def _binned(t: Array, f: Array) -> tuple[Array, Array, Array, float]:
    """Centres, means and counts of at most BINS bins, and the white noise of one sample from neighbours."""
    bins = min(BINS, t.size)
    index = np.minimum(((t - t[0]) / (t[-1] - t[0]) * bins).astype(int), bins - 1)
    count = np.bincount(index, minlength=bins)
    filled = count > 0
    mean, centre = (np.bincount(index, weights=v, minlength=bins)[filled] / count[filled] for v in (f, t))
    noise = float(np.sqrt(np.mean(np.diff(f, 2) ** 2) / 6.0))
    return centre, mean, count[filled].astype(float), max(noise, 1e-9 * float(np.max(np.abs(f))))


# Rhythms of a load as sums of harmonics, known from what was measured: their course, and how sure it is when.


@dataclass(frozen=True)
class _Rhythms:
    """A course with its rhythms, and what they cost: variance [N^2] at `times` [s] (k,) of all of them, and a typical
    one of those that are faster than a smoothed course."""

    force: NormalForce
    times: Array
    variance: Array
    fast: float


def _with_rhythms(slow: NormalForce, t: Array, f: Array) -> _Rhythms | None:
    """The course with what stands out of the noise in the spectrum of the rest; None where nothing does, or the clock
    is uneven.

    The lines that stand out say which harmonics there are, and how strong; `harmonics` what the samples say of each.
    What they leave near these lines beyond the noise counts to the error.
    """
    intervals, length = np.diff(t), float(t[-1] - t[0])
    step = float(np.median(intervals))
    if t.size < FEWEST_FOR_SPECTRUM or float(np.max(np.abs(intervals - step))) > EVEN * step:
        return None
    rest = f - slow.at(t)
    power = scipy.fft.dct(rest, norm="ortho") ** 2
    noise = max(float(np.median(power)) / chi_square(0.5, 1), 1e-300)
    share, near = _standing_out(power, noise, round(2.0 * SKIRT * length))
    share[0] = 0.0  # the level is no rhythm
    share[np.argsort(share * power)[: max(share.size - MOST_HARMONICS, 0)]] = 0.0
    if not np.any(share):
        return None
    fastest = int(np.flatnonzero(share)[-1]) + 1  # half periods in the record
    finer = int(np.clip(np.ceil(0.5 * PER_PERIOD * fastest / t.size), 1, max(MOST_DRAWN // t.size, 1)))
    slower = int(2.0 * length / SMOOTHED)  # lines of slower rhythms
    ends = np.linspace(0.0, min(3.0, 0.25 * length), NEAR_ENDS)
    inner = np.linspace(ends[-1], length - ends[-1], NEAR_ENDS + 2)[1:-1]
    times = np.concatenate([ends, inner, length - ends[::-1]])
    known = harmonics(rest, step, share, noise)
    at, wave = known.course(finer)
    stated, fast = known.variance(times), float(np.median(known.variance(times, slower)))
    left = scipy.fft.dct(rest - known.course(1)[1], norm="ortho") ** 2
    lost = np.where(near & (share == 0.0), left - noise, 0.0) / t.size
    whole, quick = (max(float(np.sum(lost[first:])), 0.0) for first in (0, slower))
    beyond = max(_unfollowed(power, left, share, stated, times) - whole, 0.0)
    coarser = max(1, int(2.0 * wave.size / (PER_PERIOD * fastest)))
    at, wave = t[0] + at[::coarser], wave[::coarser]
    places = np.unique(np.concatenate([at[(at >= t[0]) & (at <= t[-1])], [t[0], t[-1]]]))
    force = NormalForce.of((places, np.maximum(slow.at(places) + np.interp(places, at, wave), 1e-9)))
    return _Rhythms(force, t[0] + times, stated + whole + beyond, fast + quick + beyond)


def _unfollowed(power: Array, left: Array, share: Array, stated: Array, times: Array) -> float:
    """Variance [N^2] of what a course leaves of the load wherever in the spectrum, by Stein's unbiased estimate of the
    error of a smoother (1981), less what is stated of it; 0 where the white noise is not seen by itself.

    Args:
        power, left: (n,) of the lines of a record, and of what the course leaves of it; share: (n,) of them that it
            follows; stated: (k,) variance of the course at times (k,) [s].
    """
    fast = slice(-(power.size // WHITE), None)
    if np.any(share[fast]):
        return 0.0
    typical = float(np.trapezoid(stated, times) / (times[-1] - times[0]))
    return float(np.mean(left) - np.mean(power[fast])) + typical


def _standing_out(power: Array, noise: float, skirt: int) -> tuple[Array, Bools]:
    """Of every line of a spectrum (n,) the share of its power that is no noise, 0 where it does not stand out; and
    which of them are among the `skirt` lines about one that does, where more of its rhythm may hide.

    The narrowest mean that stands out of what white noise reaches counts, and is left out of the wider ones.
    """
    share, rest = np.zeros(power.size), power.copy()
    for width in NEIGHBOURS:
        mean = scipy.ndimage.uniform_filter1d(rest, width, mode="nearest")
        limit = chi_square_exceeded(FALSE_ALARMS / (power.size * len(NEIGHBOURS)), width) / width
        high = (mean > limit * noise) & (share == 0.0)
        share[high] = 1.0 - noise / mean[high]
        rest[high] = noise
    near = scipy.ndimage.maximum_filter1d(share, 2 * (skirt // 2) + 1, mode="constant") > 0.0
    return share, near


@dataclass(frozen=True)
class Harmonics:
    """What n samples, `step` [s] apart, say of rhythms: line (m,), of k half periods in the record each; amplitudes
    cosine, sine (m,); factor (2 m, 2 m), a square root of their covariance, cosines first."""

    count: int
    step: float
    line: NDArray[np.int64]
    cosine: Array
    sine: Array
    factor: Array

    def course(self, finer: int) -> tuple[Array, Array]:
        """Times [s] from the first sample, `finer` times as many as samples and half of their distance inside, and the
        rhythms there."""
        size = finer * self.count
        lines, sines = np.zeros(size), np.zeros(size)
        lines[self.line], sines[self.line - 1] = self.cosine, self.sine
        wave = np.sqrt(0.5 * size) * (scipy.fft.idct(lines, norm="ortho") + scipy.fft.idst(sines, norm="ortho"))
        return self.step * ((np.arange(size) + 0.5) / finer - 0.5), wave

    def variance(self, time: Array, first: int = 0) -> Array:
        """Variance of the rhythms at times (k,) [s] from the first sample; of those of `first` half periods or more."""
        counted = self.line >= first
        phase = np.pi * np.outer(time / self.step + 0.5, self.line) / self.count
        waves = np.concatenate([np.cos(phase) * counted, np.sin(phase) * counted], axis=1)
        return np.asarray(np.sum((waves @ self.factor) ** 2, axis=1))


def harmonics(values: Array, step: float, share: Array, noise: float) -> Harmonics:
    """The rhythms of evenly sampled values.

    The spectrum of a record repeats it backwards beyond its ends, where a rhythm does no such thing: a course made of
    its lines is off near the ends by several times what it is off elsewhere. Harmonics with sine and cosine, each with
    the variance that the spectrum shows at its frequency, run on as they come; what the samples say of them follows
    from Bayes, and so does its error, which grows towards the ends.

    Args:
        values: (n,) at times step * (0, 1, ...); share (n,) of the power of every line of their cosine spectrum that is
            no noise, 0 where there is no rhythm, below 1; noise: variance of the white noise of one value.
    """
    n = values.size
    line = np.flatnonzero(share > 0.0)
    line = line[line > 0]
    prior = noise * share[line] / (1.0 - share[line]) / n  # variance of either amplitude
    # Cosines among themselves, and sines, are orthogonal over the samples; the one with the other where k + l is odd.
    sums, differences = (np.add.outer(sign * line, line) for sign in (1, -1))
    odd = sums % 2 == 1
    across = np.zeros(sums.shape)
    across[odd] = 0.5 / np.sin(0.5 * np.pi * sums[odd] / n) + 0.5 / np.sin(0.5 * np.pi * differences[odd] / n)
    own = np.diag(0.5 * n / noise + 1.0 / prior)
    precision = np.block([[own, across / noise], [across.T / noise, own]])
    spectra = scipy.fft.dct(values, norm="ortho")[line], scipy.fft.dst(values, norm="ortho")[line - 1]
    lower = scipy.linalg.cholesky(precision, lower=True)
    amplitudes = scipy.linalg.cho_solve((lower, True), np.sqrt(0.5 * n) / noise * np.concatenate(spectra))
    factor = scipy.linalg.solve_triangular(lower, np.eye(2 * line.size), lower=True).T
    return Harmonics(n, step, line, amplitudes[: line.size], amplitudes[line.size :], factor)


# A jitter of the load that no fit can follow.


def without_jitter(log: LogData) -> LogData:
    """The log with the jitter taken out of its normal force and counted to its error; itself where there is none.

    An onset is where the spring force reaches the static limit. Where that jitters, no solver finds its way from events
    that are still off by more than a few milliseconds; from the events of a smoothed load it does.
    """
    times = log.normal_force.knots[0]
    if log.calm or times.size < FEWEST_FOR_SPECTRUM or float(np.min(np.diff(times))) > SMOOTHED / 2.0:
        return log
    fine = np.linspace(times[0], times[-1], int(np.ceil((times[-1] - times[0]) / SMOOTHED * PER_PERIOD)) + 2)
    force = log.normal_force.at(fine)
    low_pass = scipy.signal.butter(4, 2.0 / PER_PERIOD, output="sos")  # 1 is half the rate of the fine grid
    smoothed = scipy.signal.sosfiltfilt(low_pass, force)
    taken = float(np.std(force - smoothed))
    if not taken > JITTERS * float(np.mean(force)):
        return log
    expected = (0.0, 0.0)
    if log.pull is not None:
        finest = np.linspace(fine[0], fine[-1], 16 * fine.size)
        # What the measurement blurs of the jitter swings with what it shows.
        whole = float(np.hypot(log.tremor_sd, taken)) / taken
        swings = whole * (log.normal_force.at(finest) - np.interp(finest, fine, smoothed))
        rise, slip = log.pull.rate / log.pull.coefficient, log.pull.slip
        expected = first_passage(swings, finest[1] - finest[0], rise, slip, SURVIVED * slip)
    return replace(
        log,
        normal_force=NormalForce.of((fine, smoothed)),
        normal_force_sd=float(np.hypot(log.normal_force_sd, taken)),
        sd_course=None,
        tremor_sd=taken,
        calm=True,
        expected=expected,
    )


def without_unresolved_jitter(log: LogData) -> LogData:
    """The log without the jitter of its normal force where no fit can follow it, and with loose onsets where it can
    only follow it while the mass slips.

    A jitter that the measurement blurs puts onsets where the spring force falls behind the static limit; what is taken
    out counts to the error of the load. And where the limit jitters much faster than the drive loads, it dips below the
    spring force again and again before a slip: the mass moves a little each time, which is not seen in the force and
    renews the contact. Its measurement does not say what it has to be at the onset then.
    """
    smoothed, loading = without_jitter(log), log.pull
    if smoothed is log or loading is None:
        return log
    if log.tremor_sd > BLURRED * smoothed.tremor_sd:
        return replace(smoothed, blurred=True)
    times, values = log.normal_force.knots
    steps = np.diff(times)
    rates = np.diff(values - smoothed.normal_force.at(times)) / steps
    fastest = float(np.sqrt(2.0 * np.average(rates**2, weights=steps)))
    outruns = loading.coefficient * fastest > OUTRUN * loading.rate
    return replace(log, loose=smoothed.tremor_sd) if outruns else log
