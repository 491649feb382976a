"""What makes a column fit for a record: checks that return it frozen, or raise what `fail` makes of a sentence."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from data_io.errors import LogError
from data_io.frozen import COLUMN_ROLES, LARGEST_FORCE, LONGEST_GAP, Finding, FloatArray

BLOCK: Final = 1 << 16
"""Rows looked at together."""

Fail = Callable[[str], LogError]


def column(fail: Fail, name: str, values: Any, n: int | None = None) -> FloatArray:
    """Return a read-only float64 copy of shape (n,); what is already frozen is not copied again."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise fail(f"the {name} holds {values!r:.60} where numbers were expected; convert it") from error
    if array.ndim != 1 or (n is not None and array.size != n):
        expected = "one column" if n is None else f"a column of {n} rows, as many as the time has,"
        raise fail(f"the {name} has shape {array.shape} where {expected} was expected; give equal lengths")
    if not array.flags.writeable and (array.base is None or _is_frozen(array.base)):
        return array
    array = np.array(array, dtype=np.float64, order="C")
    array.flags.writeable = False
    return array


def _is_frozen(base: Any) -> bool:
    return isinstance(base, np.ndarray) and not base.flags.writeable and (base.base is None or _is_frozen(base.base))


@dataclass(frozen=True)
class Seen:
    """What a reader saw of a column while it was in the cache: that it rises strictly, that its numbers are forces.

    False says nothing.
    """

    rising: bool
    forces: bool


_SEEN: Final[dict[int, tuple["weakref.ref[FloatArray]", Seen]]] = {}


def remember(values: FloatArray, seen: Seen) -> None:
    """Freeze a column and remember what was seen of it, until it is part of a record."""
    values.flags.writeable = False
    key = id(values)
    _SEEN[key] = weakref.ref(values, lambda _: _SEEN.pop(key, None)), seen


def _seen(values: FloatArray, *, last: bool = False) -> Seen:
    entry = _SEEN.pop(id(values), None) if last else _SEEN.get(id(values))
    known = entry is not None and entry[0]() is values and not values.flags.writeable
    return entry[1] if known and entry is not None else Seen(False, False)


def rising(time: FloatArray) -> bool:
    """Tell a time of finite numbers that rises strictly. Block by block: ten million rows stay in the cache."""
    if not (np.isfinite(time[0]) and np.isfinite(time[-1])):
        return False
    return _seen(time).rising or all(
        bool((time[i + 1 : i + BLOCK + 1] > time[i : i + BLOCK][: time.size - i - 1]).all())
        for i in range(0, time.size - 1, BLOCK)
    )


def within(values: FloatArray, limit: float) -> bool:
    """Tell finite numbers (n,) of at most that size; block by block."""
    with np.errstate(all="ignore"):
        return all(_within(values[i : i + BLOCK], limit) for i in range(0, values.size, BLOCK))


def _within(block: FloatArray, limit: float) -> bool:
    # the sum of squares takes half the time, and says enough of usual numbers
    return float(block.dot(block)) <= limit * limit or bool(block.min() >= -limit and block.max() <= limit)


def forces(
    fail: Fail, time: FloatArray, normal: FloatArray, friction: FloatArray, begin: float = 0.0
) -> tuple[FloatArray, FloatArray, list[Finding]]:
    """Return both forces (n,) with NaN for what is no force, and a finding where a few rows hold none."""
    if all(_seen(column, last=True).forces or within(column, LARGEST_FORCE) for column in (normal, friction)):
        return normal, friction, []
    normal, friction = force(fail, "normal force", normal), force(fail, "friction force", friction)
    return normal, friction, check_gaps(fail, time, normal, friction, begin)


def force(fail: Fail, name: str, values: FloatArray) -> FloatArray:
    """Return a force with NaN for what is no force: infinities, and the huge numbers by which devices mark overflow."""
    beyond = np.abs(values) > LARGEST_FORCE
    if not beyond.any():
        return values
    if np.count_nonzero(beyond & np.isfinite(values)) * 2 > values.size:
        raise fail(
            f"the {name} is beyond {LARGEST_FORCE:g} N in most rows; a force was expected; check its unit and column"
        )
    values = np.where(beyond, np.nan, values)
    values.flags.writeable = False
    return values


def channel(fail: Fail, name: str, values: Any, n: int) -> FloatArray:
    """Return a channel of shape (n,) read-only; its name must be one that every file format keeps."""
    if not isinstance(name, str) or not name or not _is_plain(name) or name in COLUMN_ROLES:
        raise fail(f"a channel is called {name!r}; plain text other than {COLUMN_ROLES} is needed; rename it")
    return column(fail, f"channel {name!r}", values, n)


