"""The regime of a log: of each of its strokes and speeds, and of all of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import thinned
from data_io.signals import presses
from identify.logs.recorded_drive import RecordedDrive
from identify.logs.regime import UNKNOWN, Known, Regime, Verdict, classify
from identify.logs.segment import SLIDING, DetectedCycles, Segmentation
from identify.logs.strokes import Drive, Stroke, strokes

Array = NDArray[np.float64]

CHANGES = 0.3  # of the typical load, by which one changes that the force is to be seen over
SAME = 0.05  # share by which speeds differ if they are two
STEADY = 0.1  # of the speed of a disc: one that varies more has no turns of one length


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
    record: Record, drive: Drive, known: Known = UNKNOWN, *, tare: float = 0.0, found: Segmentation | None = None
) -> LogRegime:
    """The regime of every stroke of a record, and of all of it.

    Args:
        drive: [m/s], a programme ((start [s], speed), ...), one value per row, or None where unknown.
        known: of the rig; its drive speed and turns are those of each stroke.
        tare: force to take off the friction force [N]. found: the phases of the whole record where they are known;
            used where it is one stroke.
    """
    parts = strokes(record, drive)
    verdicts = []
    for stroke in parts:
        rows = slice(stroke.start, stroke.stop)
        force = stroke.direction * (record.friction_force[rows] - tare)
        own = replace(known, drive_speed=stroke.speed or 0.0, turn=turn_of(record, rows))
        given = found if len(parts) == 1 and found is not None and found.phase.size == force.size else None
        verdicts.append(_classified(record.time[rows], force, record.normal_force[rows], own, given))
    return LogRegime(*_of_all(changes_speed(drive), parts, verdicts), parts, tuple(verdicts))


def _classified(time: Array, force: Array, load: Array, known: Known, given: Segmentation | None) -> Verdict:
    """The verdict on a stroke: on the force, or, where its load changes much, on the force at the typical load."""
    verdict = classify(time, force, known, given=given)
    pressed = presses(load) & np.isfinite(force)
    low, level, high = np.quantile(thinned(load[pressed]), [0.05, 0.5, 0.95]) if pressed.any() else (1.0, 1.0, 1.0)
    if verdict.found.count or high - low < CHANGES * level:
        return verdict
    return classify(time, np.where(pressed, force * level / np.where(pressed, load, 1.0), np.nan), known)


def drive_of(record: Record, told: RecordedDrive) -> Drive:
    """The drive that the strokes of a record are told by: what a column of it surely says; None where none does."""
    if record.drive_speed is not None and not isinstance(record.drive_speed, np.ndarray):
        return record.drive_speed
    if told.programme is None or not told.named:
        return None
    speeds = [speed for _, speed in told.programme]
    if min(speeds) < 0.0 < max(speeds):  # its rests are part of a stroke, and the force turns later than the drive
        return float(np.median(np.abs([speed for speed in speeds if speed])))
    return told.speed if told.speed is not None else told.programme


def of_strokes(time: Array, force: Array, strokes: Sequence[tuple[int, int, int]], known: Known) -> Verdict:
    """The verdict on a force (n,) that changes its sign, from those on its strokes (first row, end, sign)."""
    verdicts = [classify(time[a:b], way * force[a:b], known) for a, b, way in strokes]
    parts = [Stroke(1, 1, i, a, b, way, known.drive_speed) for i, (a, b, way) in enumerate(strokes, start=1)]
    found = joined([(a, v.found) for (a, _, _), v in zip(strokes, verdicts, strict=True)], force.size)
    return Verdict(*_of_all(False, parts, verdicts), found, strokes=len(parts))


def turn_of(record: Record, rows: slice) -> float:
    """How often a disc turns in some rows [Hz], from a column in rpm; 0 where none tells it, or it changes."""
    for name, unit in record.channel_units.items():
        values = record.channels[name][rows] if unit == "rpm" else np.empty(0)
        values = np.abs(values[np.isfinite(values)])
        if values.size and np.median(values) > 0.0 and np.std(values) < STEADY * np.median(values):
            return float(np.median(values)) / 60.0
    return 0.0


def _of_all(
    changes: bool, parts: Sequence[Stroke], verdicts: Sequence[Verdict]
) -> tuple[Regime | None, float, tuple[str, ...]]:
    """Regime, confidence and evidence of a log from those of its strokes: what holds for most of the time."""
    if changes:
        return Regime.PROGRAMME, 0.99, ("the drive changes its speed or stands in between; strokes are seen apart",)
    if not verdicts:
        return None, 0.5, ("no rows",)
    lasts = np.array([stroke.stop - stroke.start for stroke in parts], float)
    moving = [verdict.regime for verdict in verdicts]
    totals = {regime: lasts[[own == regime for own in moving]].sum() for regime in dict.fromkeys(moving)}
    slips = sum(total for regime, total in totals.items() if regime is not None and regime.slips)
    family = slips > 0.5 * lasts.sum()
    chosen = {r: total for r, total in totals.items() if (r is not None and r.slips) == family}
    regime = max(chosen, key=lambda r: chosen[r])
    like = [i for i, own in enumerate(moving) if own == regime]
    confidence = float(np.average([verdicts[i].confidence for i in like], weights=lasts[like]))
    evidence = verdicts[max(like, key=lambda i: lasts[i])].evidence
    count = len(parts) if len({stroke.direction for stroke in parts}) > 1 else 1
    if count > 1:
        evidence = (
            f"the force changes its sign: {count} strokes to and fro, of which {len(like)} are of this regime",
            *evidence,
        )
    return regime, confidence, evidence


def changes_speed(drive: Drive) -> bool:
    """Whether a drive has several speeds, or stands between moving one way."""
    if drive is None or isinstance(drive, int | float):
        return False
    table = np.asarray(drive, dtype=np.float64)
    speeds = table[:, 1] if table.ndim == 2 else table[np.append(True, table[1:] != table[:-1])]
    speeds = speeds[np.isfinite(speeds)]
    moving = np.flatnonzero(speeds)
    speeds = (
        speeds[moving[0] : moving[-1] + 1] if moving.size else speeds
    )  # what it rests before and after is no change
    sizes = np.abs(speeds[speeds != 0.0])
    if not sizes.size or (speeds.size > 0.1 * np.size(drive) and table.ndim == 1):
        return False  # noise of a column is no programme
    several = float(sizes.max() - sizes.min()) > SAME * float(sizes.max())
    return several or (bool(np.any(speeds == 0.0)) and not (speeds.min() < 0.0 < speeds.max()))


def only_of(whole: LogRegime, numbers: Sequence[int]) -> LogRegime:
    """The regime of some of the strokes of a log, by their numbers."""
    if len(numbers) == len(whole.strokes):
        return whole
    parts, verdicts = tuple(whole.strokes[i] for i in numbers), tuple(whole.verdicts[i] for i in numbers)
    speeds = [stroke.speed for stroke in parts if stroke.speed]
    changes = bool(speeds) and max(speeds) - min(speeds) > SAME * max(speeds)
    return LogRegime(*_of_all(changes, parts, verdicts), parts, verdicts)


def joined(parts: Sequence[tuple[int, Segmentation]], rows: int) -> Segmentation:
    """The phases of one step of so many rows, put together of those of its strokes, each with its first row. Between
    strokes, where the drive stands, nothing is stick nor slip."""
    if len(parts) == 1 and parts[0][1].phase.size == rows:
        return parts[0][1]

    phase, spikes = np.full(rows, SLIDING, dtype=np.int8), np.zeros(rows, dtype=bool)
    for first, found in parts:
        phase[first : first + found.phase.size] = found.phase
        spikes[first : first + found.phase.size] = found.spikes
    names = ("onset", "onset_force", "fall", "arrest", "arrest_force")
    seen = [found for _, found in parts]
    cycles = DetectedCycles(*(np.concatenate([getattr(found.cycles, name) for found in seen]) for name in names))
    return Segmentation(
        cycles=cycles,
        noise=float(np.median([found.noise for found in seen])),
        spikes=spikes,
        phase=phase,
        begins_in_slip=seen[0].begins_in_slip,
        ends_sliding=seen[-1].ends_sliding,
        stick_slopes=np.concatenate([found.stick_slopes for found in seen]),
        loading_slope=next((found.loading_slope for found in seen if found.loading_slope is not None), None),
        sample_interval=float(np.median([found.sample_interval for found in seen])),
        low_snr=any(found.low_snr for found in seen),
    )
