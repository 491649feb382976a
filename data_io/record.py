"""Record: one run of a tribometer as frozen SI columns; refuses what a fit could not trust."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from data_io.arrays import true_runs
from data_io.values import (
    COLUMN_ROLES,
    LARGEST_FORCE,
    LONGEST_GAP,
    SIZES,
    Finding,
    FloatArray,
    Frozen,
    LogError,
    Scalar,
    Step,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

# What makes a column fit for a record: checks that return it frozen, or raise what `fail` makes of a sentence.

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


def rising(time: FloatArray) -> bool:
    """Tell a time of finite numbers that rises strictly. Block by block: ten million rows stay in the cache."""
    if not (np.isfinite(time[0]) and np.isfinite(time[-1])):
        return False
    return all(
        bool((time[i + 1 : i + BLOCK + 1] > time[i : i + BLOCK][: time.size - i - 1]).all())
        for i in range(0, time.size - 1, BLOCK)
    )


def _bounded(values: FloatArray, limit: float) -> bool:
    """Tell finite numbers (n,) of at most that size; block by block."""
    blocks = (values[i : i + BLOCK] for i in range(0, values.size, BLOCK))
    return all(block.min() >= -limit and block.max() <= limit for block in blocks)


def forces(
    fail: Fail, time: FloatArray, normal: FloatArray, friction: FloatArray, begin: float = 0.0
) -> tuple[FloatArray, FloatArray, list[Finding]]:
    """Return both forces (n,) with NaN for what is no force, and a finding where a few rows hold none."""
    if all(_bounded(column, LARGEST_FORCE) for column in (normal, friction)):
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
    if rising(time) and time[0] == 0:
        span, (least, most) = float(time[-1]), SIZES["s"]
        if span > most or span < least * (time.size - 1):
            raise fail(
                f"the clock rises by {span:g} s in {time.size} rows, which no log does; expected steps of {least:g} s "
                f"or more and {most:g} s in all; check the unit of the time"
            )
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
    if np.count_nonzero(~bad) < 2:
        raise fail("no two rows hold numbers of both forces; a log with numbers was expected; export it again")
    runs = true_runs(bad)
    starts, lengths = runs[:, 0], runs[:, 1] - runs[:, 0]
    longest = int(np.argmax(lengths))
    if lengths[longest] > LONGEST_GAP:
        row, count = int(starts[longest]), int(lengths[longest])
        which = " and ".join(
            name for name, values in (("normal", normal), ("friction", friction)) if np.isnan(values[row])
        )
        first, last = time[row] + begin, time[row + count - 1] + begin
        start, stop = _longest_between(time, starts[lengths > LONGEST_GAP], lengths[lengths > LONGEST_GAP])
        part = (
            f'use a part, as with --window "{start + begin:.6g} s,{stop + begin:.6g} s" (in a scene: window = '
            f'["{start + begin:.6g} s", "{stop + begin:.6g} s"]), in a scene leave them out with exclude = '
            f'[["{first:.6g} s", "{last:.6g} s"]], or '
        )
        raise fail(
            f"the {which} force holds no number in rows {row + 1} to {row + count} ({first:.6g} to {last:.6g} s); at "
            f"most {LONGEST_GAP} such rows in a row are accepted; {part if stop > start else ''}export the log again"
        )
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


WINDOW_START: Final = "window_start"
"""Metadata of a record that is a part of a log: how long the log had run before its first row [s]."""


@dataclass(frozen=True, eq=False)
class Record:
    """One run in SI; arrays are read-only float64 of shape (n,), n >= 2. Building one validates it (`LogError`).

    time [s] starts at 0 and rises strictly; normal_force [N] is positive in compression; friction_force [N] has the
    sign of the file. Up to five rows in a row may hold NaN in a force, which adds a finding; infinities and
    marks of overflow become NaN.
    drive_speed [m/s]: one number, (n,), or None where the log does not say. channels: other columns, (n,) each, their
    units in channel_units. metadata: where the data came from ("path", "sha256", "format", "file_time_start" [s], ...).
    """

    time: FloatArray
    normal_force: FloatArray
    friction_force: FloatArray
    drive_speed: float | FloatArray | None = None
    channels: Mapping[str, FloatArray] = field(default_factory=Frozen)
    channel_units: Mapping[str, str] = field(default_factory=Frozen)
    steps: tuple[Step, ...] = ()
    metadata: Mapping[str, Scalar] = field(default_factory=Frozen)
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        time = column(self.error, "time", self.time)
        n = time.size
        if n < 2:
            raise self.error(f"{n} row(s) of data were found; at least two are needed; choose a longer step or log")
        normal = column(self.error, "normal force", self.normal_force, n)
        friction = column(self.error, "friction force", self.friction_force, n)
        check_clock(self.error, time)
        begin = self.metadata.get(WINDOW_START, 0.0)
        normal, friction, gaps = forces(
            self._gap_error, time, normal, friction, float(begin) if isinstance(begin, (int, float)) else 0.0
        )
        values: dict[str, Any] = {
            "time": time,
            "normal_force": normal,
            "friction_force": friction,
            "drive_speed": speed(self.error, self.drive_speed, n),
            "channels": Frozen({name: channel(self.error, name, values, n) for name, values in self.channels.items()}),
            "channel_units": Frozen({n: unit(self.error, n, self.channel_units.get(n, "")) for n in self.channels}),
            "steps": _checked_steps(self, n),
            "metadata": Frozen(self.metadata),
            "findings": (*self.findings, *(g for g in gaps if g.code not in {f.code for f in self.findings})),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        # through the constructor, so that arrays are read-only in the other process as well
        return Record, tuple(getattr(self, name) for name in self.__dataclass_fields__)

    def __len__(self) -> int:
        return int(self.time.size)

    def error(self, sentence: str) -> LogError:
        """Return the error of this record with its path in front."""
        path = self.metadata.get("path")
        return LogError(f"{path}: {sentence}" if path else sentence)

    def _gap_error(self, sentence: str) -> LogError:
        """What a reader found in place of numbers is the cause of a gap."""
        causes = [finding.message for finding in self.findings if finding.code == "text_in_rows"]
        return self.error("; ".join([sentence, *causes[:1]]))

    def to_frame(self) -> pd.DataFrame:
        """Return the columns as a data frame; what is no column stands in `frame.attrs["stickslip"]`."""
        import pandas as pd

        frame = pd.DataFrame(dict(self.columns()))
        frame.attrs["stickslip"] = self.about()
        return frame

    def plot(self) -> Figure:
        """Return a figure of both forces over time, and of the drive speed where the record has one that changes."""
        from data_io.notebook_figure import NotebookFigure

        panels = [("friction force (N)", self.friction_force), ("normal force (N)", self.normal_force)]
        if isinstance(self.drive_speed, np.ndarray):
            panels.append(("drive speed (mm/s)", 1e3 * self.drive_speed))
        figure = NotebookFigure(figsize=(9.0, 2.0 + 1.4 * len(panels)), layout="constrained")
        for axes, (label, values) in zip(figure.subplots(len(panels), 1, sharex=True), panels, strict=True):
            axes.plot(self.time, values, linewidth=0.8)
            axes.set_ylabel(label)
        axes.set_xlabel("time (s)")
        return figure

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, metadata: Mapping[str, Scalar] | None = None) -> Record:
        """Build a record from a frame with the SI columns time, normal_force, friction_force and any others.

        A column drive_speed [m/s] is the drive; all other columns must be numbers and become channels. A time that
        does not start at 0 is shifted, its start kept in metadata. Raises `LogError`.
        """
        missing = [name for name in COLUMN_ROLES[:3] if name not in frame.columns]
        if missing:
            raise LogError(
                f"the frame has no column {', '.join(missing)}; time [s], normal_force [N] and friction_force [N] "
                f"were expected beside {', '.join(map(str, frame.columns))}; rename or add them"
            )
        try:
            columns = {str(name): frame[name].to_numpy(dtype=np.float64, na_value=np.nan) for name in frame.columns}
        except (ValueError, TypeError) as error:
            raise LogError(f"a column of the frame does not hold numbers ({error}); drop or convert it") from error
        about = frame.attrs.get("stickslip", {})
        return cls.from_columns(columns, {**about, "metadata": {**about.get("metadata", {}), **(metadata or {})}})

    def columns(self) -> Mapping[str, FloatArray]:
        """Return every column by name, in the order in which files hold them: time, forces, drive, channels."""
        drive = {"drive_speed": self.drive_speed} if isinstance(self.drive_speed, np.ndarray) else {}
        return {
            "time": self.time,
            "normal_force": self.normal_force,
            "friction_force": self.friction_force,
            **drive,
            **self.channels,
        }

    def units(self) -> Mapping[str, str]:
        """Return the unit of every column of `columns()`."""
        own = {"time": "s", "normal_force": "N", "friction_force": "N", "drive_speed": "m/s"}
        return {name: own.get(name) or self.channel_units.get(name, "") for name in self.columns()}

    def about(self) -> dict[str, Any]:
        """Return what is no column as plain values that JSON can hold; `from_columns` takes it back."""
        return {
            "drive_speed": None if isinstance(self.drive_speed, np.ndarray) else self.drive_speed,
            "channel_units": dict(self.channel_units),
            "steps": [[s.run, s.number, s.start, s.stop, dict(s.parameters)] for s in self.steps],
            "metadata": dict(self.metadata),
            "findings": [[f.code, f.severity, f.message] for f in self.findings],
        }

    @classmethod
    def from_columns(cls, columns: Mapping[str, FloatArray], about: Mapping[str, Any]) -> Record:
        """Build a record from SI columns by name and what `about()` tells of it. Raises `LogError`."""
        time = np.asarray(columns["time"], dtype=np.float64)
        metadata = dict(about.get("metadata", {}))
        start = float(time[0]) if time.ndim == 1 and time.size else 0.0
        if start != 0.0 and np.isfinite(start):
            time = time - start
            metadata["file_time_start"] = start + float(metadata.get("file_time_start", 0.0))
        return cls(
            time=time,
            normal_force=columns["normal_force"],
            friction_force=columns["friction_force"],
            drive_speed=columns["drive_speed"] if "drive_speed" in columns else about.get("drive_speed"),
            channels={name: values for name, values in columns.items() if name not in COLUMN_ROLES},
            channel_units=about.get("channel_units", {}),
            steps=_steps_within([Step(*step) for step in about.get("steps", ())], time.size),
            metadata=metadata,
            findings=tuple(Finding(*finding) for finding in about.get("findings", ())),
        )


def _checked_steps(record: Record, n: int) -> tuple[Step, ...]:
    steps = tuple(record.steps) or (Step(1, 1, 0, n),)
    bounds = [step.start for step in steps] + [n]
    if bounds[0] != 0 or any(s.stop != b or s.stop <= s.start for s, b in zip(steps, bounds[1:], strict=True)):
        raise record.error(f"the steps do not cover rows 0 to {n} one after the other; give each row to one step")
    if len({(step.run, step.number) for step in steps}) != len(steps):
        raise record.error("two steps carry the same run and number; number them one after the other")
    return steps


def _steps_within(steps: Sequence[Step], n: int) -> tuple[Step, ...]:
    """Return the steps, or none where rows were cut away since they were noted."""
    return tuple(steps) if steps and steps[-1].stop == n else ()


def zero_of_times(record: Record) -> str:
    """Say where times that a user writes count from, for the end of a sentence; nothing where the file agrees."""
    begin = float(record.metadata.get("file_time_start", 0.0)) - float(record.metadata.get(WINDOW_START, 0.0))
    return f", counted from its first row, where the clock of the file shows {begin:.6g} s" if begin else ""


def within(record: Record, window: tuple[float, float] | None) -> Record:
    """Return the rows of a record within (start, stop) [s] from the first row of its log on; None keeps all of them.

    Raises `LogError` where that leaves fewer than two rows.
    """
    if window is None:
        return record
    begin = float(record.metadata.get(WINDOW_START, 0.0))
    first = int(np.searchsorted(record.time, window[0] - begin, side="left"))
    last = int(np.searchsorted(record.time, window[1] - begin, side="right"))
    if (first, last) == (0, len(record)):
        return record
    if last - first < 2:
        inside = begin <= window[0] and window[1] <= begin + float(record.time[-1])
        raise record.error(
            f"the window {window[0]:g} to {window[1]:g} s holds {max(last - first, 0)} row(s); the log runs from "
            f"{begin:.6g} to {begin + record.time[-1]:.6g} s{zero_of_times(record)}; "
            f"{'widen the window' if inside else 'move the window inside'}"
        )
    columns = {name: values[first:last] for name, values in record.columns().items()}
    steps = [
        (s.run, s.number, max(s.start, first) - first, min(s.stop, last) - first, s.parameters)
        for s in record.steps
        if s.start < last and s.stop > first
    ]
    metadata = {**record.metadata, WINDOW_START: begin + float(record.time[first])}
    return Record.from_columns(columns, {**record.about(), "steps": steps, "metadata": metadata})