def unit(fail: Fail, name: str, unit: object) -> str:
    """Return the unit of a channel if it is plain text."""
    if not isinstance(unit, str) or not _is_plain(unit):
        raise fail(f"the unit of channel {name!r} is {unit!r}; plain text was expected; correct it")
    return unit


def _is_plain(text: str) -> bool:
    """Tell text that every file format keeps: printable, no blanks at its ends."""
    return text.isprintable() and text == text.strip()


def speed(fail: Fail, speed: Any, n: int) -> float | FloatArray | None:
    """Return the drive speed as a number or a read-only (n,); it must be finite."""
    if speed is None:
        return None
    values = column(fail, "drive speed", [speed] * 1 if np.ndim(speed) == 0 else speed, n if np.ndim(speed) else 1)
    if not np.isfinite(values).all():
        raise fail("the drive speed holds values that are no finite number; give it in m/s for every row")
    return values if np.ndim(speed) else float(values[0])


def check_clock(fail: Fail, time: FloatArray) -> None:
    """Refuse a clock that does not start at 0 and rise strictly."""
    sound = rising(time) and time[0] == 0
    _seen(time, last=True)
    if sound:
        return
    if not np.isfinite(time).all():
        row = int(np.argmin(np.isfinite(time)))
        raise fail(f"the time in row {row + 1} is no finite number; a clock without gaps is needed; repair it")
    if time[0] != 0:
        raise fail(f"the time starts at {time[0]:g} s; 0 was expected; subtract the start")
    rises = time[1:] > time[:-1]
    if not rises.all():
        row = int(np.argmin(rises))
        raise fail(
            f"the clock does not rise from row {row + 1} ({time[row]:.9g} s) to row {row + 2} ({time[row + 1]:.9g} s); "
            "a rising clock was expected; cut or repair the log there"
        )


def check_gaps(fail: Fail, time: FloatArray, normal: FloatArray, friction: FloatArray, begin: float) -> list[Finding]:
    """Refuse more than five rows in a row without a number; a finding for fewer. begin: of the first row [s]."""
    bad = np.isnan(normal) | np.isnan(friction)
    if not bad.any():
        return []
    edges = np.flatnonzero(np.diff(np.concatenate(([False], bad, [False]))))
    starts, lengths = edges[::2], np.diff(edges)[::2]
    longest = int(np.argmax(lengths))
    if lengths[longest] > LONGEST_GAP:
        row, count = int(starts[longest]), int(lengths[longest])
        which = " and ".join(
            name for name, values in (("normal", normal), ("friction", friction)) if np.isnan(values[row])
        )
        first, last = time[row] + begin, time[row + count - 1] + begin
        start, stop = _longest_between(time, starts[lengths > LONGEST_GAP], lengths[lengths > LONGEST_GAP])
        raise fail(
            f"the {which} force holds no number in rows {row + 1} to {row + count} ({first:.6g} to {last:.6g} s); at "
            f'most {LONGEST_GAP} such rows in a row are accepted; use a part, as with --window "{start + begin:.6g} s,'
            f'{stop + begin:.6g} s" (in a scene: window = ["{start + begin:.6g} s", "{stop + begin:.6g} s"]), in a '
            f'scene leave them out with exclude = [["{first:.6g} s", "{last:.6g} s"]], or export the log again'
        )
    if np.count_nonzero(~bad) < 2:
        raise fail("no two rows hold finite forces; a log with numbers was expected; export it again")
    total, blocks = int(np.count_nonzero(bad)), starts.size
    message = f"{total} of {bad.size} rows hold no number in {blocks} place(s), first at {time[starts[0]]:.6g} s; "
    return [Finding("missing_rows", "warning", message + "they stay empty and get no weight")]


def _longest_between(
    time: FloatArray, starts: npt.NDArray[np.intp], lengths: npt.NDArray[np.intp]
) -> tuple[float, float]:
    """Return first and last time of the longest stretch without such gaps."""
    firsts = np.concatenate(([0], starts + lengths))
    lasts = np.concatenate((starts, [time.size])) - 1
    held = np.flatnonzero(lasts > firsts)
    here = held[np.argmax(time[lasts[held]] - time[firsts[held]])] if held.size else 0
    return float(time[min(firsts[here], time.size - 1)]), float(time[max(lasts[here], 0)])
