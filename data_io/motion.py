"""How the drive moved, from a position or speed column: strokes to and fro, rests, and the speed of each piece."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from data_io.record import Record
from data_io.values import Finding, FloatArray, LogError, Step

_POINTS: Final = 4000
"""Means over rows in which the motion is looked at; a turn is found to the row afterwards."""
_AT_REST: Final = 0.01
"""Share of the fast speed below which the drive rests."""
_UNSURE: Final = 0.05
"""Share of it below which it rests where the noise hides how fast it is, and that a stated speed may be off."""
_SAME_SPEED: Final = 0.10
"""Share by which the speeds of two pieces that follow each other differ if they are two."""
_FEWEST: Final = 4
"""Means of which a piece consists at least."""
_DISAGREES: Final = 0.05
_CLEAR: Final = 8.0
"""Standard deviations of the noise by which a motion must leave a straight line to have a corner."""
_STRAIGHT: Final = 0.003
"""Share of the travel by which an even motion may leave a straight line."""


@dataclass(frozen=True)
class Piece:
    """Rows [start, stop) of a record in which the drive moved evenly: time [s] of its start, speed [m/s], signed."""

    start: int
    stop: int
    time: float
    speed: float


@dataclass(frozen=True)
class Motion:
    """The pieces of a record's motion, in order and without gaps, and the column that told them."""

    column: str
    pieces: tuple[Piece, ...]

    @property
    def programme(self) -> tuple[tuple[float, float], ...]:
        """(start [s], speed [m/s]) of each piece, as a scene takes it for `drive_speed`."""
        return tuple((piece.time, piece.speed) for piece in self.pieces)

    @property
    def speed(self) -> float | None:
        """The one speed [m/s] of all moving pieces, without sign; None where they differ."""
        speeds = [abs(piece.speed) for piece in self.pieces if piece.speed]
        if not speeds or max(speeds) - min(speeds) > _SAME_SPEED * max(speeds):
            return None
        lengths = [piece.stop - piece.start for piece in self.pieces if piece.speed]
        return float(np.average(speeds, weights=lengths))


def motion_of(record: Record, column: str | None = None) -> Motion | None:
    """Tell how the drive moved by a position column [m]; None where there is none or it does not move.

    column: the name of a channel in metres; None takes the one that is called position, else the one that travels
    farthest. Raises `LogError` for a name that is no such channel.
    """
    name = _position(record, column)
    if name is None:
        return None
    pieces = [piece for step in record.steps for piece in _of_step(record.time, record.channels[name], step)]
    if not any(piece.speed for piece in pieces):
        return None
    return Motion(name, tuple(pieces))


def check_drive(
    record: Record, speed: float | Sequence[tuple[float, float]], column: str | None = None
) -> list[Finding]:
    """Compare a stated drive with the position column: a warning where their speeds differ by more than 5 %.

    speed: [m/s], or (start [s], speed [m/s]) pairs. Empty where they agree or the log does not tell.
    """
    motion = motion_of(record, column)
    if motion is None:
        return []
    edges = np.array([0.0]) if isinstance(speed, (int, float)) else np.array([start for start, _ in speed])
    stated = np.array([speed] if isinstance(speed, (int, float)) else [value for _, value in speed], dtype=np.float64)
    middle = [0.5 * (record.time[p.start] + record.time[p.stop - 1]) for p in motion.pieces]
    told = np.abs([p.speed for p in motion.pieces])
    meant = np.abs(stated[np.clip(np.searchsorted(edges, middle, side="right") - 1, 0, None)])
    largest = max(float(meant.max()), float(told.max()))
    moving = told > 0  # a scene with one speed says nothing of rests
    wrong = np.flatnonzero(moving & (np.abs(told - meant) > _DISAGREES * np.maximum(meant, _UNSURE * largest)))
    if wrong.size == 0:
        return []
    piece = motion.pieces[int(wrong[0])]
    text = (
        f"the drive was stated as {meant[wrong[0]]:.4g} m/s, but column {motion.column} moves at {told[wrong[0]]:.4g} "
        f"m/s from {piece.time:.4g} s on ({wrong.size} of {len(motion.pieces)} pieces differ); correct drive_speed"
    )
    return [Finding("drive_speed_disagrees", "warning", text)]


def _position(record: Record, column: str | None) -> str | None:
    lengths = [name for name, unit in record.channel_units.items() if unit == "m"]
    if column is not None and column not in lengths:
        raise LogError(f"no column {column!r} in metres is there; {', '.join(lengths) or 'none'} is; name one of them")
    if column is not None or not lengths:
        return column
    named = [name for name in lengths if "position" in name.casefold()]
    travel = {name: float(np.ptp(v)) for name in named or lengths if np.isfinite(v := record.channels[name]).all()}
    best = max(travel, key=lambda name: travel[name], default=None)
    return best if best is not None and travel[best] > 0 else None


