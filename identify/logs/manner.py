"""How a log moves, from its data: in cycles of stick and slip, steadily, or in a course of its own (holds, speeds)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import kept, thinned, thinned_steps
from identify.logs.hidden_rhythm import Swing, hidden_rhythm
from identify.logs.local_fits import line_slope, slope_error
from identify.logs.segment import SLIDING, STICK, Segmentation
from identify.simulation.drive import Drive

Array = NDArray[np.float64]
Name = Literal["cycles", "course", "sliding"]

FEW = 3  # slips before a log slides: fewer are followed one by one
MOSTLY = 0.5  # share of the samples that slide from which on a log is followed, not folded
SEEN_RISE = 5  # samples of a first rise from which on it is one
LOOSE = 5.0  # standard deviations of the scatter within a bin beyond which a force is not level
BIN = 8  # samples at least
LEAST_SETTLED = 20  # samples of steady sliding
STUCK = 3.0  # standard errors by which a level force must rise more slowly than a stick to count as sliding
LEVEL = 0.5  # of the middle force: a record that starts above slides from its start


@dataclass(frozen=True)
class Manner:
    """The name; settled: since when the last stretch slides steadily [s], None where it does not; begins_sliding;
    faint: the noise hides so much of the cycles that many of them were missed; rhythm: of what only looks steady."""

    name: Name
    settled: float | None
    begins_sliding: bool
    faint: bool = False
    rhythm: Swing | None = None


def manner_of(
    found: Segmentation,
    time: Array,
    force: Array,
    load: Array,
    falls: Array,
    *,
    noise: float,
    stiffness: float,
    half_period: float,
    drive: Drive,
) -> Manner:
    """Tell how a log moves.

    Args:
        time, force, load: (n,) [s], [N], [N], NaN where nothing counts; falls: of its cycles [s]; drive: its programme.
        stiffness [N/m], half_period [s] of the rig; 0 where it is not known, or something else makes the mass swing.
    """
    manner = _as_it_looks(found, time, force, falls, noise=noise, half_period=half_period, drive=drive)
    if manner.settled is None:
        return manner
    late = time >= manner.settled
    rhythm = hidden_rhythm(
        time[late],
        force[late],
        load[late],
        stiffness=stiffness,
        drive_speed=drive.at(float(time[-1])),
        half_period=half_period,
    )
    return manner if rhythm is None else replace(manner, settled=None, rhythm=rhythm)


def _as_it_looks(
    found: Segmentation, time: Array, force: Array, falls: Array, *, noise: float, half_period: float, drive: Drive
) -> Manner:
    settled = since_settled(time, force, noise, half_period)
    if settled is not None and drive.constant and found.stick_slope is not None:
        # A slip near the end of a slow log leaves a stick too short to be seen to rise.
        settled = settled if _slides(time, force, settled, noise, found.stick_slope[0]) else None
    begins = bool(found.phase.size and found.phase[0] == SLIDING) and _starts_loaded(time, force, noise, drive)
    if not drive.constant:
        return Manner("course", settled, begins)
    slides = found.ends_sliding and (falls.size < FEW or found.share(SLIDING) > MOSTLY)
    if falls.size and not slides:
        return Manner("cycles", None, False, found.faint)
    if falls.size == 0 and not slides:
        return Manner("cycles", None, False)
    rise = int(np.argmax(found.phase != STICK)) if found.phase.size and found.phase[0] == STICK else 0
    if falls.size == 0 and (begins or rise < SEEN_RISE):
        return Manner("sliding", settled, begins)
    return Manner("course", settled, begins)


def since_settled(time: Array, force: Array, noise: float, half_period: float) -> float | None:
    """Since when a force is level within its noise up to the end [s]; None where it is not for long enough."""
    good = np.isfinite(force)
    if np.count_nonzero(good) < LEAST_SETTLED:
        return None
    t, f = kept(time, good), kept(force, good)
    interval = float(np.median(thinned_steps(t)))
    width = max(round(2.0 * half_period / interval), BIN) if half_period else BIN
    count = t.size // width
    if count < 2:
        return None
    if not _level(f[t.size - width :][None], noise)[0]:  # most logs end in a stick or a slip
        return None
    # Bins are counted from the end, so that the last one is whole.
    restless = np.flatnonzero(~_level(f[t.size - count * width :].reshape(count, width), noise))
    first = int(restless[-1]) + 1 if restless.size else 0
    start = t.size - (count - first) * width
    return float(t[start]) if count > first and t.size - start >= LEAST_SETTLED else None


def _level(rows: Array, noise: float) -> NDArray[np.bool_]:
    """Which stretches (b, width) of a force stay level within its noise, shape (b,)."""
    width = rows.shape[1]
    local = np.linspace(-1.0, 1.0, width)
    mean, slope = rows.mean(axis=1), rows @ local / float(local @ local)
    left = rows - mean[:, None] - slope[:, None] * local
    allowed = noise**2 * (1.0 + LOOSE * np.sqrt(2.0 / width))
    # A swing that fades hides in a bin of one period as little as a slope does.
    tilted = np.abs(slope) > LOOSE * noise / np.sqrt(float(local @ local)) + 0.02 * np.abs(mean)
    return np.asarray((np.sum(left**2, axis=1) / (width - 2) <= allowed) & ~tilted)


def _slides(time: Array, force: Array, since: float, noise: float, stick_slope: float) -> bool:
    """Whether a level force rises so much more slowly than a stick [N/s] that it cannot be one."""
    good = np.isfinite(force) & (time >= since)
    t = time[good]
    return line_slope(t, force[good], noise) < stick_slope - STUCK * slope_error(t, noise)


def moving_pieces(drive: Drive, begin: float, end: float) -> list[tuple[float, float, float]]:
    """(start [s], stop [s], speed [m/s]) of the stretches of a window in which the drive moves."""
    edges = [begin, *drive.changes(begin, end), end]
    return [(a, b, drive.at(0.5 * (a + b))) for a, b in pairwise(edges) if drive.at(0.5 * (a + b)) > 0.0]


def _starts_loaded(time: Array, force: Array, noise: float, drive: Drive) -> bool:
    """Whether a force begins near the level that it has while the drive moves; through a first rise and the swing after
    it a fast drive is in a few samples, which lie below that."""
    good = np.isfinite(force)
    if not np.any(good):
        return False
    t, f = kept(time, good), kept(force, good)
    moves = np.zeros(t.size, bool)
    for begin, end, _ in moving_pieces(drive, float(t[0]), float(t[-1])):
        moves |= (t >= begin) & (t <= end)
    loaded = LEVEL * float(np.median(thinned(f[moves] if np.any(moves) else f)))
    return bool(np.median(f[: max(f.size // 100, 3)]) > loaded and np.min(f[:SEEN_RISE]) > loaded - STUCK * noise)
