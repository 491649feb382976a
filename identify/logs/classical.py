"""The classical table: what a tribologist reads off a friction log, whatever a fit makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import kept, thinned
from data_io.signals import mean_and_drift, presses
from identify.base.quantiles import NORMAL
from identify.base.result import ClassicalDirection, ClassicalTable
from identify.logs.log_regime import LogRegime, look
from identify.logs.regime import Known, Regime, Verdict
from identify.logs.segment import SLIDING, SLIP, STICK, DetectedCycles, Segmentation
from identify.logs.slip_frequency import slip_frequency
from identify.logs.strokes import Drive, Stroke
from identify.logs.zigzag import smooth

Array = NDArray[np.float64]
Figures = dict[str, float | int | str | None]
Reasons = dict[str, str]

FEWEST_ROWS = 20
RUBS = 5.0  # times its noise: a smaller force is that of a drive at rest, and has no trend
STEPS = 32  # of the normal force within the width over which it is averaged, at least

DEFINITIONS: Mapping[str, str] = {
    "mean_coefficient": "friction force over normal force, mean over time from the first breakaway on",
    "first_breakaway_coefficient": "force peak that ends the first loading from rest, over the normal force there",
    "static_peak_coefficient": "mean over slips of the force peak before the slip over the normal force there, "
    "the first breakaway apart",
    "kinetic_mean_coefficient": "mean over time from the first breakaway on, as the standards of films, papers and "
    "plastics have it (ISO 8295, ASTM D1894)",
    "slip_middle_coefficient": "mean over slips of the middle between force peak and valley, where the undamped "
    "slip is symmetric, over the normal force",
    "static_rest_s": "median over the same slips of the time from the valley before to the peak: a static coefficient "
    "is that of a rest so long",
    "sliding_mean_coefficient": "mean over the samples that slide without stick-slip",
    "drop_N": "mean over slips of force peak minus following valley, the first breakaway apart where others follow",
    "stick_slope_N_per_s": "median over sticks of the slope of the straight middle of the force rise",
    "stick_stiffness_N_per_m": "stick slope over drive speed: machine, holder and contact in series",
    "ringing_Hz": "natural frequency with which the force swings while the mass slips, told once a log, in the stroke "
    "with most slips",
    "ringing_mass_kg": "moving mass: stiffness over the square of that angular frequency, for a contact much stiffer "
    "than the rig",
    "ringing_mass_from_kg": "lower end of its 95 % interval, from how slips differ, the stiffness taken as exact",
    "ringing_mass_to_kg": "upper end",
    "ringing_stiffness_N_per_m": "stiffness that this mass takes: the stated one, else that of the sticks",
    "frequency_Hz": "one over the mean time from slip to slip",
    "stick_slip_percent": "share of the time in sticks and slips",
    "sliding_percent": "share of the time in sliding without stick-slip",
    "sliding_trend_percent": "coefficient of the last tenth of what slides against the first tenth",
    "rhythm_Hz": "how often the force of steady sliding swings, where one line stands out of its spectrum",
    "rhythm_N": "range of that swing, peak to valley",
    "rhythm_turns": "turns of the disc that one swing takes, where a column tells how fast it turns",
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
    found: Segmentation


def classical_table(
    record: Record,
    segmentation: Segmentation | None = None,
    *,
    drive_speed: Drive,
    stiffness: float | None = None,
    half_period: float | None = None,
    tare: float = 0.0,
) -> ClassicalTable:
    """The classical figures per step and stroke, SI: floats, or None with a reason; never NaN.

    Args:
        record: the log; its friction force as in the file.
        segmentation: phases of the whole record where they are known (used if the record is one stroke);
            otherwise every stroke is segmented here.
        drive_speed: [m/s], a programme, one value per row, or None.
        stiffness: of the rig [N/m], to compare the sticks with.
        half_period: pi sqrt(m/k) [s] where the rig is known.
        tare: force to take off the friction force [N].

    Returns: one row per stroke; for each row why a figure is None, by its name; what each figure is (DEFINITIONS).
    """
    known = Known(stiffness=stiffness or 0.0, half_period=half_period or 0.0)
    seen = look(record, drive_speed, known, tare=tare, found=segmentation)
    return table_of(record, seen, stiffness=stiffness, tare=tare)


def table_of(record: Record, seen: LogRegime, *, stiffness: float | None = None, tare: float = 0.0) -> ClassicalTable:
    """The classical table of a log whose regime is known; see `classical_table`."""
    rows, reasons = [], []
    swung = _swung(record, seen, tare)
    for i, (stroke, verdict) in enumerate(zip(seen.strokes, seen.verdicts, strict=True)):
        figures, why = _row(record, stroke, verdict, stiffness, tare)
        told, untold = _ringing(swung[1] if swung and swung[0] == i else None, stroke, verdict, stiffness)
        figures, why = figures | told, dict.fromkeys(told, untold) | why
        rows.append({key: _plain(value) for key, value in figures.items()})
        reasons.append({key: why.get(key, "not a finite number") for key, value in rows[-1].items() if value is None})
    return ClassicalTable(tuple(rows), tuple(_directions(record, seen, tare)), tuple(reasons), dict(DEFINITIONS))


def _swung(record: Record, seen: LogRegime, tare: float) -> tuple[int, tuple[float, float]] | None:
    """The stroke, of those whose slips tell a natural frequency that with most slips, and that frequency."""
    for i in np.argsort([-verdict.found.count for verdict in seen.verdicts], kind="stable").tolist():
        stroke, found = seen.strokes[i], seen.verdicts[i].found
        rows, slope = slice(stroke.start, stroke.stop), found.stick_slope
        force = stroke.direction * (record.friction_force[rows] - tare)
        if slope and (told := slip_frequency(record.time[rows], force, found, slope[0])):
            return i, told
    return None


def _ringing(
    swung: tuple[float, float] | None, stroke: Stroke, verdict: Verdict, stiffness: float | None
) -> tuple[Figures, str]:
    """The mass that the swing of the force within slips tells, and why none is told where it is not."""
    names = ("ringing_Hz", "ringing_mass_kg", "ringing_mass_from_kg", "ringing_mass_to_kg", "ringing_stiffness_N_per_m")
    told: Figures = dict.fromkeys(names)
    if swung is None:
        return told, "not the stroke that is looked at, or fewer than six slips are resolved, or they are too slow"
    frequency, error = swung
    told["ringing_Hz"] = frequency / (2.0 * np.pi)
    slope = verdict.found.stick_slope
    # a mass that hardly rests has no sticks to tell a stiffness
    sticks = slope[0] / stroke.speed if slope and stroke.speed and verdict.regime is not Regime.NEAR_HARMONIC else None
    if not (taken := stiffness or sticks):
        return told, "neither the stiffness of the rig nor the drive speed is known, or the mass hardly rests"
    masses = taken / (frequency * np.exp(np.array([0.0, 1.0, -1.0]) * NORMAL * error)) ** 2
    return told | dict(zip(names[1:], [*masses.tolist(), taken], strict=True)), ""


def _directions(record: Record, seen: LogRegime, tare: float) -> list[ClassicalDirection]:
    """Both directions apart, where there are strokes to and fro: their number, the mean coefficient of sliding of all
    of one direction with its scatter from stroke to stroke, and its last tenth of the strokes against the first."""
    if len({stroke.direction for stroke in seen.strokes}) < 2:
        return []
    made = []
    for direction in (1, -1):
        own = [pair for pair in zip(seen.strokes, seen.verdicts, strict=True) if pair[0].direction == direction]
        levels = np.array([_level(record, stroke, verdict, tare) for stroke, verdict in own])
        known = levels[np.isfinite(levels)]
        tenth = max(known.size // 10, 1)
        trend = 100.0 * (known[-tenth:].mean() / known[:tenth].mean() - 1.0) if known.size > 1 and known[0] else None
        made.append(
            ClassicalDirection(
                direction,
                len(own),
                float(known.mean()) if known.size else None,
                float(known.std(ddof=1)) if known.size > 1 else None,
                None if trend is None else float(trend),
            )
        )
    return made


def _level(record: Record, stroke: Stroke, verdict: Verdict, tare: float) -> float:
    """Mean coefficient of what slides in a stroke, its first loading left out; NaN where nothing presses."""
    rows = slice(stroke.start, stroke.stop)
    force, load = stroke.direction * (record.friction_force[rows] - tare), record.normal_force[rows]
    good = np.isfinite(force) & presses(load) & ~verdict.found.spikes
    slides = good & (verdict.found.phase == SLIDING)
    good = slides if slides.any() else good
    return float(np.mean(force[good] / load[good])) if good.any() else np.nan


def _plain(value: float | int | str | None) -> float | int | str | None:
    if value is None or isinstance(value, int | str):
        return value
    return float(value) if np.isfinite(value) else None


def _row(
    record: Record, stroke: Stroke, verdict: Verdict, stiffness: float | None, tare: float
) -> tuple[Figures, Reasons]:
    rows, segmentation = slice(stroke.start, stroke.stop), verdict.found
    time, load = record.time[rows], record.normal_force[rows]
    force = record.friction_force[rows] - tare if tare else record.friction_force[rows]
    force = -force if stroke.direction < 0 else force
    good = np.isfinite(force) & np.isfinite(load) & ~segmentation.spikes & presses(load)
    figures: Figures = {
        "run": stroke.run,
        "step": stroke.step,
        "stroke": stroke.number,
        "direction": stroke.direction,
        "samples": int(np.count_nonzero(good)),
        "duration_s": float(time[-1] - time[0]),
        "drive_speed_m_per_s": stroke.speed,
        "regime": None if verdict.regime is None else verdict.regime.value,
        "cycles": segmentation.count,
    }
    reasons: Reasons = {
        "drive_speed_m_per_s": "the drive speed is unknown, zero or not constant in this stroke",
        "regime": "the force only rises: no slip has come yet",
    }
    part = _Part(time, force, _filled(load), good, segmentation)
    steps = (_loads(load), _coefficients(part), _slips(part), _sticks(part, stroke.speed, stiffness))
    for told, why in (*steps, _slides(part, verdict)):
        figures |= told
        reasons |= why
    if np.count_nonzero(good) < FEWEST_ROWS:
        few = f"{np.count_nonzero(good)} sound samples are too few; {FEWEST_ROWS} are needed"
        reasons |= {name: few for name, value in figures.items() if value is None}
    return figures, reasons


def _filled(values: Array) -> Array:
    """With gaps bridged; all zero where nothing is finite."""
    finite = np.isfinite(values)
    if finite.all():
        return values
    index = np.arange(values.size)
    return np.interp(index, index[finite], values[finite]) if finite.any() else np.zeros(values.size)


def _loads(load: Array) -> tuple[Figures, Reasons]:
    mean, drift = mean_and_drift(load)
    told: Figures = {
        "normal_force_N": mean if np.isfinite(load).any() else None,
        "normal_force_drift_percent": 100.0 * drift if mean > 0.0 else None,
    }
    return told, {"normal_force_N": "no sample", "normal_force_drift_percent": "nothing presses"}


def _coefficients(part: _Part) -> tuple[Figures, Reasons]:
    names = ("mean", "first_breakaway", "static_peak", "kinetic_mean", "slip_middle", "sliding_mean")
    keys = [key for name in names for key in (f"{name}_coefficient", f"{name}_coefficient_sd")]
    keys.remove("first_breakaway_coefficient_sd")
    keys.append("static_rest_s")
    told: Figures = dict.fromkeys(keys)
    if np.count_nonzero(part.good) < FEWEST_ROWS:
        return told, {}
    if float(np.median(thinned(kept(part.load, part.good)))) <= 0.0:
        return told, dict.fromkeys(keys, "the normal force is not positive: no coefficient of friction")
    cycles, phase = part.found.cycles, part.found.phase
    # A load that is averaged is none beside a row that lifts off.
    load = _steady(part.load) if np.all(presses(part.load)) else part.load
    load = np.where(presses(load), load, np.nan)
    coefficient, loaded = part.force / load, _begins_loading(part)
    begin = int(np.searchsorted(part.time, cycles.onset[0])) if cycles.count else _end_of_first_stick(phase)
    moving = slice(begin if loaded else 0, None)
    peaks = cycles.onset_force / np.interp(cycles.onset, part.time, load)
    middles = cycles.middle / np.interp(cycles.fall, part.time, load)
    breakaway = (float(peaks[0]) if cycles.count else _first_peak(part, load, begin)) if loaded else None
    _put(told, "mean_coefficient", kept(coefficient[moving], part.good[moving]))
    _put(told, "static_peak_coefficient", peaks[1:] if loaded else peaks)
    _put(told, "sliding_mean_coefficient", coefficient[moving][part.good[moving] & (phase[moving] == SLIDING)])
    told["first_breakaway_coefficient"] = breakaway
    for ending in ("", "_sd"):
        told[f"kinetic_mean_coefficient{ending}"] = told[f"mean_coefficient{ending}"]
    _put(told, "slip_middle_coefficient", middles)
    if cycles.count > 1:
        told["static_rest_s"] = float(np.median(cycles.onset[1:] - cycles.arrest[:-1]))
    return told, _coefficient_reasons(cycles)


def _slides(part: _Part, verdict: Verdict) -> tuple[Figures, Reasons]:
    """Trend and rhythm of what slides without stick-slip."""
    told: Figures = dict.fromkeys(("sliding_trend_percent", "rhythm_Hz", "rhythm_N", "rhythm_turns"))
    sliding = part.good & (part.found.phase == SLIDING)
    coefficient = part.force[sliding] / part.load[sliding]
    tenth = coefficient.size // 10
    rubs = tenth and float(np.median(part.force[sliding])) > RUBS * part.found.noise
    if rubs and (first := float(np.mean(coefficient[:tenth]))) > 0.0:
        told["sliding_trend_percent"] = 100.0 * (float(np.mean(coefficient[-tenth:])) / first - 1.0)
    if verdict.rhythm is not None:
        told |= {"rhythm_Hz": verdict.rhythm.frequency, "rhythm_N": verdict.rhythm.range}
        told["rhythm_turns"] = verdict.rhythm.turns
    reasons = dict.fromkeys(told, "no rhythm stands out of the noise of steady sliding")
    reasons["sliding_trend_percent"] = "too little slides without stick-slip, or the force is none above its noise"
    if verdict.rhythm is not None:
        reasons["rhythm_turns"] = "no column tells how fast a disc turns, or the rhythm is not that of its turns"
    return told, reasons


def _steady(load: Array) -> Array:
    """The normal force (n,) without its noise [N]: averaged over a two-hundredth of the record, a long one in steps."""
    width = max(5, load.size // 200)
    step = max(width // STEPS, 1)
    blocks = load[: load.size // step * step].reshape(-1, step).mean(axis=1)
    slow = np.repeat(smooth(blocks, width // step | 1), step)
    return np.concatenate([slow, np.full(load.size - slow.size, slow[-1])]) if slow.size < load.size else slow


def _coefficient_reasons(cycles: DetectedCycles) -> Reasons:
    few = "one slip has no standard deviation" if cycles.count else "no slip"
    peaks = "the only slip is the first breakaway" if cycles.count else "no slip"
    return {
        "mean_coefficient": "nothing slides here",
        "mean_coefficient_sd": "nothing slides here",
        "first_breakaway_coefficient": "the record does not start with loading from rest",
        "static_peak_coefficient": peaks,
        "static_peak_coefficient_sd": peaks if cycles.count < 2 else "one slip has no standard deviation",
        "kinetic_mean_coefficient": "nothing slides here",
        "kinetic_mean_coefficient_sd": "nothing slides here",
        "slip_middle_coefficient": few,
        "slip_middle_coefficient_sd": few,
        "static_rest_s": "no slip follows another",
        "sliding_mean_coefficient": "no sliding without stick-slip",
        "sliding_mean_coefficient_sd": "no sliding without stick-slip",
    }


def _put(told: Figures, name: str, values: Array) -> None:
    """Mean and sample standard deviation where there are values for them."""
    values = kept(values, np.isfinite(values))
    told[name] = float(np.mean(values)) if values.size else None
    told[f"{name}_sd"] = float(np.std(values, ddof=1)) if values.size > 1 else None


def _begins_loading(part: _Part) -> bool:
    return part.found.loading_slope is not None


def _end_of_first_stick(phase: NDArray[np.int8]) -> int:
    return int(np.argmax(phase != STICK)) if (phase != STICK).any() else phase.size


def _first_peak(part: _Part, load: Array, knee: int) -> float | None:
    """Highest smoothed coefficient where loading ends in sliding; `knee` is where the rise levels off."""
    if knee >= part.force.size:
        return None
    reach = slice(max(knee - knee // 4, 0), min(2 * knee + 5, part.force.size))
    width = max(3, knee // 20) | 1
    ratio = (part.force / load)[reach][part.good[reach]]
    return float(np.nanmax(smooth(ratio, width))) if ratio.size else None


def _slips(part: _Part) -> tuple[Figures, Reasons]:
    found = part.found
    drop, period = found.drop_mean_and_sd, found.period_mean_and_sd
    told: Figures = {
        "drop_N": drop[0] if drop else None,
        "drop_sd_N": drop[1] if drop and found.count > 1 else None,
        "frequency_Hz": 1.0 / period[0] if period and period[0] > 0 else None,
        "frequency_sd_Hz": period[1] / period[0] ** 2 if period and found.count > 2 else None,
        "samples_per_slip": found.samples_per_slip if found.count else None,
        "stick_slip_percent": 100.0 * (found.share(STICK) + found.share(SLIP)) if found.count else 0.0,
        "sliding_percent": 100.0 * found.share(SLIDING),
        "noise_N": found.noise,
    }
    none = "no slip" if not found.count else f"{found.count} slip(s) are too few"
    return told, dict.fromkeys(told, none)


def _sticks(part: _Part, speed: float | None, stiffness: float | None) -> tuple[Figures, Reasons]:
    slope = part.found.stick_slope
    measured = slope[0] / speed if slope and speed else None
    told: Figures = {
        "stick_slope_N_per_s": slope[0] if slope else None,
        "stick_slope_scatter_percent": 100.0 * slope[1] if slope and part.found.stick_slopes.size > 1 else None,
        "stick_stiffness_N_per_m": measured,
    }
    reasons = {
        "stick_slope_N_per_s": "no stick was seen from its beginning to its end",
        "stick_slope_scatter_percent": "fewer than two whole sticks",
        "stick_stiffness_N_per_m": "no stick slope" if speed else "the drive speed is unknown or zero",
    }
    if stiffness:
        told["stick_stiffness_deviation_percent"] = 100.0 * (measured / stiffness - 1.0) if measured else None
        reasons["stick_stiffness_deviation_percent"] = reasons["stick_stiffness_N_per_m"]
    return told, reasons
