"""The quality gate of a log: accept, accept with warnings, or reject, with the findings of clock, forces and slips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import kept, thinned
from data_io.quality import Quality, Verdict, assess, presses, verdict_of
from data_io.thresholds import DEFAULTS, Thresholds, percent
from data_io.values import Finding
from identify.base.result import QualityFigure, QualityResult
from identify.logs.noise import line_slope, slope_error
from identify.logs.recorded_drive import speed_of
from identify.logs.regime import CERTAIN, Spectrum, classify
from identify.logs.segment import SLIDING, STICK, Segmentation, segment

Array = NDArray[np.float64]

ENDS_LOADING = "the log ends while the first stick still loads"
RECORD_LONGER = "record longer, or faster"
NAMED = 4  # times of spikes that are listed
ENOUGH = 1 << 12  # samples that tell a level
SLOWEST = 1.0  # interval of samples [s]: of stick-slip, a slower one may be that of a wrong unit
WANTED = 25.0  # samples of a slip to ask for; a slip is at most about half a period
SWAPPED = 3  # slips of the normal force, or of the force turned over, where the friction force has none
ZERO_LOST = 0.5  # of the force at the onset, by which the force at the arrest is negative: inertia makes a third of it
STILL = 0.05  # of its level: a force that ranges less is no friction force with slips
LINE, LARGE = 0.35, 0.05  # share of the power in the line of an oscillation, and its sd over the force, worth a word
FEWEST, MOST = 2.2, 14.0  # samples per period of an oscillation that is sampled too slowly
FOR_DRIFT, BLOCKS, TREND_SD = 6, 12, 5.0  # cycles, or blocks of what slides and their scatter, that show a drift


@dataclass(frozen=True)
class RecordPart:
    """One step of a log, or what the scene leaves of it: time [s], force [N] (n,) with sliding positive, its phases;
    expected_slope: stiffness times drive speed [N/s], None where either is unknown; load [N] (n,): normal force, None
    where it counts as steady."""

    time: Array
    force: Array
    found: Segmentation
    expected_slope: float | None = None
    load: Array | None = None


@dataclass(frozen=True)
class Judgement:
    """What the gate measured of a record and everything that is to say, worst first.

    slope_errors: per part the slope of the sticks over stiffness times drive speed, less 1, where both are known;
    ends_loading: the log was stopped before its first slip.
    """

    quality: Quality
    findings: tuple[Finding, ...]
    figures: Mapping[str, QualityFigure]
    slope_errors: tuple[float, ...]
    ends_loading: bool

    @property
    def verdict(self) -> Verdict:
        """The worst finding decides."""
        return verdict_of(self.findings)

    @property
    def reason(self) -> str:
        """Why it is rejected: the first sentence that says so, "" where it is not."""
        return next((f.message for f in self.findings if f.severity == "reject"), "")

    @property
    def swapped(self) -> bool:
        """Whether normal force and friction force look exchanged."""
        return any(f.code == "forces_swapped" for f in self.findings)

    def result(self) -> QualityResult:
        """Verdict, findings and figures, SI."""
        return QualityResult(self.verdict, self.findings, self.figures)


def judge(
    record: Record,
    parts: Sequence[RecordPart],
    thresholds: Thresholds = DEFAULTS,
    used: NDArray[np.bool_] | None = None,
) -> Judgement:
    """Judge a log.

    Args:
        record: as it was read, or as the scene has corrected it.
        parts: its steps with their phases, or the one part that the scene leaves of it.
        thresholds: where warnings and rejections begin.
        used: (n,) the rows that count (None: all).
    """
    quality = assess(record, used, thresholds, speed_of(record))
    notes: list[Finding | None] = list(quality.findings)
    slopes = [_slope_error(part) for part in parts]
    drifts = [_drift(part) for part in parts]
    loading = [still_loading(part) for part in parts]
    for part, slope, drift, loads in zip(parts, slopes, drifts, loading, strict=True):
        notes += [_spikes(part, thresholds), _samples(part.found, thresholds), _few(part.found, thresholds)]
        if loads:
            notes.append(Finding("still_loading", "warning", f"no slip was found: {ENDS_LOADING}; {RECORD_LONGER}"))
        notes += [_slope_finding(part, slope, thresholds), _drift_finding(drift, thresholds)]
    notes += suspicions(record, [part.found for part in parts], thresholds)
    figures = {name: QualityFigure(value, unit) for name, (value, unit) in quality.figures.items()}
    figures["spikes"] = QualityFigure(int(sum(np.count_nonzero(_spiky(part)) for part in parts)))
    for name, values in (("stick_slope_error", slopes), ("friction_drift", drifts)):
        figures[name] = QualityFigure(next((value for value in values if value is not None), None))
    order = ["reject", "warning", "info"]
    findings = sorted(dict.fromkeys(f for f in notes if f is not None), key=lambda f: order.index(f.severity))
    if any(f.code == "forces_swapped" for f in findings):  # the other doubts come of it, an advice to zero among them
        findings = [f for f in findings if f.code != "residual_force"]
        findings.sort(key=lambda f: f.code != "forces_swapped")
    measured = tuple(slope for slope in slopes if slope is not None)
    return Judgement(quality, tuple(findings), figures, measured, any(loading))


# What is said of the slips.


def _spiky(part: RecordPart) -> NDArray[np.bool_]:
    return np.asarray(part.found.spikes & np.isfinite(part.force))


def _spikes(part: RecordPart, limits: Thresholds) -> Finding | None:
    """Spikes are left out of the fit: a few are no reason to complain."""
    where = np.flatnonzero(_spiky(part))
    if where.size == 0:
        return None
    word = "1 sample jumps" if where.size == 1 else f"{where.size} samples jump"
    times = ", ".join(f"{t:.5g}" for t in part.time[where[:NAMED]]) + (", …" if where.size > NAMED else "")
    severity = limits.severity("spikes", where.size / part.time.size)
    text = f"{word} far from the neighbours (spikes, at {times} s); left out"
    return Finding("spikes", severity or "info", text + ("; look for electric disturbance" if severity else ""))


def _samples(found: Segmentation, limits: Thresholds) -> Finding | None:
    severity = limits.severity("samples_per_slip", found.samples_per_slip) if found.count else None
    if severity is None:
        return None
    faster = max(limits["samples_per_slip"] / max(found.samples_per_slip, 0.1), 1.1)
    text = (
        f"a slip holds {found.samples_per_slip:.2g} samples: what depends on fast sliding, a and delta_mu_k, is "
        f"poorly determined; sample {faster:.2g} times as fast"
    )
    if found.sample_interval > SLOWEST:
        text += f", or check the unit of the time: rows are {found.sample_interval:.3g} s apart"
    return Finding("samples_per_slip", severity, text)


def _few(found: Segmentation, limits: Thresholds) -> Finding | None:
    severity = limits.severity("cycles", found.count) if found.count else None
    if severity is None:
        return None
    word = "one slip was" if found.count == 1 else f"{found.count} slips were"
    remedy = "it slides on: drive more slowly" if found.ends_sliding else "record longer"
    text = f"only {word} found; {limits['cycles']:g} or more are needed to compare cycles: {remedy}"
    return Finding("few_cycles", severity, text)


def still_loading(part: RecordPart) -> bool:
    """Whether no slip was seen and the force still rises at the end as in a stick: stopped too soon.

    Near its first slip a contact creeps already, and a soft skin takes its share: half the slope of a stick counts.
    """
    found = part.found
    slope = part.expected_slope or found.loading_slope
    if found.count or found.begins_in_slip or slope is None or not found.phase.size or found.phase[-1] != STICK:
        return False
    good = np.isfinite(part.force) & ~found.spikes
    last = max(round(0.1 * np.count_nonzero(good)), 8)
    t, f = part.time[good][-last:], part.force[good][-last:]
    return t.size >= 8 and line_slope(t, f, found.noise) > 0.5 * slope + 3.0 * slope_error(t, found.noise)


def _slope_error(part: RecordPart) -> float | None:
    slope = part.found.stick_slope
    known = slope is not None and part.expected_slope and part.found.count
    return slope[0] / part.expected_slope - 1.0 if slope and part.expected_slope and known else None


def _slope_finding(part: RecordPart, error: float | None, limits: Thresholds) -> Finding | None:
    if error is None or part.expected_slope is None or not (severity := limits.severity("stick_slope", abs(error))):
        return None
    text = (
        f"in stick the force rises at {(1 + error) * part.expected_slope:.4g} N/s, where stiffness times drive "
        f"speed is {part.expected_slope:.4g} N/s ({percent(error, signed=True)}): check both, and the drive"
    )
    return Finding("stick_slope", severity, text)


def _drift(part: RecordPart) -> float | None:
    """Middles between peak and valley over the load, or of what slides all of it, last third against first; the loading
    from rest does not count; None where they are too few, or no line."""
    cycles, found = part.found.cycles, part.found
    if cycles.count:
        middle = (cycles.middle / _load_at(part, cycles.fall))[1:]
    else:
        slides = (found.phase == SLIDING) & np.isfinite(part.force) & ~found.spikes
        middle = thinned(part.force[slides] / _load_at(part, part.time[slides]), ENOUGH)
    if middle.size < (FOR_DRIFT if cycles.count else BLOCKS) or (cycles.count == 0 and not _has_trend(middle)):
        return None
    third = max(middle.size // 3, 1)
    # about zero force the middles say nothing of how large the force is
    drop = float(np.median(cycles.drop)) if cycles.count else 0.0
    level = max(abs(float(np.median(middle))), 0.5 * abs(drop), 5.0 * found.noise)
    return float(np.median(middle[-third:]) - np.median(middle[:third])) / level if level else None


def _load_at(part: RecordPart, times: Array) -> Array:
    """The load at some times (m,), over its median; ones where it counts as steady or is no load."""
    steady = np.ones(times.size)
    if part.load is None or not np.isfinite(part.load).any():
        return steady
    known = np.isfinite(part.load)
    load = np.interp(times, part.time[known], part.load[known])
    return load / np.median(load) if np.all(load > 0.0) else steady


def _has_trend(values: Array) -> bool:
    """Whether values (n,) change along a line by clearly more than blocks of them scatter about it."""
    blocks = np.array([float(np.mean(block)) for block in np.array_split(values, BLOCKS)])
    place = np.linspace(-0.5, 0.5, BLOCKS)
    change = float(place @ (blocks - blocks.mean()) / (place @ place))
    return abs(change) > TREND_SD * float(np.std(blocks - blocks.mean() - change * place))


def _drift_finding(drift: float | None, limits: Thresholds) -> Finding | None:
    if drift is None or not (severity := limits.severity("friction_drift", abs(drift))):
        return None
    text = (
        f"the friction force over the load {'rises' if drift > 0 else 'falls'} by {percent(abs(drift))} from the first "
        "to the last third: running-in, wear or a drifting zero? Cut it with skip_cycles or window"
    )
    return Finding("friction_drift", severity, text)


# What is probably wrong with a log although it can be read: units, columns, wiring, sampling.


def suspicions(record: Record, phases: Sequence[Segmentation], thresholds: Thresholds = DEFAULTS) -> list[Finding]:
    """Findings of unit, columns, wiring and sampling; phases: the segmentation of each step of the record."""
    notes = [_strange_coefficient(record, thresholds), _swapped(record, phases)]
    for step, part in zip(record.steps, phases, strict=False):
        rows = slice(step.start, step.stop)
        force = np.where(presses(record.normal_force[rows]), record.friction_force[rows], np.nan)
        if part.count:
            notes.append(_zero_lost(part))
        elif np.isfinite(force).any():
            notes.append(_upside_down(record.time[rows], force) or _swings(record.time[rows], force, thresholds))
    return [finding for finding in notes if finding is not None]


def _strange_coefficient(record: Record, thresholds: Thresholds) -> Finding | None:
    """A ratio of friction and normal force that no contact has."""
    loaded = np.isfinite(record.normal_force) & np.isfinite(record.friction_force) & (record.normal_force > 0)
    if not loaded.any():
        return None
    friction, normal = (thinned(kept(force, loaded), ENOUGH) for force in (record.friction_force, record.normal_force))
    ratio = float(np.quantile(np.abs(friction) / normal, 0.9))
    severity = thresholds.severity("coefficient_highest", ratio) or thresholds.severity("coefficient_lowest", ratio)
    if severity is None or ratio == 0.0:
        return None
    return Finding(
        "strange_coefficient",
        severity,
        f"friction is {ratio:.3g} times the normal force; a coefficient of 0.01 to 10 was expected: is mN named N, or "
        "a column another one? Say it with --units friction_force=mN or --columns",
    )


def _swapped(record: Record, phases: Sequence[Segmentation]) -> Finding | None:
    """Slips of the normal force where the friction force hardly moves; a load that ripples beside friction that rests
    and slides is none."""
    normal, friction = record.normal_force, record.friction_force
    if not np.isfinite(normal).any() or not np.isfinite(friction).any():
        return None
    range_ = _range(friction)
    if range_ > _range(normal) or (range_ > STILL and any(p.count for p in phases)):
        return None
    count = max(segment(record.time[s.start : s.stop], normal[s.start : s.stop]).count for s in record.steps)
    if count < SWAPPED:
        return None
    return Finding(
        "forces_swapped",
        "warning",
        f"the normal force sticks and slips ({count} slips) and the friction force does not: are the two swapped? "
        "Say it with --columns normal_force=…,friction_force=…",
    )


def _range(force: Array) -> float:
    """How far a force ranges, without its outer tenths, over its level."""
    low, middle, high = np.quantile(np.abs(thinned(kept(force, np.isfinite(force)), ENOUGH)), [0.1, 0.5, 0.9])
    return float((high - low) / middle) if middle > 0.0 else np.inf


def _zero_lost(part: Segmentation) -> Finding | None:
    """Slips about a force of zero: friction of no contact does so, a filter that takes out the mean does."""
    onset, arrest = (float(np.median(force)) for force in (part.cycles.onset_force, part.cycles.arrest_force))
    if not arrest < -ZERO_LOST * onset:
        return None
    return Finding(
        "zero_lost",
        "warning",
        f"the force swings about zero, from {onset:.3g} N to {arrest:.3g} N, as no friction does: its zero was lost "
        "(AC coupling, or a tare while it ran); drops and periods are right, coefficients are not: record with DC "
        "coupling, or state the zero with tare",
    )


def _upside_down(time: Array, force: Array) -> Finding | None:
    """A saw-tooth whose rises are sudden: the sensor is wired the other way."""
    mirrored = classify(time, -np.copysign(1.0, np.nanmedian(force)) * force)
    slips = mirrored.regime is not None and mirrored.regime.slips and mirrored.confidence > 0.95
    if not slips or mirrored.found.count < SWAPPED:
        return None
    return Finding(
        "upside_down",
        "warning",
        f"the force rises at once and falls slowly, {mirrored.found.count} times, as stick-slip upside down: is the "
        "sensor wired the other way? Turn it with flip_sign = true and give its zero with tare",
    )


def _swings(time: Array, force: Array, thresholds: Thresholds) -> Finding | None:
    """An oscillation of what slides; one of few samples per period, of which stick and slip cannot be told apart."""
    seen = Spectrum.of(time, force)
    if seen is None:
        return None
    level = float(np.median(np.abs(force[np.isfinite(force)])))
    peak, samples = seen.peak, seen.samples
    large = seen.share(peak) >= LINE and np.sqrt(seen.variance) >= LARGE * level
    if not large or samples < FEWEST or seen.periods < CERTAIN:
        return None
    if samples > MOST:
        height = 2.0 * seen.amplitude(peak)
        return Finding(
            "swings",
            "warning",
            f"the force swings by {height:.3g} N ({percent(height / level) if level else 'about zero'}), {peak:.3g} "
            "times a second, without a slip: an oscillation of rig, track or drive, which a mean coefficient hides; "
            "look for what has this rhythm",
        )
    rates = (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 10_000.0)
    rate = next((r for r in rates if r >= 2.0 * WANTED * peak), 2.0 * WANTED * peak)
    return Finding(
        "sampled_too_slowly",
        thresholds.severity("samples_per_cycle", samples) or "warning",
        f"the force swings {peak:.3g} times per second, with {samples:.1f} samples in each swing: too few to tell "
        f"stick from slip (all is called sliding); sample at {rate:g} Hz or more",
    )
