"""The normal force as the model takes it: its course or its mean; where a trembling one lets a slip begin."""

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
from identify.logs.spectrum import harmonics
from identify.simulation.drive import NormalForce

# Where a tremor stands when something that rises slowly first reaches it.
#
# A pull that loads a stick meets a grip that trembles in one of its dips, the first that is deep enough: at the onset
# of a slip the grip is weaker than its mean, and half a period later, when the slip ends, stronger. A tremor that is
# not followed has these means nevertheless, and a fit that takes it for noise about nothing answers with wrong
# friction.

Array = NDArray[np.float64]


def first_passage(tremor: Array, step: float, rise: float, later: float, survived: float = 0.0) -> tuple[float, float]:
    """Return the mean of a tremor where a line that rises reaches it for the first time, and its mean `later` [s].

    The line may come from anywhere: every height at which it could start counts alike. Those that reach the tremor at a
    sample are as many as the tremor, less the rise, is lower there than ever before.

    Args:
        tremor: (n,) in units of the line, `step` [s] apart; rise: of the line [1/s]; survived [s]: a dip below the line
            that is over so soon does not count.
    """
    above = tremor - rise * step * np.arange(tremor.size)
    reached = np.append(0.0, -np.diff(np.minimum.accumulate(above)))
    after, soon = round(later / step), round(survived / step)
    if soon:
        reached[:-soon] = np.where(above[soon:] < above[:-soon], reached[:-soon], 0.0)
    whole = np.flatnonzero(reached[: max(tremor.size - after, 0)])
    if whole.size == 0:
        return 0.0, 0.0
    ends = np.average([tremor[whole], tremor[whole + after]], axis=1, weights=reached[whole])
    return float(ends[0]), float(ends[1])


Bools = NDArray[np.bool_]

SEGMENTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
BINS = 2048  # means of samples a spline is fitted to: enough for the finest one
WORTH = 3.0  # what one more knot must gain in 2 ln(likelihood): more than Akaike's 2, so that noise stays out
DRAWN = 8  # straight pieces per spline segment
NEIGHBOURS = (3, 9, 27, 81)  # frequencies over which a spectrum is averaged: a pulse is a line, a tremor a band
SKIRT = 3.0  # [Hz] about a line that stands out in which more of its rhythm may hide
WHITE = 3  # the fastest lines, one of so many, show the white noise alone
FALSE_ALARMS = 0.01  # rhythms per log that white noise alone may show
FEWEST_FOR_SPECTRUM = 64
EVEN = 0.05  # of a sampling interval that intervals may differ, where a spectrum is taken
PER_PERIOD = 20  # straight pieces per period of the fastest rhythm
MOST_DRAWN = 60_000
MOST_HARMONICS = 1500  # of more, a noise of its own, the spectrum of the record is taken as it is
ENDS, TOWARDS = 64, 3.0  # times near either end at which the error of a course is told, and [s] how far they reach
BETWEEN = 64  # times in between
CALM = 0.3  # [s]: rhythms with shorter periods are taken out of a calm course; a pulse stays in it
ORDER = 4  # of the filter that does
SURVIVED = 0.25  # of a slip: it begins slowly, and a grip that is firm again so soon ends it
FINEST = 16  # times finer than that filter sees a load: where a line that rises meets its tremor
OUTRUN = 3.0  # times the pull: rate of a trembling grip from which on a contact slips a little before it slips
BLURRED = 0.4  # of a tremor: error of its measured course from which on it is not followed
TREMBLES = 1e-3  # of the load: less is left in
SEEN = 5.0  # standard errors of its course from which on a normal force is said to vary


@dataclass(frozen=True)
class LoadSpline:
    """A measured normal force as a line over time; sd [N] by which it may be off (0: exact); tremor_sd [N], the part of
    it that lies in fast rhythms and is another one at the end of a slip than at its onset; sd_course: the sd over
    time, where it is not the same throughout."""

    force: NormalForce
    sd: float = 0.0
    tremor_sd: float = 0.0
    sd_course: NormalForce | None = None


