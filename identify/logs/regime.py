"""How a log moves, tested on its force: stick-slip, an oscillation of the mass, or sliding; one answer for all.

A stick is where the force rises at stiffness times drive speed: rises of one slope, straight, whatever the drop before
them. A slip is faster than that. Noise that remembers rises at any slope; the swing of a turning disc is as slow down
as up, and rises far more slowly than a stick where stiffness and speed are known. Where they are not, a swing as slow
and small as a disc makes it is taken for one, with as much confidence as its period and its size give.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from identify.base.wording import three_figures
from identify.logs.segment import SLIDING, Segmentation, segment
from identify.logs.spectrum import Spectrum

Array = NDArray[np.float64]

STRAIGHT = 0.8  # share of the usual rise that a line of the one slope explains
COVERS = (0.5, 2.0)  # times a fall, that a rise makes up
AS_LONG, SAWTOOTH = 2.0, 4.0  # longer than this times a fall, a rise is a stick's: log odds per logarithm beyond
OFF, LOADING = 5.0, 3.0  # times off k v_0, up or down, at which rises hardly are sticks: log odds per logarithm
MISSTATED = -5.0  # log odds at least: stiffness, speed or a unit may be stated wrongly by any factor
UNCOMPARED = 2.0  # log odds against slips whose rises are too few to be compared
SINE = 0.985  # part of the mean cycle that its first harmonic holds from which on it is one sine
POINTS = 128  # of the mean cycle
CORNER = 0.1  # of a rise at either end, which a sample of the slip may reach into
FEW = 3  # rises from which on their slopes can be compared
UNEVEN = 0.08  # scatter of the drop from one slip to the next, beyond noise and sampling, as a share
FOR_SCATTER = 6  # drops
SLOW, SMALL = 5.0, 0.07  # swings that discs and rigs make alike: how often [Hz], peak to valley over the level
HUMP = 4.0  # times the power beside it, octave by octave, at which a rhythm that wanders stands out
PERIODS = 8  # of a rhythm
CLEAR = 0.4  # share of the power at its frequency and above
SURE = 0.99
MAINS_DRIFT = 0.004  # share by which the frequency of the mains, or a clock, is off
RUBS = 2.0  # times its noise: a smaller force is that of a drive at rest
LEAST = 0.03  # share of the power in the line of slips that noise hides


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
    """What is known of rig and drive; 0: not known. stiffness [N/m], drive_speed [m/s], half_period pi sqrt(m/k) [s],
    turn: how often a disc turns [Hz]."""

    stiffness: float = 0.0
    drive_speed: float = 0.0
    half_period: float = 0.0
    turn: float = 0.0

    @property
    def loading_rate(self) -> float:
        """Stiffness times drive speed [N/s]."""
        return self.stiffness * abs(self.drive_speed)


UNKNOWN = Known()


@dataclass(frozen=True)
class ForceOscillation:
    """A swing of a force that slides: frequency [Hz], range peak to valley [N]; turns: how many a period takes, None
    where the turns are not known."""

    frequency: float
    range: float
    turns: float | None = None


@dataclass(frozen=True)
class Verdict:
    """regime, None where nothing moves (a first loading, a drive at rest); confidence, 0.5 to 1; evidence: what was
    tested, in sentences; rhythm of what slides, None without one; found: the phases that go with it; strokes: of
    how many it tells, to and fro."""

    regime: Regime | None
    confidence: float
    evidence: tuple[str, ...]
    found: Segmentation
    rhythm: ForceOscillation | None = None
    strokes: int = 1


@dataclass(frozen=True)
class _Shape:
    """Of the rises and falls of a force: their number; straight: share of the usual rise that a line of the one slope
    explains, NaN where they have too few samples; asymmetry: duration of a rise over that of a fall; sine: share of the
    first harmonic; rate: the one slope [N/s]; covers: what a rise at it makes up of a fall; frequency [Hz]; share
    of the level that the fall is."""

    rises: int
    straight: float
    asymmetry: float
    sine: float
    rate: float
    covers: float
    frequency: float
    share: float


@dataclass(frozen=True)
class _Tested:
    """Whether falls are slips, with what confidence and evidence; their shape."""

    slips: bool
    confidence: float
    evidence: tuple[str, ...]
    shape: _Shape


NO_SHAPE = _Shape(0, *[float("nan")] * 7)


def classify(
    time: Array,
    force: Array,
    known: Known = UNKNOWN,
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
    brief: Verdict | None = None
    first: _Tested | None = None
    for found in _segmented(time, force, known, noise) if given is None else (given,):
        if found.count == 0 and found.phase.size and not found.share(SLIDING):
            return Verdict(None, SURE, ("the force only rises: no slip has come yet",), found)
        tested = _tested(time, force, found, known)
        first = first or tested
        if tested.slips and not found.slides_on(found.count):
            return _slipping(time, force, found, tested)
        if tested.slips and brief is None:
            word = "one slip" if found.count == 1 else f"{found.count} slips"
            evidence = (*tested.evidence, f"{word} at first, then it slides")
            brief = Verdict(Regime.SLIDING, tested.confidence, evidence, found)
        if not tested.slips and found.low_snr and (often := _hidden(time, force, known)) is not None:
            says = f"noise hides most slips, but it swings {often:.3g} times a second as fast as sticks load"
            return Verdict(Regime.STICK_SLIP, 0.8, (says,), found)
    assert first is not None
    if brief is None and abs(float(np.nanmedian(force))) < RUBS * found.noise:
        return Verdict(None, 0.9, ("no friction above its noise: the drive stands, or nothing presses",), found)
    return brief or _sliding(time, force, known, noise, first)


def _hidden(time: Array, force: Array, known: Known) -> float | None:
    """How often the spectrum shows slips that noise hides [Hz]: a swing that loads about as fast as sticks do."""
    if not known.loading_rate or (frequency := _hump(time, force, LEAST)) is None:
        return None
    seen = Spectrum.of(time, force)
    loads = 0.0 if seen is None else 2.0 * np.pi * frequency * seen.amplitude(frequency) / known.loading_rate
    return frequency if 1.0 / OFF < loads < OFF else None


def _segmented(time: Array, force: Array, known: Known, noise: float | None) -> Iterator[Segmentation]:
    """The phases of a force as the period of the rig smooths it, as its own slips do, and as a rhythm that its spectrum
    shows does: noise hides some of them from each."""
    if known.half_period:
        yield segment(time, force, half_period=known.half_period, noise=noise)
    yield segment(time, force, noise=noise)
    if (hump := _hump(time, force)) is not None:
        found = segment(time, force, half_period=0.5 / hump, noise=noise)
        if found.count > PERIODS:
            yield found


def is_mains(frequency: float, lasts: float) -> bool:
    """Whether a frequency [Hz], known from so long a record [s], is that of the mains or a low multiple of it."""
    near = max(MAINS_DRIFT * frequency, 0.2 / lasts)
    return any(abs(frequency - many * mains) < many * near for mains in (50.0, 60.0) for many in (1, 2, 3))


def _slipping(time: Array, force: Array, found: Segmentation, tested: _Tested) -> Verdict:
    """Which stick-slip it is."""
    shape, confidence, evidence = tested.shape, tested.confidence, tested.evidence
    if shape.rises >= FEW and shape.sine >= SINE and is_mains(shape.frequency, float(np.ptp(found.cycles.fall))):
        says = f"it swings {shape.frequency:.4g} times a second as one sine, as the mains make a sensor hum"
        smooth_slide = segment(time, force, noise=None, slips=False)
        hum = ForceOscillation(shape.frequency, float(np.median(found.cycles.drop)))
        return Verdict(Regime.SLIDING, confidence, (says,), smooth_slide, hum)
    if shape.rises >= FEW and shape.sine >= SINE:
        says = f"the mean cycle is a sine to {100 * shape.sine:.1f} %, {shape.frequency:.3g} times a second"
        return Verdict(Regime.NEAR_HARMONIC, confidence, (*evidence, says), found)
    scatter = drop_scatter(found)
    if scatter is not None and scatter > UNEVEN:
        says = f"the drop scatters by {100 * scatter:.0f} % from one slip to the next"
        return Verdict(Regime.UNEVEN_STICK_SLIP, confidence, (*evidence, says), found)
    return Verdict(Regime.STICK_SLIP, confidence, evidence, found)


def drop_scatter(found: Segmentation) -> float | None:
    """How much the force drop differs from one slip to the next, as a share of the mean, beyond what noise and
    sampling do; None with too few slips. A slow drift does not count."""
    drop = found.cycles.drop[1:]
    if drop.size < FOR_SCATTER or found.stick_slope is None:
        return None
    steps = np.diff(drop) / np.sqrt(2.0)
    # A peak falls anywhere between two samples of a stick, a valley between two about the end of a slip.
    lasts = max(found.samples_per_slip, 2.0)
    missed = (found.stick_slope[0] * found.sample_interval) ** 2 / 6.0 + (0.2 * float(np.mean(drop)) / lasts**2) ** 2
    excess = (1.4826 * float(np.median(np.abs(steps)))) ** 2 - (2.0 * found.noise) ** 2 - missed
    return float(np.sqrt(max(excess, 0.0)) / np.mean(drop))


def _tested(time: Array, force: Array, found: Segmentation, known: Known) -> _Tested:
    """Whether the falls of a force are slips, how sure that is, and what was tested."""
    if found.count == 0:
        says = "no fall of the force stands out of its noise"
        if found.other_falls:
            says = f"{found.other_falls} falls stand out of the noise, none of them faster than the rises beside it"
        return _Tested(False, 0.95, (says,), NO_SHAPE)
    shape = _shape(time, force, found)
    return _Tested(*_slips(shape, found, known), shape)


def _slips(shape: _Shape, found: Segmentation, known: Known) -> tuple[bool, float, tuple[str, ...]]:
    loads = shape.rate / known.loading_rate if known.loading_rate else np.nan
    evidence = []
    if np.isfinite(shape.straight):
        evidence.append(f"lines of one slope explain {100 * max(shape.straight, 0.0):.0f} % of {shape.rises} rises")
    if np.isfinite(loads):
        evidence.append(f"they load at {_times(loads)} stiffness times drive speed")
    bent = shape.straight < STRAIGHT or not COVERS[0] <= shape.covers <= COVERS[1]
    if shape.rises and bent:
        sure = _sure(10.0 * (STRAIGHT - shape.straight)) if shape.straight < STRAIGHT else 0.9
        return False, sure, (*evidence, "sticks would rise alike and straight, by as much as a slip falls")
    odds, size = 0.0, 2.0 * float(np.log(max(shape.share, 1e-9) / SMALL))
    if shape.asymmetry > 1.0:
        evidence.append(f"a fall is {shape.asymmetry:.2g} times as fast as a rise")
        odds += SAWTOOTH * np.log(max(shape.asymmetry / AS_LONG, 1.0))
    if np.isfinite(loads):
        off = abs(np.log(loads)) if loads > 0.0 else np.inf
        odds += max(LOADING * (np.log(OFF) - off), MISSTATED) + size
        return bool(odds > 0.0), _sure(float(odds)), tuple(evidence)
    if not shape.rises:
        return False, 0.6, (*evidence, "one fall alone; stiffness and drive speed of the rig would tell")
    turns = _turns(shape.frequency, known.turn)
    if turns is not None:
        return False, SURE, (*evidence, f"the swing comes once in {turns:.3g} turns")
    odds += np.log(shape.frequency / SLOW) + size
    odds -= 0.0 if shape.rises >= FEW else UNCOMPARED
    says = f"it swings by {three_figures(100 * shape.share)} % of the force, {shape.frequency:.3g} times a second"
    if odds <= 0.0:
        says += ", as a turning disc or an uneven track makes it; stiffness and drive speed of the rig would tell"
    return bool(odds > 0.0), _sure(float(odds)), (*evidence, says)


def _sure(odds: float) -> float:
    """A probability from log odds, never certain."""
    return float(min(1.0 / (1.0 + np.exp(-abs(odds))), SURE))


def _times(ratio: float) -> str:
    return (
        f"{ratio:.2g} times" if 0.01 <= ratio < 100.0 else ("less than 0.01 times" if ratio < 1.0 else "over 100 times")
    )


def _sliding(time: Array, force: Array, known: Known, noise: float | None, tested: _Tested) -> Verdict:
    """Sliding, segmented without slips, with its rhythm."""
    found = segment(time, force, half_period=known.half_period or None, noise=noise, slips=False)
    slides = np.where(found.phase == SLIDING, np.where(found.spikes, np.nan, force), np.nan)
    rhythm = _rhythm(time, slides, known.turn)
    evidence = tested.evidence
    if rhythm is not None:
        turns = "" if rhythm.turns is None else f", once in {rhythm.turns:.3g} turns"
        evidence = (*evidence, f"it swings by {rhythm.range:.3g} N, {rhythm.frequency:.3g} times a second{turns}")
    return Verdict(Regime.SLIDING, tested.confidence, evidence, found, rhythm)


def _shape(time: Array, force: Array, found: Segmentation) -> _Shape:
    cycles = found.cycles
    rise = cycles.onset[1:] - cycles.arrest[:-1]
    level = abs(float(np.nanmedian(force)))
    swing = float(np.median(cycles.drop))
    share = swing / level if level > 0.0 else np.inf
    interval = found.sample_interval
    if not rise.size:
        slope = found.loading_slope or 0.0
        return _Shape(0, np.nan, np.nan, np.nan, slope, np.nan, np.nan, share)
    pieces = []
    for first, last in np.searchsorted(time, np.stack([cycles.arrest[:-1], cycles.onset[1:]], axis=1)).tolist():
        corner = max(round(CORNER * (last - first)), 1) if last - first >= 5 else 0
        rows = slice(first + corner, last + 1 - corner)
        good = np.isfinite(force[rows]) & ~found.spikes[rows]
        if np.count_nonzero(good) >= 3:
            t, f = time[rows][good], force[rows][good]
            pieces.append((t - t.mean(), f - f.mean()))
    # Medians: a rise with a slip in it that was missed is none that tells.
    slopes = np.array([t @ f / (t @ t) for t, f in pieces])
    rate = float(np.median(slopes)) if pieces else float(np.median(cycles.drop[1:] / np.maximum(rise, interval)))
    straight = [_explained(t, f, rate, found.noise) for t, f in pieces]
    period = float(np.median(cycles.period))
    asymmetry, sine = _mean_cycle(time, force, found, period)
    return _Shape(
        rises=len(rise),
        straight=float(np.median(straight)) if straight else np.nan,
        asymmetry=asymmetry,
        sine=sine,
        rate=rate,
        covers=rate * float(np.median(rise)) / swing,
        frequency=1.0 / period,
        share=share,
    )


def _mean_cycle(time: Array, force: Array, found: Segmentation, period: float) -> tuple[float, float]:
    """Of the mean of all cycles, in which noise is averaged out: how many times as long as its fall its rise lasts, and
    the share of its first harmonic, 0.61 for a saw-tooth; NaN without a whole cycle."""
    good = np.isfinite(force) & ~found.spikes
    sound, there = time[good], force[good]
    grid = (np.arange(POINTS) / POINTS - 0.5) * period
    falls = found.cycles.fall
    falls = falls[(falls - 0.5 * period >= sound[0]) & (falls + 0.5 * period <= sound[-1])]
    if not falls.size:
        return np.nan, np.nan
    near = np.searchsorted(sound, np.add.outer(falls, [grid[0], grid[-1]])).tolist()
    rows = [slice(max(first - 1, 0), last + 1) for first, last in near]  # np.interp reads all that it is given
    mean = np.mean([np.interp(at + grid, sound[r], there[r]) for at, r in zip(falls, rows, strict=True)], axis=0)
    peak, valley = int(np.argmax(mean[: POINTS // 2])), POINTS // 2 + int(np.argmin(mean[POINTS // 2 :]))
    power = np.abs(np.fft.rfft(mean - mean.mean())[1:]) ** 2
    return POINTS / (valley - peak) - 1.0, float(power[0] / np.sum(power)) if np.any(power) else np.nan


def _explained(t: Array, f: Array, rate: float, noise: float) -> float:
    """Share of a rise (n,) about its mean that a line of some slope [N/s] explains, the noise taken off."""
    whole, left, own = float(f @ f), float(np.sum((f - rate * t) ** 2)), t.size * noise**2
    return 1.0 - max(left - own, 0.0) / max(whole - own, 1e-3 * whole) if whole > 0.0 else 0.0


def _turns(frequency: float, turn: float) -> float | None:
    """How many turns one period takes, if it is one turn or a half or third of it; None where it is not."""
    if not turn > 0.0:
        return None
    many = frequency / turn
    return 1.0 / round(many) if 0.9 < many < 3.3 and abs(many - round(many)) < 0.05 * many else None


def _rhythm(time: Array, force: Array, turn: float) -> ForceOscillation | None:
    """A line in the spectrum of what slides."""
    seen = Spectrum.of(time, force)
    if seen is None or seen.periods < PERIODS or seen.share(seen.peak) < CLEAR or seen.chance > 1e-6:
        return None
    return ForceOscillation(seen.peak, 2.0 * seen.amplitude(seen.peak), _turns(seen.peak, turn))


def _hump(time: Array, force: Array, clear: float = CLEAR) -> float | None:
    """Where the spectrum has a hump [Hz]: a rhythm that wanders; None without one that stands out to both sides."""
    seen = Spectrum.of(time, force)
    if seen is None:
        return None
    lines = np.arange(seen.frequency.size)
    edges = np.unique(np.round(np.geomspace(PERIODS, max(seen.frequency.size - 1, PERIODS + 1), 40)).astype(int))
    total = np.concatenate([[0.0], np.cumsum(seen.power)])
    best, where = 0.0, None
    for edge in edges[1:-1].tolist():
        low, high, far = round(edge / 1.25), round(1.25 * edge), round(2.5 * edge)
        if far >= lines.size or high - low < 5:
            continue
        here = (total[high] - total[low]) / (high - low)
        below = (total[round(0.6 * edge)] - total[round(0.4 * edge)]) / max(round(0.6 * edge) - round(0.4 * edge), 1)
        above = (total[far] - total[round(1.7 * edge)]) / max(far - round(1.7 * edge), 1)
        share = (total[high] - total[low]) / max(total[-1] - total[low], 1e-300)
        if here > HUMP * max(below, above) and share > clear and here * (high - low) > best:
            best, where = here * (high - low), edge
    return None if where is None else float(seen.frequency[where])
