"""The regime of a record, of each of its strokes and of all of it: stick-slip, an oscillation of the mass, or sliding.

One test discriminates. In a stick the force rises at stiffness times drive speed: straight rises of one slope, whatever
the drop before them; and a slip is faster than that. Noise with a memory rises at any slope; a turning disc swings as
slowly down as up, and far more slowly than a stick loads where stiffness and speed are known. Where they are not, a
swing as slow and small as a disc makes it counts as one, with as much confidence as its period and its size give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import thinned
from data_io.quality import presses
from identify.base.wording import three_figures
from identify.logs.noise import bridged, largest_drop
from identify.logs.recorded_drive import DriveCourse, Stroke, changes_speed, one_speed, strokes
from identify.logs.segment import (
    FEW_SLIPS,
    FEWEST,
    SLIDING,
    DetectedCycles,
    Resonance,
    Segmentation,
    drive_force,
    segment,
)

Array = NDArray[np.float64]

STRAIGHT = 0.8  # share of the usual rise that a line of the one slope explains
UNLIKE = 0.2  # scatter of the slopes of rises over their median, from which on no sticks make them (measured: 0.08)
AS_LONG, SAWTOOTH = 2.0, 4.0  # longer than this times a fall, a rise is a stick's: log odds per logarithm beyond
OFF, LOADING = 5.0, 3.0  # times off k v_0, up or down, at which rises hardly are sticks: log odds per logarithm
MISSTATED = -5.0  # log odds at least: stiffness, speed or a unit may be stated wrongly by any factor
SLOW, SMALL = 5.0, 0.07  # swings that discs and rigs make alike: how often [Hz], peak to valley over the level
SINE = 0.985  # part of the mean cycle that its first harmonic holds from which on it is one sine
UNEVEN = 0.08  # scatter of the drop from one slip to the next, beyond noise and sampling, as a share
CERTAIN, CLEAR = 8, 0.4  # periods of a spectral line, and share of the power that it holds, from which on it is one
SURE = 0.99
LOAD_CHANGES = 0.3  # of the typical load, by which one changes that the force is to be seen over
LOADS = (0.5, 4.0)  # times k v_0: how fast a swing of stick-slip loads; a saw-tooth's first harmonic does by 2
ALIASES = 3  # times the sampling rate up to which a swing may really be


class Regime(StrEnum):
    """What a log, or a stretch of it, shows."""

    STICK_SLIP = "stick_slip"
    UNEVEN_STICK_SLIP = "uneven_stick_slip"
    NEAR_HARMONIC = "near_harmonic"
    SLIDING = "sliding"
    PROGRAMME = "programme"

    @property
    def slips(self) -> bool:
        """Whether it holds cycles of stick and slip, or an oscillation of the mass."""
        return self not in (Regime.SLIDING, Regime.PROGRAMME)


@dataclass(frozen=True)
class Known:
    """What is known of rig and drive, 0: unknown. stiffness [N/m], drive_speed [m/s], half_period pi sqrt(m/k) [s];
    plate: its resonance where the force is measured under the counterface."""

    stiffness: float = 0.0
    drive_speed: float = 0.0
    half_period: float = 0.0
    plate: Resonance | None = None

    @property
    def loading_rate(self) -> float:
        """Stiffness times drive speed [N/s]."""
        return self.stiffness * abs(self.drive_speed)


@dataclass(frozen=True)
class ForceOscillation:
    """An oscillation of a force that slides: frequency [Hz], if it is no faster than it looks; range peak to valley
    [N]; samples per period."""

    frequency: float
    range: float
    samples: float

    def __str__(self) -> str:
        """What a log does that is sampled too slowly, to follow its name."""
        return (
            f"oscillates by {self.range:.2g} N at {self.frequency:.3g} Hz, with {self.samples:.2g} samples per period, "
            f"as stick-slip does: sample it at {25.0 * self.frequency:.2g} Hz or more"
        )


@dataclass(frozen=True)
class Verdict:
    """regime, None where nothing moves (a first loading, a drive at rest); confidence, 0.5 to 1; evidence: what was
    tested, in sentences; phases: those that go with it; rhythm of what slides, None without one; strokes: of how
    many it is the verdict, to and fro."""

    regime: Regime | None
    confidence: float
    evidence: tuple[str, ...]
    phases: Segmentation
    rhythm: ForceOscillation | None = None
    strokes: int = 1


def classify(
    time: Array,
    force: Array,
    known: Known = Known(),
    *,
    noise: float | None = None,
    given: Segmentation | None = None,
) -> Verdict:
    """The regime of a stretch in which the drive goes one way at one speed.

    Args:
        time: rising [s], shape (n,); force: sliding positive [N], shape (n,), NaN where nothing counts.
        noise: standard deviation of the force [N] where it is known.
        given: its phases, where they are known.
    """
    # Averaged as the period of the rig asks for, and as its own slips do: noise hides some from each.
    half_periods = [known.half_period, None] if known.half_period and given is None else [None]
    brief = sliding = None
    for half_period in half_periods:
        phases = given or segment(time, force, half_period=half_period, noise=noise, plate=known.plate)
        if phases.count == 0 and phases.phase.size and not phases.share(SLIDING):
            return Verdict(None, SURE, ("the force only rises: no slip has come yet",), phases)
        if phases.phase.size < FEWEST:
            return Verdict(None, 0.5, (f"{phases.phase.size} rows are too few to judge a regime",), phases)
        shape = _Shape.of(time, _at_drive(time, force, phases, known), phases)
        slips, confidence, evidence = _discriminate(shape, phases, known)
        if slips and not phases.slides_on(phases.count):
            return _named(time, force, Verdict(Regime.STICK_SLIP, confidence, evidence, phases), shape, known.plate)
        if slips:
            word = "one slip" if phases.count == 1 else f"{phases.count} slips"
            evidence = (*evidence, f"{word} at first, then it slides")
            brief = brief or Verdict(Regime.SLIDING, confidence, evidence, phases)
        sliding = sliding or Verdict(Regime.SLIDING, confidence, evidence, phases)
    if brief is not None:
        return brief
    assert sliding is not None
    if abs(float(np.nanmedian(force))) < 2.0 * phases.noise:
        return Verdict(None, 0.9, ("no friction above its noise: the drive stands, or nothing presses",), phases)
    phases = segment(time, force, half_period=known.half_period or None, noise=noise, slips=False, plate=known.plate)
    seen = Spectrum.of(time, np.where((phases.phase == SLIDING) & ~phases.spikes, force, np.nan))
    if seen is None or not seen.stands_out():
        return replace(sliding, phases=phases)
    rhythm = seen.oscillation
    text = f"it oscillates by {rhythm.range:.3g} N at {rhythm.frequency:.3g} Hz"
    return replace(sliding, phases=phases, rhythm=rhythm, evidence=(*sliding.evidence, text))


def _at_drive(time: Array, force: Array, phases: Segmentation, known: Known) -> Array:
    """A force (n,) [N] as a load cell at the drive shows it, which is what rises and falls are compared in."""
    holes = ~np.isfinite(force) | phases.spikes
    return force if known.plate is None or holes.all() else drive_force(time, bridged(force, holes), *known.plate)


# The shape of rises and falls, and the test of it.


@dataclass(frozen=True)
class _Shape:
    """Of the rises and falls of a force: their number; straight: share of the usual rise that a line of the one slope
    explains, NaN where they have too few samples; unlike: scatter of their slopes beyond noise, over the one slope;
    asymmetry: duration of a rise over that of a fall; sine: share of the first harmonic; rate: the one slope [N/s];
    frequency [Hz]; share of the level that the fall is; drift: largest drop without a cycle [N], 0 within noise."""

    rises: int = 0
    straight: float = np.nan
    unlike: float = 0.0
    asymmetry: float = np.nan
    sine: float = np.nan
    rate: float = np.nan
    frequency: float = np.nan
    share: float = np.nan
    drift: float = 0.0

    @property
    def one_sine(self) -> bool:
        """Whether the mean cycle, in which noise is averaged out, is one sine."""
        return self.rises >= FEW_SLIPS and self.sine >= SINE

    @classmethod
    def of(cls, time: Array, force: Array, phases: Segmentation) -> _Shape:
        cycles = phases.at_drive or phases.cycles
        if not cycles.count:
            return cls(drift=largest_drop(force[np.isfinite(force) & ~phases.spikes]))
        rise, level = cycles.onset[1:] - cycles.arrest[:-1], abs(float(np.nanmedian(force)))
        swing = float(np.median(cycles.drop))
        share = swing / level if level > 0.0 else np.inf
        if not rise.size:
            return cls(rate=phases.loading_slope or 0.0, share=share)
        pieces = []
        for first, last in np.searchsorted(time, np.stack([cycles.arrest[:-1], cycles.onset[1:]], axis=1)).tolist():
            # A sample of the slip may reach into either end.
            corner = max(round(0.1 * (last - first)), 1) if last - first >= 5 else 0
            rows = slice(first + corner, last + 1 - corner)
            good = np.isfinite(force[rows]) & ~phases.spikes[rows]
            if np.count_nonzero(good) >= 3:
                t, f = time[rows][good], force[rows][good]
                pieces.append((t - t.mean(), f - f.mean()))
        # Medians: a rise with a slip in it that was missed is none that counts.
        per_rise = cycles.drop[1:] / np.maximum(rise, phases.sample_interval)
        slopes = np.array([t @ f / (t @ t) for t, f in pieces] if pieces else per_rise)
        rate, scatter, straight = float(np.median(slopes)), 0.0, []
        if pieces:
            error = phases.noise * float(np.median([1.0 / np.sqrt(t @ t) for t, _ in pieces]))
            scatter = 1.4826 * float(np.median(np.abs(slopes - rate))) - 2.0 * error
        for t, f in pieces:  # the noise taken off
            whole, left, own = float(f @ f), float(np.sum((f - rate * t) ** 2)), t.size * phases.noise**2
            straight.append(1.0 - max(left - own, 0.0) / max(whole - own, 1e-3 * whole) if whole > 0.0 else 0.0)
        period = float(np.median(cycles.period))
        asymmetry = sine = np.nan
        good, points = np.isfinite(force) & ~phases.spikes, 128
        t, f = time[good], force[good]
        falls = cycles.fall[(cycles.fall - 0.5 * period >= t[0]) & (cycles.fall + 0.5 * period <= t[-1])]
        if falls.size:  # the mean cycle about its fall
            mean = np.interp(np.add.outer(falls, (np.arange(points) / points - 0.5) * period), t, f).mean(axis=0)
            peak, valley = int(np.argmax(mean[: points // 2])), points // 2 + int(np.argmin(mean[points // 2 :]))
            power = np.abs(np.fft.rfft(mean - mean.mean())[1:]) ** 2
            asymmetry, sine = points / (valley - peak) - 1.0, float(power[0] / max(np.sum(power), 1e-300))
        return cls(
            rises=len(rise),
            straight=float(np.median(straight)) if straight else np.nan,
            unlike=scatter / rate if rate > 0.0 else np.inf,
            asymmetry=asymmetry,
            sine=sine,
            rate=rate,
            frequency=1.0 / period,
            share=share,
        )


def _discriminate(shape: _Shape, phases: Segmentation, known: Known) -> tuple[bool, float, tuple[str, ...]]:
    """Whether the falls of a force are slips, with what confidence, and what was tested."""
    if phases.count == 0:
        text = "no drop of the force exceeds its noise"
        if phases.other_falls:
            text = f"{phases.other_falls} drops exceed the noise, none of them faster than the rise before it"
        elif shape.drift:
            text = f"the force drops by up to {shape.drift:.3g} N in all, slowly and in no slip"
        return False, 0.95, (text,)
    loads = shape.rate / known.loading_rate if known.loading_rate else np.nan
    evidence = []
    if np.isfinite(shape.straight):
        evidence.append(f"{shape.rises} rises, to {100 * max(shape.straight, 0.0):.0f} % straight and of one slope")
    if np.isfinite(loads):
        ratio = "less than 0.01" if loads < 0.01 else f"{loads:.3g}" if loads < 100.0 else "over 100"
        evidence.append(f"their slope is {ratio} of stiffness times drive speed")
    if shape.rises and not shape.one_sine and (shape.straight < STRAIGHT or shape.unlike > UNLIKE):
        sure = _probability(10.0 * (STRAIGHT - shape.straight)) if shape.straight < STRAIGHT else 0.9
        return False, sure, (*evidence, "sticks would rise straight, at one slope")
    odds = 2.0 * float(np.log(max(shape.share, 1e-9) / SMALL))
    if shape.asymmetry > 1.0:
        evidence.append(f"a drop is {shape.asymmetry:.2g} times as fast as a rise")
        odds += SAWTOOTH * float(np.log(max(shape.asymmetry / AS_LONG, 1.0)))
    if np.isfinite(loads):
        off = abs(float(np.log(loads))) if loads > 0.0 else np.inf
        odds += max(LOADING * (np.log(OFF) - off), MISSTATED)
        return odds > 0.0, _probability(odds), tuple(evidence)
    if not shape.rises:
        return False, 0.6, (*evidence, "one drop alone; give stiffness and drive speed of the rig")
    odds += float(np.log(shape.frequency / SLOW)) - (0.0 if shape.rises >= FEW_SLIPS else 2.0)  # few cannot be compared
    share = f"{three_figures(100 * shape.share)} %" if shape.share < 2.0 else "over 200 %"
    text = f"it oscillates by {share} of the force at {shape.frequency:.3g} Hz"
    if odds <= 0.0:
        text += ", as a turning disc or an uneven track makes it; give stiffness and drive speed of the rig"
    return odds > 0.0, _probability(odds), (*evidence, text)


def _probability(odds: float) -> float:
    """A probability from log odds, never certain."""
    return float(min(1.0 / (1.0 + np.exp(-abs(odds))), SURE))


def _named(time: Array, force: Array, verdict: Verdict, shape: _Shape, plate: Resonance | None) -> Verdict:
    """Which stick-slip it is; an even sine at a frequency of the mains is none."""
    phases = verdict.phases
    if shape.one_sine:
        lasts = float(np.ptp(phases.cycles.fall))
        often = (phases.count - 1) / lasts  # of few samples the typical period is a whole number
        near = max(0.004 * often, 0.2 / lasts)  # the mains drift, and clocks
        if any(abs(often - n * mains) < n * near for mains in (50.0, 60.0) for n in (1, 2, 3)):
            text = f"it oscillates at {often:.4g} Hz as one sine, a multiple of the mains frequency"
            hum = ForceOscillation(often, float(np.median(phases.cycles.drop)), phases.samples_per_cycle)
            return Verdict(Regime.SLIDING, verdict.confidence, (text,), segment(time, force, slips=False), hum)
        text = f"the mean cycle is a sine to {100 * shape.sine:.1f} %, {shape.frequency:.3g} times a second"
        text += ": its rests are short, and mu_s, t_cr and D are poorly determined; record slower as well"
        cycles = segment(time, force, half_period=0.5 / shape.frequency, plate=plate)
        return Verdict(Regime.NEAR_HARMONIC, verdict.confidence, (*verdict.evidence, text), cycles)
    drop, scatter = phases.cycles.drop[1:], 0.0
    if drop.size >= 6 and phases.stick_slope is not None:
        # A peak falls anywhere between two samples of a stick, a valley between two about the end of a slip.
        rise, lasts = phases.stick_slope[0] * phases.sample_interval, max(phases.samples_per_slip, 2.0)
        missed = rise**2 / 6.0 + (0.2 * float(np.mean(drop)) / lasts**2) ** 2
        scatter = drop_scatter(drop, (2.0 * phases.noise) ** 2 + missed)
    if scatter > UNEVEN:
        text = f"the drop scatters by {100 * scatter:.0f} % from one slip to the next"
        return replace(verdict, regime=Regime.UNEVEN_STICK_SLIP, evidence=(*verdict.evidence, text))
    return verdict


def drop_scatter(drop: Array, explained: float) -> float:
    """How much drops (n,) [N] differ from one to the next, as a share of their mean, beyond an explained variance
    [N^2]; 0 with fewer than three. A slow drift does not count."""
    if drop.size < 3:
        return 0.0
    variance = (1.4826 * float(np.median(np.abs(np.diff(drop)))) / np.sqrt(2.0)) ** 2 - explained
    return float(np.sqrt(max(variance, 0.0)) / max(float(np.mean(drop)), 1e-300))


# Oscillations of what slides.


@dataclass(frozen=True)
class Spectrum:
    """frequency (m,) [Hz]; power (m,) of the windowed values, 0 where they are trend (fewer than three periods);
    variance of the values about it; interval of the samples [s]."""

    frequency: Array
    power: Array
    variance: float
    interval: float

    @classmethod
    def of(cls, time: Array, values: Array) -> Spectrum | None:
        """Of values (n,) at times (n,) [s], what is not finite left out; None where there are fewer than 32."""
        good = np.isfinite(values)
        if np.count_nonzero(good) < 32:
            return None
        t, f = time[good], values[good]
        interval = float(np.median(np.diff(t)))
        f = f - np.polyval(np.polyfit(t - t[0], f, 2), t - t[0])
        power = np.abs(np.fft.rfft(f * np.hanning(f.size))) ** 2
        frequency = np.fft.rfftfreq(f.size, interval)
        power[frequency < 3.0 / (f.size * interval)] = 0.0
        return cls(np.asarray(frequency, np.float64), power, float(np.var(f)), interval)

    @property
    def peak(self) -> float:
        """Where the power is highest [Hz]."""
        return float(self.frequency[int(np.argmax(self.power))])

    def share(self, frequency: float) -> float:
        """Which part of the power a line there holds."""
        near = np.abs(self.frequency - frequency) <= max(0.08 * frequency, 2.0 * self.frequency[1])
        return float(np.sum(self.power[near]) / max(np.sum(self.power), 1e-300))

    def amplitude(self, frequency: float) -> float:
        """Of the sine that holds as much of the variance as a line there."""
        return float(np.sqrt(2.0 * self.share(frequency) * self.variance))

    @property
    def oscillation(self) -> ForceOscillation:
        """That of the highest line."""
        samples = 1.0 / (self.peak * self.interval) if self.peak > 0.0 else np.inf
        return ForceOscillation(self.peak, 2.0 * self.amplitude(self.peak), samples)

    def stands_out(self, least: float = CLEAR) -> bool:
        """Whether its highest line is of enough periods, with so much of the power, and not by chance: noise that is
        white within an octave on each side is hardly ever so high (R. A. Fisher, Proc. R. Soc. A 125 (1929) 54)."""
        if self.peak < CERTAIN * self.frequency[1] or self.share(self.peak) < least:
            return False
        power = self.power[(self.frequency >= 0.5 * self.peak) & (self.frequency <= 2.0 * self.peak)]
        count = np.count_nonzero(power)
        return bool(count * (1.0 - np.max(power) / np.sum(power)) ** (count - 1) <= 1e-6)


def hidden_rhythm(
    time: Array, force: Array, load: Array | None, known: Known, least: float = CLEAR
) -> ForceOscillation | None:
    """The swing of what looks like steady sliding, where it is that of stick-slip; None where there is none.

    The mean force of stick-slip is not that of steady sliding. While the mass slides the spring loads more slowly than
    in a stick, dF/dt < k v_0; a swing that reaches that rate comes to rest, however few samples see each cycle.

    Args:
        time, force, load: (n,) [s], [N], [N]; NaN where nothing counts. load: None where the force is without what the
            load does to it.
        known: of the rig; nothing is said where a part of it is not.
        least: share of the power that the swing holds.
    """
    swing = Spectrum.of(time, force) if known.loading_rate and known.half_period else None
    if swing is None or not swing.stands_out(least):
        return None
    peak, rate, height = swing.peak, 1.0 / swing.interval, swing.amplitude(swing.peak)
    if load is not None:
        pressed = Spectrum.of(time, load)
        coefficient = abs(float(np.nanmean(force) / np.nanmean(load)))
        if pressed is None or coefficient * pressed.amplitude(peak) > 0.2 * height:
            return None
    candidates = np.array([peak, *(n * rate + sign * peak for n in range(1, ALIASES + 1) for sign in (-1.0, 1.0))])
    candidates = candidates[candidates <= 0.6 / known.half_period]  # no stick-slip is faster than the rig swings
    loads = 2.0 * np.pi * candidates * height / known.loading_rate
    return swing.oscillation if np.any((loads >= LOADS[0]) & (loads <= LOADS[1])) else None


# All strokes of a log.


@dataclass(frozen=True)
class LogRegime:
    """regime of the log, None where nothing moves yet; confidence, 0.5 to 1; evidence: sentences; strokes and, for
    each, the verdict on it."""

    regime: Regime | None
    confidence: float
    evidence: tuple[str, ...]
    strokes: tuple[Stroke, ...]
    verdicts: tuple[Verdict, ...]


def look(
    record: Record, drive: DriveCourse, known: Known = Known(), *, phases: Segmentation | None = None
) -> LogRegime:
    """The regime of every stroke of a record, and of all of it.

    Args:
        drive: [m/s], a programme ((start [s], speed), ...), or None where unknown.
        known: of the rig; its drive speed is that of each stroke.
        phases: of the whole record where they are known; used where it is one stroke.
    """
    parts, verdicts = strokes(record, drive), []
    for stroke in parts:
        rows = slice(stroke.start, stroke.stop)
        time, load = record.time[rows], record.normal_force[rows]
        force = stroke.direction * record.friction_force[rows]
        own = replace(known, drive_speed=stroke.speed or 0.0)
        given = phases if len(parts) == 1 and phases is not None and phases.phase.size == force.size else None
        verdict = classify(time, force, own, given=given)
        pressed = presses(load) & np.isfinite(force)
        low, level, high = np.quantile(thinned(load[pressed]), [0.05, 0.5, 0.95]) if pressed.any() else (1.0, 1.0, 1.0)
        if high - low >= LOAD_CHANGES * level:
            # Where the load changes much, the force at the typical load tells; of what slips, where it explains that.
            at_level = np.where(pressed, force * level / np.where(pressed, load, 1.0), np.nan)
            over_load = classify(time, at_level, own)
            explained = over_load.regime is Regime.SLIDING and np.nanstd(at_level) < np.std(force[pressed])
            verdict = over_load if explained or not verdict.phases.count else verdict
        verdicts.append(verdict)
    return _of_all(changes_speed(drive), parts, verdicts)


def of_strokes(
    time: Array, force: Array, edges: Sequence[tuple[int, int, int]], known: Known, noise: float | None
) -> Verdict:
    """The verdict on a force (n,), where it changes its sign from those on its strokes (first row, end, sign)."""
    if len(edges) < 2:
        return classify(time, force, known, noise=noise)
    verdicts = [classify(time[a:b], direction * force[a:b], known) for a, b, direction in edges]
    parts = [Stroke(1, 1, i, a, b, direction, known.drive_speed) for i, (a, b, direction) in enumerate(edges, start=1)]
    phases = joined([(a, v.phases) for (a, _, _), v in zip(edges, verdicts, strict=True)], force.size)
    whole = _of_all(False, parts, verdicts)
    return Verdict(whole.regime, whole.confidence, whole.evidence, phases, strokes=len(parts))


def _of_all(changes: bool, parts: Sequence[Stroke], verdicts: Sequence[Verdict]) -> LogRegime:
    """The regime of a log from those of its strokes: what holds for most of the time."""
    all_parts, all_verdicts = tuple(parts), tuple(verdicts)
    if changes:
        text = "the drive changes its speed or stands in between; strokes are judged one by one"
        return LogRegime(Regime.PROGRAMME, SURE, (text,), all_parts, all_verdicts)
    if not verdicts:
        return LogRegime(None, 0.5, ("no rows",), all_parts, all_verdicts)
    lasts = np.array([stroke.stop - stroke.start for stroke in parts], float)
    regimes = [verdict.regime for verdict in verdicts]
    totals = {regime: lasts[[own == regime for own in regimes]].sum() for regime in dict.fromkeys(regimes)}
    slips = sum(total for regime, total in totals.items() if regime is not None and regime.slips)
    family = {r: n for r, n in totals.items() if (r is not None and r.slips) == (slips > 0.5 * lasts.sum())}
    regime = max(family, key=lambda r: family[r])
    like = [i for i, own in enumerate(regimes) if own == regime]
    confidence = float(np.average([verdicts[i].confidence for i in like], weights=lasts[like]))
    evidence = verdicts[max(like, key=lambda i: lasts[i])].evidence
    if len({stroke.direction for stroke in parts}) > 1:
        text = f"the force changes its sign: {len(parts)} strokes to and fro, of which {len(like)} are of this regime"
        evidence = (text, *evidence)
    return LogRegime(regime, confidence, evidence, all_parts, all_verdicts)


def only_of(whole: LogRegime, numbers: Sequence[int]) -> LogRegime:
    """The regime of some of the strokes of a log, by their numbers."""
    if len(numbers) == len(whole.strokes):
        return whole
    parts, verdicts = [whole.strokes[i] for i in numbers], [whole.verdicts[i] for i in numbers]
    return _of_all(not one_speed([stroke.speed for stroke in parts if stroke.speed]), parts, verdicts)


def joined(parts: Sequence[tuple[int, Segmentation]], rows: int) -> Segmentation:
    """The phases of one step of so many rows, put together of those of its strokes, each with its first row. Between
    strokes, where the drive stands, nothing is stick nor slip."""
    if len(parts) == 1 and parts[0][1].phase.size == rows:
        return parts[0][1]
    phase, spikes = np.full(rows, SLIDING, dtype=np.int8), np.zeros(rows, dtype=bool)
    for first, own in parts:
        phase[first : first + own.phase.size] = own.phase
        spikes[first : first + own.phase.size] = own.spikes
    each = [own for _, own in parts]
    names = ("onset", "onset_force", "fall", "arrest", "arrest_force")
    return Segmentation(
        cycles=DetectedCycles(*(np.concatenate([getattr(own.cycles, name) for own in each]) for name in names)),
        noise=float(np.median([own.noise for own in each])),
        spikes=spikes,
        phase=phase,
        begins_in_slip=each[0].begins_in_slip,
        ends_sliding=each[-1].ends_sliding,
        stick_slopes=np.concatenate([own.stick_slopes for own in each]),
        loading_slope=next((own.loading_slope for own in each if own.loading_slope is not None), None),
        sample_interval=float(np.median([own.sample_interval for own in each])),
        low_snr=any(own.low_snr for own in each),
    )