@dataclass(frozen=True)
class _Rhythms:
    """A course with its rhythms, and what they cost: variance [N^2] at `times` [s] (k,) of all of them, and a typical
    one of those that are faster than a calm course."""

    force: NormalForce
    times: Array
    variance: Array
    fast: float


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
    fast for it but stands out of the noise, as pulse and tremor of a live finger do, is added. It is
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
    level = float(np.average(means, weights=weights))
    best, count = NormalForce.of(level), 1
    best_score = float(np.sum(weights * (means - level) ** 2)) / noise**2 + WORTH
    for segments in SEGMENTS:
        if centres.size < 4 * (segments + 3):
            break
        inner = np.quantile(centres, np.linspace(0.0, 1.0, segments + 1)[1:-1])
        knots = np.concatenate([[centres[0]] * 4, inner, [centres[-1]] * 4])
        spline = scipy.interpolate.make_lsq_spline(centres, means, knots, k=3, w=np.sqrt(weights))
        square = float(np.sum(weights * (means - spline(centres)) ** 2)) / noise**2
        score = square + WORTH * (segments + 3)
        if score < best_score:
            drawn = np.linspace(centres[0], centres[-1], DRAWN * segments + 1)
            best, count, best_score = NormalForce.of((drawn, np.maximum(spline(drawn), 1e-9))), segments + 3, score
    found = _with_rhythms(best, t, f)
    one = noise**2 / t.size
    fast = one * max(count - (t[-1] - t[0]) / CALM, 0.0)  # of a spline of short segments
    if found is None:
        return LoadSpline(_checked(best, name), float(np.sqrt(one * max(count, cycles))), float(np.sqrt(fast)))
    variance = np.maximum(one * count + found.variance, one * cycles)
    sd = float(np.sqrt(np.median(variance)))
    over_time = NormalForce.of((found.times, np.sqrt(variance)))
    return LoadSpline(_checked(found.force, name), sd, float(np.sqrt(fast + found.fast)), over_time)