def _of_step(time: FloatArray, position: FloatArray, step: Step) -> list[Piece]:
    """Split one step into pieces of even speed: corners of the means over rows, equal slopes together."""
    rows = np.arange(step.start, step.stop)
    width = max(rows.size // _POINTS, 1)
    count = rows.size // width
    if count < 2 * _FEWEST:
        return [Piece(step.start, step.stop, float(time[step.start]), _slope(time, position, step.start, step.stop))]
    t = time[step.start : step.start + count * width].reshape(count, width).mean(axis=1)
    x = position[step.start : step.start + count * width].reshape(count, width).mean(axis=1)
    noise = float(np.median(np.abs(np.diff(x, 2)))) / 1.65  # of white noise the second difference is 0.67 * 6**0.5 wide
    edges = _corners(t, x, 0, count - 1, max(_CLEAR * noise, _STRAIGHT * float(np.ptp(x))))
    edges = [0, *edges, count]
    fast = max(abs(_slope(t, x, a, b)) for a, b in pairwise(edges))
    bounds = [step.start + edge * width for edge in edges[:-1]] + [step.stop]
    pieces = []
    for a, b in pairwise(bounds):
        speed = _slope(time, position, a, b)
        error = noise * float(np.sqrt(12.0 * width / (b - a))) / max(float(time[b - 1] - time[a]), 1e-300)
        slow = max(_AT_REST, min(_CLEAR * error / fast, _UNSURE)) * fast if fast else 0.0
        pieces.append(Piece(a, b, float(time[a]), 0.0 if abs(speed) <= slow else speed))
    return _refined(time, position, _joined(pieces), width)


def _corners(t: FloatArray, x: FloatArray, first: int, last: int, tolerance: float) -> list[int]:
    """Return where lines between points leave the motion by no more than the tolerance (Douglas and Peucker 1973)."""
    found: list[int] = []
    waiting = [(first, last)]
    while waiting:
        a, b = waiting.pop()
        if b - a < 2 * _FEWEST:
            continue
        off = np.abs(x[a : b + 1] - (x[a] + (x[b] - x[a]) * (t[a : b + 1] - t[a]) / (t[b] - t[a])))
        corner = int(np.clip(a + np.argmax(off), a + _FEWEST, b - _FEWEST))
        if off.max() > tolerance:
            found.append(corner)
            waiting += [(a, corner), (corner, b)]
    return sorted(found)


def _joined(pieces: list[Piece]) -> list[Piece]:
    """Put neighbours of the same speed together."""
    kept = pieces[:1]
    for piece in pieces[1:]:
        last = kept[-1]
        if abs(piece.speed - last.speed) <= _SAME_SPEED * max(abs(piece.speed), abs(last.speed)):
            share = (last.stop - last.start) / (piece.stop - last.start)
            kept[-1] = Piece(last.start, piece.stop, last.time, share * last.speed + (1 - share) * piece.speed)
        else:
            kept.append(piece)
    return kept


def _refined(time: FloatArray, position: FloatArray, pieces: list[Piece], width: int) -> list[Piece]:
    """Move each border to where the lines of the two pieces cross, at most two means away."""
    lines = [np.polyfit(time[p.start : p.stop], position[p.start : p.stop], 1) for p in pieces]
    bounds = [p.start for p in pieces] + [pieces[-1].stop]
    for i in range(1, len(pieces)):
        steep = lines[i - 1][0] - lines[i][0]
        if steep:
            crossing = (lines[i][1] - lines[i - 1][1]) / steep
            row = int(np.searchsorted(time, crossing))
            bounds[i] = int(np.clip(row, max(bounds[i] - 2 * width, bounds[i - 1] + 1), bounds[i] + 2 * width))
    return [
        Piece(a, b, float(time[a]), piece.speed)
        for piece, a, b in zip(pieces, bounds, bounds[1:], strict=False)
        if b > a
    ]


def _slope(t: FloatArray, x: FloatArray, start: int, stop: int) -> float:
    """Return the slope over the inner four fifths of rows, which turns and ramps do not reach."""
    tenth = (stop - start) // 10
    a, b = start + tenth, stop - tenth
    if b - a < 2:
        return 0.0
    return float(np.polyfit(t[a:b] - t[a], x[a:b] - x[a], 1)[0])
