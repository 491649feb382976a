"""How the drive moved: pieces of a position column, steps of a speed column, and what neither tells."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from data_io.record import Record
from data_io.values import FloatArray, LogError, Step

Programme = tuple[tuple[float, float], ...]

MOST: Final = 200
"""Steps of a programme at most."""
SAME: Final = 0.05
"""Share of the larger by which the speeds of two pieces that follow each other differ if they are two."""
_RAMP: Final = 10
"""Rows that a drive may always take from one speed to the next; fewer than that are no piece of their own."""
_RAMP_SHARE: Final = 0.1  # share of the shorter neighbour that it may take as well
_SHORT: Final = 0.002  # share of all rows that a piece lasts at least
_CLEAR: Final = 6.0  # standard errors by which two means differ if the rows are halved between them
_SURE: Final = 4.0  # standard errors by which they differ in the end if there is a step
_SLIGHT: Final = 0.002  # share of the largest speed below which nothing is looked at
_AT_REST: Final = 0.005  # share of the largest speed below which the drive rests
_AS_LARGE: Final = 0.01  # share by which speeds that are one on the dial differ from piece to piece
_SHARP: Final = 0.5  # share of a step that the rows beside it show: a sine or a long ramp shows a third
_CLIMBS: Final = 0.3  # share of its steps that a level goes on by; a sine cut into stairs does so by about all of it
_UNDECIDED: Final = 10 * MOST  # pieces beyond which it is no programme, before any are joined


@dataclass(frozen=True)
class SpeedSteps:
    """The programme ((start [s], speed [m/s]), ...), signed, from 0 s on; None where there is none, and `trouble` says
    why, as what follows the name of the column; stands: it says that the drive does not move."""

    programme: Programme | None
    trouble: str = ""
    stands: bool = False


@dataclass(frozen=True)
class _Level:
    """Rows [start, stop) of one speed [m/s]."""

    start: int
    stop: int
    speed: float

    @property
    def rows(self) -> int:
        return self.stop - self.start


def steps_of(time: FloatArray, speed: FloatArray) -> SpeedSteps:
    """Tell the programme of a speed column; time [s] and speed [m/s] (n,), gaps are NaN.

    Noise is averaged out, a change takes a few rows, and a fall of a few rows that comes back is none.
    """
    finite = np.isfinite(speed)
    if np.count_nonzero(finite) < max(2, 0.9 * speed.size):
        return SpeedSteps(None, "has gaps")
    values = speed if finite.all() else np.interp(time, time[finite], speed[finite])
    fast = float(np.quantile(np.abs(values), 0.99)) or float(np.abs(values).max())
    if fast == 0.0:
        return SpeedSteps(None, "is 0 throughout", stands=True)
    jumps = np.abs(np.diff(values))  # the largest of them may be steps
    usual = jumps[jumps <= np.quantile(jumps, 0.98)]
    noise = max(float(np.sqrt(np.mean(usual**2) / 2.0)), _SLIGHT * fast)
    edges = _split(values, noise, fast)
    if edges is None:
        return SpeedSteps(None, _gradual(values))
    levels = _without_ramps(values, _joined(edges, fast, noise))
    if levels is None:
        return SpeedSteps(None, _gradual(values))
    levels = _joined(levels, fast, noise)
    if len(levels) > MOST:
        return SpeedSteps(None, f"has {len(levels)} steps, more than {MOST}")
    if not _sharp(values, levels, noise):
        return SpeedSteps(None, _gradual(values))
    unsure = [min(4.0 * noise / float(np.sqrt(level.rows)), SAME * fast) for level in levels]
    rests = [abs(level.speed) <= max(_AT_REST * fast, u) for level, u in zip(levels, unsure, strict=True)]
    speeds = evened([0.0 if at_rest else level.speed for level, at_rest in zip(levels, rests, strict=True)])
    if not any(speeds):
        return SpeedSteps(None, "is 0 within its noise", stands=True)
    starts = [0.0, *(float(time[level.start]) for level in levels[1:])]
    return SpeedSteps(tuple((start, float(f"{speed:.9g}")) for start, speed in zip(starts, speeds, strict=True)))


def evened(speeds: list[float]) -> list[float]:
    """The speeds with sizes that hardly differ made equal, as they are on the dial."""
    sizes = sorted(abs(speed) for speed in speeds if speed)
    groups: list[list[float]] = []
    for size in sizes:
        if groups and size - groups[-1][0] <= _AS_LARGE * size:
            groups[-1].append(size)
        else:
            groups.append([size])
    middle = {size: float(np.median(group)) for group in groups for size in group}
    return [float(np.copysign(middle[abs(speed)], speed)) if speed else 0.0 for speed in speeds]


def _gradual(values: FloatArray) -> str:
    return f"goes gradually from {1e3 * values.min():.4g} to {1e3 * values.max():.4g} mm/s, not in steps"


def _split(values: FloatArray, noise: float, fast: float) -> list[_Level] | None:
    """Halve the rows where the means to both sides differ most, until they do not; None with too many pieces."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    waiting = [(0, values.size)]
    done: list[_Level] = []
    while waiting:
        a, b = waiting.pop()
        if len(done) + len(waiting) > _UNDECIDED:
            return None
        width = min(_RAMP // 2, b - a)
        means = (total[a + width : b + 1] - total[a : b + 1 - width]) / width
        cut = None  # means over a few rows that stay within what counts as one speed are one level
        if b - a > 1 and np.ptp(means) > SAME * max(abs(float(means.mean())), _AS_LARGE * fast):
            left = np.arange(1, b - a)
            right = b - a - left
            apart = (total[a + 1 : b] - total[a]) / left - (total[b] - total[a + 1 : b]) / right
            clear = np.abs(apart) * np.sqrt(left * right / (b - a))
            best = int(np.argmax(clear))
            cut = a + 1 + best if clear[best] > _CLEAR * noise else None
        if cut is None:
            done.append(_Level(a, b, float((total[b] - total[a]) / (b - a))))
        else:
            waiting += [(cut, b), (a, cut)]
    return done


def _joined(levels: list[_Level], fast: float, noise: float) -> list[_Level]:
    """Put neighbours of one speed together, the most alike first."""
    kept = list(levels)
    while len(kept) > 1:
        speed, rows = np.array([level.speed for level in kept]), np.array([level.rows for level in kept])
        size = np.maximum(np.maximum(np.abs(speed[1:]), np.abs(speed[:-1])), _AS_LARGE * fast)
        error = noise * np.sqrt(1.0 / rows[1:] + 1.0 / rows[:-1])
        apart = np.abs(np.diff(speed)) / np.maximum(SAME * size, _SURE * error)
        i = int(np.argmin(apart))
        if apart[i] > 1.0:
            break
        a, b = kept[i], kept[i + 1]
        kept[i : i + 2] = [_Level(a.start, b.stop, (a.rows * a.speed + b.rows * b.speed) / (a.rows + b.rows))]
    return kept


def _without_ramps(values: FloatArray, levels: list[_Level]) -> list[_Level] | None:
    """The levels that last, each border where the speed passes the middle; None where a way between two takes long."""
    least = max(_RAMP, int(_SHORT * values.size))
    lasting = [level for level in levels if level.rows >= least]
    if not lasting:
        return None
    borders = [0]
    for a, b in pairwise(lasting):
        ramp = values[a.stop : b.start]
        if ramp.size > max(_RAMP, _RAMP_SHARE * min(a.rows, b.rows)):
            return None
        borders.append(a.stop + int(np.count_nonzero(np.abs(ramp - a.speed) < np.abs(ramp - b.speed))))
    first, last = lasting[0], lasting[-1]
    for way_rows, level in ((first.start, first), (values.size - last.stop, last)):
        if way_rows > max(_RAMP, _RAMP_SHARE * level.rows):
            return None
    borders.append(values.size)
    return [_Level(a, b, level.speed) for level, (a, b) in zip(lasting, pairwise(borders), strict=True)]


def _sharp(values: FloatArray, levels: list[_Level], noise: float) -> bool:
    """Whether the speed steps from level to level within a few rows, as far as the noise shows it."""
    for a, b in pairwise(levels):
        rows = min(a.rows, b.rows)  # means of a few rows right before and right after the border, a ramp aside
        width, gap = max(rows // 5, 1), min(rows // 10, _RAMP // 2)
        low, high = values[b.start - gap - width : b.start - gap], values[b.start + gap : b.start + gap + width]
        shown = abs(float(high.mean() - low.mean()))
        if shown + 3.0 * noise * float(np.sqrt(2.0 / width)) < _SHARP * abs(b.speed - a.speed):
            return False
    # stairs cut out of a sine: the levels themselves go on as their steps do, all of them together
    steps = [b.speed - a.speed for a, b in pairwise(levels)]
    likely = known = 0.0
    for level, before, after in zip(levels, [*steps[:1], *steps], [*steps, *steps[-1:]], strict=False):
        if level.rows < _RAMP:
            continue
        place = np.linspace(-0.5, 0.5, level.rows)
        rise = float(place @ values[level.start : level.stop]) / float(place @ place)
        expected = 0.5 * (before + after)
        likely += level.rows * expected * rise
        known += level.rows * expected**2
    return known == 0.0 or likely / known <= _CLIMBS + 2.0 * noise * float(np.sqrt(12.0 / known))


_POINTS: Final = 4000  # means over rows in which the motion is looked at; a turn is found to the row afterwards
_STANDS: Final = 0.01  # share of the fast speed below which the drive rests
_UNSURE: Final = 0.05  # share of it below which it rests where the noise hides how fast it is
_SAME_SPEED: Final = 0.10  # share by which the speeds of two pieces that follow each other differ if they are two
_FEWEST: Final = 4  # means of which a piece consists at least
_CORNER: Final = 8.0  # standard deviations of the noise by which a motion must leave a straight line to have a corner
_STRAIGHT: Final = 0.003  # share of the travel by which an even motion may leave a straight line


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
    edges = _corners(t, x, 0, count - 1, max(_CORNER * noise, _STRAIGHT * float(np.ptp(x))))
    edges = [0, *edges, count]
    fast = max(abs(_slope(t, x, a, b)) for a, b in pairwise(edges))
    bounds = [step.start + edge * width for edge in edges[:-1]] + [step.stop]
    pieces: list[Piece] = []
    for a, b in pairwise(bounds):
        speed = _slope(time, position, a, b)
        error = noise * float(np.sqrt(12.0 * width / (b - a))) / max(float(time[b - 1] - time[a]), 1e-300)
        slow = max(_STANDS, min(_CORNER * error / fast, _UNSURE)) * fast if fast else 0.0
        speed = 0.0 if abs(speed) <= slow else speed
        last = pieces[-1] if pieces else None
        if last is not None and abs(speed - last.speed) <= _SAME_SPEED * max(abs(speed), abs(last.speed)):
            share = (last.stop - last.start) / (b - last.start)
            pieces[-1] = Piece(last.start, b, last.time, share * last.speed + (1 - share) * speed)
        else:
            pieces.append(Piece(a, b, float(time[a]), speed))
    return _refined(time, position, pieces, width)


def _corners(t: FloatArray, x: FloatArray, first: int, last: int, tolerance: float) -> list[int]:
    """Return where lines between points leave the motion by no more than the tolerance (Douglas and Peucker 1973)."""
    corners: list[int] = []
    waiting = [(first, last)]
    while waiting:
        a, b = waiting.pop()
        if b - a < 2 * _FEWEST:
            continue
        off = np.abs(x[a : b + 1] - (x[a] + (x[b] - x[a]) * (t[a : b + 1] - t[a]) / (t[b] - t[a])))
        corner = int(np.clip(a + np.argmax(off), a + _FEWEST, b - _FEWEST))
        if off.max() > tolerance:
            corners.append(corner)
            waiting += [(a, corner), (corner, b)]
    return sorted(corners)


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