def _with_rhythms(slow: NormalForce, t: Array, f: Array) -> _Rhythms | None:
    """The course with what stands out of the noise in the spectrum of the rest; None where nothing does, or the clock
    is uneven.

    The lines that stand out say which harmonics there are, and how strong; `harmonics` what the samples say of each.
    What they leave near these lines beyond the noise counts to the error.
    """
    intervals = np.diff(t)
    step = float(np.median(intervals))
    if t.size < FEWEST_FOR_SPECTRUM or float(np.max(np.abs(intervals - step))) > EVEN * step:
        return None
    rest = f - slow.at(t)
    lines = scipy.fft.dct(rest, norm="ortho")
    power = lines**2
    noise = max(float(np.median(power)) / chi_square(0.5, 1), 1e-300)
    kept, near = _standing_out(power, noise, round(2.0 * SKIRT * (t[-1] - t[0])))
    kept[0] = 0.0  # the level is no rhythm
    strongest = int(np.count_nonzero(kept))
    if not strongest:
        return None
    fastest = int(np.flatnonzero(kept)[-1]) + 1  # half periods in the record
    finer = int(np.clip(np.ceil(0.5 * PER_PERIOD * fastest / t.size), 1, max(MOST_DRAWN // t.size, 1)))
    calm = int(2.0 * (t[-1] - t[0]) / CALM)  # lines of slower rhythms
    times = _towards_the_ends(t[-1] - t[0])
    if strongest <= MOST_HARMONICS:
        known = harmonics(rest, step, kept, noise)
        at, wave = known.course(finer)
        told, fast = known.variance(times), float(np.median(known.variance(times, calm)))
        left = scipy.fft.dct(rest - known.course(1)[1], norm="ortho") ** 2
    else:
        padded = np.concatenate([kept * lines, np.zeros((finer - 1) * t.size)])
        at = step * ((np.arange(padded.size) + 0.5) / finer - 0.5)
        wave = scipy.fft.idct(padded, norm="ortho") * np.sqrt(finer)
        told, fast = (np.full(times.size, noise * np.sum(kept) / t.size), noise * float(np.sum(kept[calm:])) / t.size)
        left = ((1.0 - kept) * lines) ** 2
    lost = np.where(near & (kept == 0.0), left - noise, 0.0) / t.size
    whole, quick = (max(float(np.sum(lost[first:])), 0.0) for first in (0, calm))
    beyond = max(_unfollowed(power, left, kept, told, times) - whole, 0.0)
    whole, quick = whole + beyond, quick + beyond
    coarser = max(1, int(2.0 * wave.size / (PER_PERIOD * fastest)))
    at, wave = t[0] + at[::coarser], wave[::coarser]
    inside = (at >= t[0]) & (at <= t[-1])
    places = np.unique(np.concatenate([at[inside], [t[0], t[-1]]]))
    course = slow.at(places) + np.interp(places, at, wave)
    force = NormalForce.of((places, np.maximum(course, 1e-9)))
    return _Rhythms(force, t[0] + times, told + whole, fast + quick)


def _unfollowed(power: Array, left: Array, kept: Array, told: Array, times: Array) -> float:
    """Variance [N^2] of what a course leaves of the load wherever in the spectrum, by Stein's unbiased estimate of the
    error of a smoother (1981), less what is told of it; 0 where the white noise is not seen by itself.

    Args:
        power, left: (n,) of the lines of a record, and of what the course leaves of it; kept: (n,) their shares that it
            follows; told: (k,) variance of the course at times (k,) [s].
    """
    fast = slice(-(power.size // WHITE), None)
    if np.any(kept[fast]):
        return 0.0
    typical = float(np.trapezoid(told, times) / (times[-1] - times[0]))
    return float(np.mean(left) - np.mean(power[fast])) + typical


def _towards_the_ends(length: float) -> Array:
    """Times from the beginning of a record [s], closer to each other near its ends."""
    near = np.linspace(0.0, min(TOWARDS, 0.25 * length), ENDS)
    inner = np.linspace(near[-1], length - near[-1], BETWEEN + 2)[1:-1]
    return np.concatenate([near, inner, length - near[::-1]])


def _standing_out(power: Array, noise: float, skirt: int) -> tuple[Array, Bools]:
    """Of every line of a spectrum (n,) the share of its power that is no noise, 0 where it does not stand out; and
    which of them are among the `skirt` lines about one that does, where more of its rhythm may hide.

    The narrowest mean that stands out of what white noise reaches counts, and is left out of the wider ones.
    """
    kept, rest = np.zeros(power.size), power.copy()
    for width in NEIGHBOURS:
        mean = scipy.ndimage.uniform_filter1d(rest, width, mode="nearest")
        limit = chi_square_exceeded(FALSE_ALARMS / (power.size * len(NEIGHBOURS)), width) / width
        high = (mean > limit * noise) & (kept == 0.0)
        kept[high] = 1.0 - noise / mean[high]
        rest[high] = noise
    return kept, _within(kept > 0.0, skirt)


def _within(marked: Bools, width: int) -> Bools:
    """Which places (n,) have a marked one within half a width on either side."""
    counted = np.append(0, np.cumsum(marked))
    place = np.arange(marked.size)
    first, last = np.maximum(place - width // 2, 0), np.minimum(place + width // 2 + 1, marked.size)
    return np.asarray(counted[last] > counted[first])


def level(time: Array, normal_force: Array, name: str = "the log", cycles: int = 1) -> LoadSpline:
    """The mean of a measured normal force, and its standard error [N] as the white noise leaves it.

    Arguments and errors as `smooth`.
    """
    t, f = _finite(time, normal_force, name)
    mean = _checked(NormalForce.of(max(float(np.mean(f)), 1e-9)), name)
    if np.ptp(f) == 0.0 or t.size < 16:
        return LoadSpline(mean)
    return LoadSpline(mean, _binned(t, f)[3] * float(np.sqrt(max(cycles, 1) / t.size)))


def calmed(log: LogData) -> LogData:
    """The log with the tremor taken out of its normal force and counted to its error; itself where it does not tremble.

    An onset is where the pull reaches the grip. Where the grip trembles, that row bends within a few milliseconds, and
    no solver finds its way from events that are still off by more; from the events of a calm load it does.
    """
    times = log.normal_force.knots[0]
    if log.calm or times.size < FEWEST_FOR_SPECTRUM or float(np.min(np.diff(times))) > CALM / 2.0:
        return log
    fine = np.linspace(times[0], times[-1], int(np.ceil((times[-1] - times[0]) / CALM * PER_PERIOD)) + 2)
    force = log.normal_force.at(fine)
    low_pass = scipy.signal.butter(ORDER, 2.0 / PER_PERIOD, output="sos")  # 1 is half the rate of the fine grid
    calm = scipy.signal.sosfiltfilt(low_pass, force)
    taken = float(np.std(force - calm))
    if not taken > TREMBLES * float(np.mean(force)):
        return log
    sd = float(np.hypot(log.normal_force_sd, taken))
    expected = (0.0, 0.0)
    if log.pull is not None:
        finest = np.linspace(fine[0], fine[-1], FINEST * fine.size)
        # What the measurement blurs of the tremor swings with what it shows.
        whole = float(np.hypot(log.tremor_sd, taken)) / taken
        swings = whole * (log.normal_force.at(finest) - np.interp(finest, fine, calm))
        rise, slip = log.pull.rate / log.pull.coefficient, log.pull.slip
        expected = first_passage(swings, finest[1] - finest[0], rise, slip, SURVIVED * slip)
    return replace(
        log,
        normal_force=NormalForce.of((fine, calm)),
        normal_force_sd=sd,
        sd_course=None,
        tremor_sd=taken,
        calm=True,
        expected=expected,
    )


def as_far_as_told(log: LogData) -> LogData:
    """The log without the tremor of its normal force where no fit can follow it, and with loose onsets where it can
    only follow it while the mass slips.

    A tremor that the measurement blurs puts onsets where the pull falls behind the grip; what is taken out counts to
    the error of the load. And where the grip trembles much faster than the drive pulls, it dips below the pull again
    and again before a slip: the mass moves a little each time, which is not seen in the force and renews the contact.
    What the grip has to be at the onset is not told by its measurement then.
    """
    calm, pull = calmed(log), log.pull
    if calm is log or pull is None:
        return log
    if log.tremor_sd > BLURRED * calm.tremor_sd:
        return replace(calm, blurred=True)
    times, values = log.normal_force.knots
    steps = np.diff(times)
    rates = np.diff(values - calm.normal_force.at(times)) / steps
    fastest = float(np.sqrt(2.0 * np.average(rates**2, weights=steps)))
    outruns = pull.coefficient * fastest > OUTRUN * pull.rate
    return replace(log, loose=calm.tremor_sd) if outruns else log


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


def _binned(t: Array, f: Array) -> tuple[Array, Array, Array, float]:
    """Centres, means and counts of at most BINS bins, and the white noise of one sample from neighbours."""
    bins = min(BINS, t.size)
    index = np.minimum(((t - t[0]) / (t[-1] - t[0]) * bins).astype(int), bins - 1)
    count = np.bincount(index, minlength=bins)
    filled = count > 0
    mean = np.bincount(index, weights=f, minlength=bins)[filled] / count[filled]
    centre = np.bincount(index, weights=t, minlength=bins)[filled] / count[filled]
    second = np.diff(f, 2) if f.size > 2 else np.array([np.std(f)])
    noise = float(np.sqrt(np.mean(second**2) / 6.0))
    return centre, mean, count[filled].astype(float), max(noise, 1e-9 * float(np.max(np.abs(f))))


def _checked(force: NormalForce, name: str) -> NormalForce:
    if min(force.values) <= 1e-6:
        raise FitError(f"{name}: the normal force falls to zero; cut the window to the part under load")
    return force
