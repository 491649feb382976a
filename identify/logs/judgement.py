"""The quality gate of a log: accept, accept with warnings, or reject, with the findings of clock, forces and slips."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import kept, thinned
from data_io.quality import DEFAULTS, Quality, Thresholds, Verdict, assess, percent, presses, verdict_of
from data_io.values import Finding
from identify.base.result import QualityResult, Value
from identify.logs.noise import line_slope, slope_error
from identify.logs.recorded_drive import speed_of, turns_of_sign
from identify.logs.regime import CERTAIN, Spectrum, classify
from identify.logs.segment import FEW_SLIPS, SLIDING, STICK, Segmentation, segment

Array = NDArray[np.float64]

ENDS_LOADING = "the log ends while the first stick still loads"
RECORD_LONGER = "record longer, or faster"
USUAL = (0.001, 10.0)  # friction over normal force; beyond it a unit is wrong
LINE, LARGE = 0.35, 0.05  # share of the power in the line of an oscillation, and its sd over the force, worth a word
SAMPLES = (2.2, 4.0, 14.0)  # per period: of an oscillation that may be seen, may be counted, and is sampled well enough
BLOCKS = 12  # of what slides, that show a drift


@dataclass(frozen=True)
class RecordPart:
    """One step of a log, or what the scene leaves of it: time [s], force [N] (n,) with sliding positive, its phases;
    expected_slope: stiffness times drive speed [N/s], None where either is unknown; load [N] (n,): normal force, None
    where it counts as steady."""

    time: Array
    force: Array
    phases: Segmentation
    expected_slope: float | None = None
    load: Array | None = None

    @property
    def spikes(self) -> NDArray[np.bool_]:
        """Samples that are left out, those without a force apart, (n,)."""
        return np.asarray(self.phases.spikes & np.isfinite(self.force))

    @property
    def slope_error(self) -> float | None:
        """Slope of the sticks over what is expected, less 1; None where either is unknown."""
        slope = self.phases.stick_slope if self.phases.count else None
        return slope[0] / self.expected_slope - 1.0 if slope and self.expected_slope else None


@dataclass(frozen=True)
class Judgement:
    """What the gate measured of a record and everything that is to say, worst first.

    slope_errors: per part the slope of the sticks over stiffness times drive speed, less 1, where both are known;
    ends_loading: the log was stopped before its first slip.
    """

    quality: Quality
    findings: tuple[Finding, ...]
    figures: Mapping[str, Value]
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
    notes = list(quality.findings)
    slopes = [part.slope_error for part in parts]
    drifts = [_drift(part) for part in parts]
    for part, slope, drift in zip(parts, slopes, drifts, strict=True):
        notes += _of_slips(part, slope, drift, thresholds)
    notes += _suspicions(record, [part.phases for part in parts])
    figures = {name: Value(value, unit) for name, (value, unit) in quality.figures.items()}
    figures["spikes"] = Value(int(sum(np.count_nonzero(part.spikes) for part in parts)))
    for name, values in (("stick_slope_error", slopes), ("friction_drift", drifts)):
        figures[name] = Value(next((value for value in values if value is not None), None))
    order = ["reject", "warning", "info"]
    findings = sorted(dict.fromkeys(notes), key=lambda f: order.index(f.severity))
    if any(f.code == "forces_swapped" for f in findings):  # the other doubts come of it, an advice to zero among them
        findings = [f for f in findings if f.code != "residual_force"]
        findings.sort(key=lambda f: f.code != "forces_swapped")
    measured = tuple(slope for slope in slopes if slope is not None)
    return Judgement(quality, tuple(findings), figures, measured, any(still_loading(part) for part in parts))


# What is said of the slips.


def _of_slips(part: RecordPart, slope: float | None, drift: float | None, limits: Thresholds) -> Iterator[Finding]:
    """What spikes, slips, sticks and their drift have to say."""
    phases, where = part.phases, np.flatnonzero(part.spikes)
    if where.size:
        word = "1 sample jumps" if where.size == 1 else f"{where.size} samples jump"
        times = ", ".join(f"{t:.5g}" for t in part.time[where[:4]]) + (", …" if where.size > 4 else "")
        severity = limits.severity("spikes", where.size / part.time.size)
        text = f"{word} far from the neighbours (spikes, at {times} s); left out"
        yield Finding("spikes", severity or "info", text + ("; look for electric disturbance" if severity else ""))
    if phases.count:
        samples = phases.samples_per_slip
        slow = f", or check the unit of the time: rows are {phases.sample_interval:.3g} s apart"
        yield from limits.finding(
            "samples_per_slip", "samples_per_slip", samples,
            f"a slip holds {samples:.2g} samples: a and delta_mu_k, of fast sliding, are poorly determined; "
            f"sample {max(limits['samples_per_slip'] / max(samples, 0.1), 1.1):.2g} times as fast"
            f"{slow if phases.sample_interval > 1.0 else ''}",
        )  # fmt: skip
        yield from limits.finding(
            "few_cycles", "cycles", phases.count,
            f"only {phases.count} slip(s) found; {limits['cycles']:g} or more are needed to compare cycles: "
            f"{'it slides on: drive more slowly' if phases.ends_sliding else 'record longer'}",
        )  # fmt: skip
    if still_loading(part):
        yield Finding("still_loading", "warning", f"no slip was found: {ENDS_LOADING}; {RECORD_LONGER}")
    if slope is not None and part.expected_slope:
        yield from limits.finding(
            "stick_slope", "stick_slope", abs(slope),
            f"in stick the force rises at {(1 + slope) * part.expected_slope:.4g} N/s, where stiffness times drive "
            f"speed is {part.expected_slope:.4g} N/s ({percent(slope, signed=True)}): check both, and the drive",
        )  # fmt: skip
    if drift is not None:
        yield from limits.finding(
            "friction_drift", "friction_drift", abs(drift),
            f"the friction force over the load {'rises' if drift > 0 else 'falls'} by {percent(abs(drift))} from the "
            "first to the last third: running-in, wear or a drifting zero? Cut it with skip_cycles or window",
        )  # fmt: skip


def still_loading(part: RecordPart) -> bool:
    """Whether no slip was seen and the force still rises at the end as in a stick: stopped too soon.

    Near its first slip a contact creeps already, and a soft skin takes its share: half the slope of a stick counts.
    """
    phases = part.phases
    slope = part.expected_slope or phases.loading_slope
    if phases.count or phases.begins_in_slip or slope is None or not phases.phase.size or phases.phase[-1] != STICK:
        return False
    good = np.isfinite(part.force) & ~phases.spikes
    last = max(round(0.1 * np.count_nonzero(good)), 8)
    t, f = part.time[good][-last:], part.force[good][-last:]
    return t.size >= 8 and line_slope(t, f, phases.noise) > 0.5 * slope + 3.0 * slope_error(t, phases.noise)


def _drift(part: RecordPart) -> float | None:
    """Middles of slips over the load, or all of what slides, last third against first; None where nothing tells."""
    cycles, phases, time = part.phases.cycles, part.phases, part.phases.cycles.fall
    slides = (phases.phase == SLIDING) & np.isfinite(part.force) & ~phases.spikes
    if not cycles.count:
        time = part.time[slides]
    load = np.ones(time.size)
    if part.load is not None and (known := np.isfinite(part.load)).any():
        own = np.interp(time, part.time[known], part.load[known])
        load = own / np.median(own) if own.size and np.all(own > 0.0) else load
    middle = (cycles.middle / load)[1:] if cycles.count else thinned(part.force[slides] / load)
    if middle.size < (6 if cycles.count else BLOCKS):
        return None
    if not cycles.count:  # a change along a line by clearly more than blocks scatter about it
        blocks = np.array([float(np.mean(block)) for block in np.array_split(middle, BLOCKS)])
        place = np.linspace(-0.5, 0.5, BLOCKS)
        change = float(np.polyfit(place, blocks, 1)[0])
        if abs(change) <= 5.0 * float(np.std(blocks - blocks.mean() - change * place)):
            return None
    third = max(middle.size // 3, 1)
    # about zero force the middles say nothing of how large the force is
    drop = float(np.median(cycles.drop)) if cycles.count else 0.0
    level = max(abs(float(np.median(middle))), 0.5 * abs(drop), 5.0 * phases.noise)
    return float(np.median(middle[-third:]) - np.median(middle[:third])) / level if level else None


# What is probably wrong with a log although it can be read: units, columns, wiring, sampling.


def _suspicions(record: Record, phases: Sequence[Segmentation]) -> Iterator[Finding]:
    """Findings of unit, columns, wiring and sampling; phases: the segmentation of each step of the record."""
    normal, friction = record.normal_force, record.friction_force
    sound = np.isfinite(normal) & np.isfinite(friction)
    if (loaded := sound & (normal > 0.0)).any():
        sizes = (thinned(kept(force, loaded)) for force in (np.abs(friction), normal))
        ratio = float(np.quantile(np.divide(*sizes), 0.9))
        if ratio and not USUAL[0] <= ratio <= USUAL[1]:
            text = (
                f"friction is {ratio:.3g} times the normal force; a coefficient of 0.01 to 10 was expected: is mN "
                "named N, or a column another one? Say it with --units friction_force=mN or --columns"
            )
            yield Finding("strange_coefficient", "warning", text)
    if sound.any():
        few = [np.abs(thinned(kept(force, sound))) for force in (normal, friction)]
        of_normal, of_friction = (np.diff(np.quantile(f, [0.1, 0.9])) / max(np.median(f), 1e-300) for f in few)
        still = of_friction <= of_normal and (of_friction <= 0.05 or not any(p.count for p in phases))
        parts = (slice(step.start, step.stop) for step in record.steps)
        count = max(segment(record.time[part], normal[part]).count for part in parts) if still else 0
        if count >= FEW_SLIPS:
            text = (
                f"the normal force sticks and slips ({count} slips) and the friction force does not: are the two "
                "swapped? Say it with --columns normal_force=…,friction_force=…"
            )
            yield Finding("forces_swapped", "warning", text)
    for step, own in zip(record.steps, phases, strict=False):
        rows = slice(step.start, step.stop)
        force = np.where(presses(normal[rows]), friction[rows], np.nan)
        if own.count:
            onset, arrest = (float(np.median(ends)) for ends in (own.cycles.onset_force, own.cycles.arrest_force))
            if arrest < -0.5 * onset:  # inertia makes a third of it
                text = (
                    f"the force oscillates about zero, from {onset:.3g} N to {arrest:.3g} N, as no friction does: its "
                    "zero was lost (AC coupling, or a tare while it ran); drops and periods are right, "
                    "coefficients are not: record with DC coupling, or state the zero with tare"
                )
                yield Finding("zero_lost", "warning", text)
        elif np.isfinite(force).any() and len(turns_of_sign(force)) == 1:  # to and fro it is the drive that oscillates
            yield from _of_sliding(record.time[rows], force)


def _of_sliding(time: Array, force: Array) -> Iterator[Finding]:
    """A saw-tooth upside down, else an oscillation of what slides, or one that is sampled too slowly."""
    mirrored = classify(time, -np.copysign(1.0, np.nanmedian(force)) * force)
    slips = mirrored.regime is not None and mirrored.regime.slips and mirrored.confidence > 0.95
    if slips and mirrored.phases.count >= FEW_SLIPS:
        text = (
            f"the force rises at once and falls slowly, {mirrored.phases.count} times, as stick-slip upside down: is "
            "the sensor wired the other way? Turn it with flip_sign = true and give its zero with tare"
        )
        yield Finding("upside_down", "warning", text)
        return
    seen = Spectrum.of(time, force)
    if seen is None:
        return
    level, line = float(np.nanmedian(np.abs(force))), seen.oscillation
    large = seen.share(line.frequency) >= LINE and np.sqrt(seen.variance) >= LARGE * level
    if not large or line.samples < SAMPLES[0] or line.frequency < CERTAIN * float(seen.frequency[1]):
        return
    if line.samples > SAMPLES[2]:
        text = (
            f"the force oscillates by {line.range:.3g} N ({percent(line.range / level) if level else 'about zero'}), "
            f"{line.frequency:.3g} times a second, without a slip: an oscillation of rig, track or drive, which a mean "
            "coefficient hides; look for what has this frequency"
        )
        yield Finding("swings", "warning", text)
        return
    size = 10.0 ** np.floor(np.log10(50.0 * line.frequency))
    text = (
        f"the force oscillates at {line.frequency:.3g} Hz, with {line.samples:.1f} samples per period: too few to "
        "distinguish stick from slip (all is called sliding); sample at "
        f"{size * np.ceil(50.0 * line.frequency / size):g} Hz or more"
    )
    yield Finding("sampled_too_slowly", "reject" if line.samples < SAMPLES[1] else "warning", text)
