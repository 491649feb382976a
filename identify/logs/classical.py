"""The classical table: what a tribologist reads off a friction log, whatever a fit makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import kept, thinned
from data_io.quality import mean_and_drift, presses
from identify.base.result import ClassicalDirection, ClassicalTable
from identify.logs.noise import FEWEST_ROWS, SIGNIFICANT, bridged, smooth
from identify.logs.recorded_drive import Stroke
from identify.logs.regime import LogRegime, Verdict
from identify.logs.segment import SLIDING, SLIP, STICK, Segmentation

Array = NDArray[np.float64]
Value = float | int | str | None
Figures = dict[str, tuple[Value, str]]  # by its name a figure, and why there is none where it is None

DEFINITIONS: Mapping[str, str] = {
    "first_breakaway_coefficient": "force peak that ends the first loading from rest, over the normal force there",
    "static_peak_coefficient": "mean over slips of the force peak before the slip over the normal force there, "
    "the first breakaway apart",
    "kinetic_mean_coefficient": "friction force over normal force, mean over time from the first breakaway on, as the "
    "standards of films, papers and plastics have it (ISO 8295, ASTM D1894)",
    "slip_middle_coefficient": "mean over slips of the middle between force peak and valley, where the undamped "
    "slip is symmetric, over the normal force",
    "static_rest_s": "median over the same slips of the time from the valley before to the peak: a static coefficient "
    "is that of a rest so long",
    "sliding_mean_coefficient": "mean over the samples that slide without stick-slip",
    "static_over_kinetic": "static peak coefficient over kinetic mean coefficient",
    "stick_slip_index": "mean force peak less mean valley of the slips, over twice the mean force from the first "
    "breakaway on: (max - min) / (2 mean)",
    "slips_per_mm": "slips per millimetre of travel of the drive",
    "jump_length_m": "drop over stiffness: that of the rig where it is given, else that of the sticks",
    "kinetic_travel_m": "travel of the drive over which the kinetic mean is taken; another with --window",
    "drop_N": "mean over slips of force peak minus following valley, the first breakaway apart where others follow",
    "stick_slope_N_per_s": "median over sticks of the slope of the straight middle of the force rise",
    "stick_stiffness_N_per_m": "stick slope over drive speed: machine, holder and contact in series",
    "frequency_Hz": "one over the mean time from slip to slip",
    "stick_slip_percent": "share of the time in sticks and slips",
    "sliding_percent": "share of the time in sliding without stick-slip",
    "sliding_trend_percent": "coefficient of the last tenth of what slides against the first tenth",
    "rhythm_Hz": "frequency of the spectral line of the force in steady sliding, where there is one",
    "rhythm_N": "range of that oscillation, peak to valley",
    "normal_force_N": "mean over the loaded rows",
    "normal_force_drift_percent": "median normal force of the last tenth of the loaded rows less that of the first, as "
    "share of their median",
}


@dataclass(frozen=True)
class _Part:
    """One stroke with sliding positive: time [s], forces [N] (n,), sound samples, its phases."""

    time: Array
    force: Array
    load: Array
    good: NDArray[np.bool_]
    phases: Segmentation

    @classmethod
    def of(cls, record: Record, stroke: Stroke, verdict: Verdict) -> _Part:
        rows = slice(stroke.start, stroke.stop)
        force, load = stroke.direction * record.friction_force[rows], record.normal_force[rows]
        good = np.isfinite(force) & np.isfinite(load) & ~verdict.phases.spikes & presses(load)
        return cls(record.time[rows], force, load, good, verdict.phases)


def table_of(record: Record, seen: LogRegime, stiffness: float | None = None) -> ClassicalTable:
    """The classical figures per step and stroke of a log, SI: floats, or None with a reason; never NaN.

    Args:
        record: the log; its friction force as in the file. seen: its regime.
        stiffness: of the rig [N/m], to compare the sticks with.

    Returns: one row per stroke; both directions apart where strokes go to and fro, with scatter, and last tenth over
    first; for each row why a figure is None, by its name; what each figure is (DEFINITIONS).
    """
    parts = [_Part.of(record, s, v) for s, v in zip(seen.strokes, seen.verdicts, strict=True)]
    rows, reasons = [], []
    for part, stroke, verdict in zip(parts, seen.strokes, seen.verdicts, strict=True):
        figures = _row(part, stroke, verdict, stiffness)
        finite = {k: v if not isinstance(v, float) or np.isfinite(v) else None for k, (v, _) in figures.items()}
        few = f"{np.count_nonzero(part.good)} sound samples are too few; {FEWEST_ROWS} are needed"
        enough = np.count_nonzero(part.good) >= FEWEST_ROWS
        rows.append(finite)
        reasons.append({k: figures[k][1] if enough else few for k, value in finite.items() if value is None})
    directions = []
    for direction in (1, -1) if len({stroke.direction for stroke in seen.strokes}) > 1 else ():
        levels = []
        for part in (part for part, stroke in zip(parts, seen.strokes, strict=True) if stroke.direction == direction):
            slides = part.good & (part.phases.phase == SLIDING)
            good = slides if slides.any() else part.good
            levels.append(float(np.mean(part.force[good] / part.load[good])) if good.any() else np.nan)
        known = np.array(levels)[np.isfinite(levels)]
        tenth, mean = max(known.size // 10, 1), float(known.mean()) if known.size else None
        sd, trend = (float(known.std(ddof=1)) if known.size > 1 else None), None
        if known.size > 1 and known[0]:
            trend = float(100.0 * (known[-tenth:].mean() / known[:tenth].mean() - 1.0))
        directions.append(ClassicalDirection(direction, len(levels), mean, sd, trend))
    return ClassicalTable(tuple(rows), tuple(directions), tuple(reasons), dict(DEFINITIONS))


def _row(part: _Part, stroke: Stroke, verdict: Verdict, stiffness: float | None) -> Figures:
    """The figures of a stroke."""
    time, phases, speed, rhythm, trend = part.time, part.phases, stroke.speed, verdict.rhythm, None
    mean, drift = mean_and_drift(part.load)
    drop, period, slope = phases.drop_mean_and_sd, phases.period_mean_and_sd, phases.stick_slope
    measured = slope[0] / speed if slope and speed else None
    sliding = part.good & (phases.phase == SLIDING)
    coefficient = part.force[sliding] / part.load[sliding]
    tenth = coefficient.size // 10
    rubs = tenth and float(np.median(part.force[sliding])) > SIGNIFICANT * phases.noise  # the drive may stand
    if rubs and (first := float(np.mean(coefficient[:tenth]))) > 0.0:
        trend = 100.0 * (float(np.mean(coefficient[-tenth:])) / first - 1.0)
    few = f"{phases.count} slip(s) are too few" if phases.count else "no slip"
    coefficients = _coefficients(part)
    static, kinetic = (coefficients[f"{name}_coefficient"][0] for name in ("static_peak", "kinetic_mean"))
    force, spring = (float(kinetic) * mean if kinetic else 0.0), stiffness or measured
    loaded = phases.cycles.onset[0] if phases.count and phases.loading_slope is not None else time[0]
    no_speed = "the drive speed is unknown or zero"
    no_stick, none_slides = ("no stick slope", "nothing slides here") if speed else (no_speed, no_speed)
    no_rhythm = "no spectral line above the noise of steady sliding"
    out: Figures = {
        "run": (stroke.run, ""),
        "step": (stroke.step, ""),
        "stroke": (stroke.number, ""),
        "direction": (stroke.direction, ""),
        "samples": (int(np.count_nonzero(part.good)), ""),
        "duration_s": (float(time[-1] - time[0]), ""),
        "drive_speed_m_per_s": (speed, "the drive speed is unknown, zero or not constant in this stroke"),
        "regime": (verdict.regime and verdict.regime.value, "the force only rises: no slip has come yet"),
        "cycles": (phases.count, ""),
        "normal_force_N": (mean if np.isfinite(part.load).any() else None, "no sample"),
        "normal_force_drift_percent": (100.0 * drift if mean > 0.0 else None, "nothing presses"),
        **coefficients,
        "static_over_kinetic": (float(static) / float(kinetic) if static and kinetic else None, few),
        "stick_slip_index": (drop[0] / (2.0 * force) if drop and force > 0.0 else None, few),
        "slips_per_mm": (1e-3 / (period[0] * speed) if period and period[0] > 0.0 and speed else None, few),
        "jump_length_m": (drop[0] / spring if drop and spring else None, few if spring else no_stick),
        "kinetic_travel_m": (speed * float(time[-1] - loaded) if speed and kinetic else None, none_slides),
        "drop_N": (drop[0] if drop else None, few),
        "drop_sd_N": (drop[1] if drop and phases.count > 1 else None, few),
        "frequency_Hz": (1.0 / period[0] if period and period[0] > 0 else None, few),
        "frequency_sd_Hz": (period[1] / period[0] ** 2 if period and phases.count > 2 else None, few),
        "samples_per_slip": (phases.samples_per_slip if phases.count else None, few),
        "stick_slip_percent": (100.0 * (phases.share(STICK) + phases.share(SLIP)) if phases.count else 0.0, ""),
        "sliding_percent": (100.0 * phases.share(SLIDING), ""),
        "noise_N": (phases.noise, ""),
        "stick_slope_N_per_s": (slope[0] if slope else None, "no stick is complete"),
        "stick_slope_scatter_percent": (
            100.0 * slope[1] if slope and phases.stick_slopes.size > 1 else None,
            "fewer than two whole sticks",
        ),
        "stick_stiffness_N_per_m": (measured, no_stick),
    }
    if stiffness:
        deviation = 100.0 * (measured / stiffness - 1.0) if measured else None
        out["stick_stiffness_deviation_percent"] = (deviation, no_stick)
    return out | {
        "sliding_trend_percent": (trend, "too little slides without stick-slip, or the force is none above its noise"),
        "rhythm_Hz": (rhythm.frequency if rhythm else None, no_rhythm),
        "rhythm_N": (rhythm.range if rhythm else None, no_rhythm),
    }


def _coefficients(part: _Part) -> Figures:
    cycles, phase, good = part.phases.cycles, part.phases.phase, part.good
    few = "one slip has no standard deviation" if cycles.count else "no slip"
    peaks_missing = "the only slip is the first breakaway" if cycles.count else "no slip"
    pressed = np.count_nonzero(good) >= FEWEST_ROWS and float(np.median(thinned(kept(part.load, good)))) > 0.0
    none = "" if pressed else "the normal force is not positive: no coefficient of friction"
    coefficient = middles = peaks = np.full(part.time.size if not cycles.count else cycles.count, np.nan)
    breakaway, moving, loaded = None, slice(0, None), part.phases.loading_slope is not None
    if pressed:
        # A load that is averaged is none beside a row that lifts off.
        load = bridged(part.load, ~np.isfinite(part.load))
        load = scipy.ndimage.uniform_filter1d(load, max(5, load.size // 200)) if np.all(presses(load)) else load
        load = np.where(presses(load), load, np.nan)
        coefficient = part.force / load
        rests = int(np.argmax(phase != STICK)) if (phase != STICK).any() else phase.size
        begin = int(np.searchsorted(part.time, cycles.onset[0])) if cycles.count else rests
        moving = slice(begin if loaded else 0, None)
        peaks = cycles.onset_force / np.interp(cycles.onset, part.time, load)
        middles = cycles.middle / np.interp(cycles.fall, part.time, load)
        if loaded and cycles.count:
            breakaway = float(peaks[0])
        elif loaded and begin < part.force.size:  # the highest averaged coefficient where the rise levels off
            reach = slice(max(begin - begin // 4, 0), min(2 * begin + 5, part.force.size))
            ratio = coefficient[reach][good[reach]]
            breakaway = float(np.nanmax(smooth(ratio, max(3, begin // 20) | 1))) if ratio.size else None
    moved = coefficient[moving][good[moving]] if pressed else np.empty(0)
    slides = coefficient[moving][good[moving] & (phase[moving] == SLIDING)] if pressed else np.empty(0)
    peaks = peaks[1:] if loaded else peaks
    rest = float(np.median(cycles.onset[1:] - cycles.arrest[:-1])) if pressed and cycles.count > 1 else None
    out: Figures = {}
    for name, values, reason, of_sd in (
        ("static_peak", peaks, peaks_missing, peaks_missing if cycles.count < 2 else few),
        ("kinetic_mean", moved, "nothing slides here", "nothing slides here"),
        ("slip_middle", middles, few, few),
        ("sliding_mean", slides, "no sliding without stick-slip", "no sliding without stick-slip"),
    ):
        values = values[np.isfinite(values)]
        mean = float(np.mean(values)) if values.size else None
        sd = float(np.std(values, ddof=1)) if values.size > 1 else None
        out |= {f"{name}_coefficient": (mean, none or reason), f"{name}_coefficient_sd": (sd, none or of_sd)}
    loading = none or "the record does not start with loading from rest"
    return out | {
        "first_breakaway_coefficient": (breakaway, loading),
        "static_rest_s": (rest, none or "no slip follows another"),
    }
