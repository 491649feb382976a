"""How the drive moved: a column of its position, or of its speed, as pieces of even speed."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from data_io.record import Record
from data_io.values import FloatArray

Programme = tuple[tuple[float, float], ...]

MOST: Final = 200
"""Steps of a programme at most."""
SAME: Final = 0.05
"""Share of the larger by which the speeds of two pieces that follow each other differ if they are two."""
_POINTS: Final = 4000, 40_000  # means over rows in which a motion is looked at: a noisy one, one without noise
_FEWEST: Final = 4  # means of which a piece consists at least
_CORNER: Final = 8.0  # standard deviations of the noise by which a motion must leave a straight line to have a corner
_STRAIGHT: Final = 0.003  # share of the travel by which an even motion may leave a straight line
_STANDS: Final = 0.01  # share of the fast speed below which the drive rests
_HIDDEN: Final = 0.05  # share of it below which it rests where noise hides how fast it is
_ON_DIAL: Final = 0.01  # share by which speeds that are one on the dial differ from piece to piece
_SPIKE: Final = 11  # rows: what lasts for less than half of them is no speed of the drive


@dataclass(frozen=True)
class Piece:
    """Rows [start, stop) of a record in which the drive moved evenly: time [s] of its start, speed [m/s], signed."""

    start: int
    stop: int
    time: float
    speed: float


@dataclass(frozen=True)
class Motion:
    """The pieces of a record's motion, in order and without gaps; time (n,) [s] and position (n,) [m], that of a column
    of speed its integral; white noise of a position [m], and of a speed [m/s]."""

    pieces: tuple[Piece, ...]
    time: FloatArray
    position: FloatArray
    noise: tuple[float, float]

    @property
    def programme(self) -> Programme:
        """(start [s], speed [m/s]) of each piece, as a scene takes it for `drive_speed`."""
        return tuple((piece.time, piece.speed) for piece in self.pieces)


def motion_of(record: Record, column: str) -> Motion | None:
    """Tell how the drive moved by a channel of its position [m] or speed [m/s], or by the role drive_speed; None where
    it does not move, or a tenth of its rows holds no number.

    Noise is averaged out, a change takes a few rows, and a speed of a few rows that comes back is none.
    """
    time, values = record.time, record.columns()[column]
    finite = np.isfinite(values)
    if np.count_nonzero(finite) < max(2, 0.9 * values.size):
        return None
    values = values if finite.all() else np.interp(time, time[finite], values[finite])
    if record.units()[column] == "m/s":
        import scipy

        speed = scipy.ndimage.median_filter(values, min(_SPIKE, values.size), mode="nearest")
        noise = 0.0, 1.4826 * float(np.median(np.abs(values - speed)))
        values = np.concatenate([[0.0], np.cumsum(speed[:-1] * np.diff(time))])
    else:  # of white noise the second difference is 0.67 * 6**0.5 wide
        noise = float(np.median(np.abs(np.diff(values, 2)))) / 1.65, 0.0
    if np.ptp(values) <= 1e-9 * float(np.max(np.abs(values))):
        return None
    motion = Motion((), time, values, noise)
    bounds = [row for step in record.steps for row in _corners(motion, step.start, step.stop)]
    motion = replace(motion, pieces=_joined(motion, [*bounds, len(record)]))
    return motion if any(piece.speed for piece in motion.pieces) else None


def even(motion: Motion) -> bool:
    """Whether every piece of a motion moves at one speed: its halves do."""
    fast = max(abs(piece.speed) for piece in motion.pieces)
    for piece in motion.pieces:
        inset = (piece.stop - piece.start) // 10
        first, last = piece.start + inset, piece.stop - inset
        middle = (first + last) // 2
        if middle - first < 2 * _SPIKE:
            continue
        (one, error), (other, _) = (_slope(motion, a, b) for a, b in ((first, middle), (middle, last)))
        if abs(one - other) > SAME * max(abs(piece.speed), SAME * fast) + 4.0 * np.sqrt(2.0) * error:
            return False
    return True


def evened(speeds: list[float]) -> list[float]:
    """The speeds with sizes that hardly differ made equal, as they are on the dial."""
    groups: list[list[float]] = []
    for size in sorted(abs(speed) for speed in speeds if speed):
        if groups and size - groups[-1][0] <= _ON_DIAL * size:
            groups[-1].append(size)
        else:
            groups.append([size])
    middle = {size: float(f"{np.median(group):.9g}") for group in groups for size in group}
    return [float(np.copysign(middle[abs(speed)], speed)) if speed else 0.0 for speed in speeds]


def _width(motion: Motion, rows: int) -> int:
    """Over how many of so many rows the motion is averaged: long means lose short holds, short ones noise."""
    wanted = (_CORNER * motion.noise[0] / (_STRAIGHT * float(np.ptp(motion.position)))) ** 2
    coarse, fine = (rows // points for points in _POINTS)
    return max(int(np.clip(wanted, fine, coarse)), 1)


def _corners(motion: Motion, start: int, stop: int) -> list[int]:
    """Return the first rows of the pieces of a step: lines between means of rows leave the motion by no more than the
    tolerance (Douglas and Peucker 1973)."""
    width, straight = _width(motion, stop - start), _STRAIGHT * float(np.ptp(motion.position[start:stop]))
    count = (stop - start) // width
    if count < 2 * _FEWEST:
        return [start]
    rows = slice(start, start + count * width)
    t, x = (values[rows].reshape(count, width).mean(axis=1) for values in (motion.time, motion.position))
    corners, waiting = [0], [(0, count - 1)]
    tolerance = max(_CORNER * motion.noise[0] / np.sqrt(width), straight)
    while waiting and len(corners) <= 10 * MOST:
        a, b = waiting.pop()
        if b - a < 2 * _FEWEST:
            continue
        off = np.abs(x[a : b + 1] - (x[a] + (x[b] - x[a]) * (t[a : b + 1] - t[a]) / (t[b] - t[a])))
        corner = int(np.clip(a + np.argmax(off), a + _FEWEST, b - _FEWEST))
        if off.max() > tolerance:
            corners.append(corner)
            waiting += [(a, corner), (corner, b)]
    return [start + width * corner for corner in sorted(corners)]


def _joined(motion: Motion, bounds: list[int]) -> tuple[Piece, ...]:
    """Put neighbours of one speed together, and each border where the motion leaves the mean of both speeds most."""
    time, x, pieces = motion.time, motion.position, list[Piece]()
    slopes, shortest = [_slope(motion, a, b) for a, b in pairwise(bounds)], _FEWEST * _width(motion, x.size)
    between = [  # the shortest pieces of a speed between those beside them are no pieces, but hold a corner
        i for i in range(1, len(slopes) - 1)
        if bounds[i + 1] - bounds[i] <= shortest and slopes[i][0] == sorted(slopes[i - 1 : i + 2])[1][0]
    ]  # fmt: skip
    bounds = [bound for i, bound in enumerate(bounds) if i not in between]
    slopes = [slope for i, slope in enumerate(slopes) if i not in between]
    fast = max(abs(speed) for speed, _ in slopes)
    for (a, b), (speed, error) in zip(pairwise(bounds), slopes, strict=True):
        if abs(speed) <= max(_STANDS * fast, min(_CORNER * error, _HIDDEN * fast)):
            speed = 0.0
        last = pieces[-1] if pieces else None
        if last is not None and abs(speed - last.speed) <= SAME * max(abs(speed), abs(last.speed)):
            share = (last.stop - last.start) / (b - last.start)
            pieces[-1] = Piece(last.start, b, last.time, share * last.speed + (1 - share) * speed)
        else:
            pieces.append(Piece(a, b, float(time[a]), speed))
    edges = [0]
    for one, other in pairwise(pieces):
        rows = slice((max(one.start, edges[-1]) + one.stop) // 2, (other.start + other.stop) // 2)
        off = np.sign(one.speed - other.speed) * (x[rows] - 0.5 * (one.speed + other.speed) * time[rows])
        edges.append(max(rows.start + int(np.argmax(off)), edges[-1] + 1))
    lasting = [(a, p.speed) for (a, b), p in zip(pairwise([*edges, x.size]), pieces, strict=True) if b - a >= _FEWEST]
    ends = [*(a for a, _ in lasting[1:]), x.size]  # what lasts for a few rows is a change from one speed to the next
    return tuple(Piece(a, b, float(time[a]), speed) for (a, speed), b in zip(lasting, ends, strict=True))


def _slope(motion: Motion, start: int, stop: int) -> tuple[float, float]:
    """Return the slope over the inner four fifths of rows, which turns and ramps do not reach, and its error [m/s]."""
    tenth = (stop - start) // 10
    a, b = start + tenth, stop - tenth
    if b - a < 2:
        return 0.0, 0.0
    t = motion.time[a:b] - motion.time[a]
    error = np.hypot(motion.noise[0] * np.sqrt(12.0) / t[-1], motion.noise[1] * np.sqrt(1.2)) / np.sqrt(b - a)
    return float(np.polyfit(t, motion.position[a:b] - motion.position[a], 1)[0]), float(error)
