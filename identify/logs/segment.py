"""Stick and slip phases of a measured force, from the data alone."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import kept, thinned_steps
from identify.logs.noise import bridged, quantum, spikes, uneven, white_noise
from identify.logs.slips import (
    SLIDING,
    SLIP,
    STICK,
    ForceTrace,
    JudgedFalls,
    crossing,
    judge,
    label,
    level,
    line_slope,
    loading_knee,
    noise_on_lines,
    not_slipping,
    slope,
    slope_error,
    span,
)
from identify.logs.zigzag import WIDTH_SHARE, find_falls

__all__ = ["SLIDING", "SLIP", "STICK", "DetectedCycles", "Segmentation", "segment"]

Array = NDArray[np.float64]

CLEAR = 6.0  # standard deviations of the smoothed force: of smaller falls many are lost in the noise
FEW_SLIPS = 3  # slips before a record slides: fewer are followed one by one
MOSTLY = 0.5  # share of the samples that slide from which on a record is followed, not folded


@dataclass(frozen=True)
class DetectedCycles:
    """One stick and the slip that ends it per entry, both complete; arrays of shape (c,), from the data only.

    onset: time of the force peak before the fall [s], with its force [N] from a local fit; fall: time
    at which the force crosses the middle of the fall [s], interpolated; arrest: time of the valley after
    it [s], with its force [N]. In fast logs the true onset lies before the peak (there the mass already
    moves as fast as the drive) and the true arrest after the valley.
    """

    onset: Array
    onset_force: Array
    fall: Array
    arrest: Array
    arrest_force: Array

    @property
    def count(self) -> int:
        """Number of cycles."""
        return int(self.onset.size)

    @property
    def drop(self) -> Array:
        """Peak minus valley [N], shape (c,)."""
        return self.onset_force - self.arrest_force

    @property
    def middle(self) -> Array:
        """Middle between peak and valley [N], shape (c,): where an undamped slip is symmetric."""
        return 0.5 * (self.onset_force + self.arrest_force)

    @property
    def period(self) -> Array:
        """Time from fall to fall [s], shape (c - 1,)."""
        return np.diff(self.fall)


@dataclass(frozen=True)
class Segmentation:
    """Phases of a force record of n samples and figures of their quality.

    noise: sd of the white noise [N]; spikes: samples to mask, shape (n,), true also where the force is
    not finite; phase: int8 (n,), 0 stick, 1 slip (peak to valley), 2 sliding without stick-slip;
    begins_in_slip: the record starts within a slip (not counted); stick_slopes: slope of every stick
    that was seen completely [N/s], in order, the first ramp of a record that starts at rest apart in
    `loading_slope` (None without one); ends_sliding: steady or decaying sliding follows the last cycle; low_snr: slips
    fall by so little that many of them are lost in the noise; other_falls: number of falls that stand out of the noise
    and are no slips.
    """

    cycles: DetectedCycles
    noise: float
    spikes: NDArray[np.bool_]
    phase: NDArray[np.int8]
    begins_in_slip: bool
    ends_sliding: bool
    stick_slopes: Array
    loading_slope: float | None
    sample_interval: float
    low_snr: bool = False
    other_falls: int = 0

    @property
    def count(self) -> int:
        """Number of complete cycles."""
        return self.cycles.count

    @property
    def samples_per_slip(self) -> float:
        """Median number of samples from peak to valley; 0 without cycles."""
        return self._median(self.cycles.arrest - self.cycles.onset) / self.sample_interval

    @property
    def samples_per_cycle(self) -> float:
        """Median number of samples from fall to fall; 0 with fewer than two cycles."""
        return self._median(self.cycles.period) / self.sample_interval

    @property
    def drop_mean_and_sd(self) -> tuple[float, float] | None:
        """Mean and standard deviation of the drops [N], the first breakaway apart where slips follow it: its rest is of
        any length; None without cycles."""
        apart = self.count > 1 and self.loading_slope is not None
        return _mean_and_sd(self.cycles.drop[1:] if apart else self.cycles.drop)

    @property
    def period_mean_and_sd(self) -> tuple[float, float] | None:
        """Mean and standard deviation of the periods [s]; None with fewer than two cycles."""
        return _mean_and_sd(self.cycles.period)

    @property
    def stick_slope(self) -> tuple[float, float] | None:
        """Median stick slope [N/s] and its relative scatter (1.48 MAD); None where no stick was seen."""
        slopes = self.stick_slopes
        if slopes.size == 0:
            return None if self.loading_slope is None else (self.loading_slope, 0.0)
        middle = float(np.median(slopes))
        return middle, float(1.4826 * np.median(np.abs(slopes - middle)) / abs(middle)) if middle else 0.0

    @property
    def spike_count(self) -> int:
        """Number of masked samples."""
        return int(np.count_nonzero(self.spikes))

    def share(self, phase: int) -> float:
        """Share of the samples in a phase (STICK, SLIP or SLIDING), 0 to 1."""
        return float(np.count_nonzero(self.phase == phase) / self.phase.size) if self.phase.size else 0.0

    def slides_on(self, slips: int) -> bool:
        """Whether the record slides after so many slips, which are few or a small part of it."""
        return self.ends_sliding and (slips < FEW_SLIPS or self.share(SLIDING) > MOSTLY)

    @staticmethod
    def _median(values: Array) -> float:
        return float(np.median(values)) if values.size else 0.0


def _mean_and_sd(values: Array) -> tuple[float, float] | None:
    if values.size == 0:
        return None
    return float(np.mean(values)), float(np.std(values, ddof=1)) if values.size > 1 else 0.0


def segment(
    time: Array, force: Array, *, half_period: float | None = None, noise: float | None = None, slips: bool = True
) -> Segmentation:
    """Finds the sticks and slips of a force record.

    A slip is a fall of the smoothed force by more than the noise spans, with a rise before and after it.
    What then only rises less steeply than a stick, and decays, is sliding and no cycle.

    Args:
        time: rising [s], shape (n,), about evenly spaced.
        force: friction force, positive in the direction of sliding [N], shape (n,); NaN where not measured.
        half_period: pi sqrt(m/k) [s] where the rig is known: it bounds the smoothing.
        noise: standard deviation of the force [N] where it is known, else estimated.
        slips: False where it is known that no fall of it is one: loading, then sliding.

    Raises:
        ValueError: time and force of different shapes.
    """
    time, force = np.asarray(time, dtype=np.float64), np.asarray(force, dtype=np.float64)
    if time.shape != force.shape or time.ndim != 1:
        raise ValueError(f"time {time.shape} and force {force.shape} are not two columns of one length")
    holes = ~np.isfinite(force)
    if time.size < 8 or holes.all():
        return _nothing(time, holes, noise or 0.0)
    clean = bridged(force, holes)
    stamps = time if uneven(time) else None
    white = white_noise(clean, stamps)
    # What slides moves as its track and its noise do: a spike stands out of these, and a dip with a floor is none.
    steps = 0.0 if slips else 1.4826 * float(np.median(np.abs(np.diff(clean)))) / sqrt(2.0)
    masked = spikes(clean, max(white, noise or 0.0, steps), floors=not slips)
    clean = bridged(clean, masked)
    interval = float(np.median(thinned_steps(time)))
    sd = white if noise is None else noise
    turns = find_falls(clean, sd, None if half_period is None else half_period / interval)
    turns = turns if slips else turns.without_falls()
    trace = ForceTrace(time, clean, turns.smoothed, sd, turns.hysteresis)
    falls = judge(trace, turns)
    phase, ends_sliding = label(trace, falls)
    cycles = _cycles(trace, falls)
    low_snr = _low_snr(cycles, sd, interval, half_period)
    return Segmentation(
        cycles=cycles,
        noise=_noise(kept(force, ~holes), clean, phase, white, low_snr, stamps) if noise is None else noise,
        spikes=masked | holes,
        phase=phase,
        begins_in_slip=falls.starts_falling and bool(falls.kept.any()),
        ends_sliding=ends_sliding,
        stick_slopes=falls.stick_slopes,
        loading_slope=_loading_slope(trace, falls),
        sample_interval=interval,
        low_snr=low_snr,
        other_falls=int(np.count_nonzero(~falls.kept)),
    )


def _low_snr(cycles: DetectedCycles, white: float, interval: float, half_period: float | None) -> bool:
    """Whether slips fall by less than what is surely seen of them."""
    if cycles.count == 0:
        return False
    drop = float(np.median(cycles.onset_force - cycles.arrest_force))
    lasting = half_period or float(np.median(cycles.arrest - cycles.onset))
    return drop * sqrt(max(WIDTH_SHARE * lasting / interval, 1.0)) < CLEAR * white


def _noise(
    finite: Array, clean: Array, phase: NDArray[np.int8], white: float, low_snr: bool, stamps: Array | None
) -> float:
    """Never less than the rounding of the file; what lies between slips lost in the noise holds others."""
    on_lines = None if low_snr else noise_on_lines(clean, not_slipping(phase), stamps)
    return max(on_lines or white, quantum(finite) / sqrt(12.0))


def _nothing(time: Array, holes: NDArray[np.bool_], noise: float) -> Segmentation:
    none = np.empty(0)
    phase = np.full(time.size, SLIDING, dtype=np.int8)
    interval = float(np.median(thinned_steps(time))) if time.size > 1 else 1.0
    return Segmentation(
        DetectedCycles(none, none, none, none, none), noise, holes, phase, False, True, none, None, interval
    )


def _loading_slope(trace: ForceTrace, slips: JudgedFalls) -> float | None:
    if slips.kept.any():
        return slips.loading_slope
    knee = loading_knee(trace)
    return slope(trace.time, trace.force, 0, knee, trace.noise) if knee else None


def _cycles(trace: ForceTrace, slips: JudgedFalls) -> DetectedCycles:
    """The slips with forces from local fits and interpolated falls."""
    rows = []
    for i in np.flatnonzero(slips.kept):
        peak, valley = int(slips.peaks[i]), int(slips.valleys[i])
        before = int(slips.valleys[i - 1]) if i else 0
        after = int(slips.peaks[i + 1]) if i + 1 < slips.peaks.size else trace.last
        inward = int(0.08 * (valley - peak))
        high = level(trace.force, peak - span(peak - before), peak + inward, peak)
        low = level(trace.force, valley - inward, valley + span(after - valley), valley)
        fall = slice(peak, valley + 1)
        middle = crossing(trace.time[fall], trace.force[fall], trace.coarse[fall], 0.5 * (high + low), high - low)
        rows.append((trace.time[peak], high, middle, trace.time[valley], low))
    return DetectedCycles(*np.array(rows, dtype=np.float64).reshape(-1, 5).T)


# Whether a log without a slip ends while its first stick still loads: it was stopped too soon.

END = 0.1  # share of the samples at the end whose slope is asked for
FEWEST = 8  # of these samples, at least
AS_STEEP = 0.5  # of the slope of a stick: near its first slip a contact creeps already, and a soft skin takes its share
SURE = 3.0  # standard errors by which the slope at the end is more than that

ENDS_LOADING = "the log ends while the first stick still loads"
REMEDY = "record longer, or faster"


def still_loading(time: Array, force: Array, found: Segmentation, expected_slope: float | None) -> bool:
    """Whether the force still rises at the end as in a stick, in a log in which no slip was seen.

    Args:
        time, force: (n,) [s], [N], sliding positive, NaN where nothing counts.
        expected_slope: stiffness times drive speed [N/s]; None where not known: the first rise of the log counts.
    """
    if found.count or found.begins_in_slip or not found.phase.size or found.phase[-1] != STICK:
        return False
    slope = expected_slope or found.loading_slope
    good = np.isfinite(force) & ~found.spikes
    last = max(round(END * np.count_nonzero(good)), FEWEST)
    t, f = time[good][-last:], force[good][-last:]
    if slope is None or t.size < FEWEST:
        return False
    return line_slope(t, f, found.noise) > AS_STEEP * slope + SURE * slope_error(t, found.noise)
