"""Holds and velocity steps of a record, as friction laboratories read them: slide-hold-slide, direct and evolution
effect."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.quality import presses
from identify.base.wording import quantity
from identify.logs.log_data import BINS
from identify.logs.noise import FEWEST_ROWS, SIGNIFICANT
from identify.logs.recorded_drive import Stroke, one_speed
from identify.logs.regime import LogRegime, Regime, Verdict

Array = NDArray[np.float64]

RINGS = 0.15  # of an evolution effect, by which friction leaves the exponential where it is the rig that rings


@dataclass(frozen=True)
class DriveChange:
    """A hold, or a velocity step where hold_s is 0.

    start_s [s]: when the drive stopped or changed its speed; speeds [m/s], that before a first rest None. Coefficients
    of friction, None where they do not show: before and after the mean of the last third of what slides, of stick-slip
    all of it; peak: the static one that ends a hold. direct_effect: of a velocity step the change at once,
    evolution_effect: that which follows, over D_c_m [m] of the drive's travel to 1/e; only where it slides.
    """

    start_s: float
    hold_s: float
    speed_before_m_per_s: float | None
    speed_after_m_per_s: float | None
    before_coefficient: float | None = None
    peak_coefficient: float | None = None
    after_coefficient: float | None = None
    direct_effect: float | None = None
    evolution_effect: float | None = None
    D_c_m: float | None = None

    @property
    def name(self) -> str:
        """What it is."""
        if self.hold_s:
            return f"hold of {quantity(self.hold_s, 's', 3)}"
        return "step up" if (self.speed_after_m_per_s or 0.0) > (self.speed_before_m_per_s or 0.0) else "step down"


def summary(changes: Sequence[DriveChange]) -> str:
    """What they are, in words: "slide-hold-slide, 7 holds of 1 s to 1000 s; velocity steps, 2 up and 1 down"."""
    holds = [change for change in changes if change.hold_s]
    steps = [change.name for change in changes if not change.hold_s]
    texts = []
    if holds:
        low, high = (quantity(end([hold.hold_s for hold in holds]), "s", 3) for end in (min, max))
        word = "slide-hold-slide" if any(hold.speed_before_m_per_s for hold in holds) else "rest before sliding"
        text = f"{word}, {len(holds)} hold{'s' * (len(holds) > 1)} of {low if low == high else f'{low} to {high}'}"
        texts.append(text)
    if steps:
        up = steps.count("step up")
        texts.append(f"velocity steps, {up} up and {len(steps) - up} down")
    return "; ".join(texts)


def drive_changes(record: Record, seen: LogRegime) -> tuple[DriveChange, ...]:
    """The holds and velocity steps between the strokes of a record, and a rest before the first, with what friction
    does at each; turns of the drive are none."""
    pairs = list(zip(seen.strokes, seen.verdicts, strict=True))
    out = []
    for before, after, change in _between(record.time, seen.strokes):
        earlier, later = (None if i is None else _Stretch.of(record, *pairs[i]) for i in (before, after))
        assert later is not None
        change = replace(
            change, before_coefficient=None if earlier is None else earlier.level, after_coefficient=later.level
        )
        if change.hold_s:
            change = replace(change, peak_coefficient=later.peak)
        elif earlier is not None and earlier.slides and later.slides:
            change = _with_effects(change, later.time, later.coefficient)
        out.append(change)
    return tuple(out)


def _between(time: Array, strokes: Sequence[Stroke]) -> Iterator[tuple[int | None, int, DriveChange]]:
    """The changes with the numbers of the strokes before and after each."""
    if strokes and strokes[0].start and strokes[0].speed:
        begin = float(time[0])
        yield None, 0, DriveChange(begin, float(time[strokes[0].start]) - begin, None, strokes[0].speed)
    for i, (one, other) in enumerate(pairwise(strokes)):
        known = one.speed and other.speed and one.direction == other.direction
        if known and (other.start > one.stop or not one_speed([one.speed or 0.0, other.speed or 0.0])):
            stop, start = float(time[one.stop]), float(time[other.start])
            yield i, i + 1, DriveChange(stop, start - stop, one.speed, other.speed)


@dataclass(frozen=True)
class _Stretch:
    """One speed: time [s], force and load [N] (m,) where they are sound, and the verdict on it."""

    time: Array
    force: Array
    load: Array
    verdict: Verdict

    @classmethod
    def of(cls, record: Record, stroke: Stroke, verdict: Verdict) -> _Stretch:
        rows = slice(stroke.start, stroke.stop)
        force, load = stroke.direction * record.friction_force[rows], record.normal_force[rows]
        good = np.isfinite(force) & np.isfinite(load) & ~verdict.phases.spikes & presses(load)
        return cls(record.time[rows][good], force[good], load[good], verdict)

    @property
    def coefficient(self) -> Array:
        """(m,) of friction."""
        return self.force / self.load

    @property
    def slides(self) -> bool:
        """Whether it slides in the end, enough rows of it."""
        return self.verdict.regime is Regime.SLIDING and self.time.size >= FEWEST_ROWS

    @property
    def level(self) -> float | None:
        """Its mean coefficient: of the last third where it slides, of all of it from the first slip on where not."""
        slips = np.searchsorted(self.time, self.verdict.phases.cycles.onset)
        begin = 2 * self.time.size // 3 if self.slides else int(np.min(slips, initial=self.time.size))
        values = self.coefficient[begin:]
        return float(np.mean(values)) if values.size else None

    @property
    def peak(self) -> float | None:
        """The coefficient at the onset of its first slip, where one was found; else the highest mean of so many rows
        that noise is a twentieth of its height."""
        cycles, noise = self.verdict.phases.cycles, self.verdict.phases.noise
        if self.time.size < FEWEST_ROWS:
            return None
        if cycles.count:
            return float(cycles.onset_force[0] / np.interp(cycles.onset[0], self.time, self.load))
        height = float(np.max(self.force) - np.median(self.force))
        rows = int(np.clip((noise / max(0.05 * height, 1e-300)) ** 2, 1, self.time.size // 20))
        return float(np.max(np.convolve(self.coefficient, np.full(rows, 1.0 / rows), "valid")))


def _with_effects(change: DriveChange, time: Array, coefficient: Array) -> DriveChange:
    """A velocity step with direct and evolution effect: from where friction turns on, a level and an exponential over
    the drive's travel, as of a state that evolves with slip (A. Ruina, J. Geophys. Res. 88 (1983) 10359)."""
    speed, before = change.speed_after_m_per_s or 0.0, change.before_coefficient or 0.0
    width = max(time.size // BINS, 1)
    mean = coefficient[: time.size // width * width].reshape(-1, width).mean(axis=1)
    way = 1.0 if change.name == "step up" else -1.0
    turn = int(np.argmax(way * mean[: 2 * mean.size // 3]))
    between = speed * width * float(np.median(np.diff(time)))
    x, y = between * (np.arange(mean.size - turn) + 0.5), mean[turn:]
    if x[-1] < 50.0 * between:
        return change
    lengths, fits = np.geomspace(10.0 * between, x[-1] / 4.0, 100).tolist(), []
    for length in lengths:
        shape = np.exp(-x / length)
        above = float((shape - shape.mean()) @ y / np.sum((shape - shape.mean()) ** 2))
        after = float(np.mean(y) - above * np.mean(shape))
        fits.append((float(np.sum((y - after - above * shape) ** 2)), length, after, above))
    left, length, after, above = min(fits)
    shape = np.exp(-x / length)
    error = np.sqrt(left / (x.size - 3) / np.sum((shape - shape.mean()) ** 2))
    squares, soon = (y - after - above * shape) ** 2, x < 3.0 * length
    rings = float(np.mean(squares[soon]) - np.mean(squares[~soon])) > (RINGS * above) ** 2
    if abs(above) <= SIGNIFICANT * error or length == lengths[0] or rings:
        return change
    return replace(
        change, peak_coefficient=after + above, after_coefficient=after, direct_effect=after + above - before,
        evolution_effect=-above, D_c_m=length,
    )  # fmt: skip
