"""The verdict on a log: accept, accept with warnings, or reject, with the reasons; from clock, forces and slips."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import kept, thinned
from data_io.quality import Quality, Verdict, assess, verdict_of
from data_io.signals import presses
from data_io.thresholds import DEFAULTS, Thresholds, percent
from data_io.values import Finding
from identify.base.result import QualityFigure, QualityResult
from identify.logs.recorded_drive import speed_of
from identify.logs.regime import PERIODS, classify
from identify.logs.segment import Segmentation, segment
from identify.logs.slip_quality import RecordPart, SlipQuality, look_at_slips
from identify.logs.spectrum import Spectrum

# What is probably wrong with a log although it can be read: units, columns, sampling.

Array = NDArray[np.float64]

ENOUGH = 1 << 12  # forces that tell how large they are
SWAPPED = 3  # slips of the normal force, where the friction force has none
CLEARLY = 0.95  # probability of stick-slip in the force turned over
ZERO_LOST = 0.5  # of the force at the onset, by which the force at the arrest is negative: inertia makes a third of it
STILL = 0.05  # of its level: a force that ranges less is no friction force with slips
SLOWEST, FASTEST = 2.2, 14.0  # samples per period of an oscillation that is sampled too slowly
LINE = 0.35  # share of the power that such a line holds at least
LARGE = 0.05  # of the force: standard deviation of an oscillation worth a word
WANTED = 25.0  # samples of a slip to ask for; a slip is at most about half a period


def suspicions(record: Record, phases: Sequence[Segmentation], thresholds: Thresholds = DEFAULTS) -> list[Finding]:
    """Findings beyond the quality gate, each with what to do.

    Args:
        phases: the segmentation of each step of the record.
        thresholds: where they begin.
    """
    found = [strange_coefficient(record, thresholds), _swapped(record, phases)]
    for step, part in zip(record.steps, phases, strict=False):
        rows = slice(step.start, step.stop)
        force = np.where(presses(record.normal_force[rows]), record.friction_force[rows], np.nan)
        if part.count:
            found.append(_zero_lost(part))
        else:
            found.append(_upside_down(record.time[rows], force) or _swings(record.time[rows], force, thresholds))
    return [finding for finding in found if finding is not None]


def strange_coefficient(record: Record, thresholds: Thresholds = DEFAULTS) -> Finding | None:
    """A ratio of friction and normal force that no contact has."""
    loaded = np.isfinite(record.normal_force) & np.isfinite(record.friction_force) & (record.normal_force > 0)
    if not loaded.any():
        return None
    forces = record.friction_force, record.normal_force
    friction, normal = (thinned(kept(values, loaded), ENOUGH) for values in forces)
    ratio = float(np.quantile(np.abs(friction) / normal, 0.9))
    severity = thresholds.severity("coefficient_highest", ratio) or thresholds.severity("coefficient_lowest", ratio)
    if severity is None or ratio == 0.0:
        return None
    word = f"{ratio:.3g} times"
    return Finding(
        "strange_coefficient",
        severity,
        f"friction is {word} the normal force; a coefficient of 0.01 to 10 was expected: is mN named N, or a column "
        "another one? Say it with --units friction_force=mN or --columns",
    )


def _swapped(record: Record, phases: Sequence[Segmentation]) -> Finding | None:
    """Slips of the normal force where the friction force hardly moves; a load that ripples beside friction that rests
    and slides is none."""
    normal, friction = record.normal_force, record.friction_force
    if not np.isfinite(normal).any() or not np.isfinite(friction).any():
        return None
    swing = _swing(friction)
    if swing > _swing(normal) or (swing > STILL and any(p.count for p in phases)):
        return None
    seen = [segment(record.time[s.start : s.stop], normal[s.start : s.stop]) for s in record.steps]
    count = max(p.count for p in seen)
    if count < SWAPPED:
        return None
    return Finding(
        "forces_swapped",
        "warning",
        f"the normal force sticks and slips ({count} slips) and the friction force does not: are the two swapped? "
        "Say it with --columns normal_force=…,friction_force=…",
    )


def _swing(force: Array) -> float:
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
    if not np.isfinite(force).any():
        return None
    mirrored = classify(time, -np.copysign(1.0, np.nanmedian(force)) * force)
    slips = mirrored.regime is not None and mirrored.regime.slips and mirrored.confidence > CLEARLY
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
    if seen.share(peak) < LINE or np.sqrt(seen.variance) < LARGE * level or samples < SLOWEST:
        return None
    if seen.periods < PERIODS:
        return None
    if samples > FASTEST:
        height = 2.0 * seen.amplitude(peak)
        return Finding(
            "swings",
            "warning",
            f"the force swings by {height:.3g} N ({percent(height / level) if level else 'about zero'}), {peak:.3g} "
            "times a second, without a slip: an oscillation of rig, track or drive, which a mean coefficient hides; "
            "look for what has this rhythm",
        )
    return Finding(
        "sampled_too_slowly",
        thresholds.severity("samples_per_cycle", samples) or "info",
        f"the force swings {peak:.3g} times per second, with {samples:.1f} samples in each swing: too few to tell "
        f"stick from slip (all is called sliding); sample at {_rounded(2.0 * WANTED * peak):g} Hz or more",
    )


def _rounded(rate: float) -> float:
    return float(next((r for r in (20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000) if r >= rate), rate))


FORCES_SWAPPED = "forces_swapped"
NO_ZERO = "residual_force"  # no zero error of a sensor, where its column holds another force


@dataclass(frozen=True)
class Judgement:
    """What the gate found: of the record, of the slips of every part, and everything that is to say, worst first.

    Before all comes that two columns look swapped: the other doubts come of it.
    """

    quality: Quality
    slips: tuple[SlipQuality, ...]
    findings: tuple[Finding, ...]

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
        return any(f.code == FORCES_SWAPPED for f in self.findings)

    @property
    def ends_loading(self) -> bool:
        """Whether the log was stopped before its first slip."""
        return any(part.loading for part in self.slips)

    def result(self) -> QualityResult:
        """Verdict, findings and figures, SI."""
        lag = next((s.lag for s in self.slips if s.lag is not None), None)
        figures = {name: QualityFigure(value, unit) for name, (value, unit) in self.quality.figures.items()}
        figures["spikes"] = QualityFigure(sum(s.spikes for s in self.slips))
        figures["sensor_lag"] = QualityFigure(None if lag is None else lag.lag, "s")
        for name, values in (
            ("stick_slope_error", [s.slope for s in self.slips]),
            ("friction_drift", [s.drift for s in self.slips]),
            ("uneven_cycles", [s.scatter for s in self.slips]),
            ("harmonic", [s.harmonic for s in self.slips]),
        ):
            figures[name] = QualityFigure(next((value for value in values if value is not None), None))
        return QualityResult(self.verdict, self.findings, figures)


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
    slips = tuple(look_at_slips(part, thresholds) for part in parts)
    doubts = suspicions(record, [part.found for part in parts], thresholds)
    findings = dict.fromkeys((*quality.findings, *(f for s in slips for f in s.findings), *doubts))
    return Judgement(quality, slips, _in_order(findings))


def _in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Worst first; where two columns look swapped, that before all, and no advice to zero a sensor by the wrong one."""
    order = {"reject": 0, "warning": 1, "info": 2}
    listed = sorted(findings, key=lambda finding: order[finding.severity])
    swap = [finding for finding in listed if finding.code == FORCES_SWAPPED]
    if not swap:
        return tuple(listed)
    return (*swap, *(f for f in listed if f.code not in (FORCES_SWAPPED, NO_ZERO)))
