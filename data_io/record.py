"""Record: one run of a tribometer as frozen SI columns; refuses what a fit could not trust."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from data_io.arrays import true_runs
from data_io.spelling import Spelled
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

BLOCK: Final = 1 << 16
"""Rows looked at together."""

Fail = Callable[[str], LogError]


def step_range(time: FloatArray) -> tuple[float, float]:
    """Return the least and the largest step of a clock (n,), NaN where a row holds no number or there is one row only.

    Block by block: the steps of ten million rows are made in the cache, not in memory.
    """
    blocks = (np.diff(time[i : i + BLOCK + 1]) for i in range(0, time.size - 1, BLOCK))
    ends = np.array([(block.min(), block.max()) for block in blocks]).reshape(-1, 2)
    return (float(ends[:, 0].min()), float(ends[:, 1].max())) if ends.size else (np.nan, np.nan)


def rises(time: FloatArray) -> bool:
    """Tell whether a clock (n,) rises from row to row; not where a row holds no number."""
    return bool(np.all(time[1:] > time[:-1]))


def _column(fail: Fail, name: str, values: npt.ArrayLike, n: int | None = None) -> FloatArray:
    """Return a read-only float64 copy of shape (n,); what is already frozen is not copied again."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise fail(f"the {name} holds {values!r:.60} where numbers were expected; convert it") from error
    if array.ndim != 1 or (n is not None and array.size != n):
        expected = "one column" if n is None else f"a column of {n} rows, as many as the time has,"
        raise fail(f"the {name} has shape {array.shape} where {expected} was expected; give equal lengths")
    base: object = array
    while isinstance(base, np.ndarray) and not base.flags.writeable:
        base = base.base
    if base is None:
        return array
    array = np.array(array, dtype=np.float64, order="C")
    array.flags.writeable = False
    return array


def _force(fail: Fail, name: str, values: FloatArray) -> tuple[FloatArray, bool]:
    """Return a force (n,) with NaN for what is none, infinities and huge numbers by which devices mark overflow, and
    whether it holds NaN."""
    blocks = (values[i : i + BLOCK] for i in range(0, values.size, BLOCK))
    if all(block.min() >= -LARGEST_FORCE and block.max() <= LARGEST_FORCE for block in blocks):  # no NaN passes
        return values, False
    beyond = np.abs(values) > LARGEST_FORCE
    if np.count_nonzero(beyond & np.isfinite(values)) * 2 > values.size:
        raise fail(
            f"the {name} is beyond {LARGEST_FORCE:g} N in most rows; a force was expected; check its unit and column"
        )
    values = np.where(beyond, np.nan, values)
    values.flags.writeable = False
    return values, True


def _is_plain(text: object) -> bool:
    """Tell text that every file format keeps: printable, no blanks at its ends."""
    return isinstance(text, str) and text.isprintable() and text == text.strip()


def _check_clock(fail: Fail, time: FloatArray) -> None:
    """Refuse a clock that does not start at 0 and rise strictly."""
    if time[0] == 0 and rises(time) and np.isfinite(time[-1]):
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
    row = int(np.argmin(time[1:] > time[:-1]))
    raise fail(
        f"the clock does not rise from row {row + 1} ({time[row]:.9g} s) to row {row + 2} ({time[row + 1]:.9g} s); "
        "a rising clock was expected; cut or repair the log there"
    )


def _check_gaps(fail: Fail, time: FloatArray, normal: FloatArray, friction: FloatArray, begin: float) -> list[Finding]:
    """Refuse more than five rows in a row without a number; a finding for fewer. begin: of the first row [s]."""
    bad = np.isnan(normal) | np.isnan(friction)
    if np.count_nonzero(~bad) < 2:
        raise fail("no two rows hold numbers of both forces; a log with numbers was expected; export it again")
    runs = true_runs(bad)
    starts, lengths = runs[:, 0], runs[:, 1] - runs[:, 0]
    longest = int(np.argmax(lengths))
    if lengths[longest] > LONGEST_GAP:
        row, last_row = int(starts[longest]), int(runs[longest, 1]) - 1
        forces = (("normal", normal), ("friction", friction))
        which = " and ".join(name for name, values in forces if np.isnan(values[row]))
        first, last = time[row] + begin, time[last_row] + begin
        long_ones = runs[lengths > LONGEST_GAP]  # the longest stretch between them is proposed
        firsts = np.minimum(np.concatenate(([0], long_ones[:, 1])), time.size - 1)
        lasts = np.maximum(np.concatenate((long_ones[:, 0], [time.size])) - 1, firsts)
        best = int(np.argmax(time[lasts] - time[firsts]))
        start, stop = time[firsts[best]] + begin, time[lasts[best]] + begin
        part = (
            f'use a part, as with --window "{start:.6g} s,{stop:.6g} s" (in a scene: window = ["{start:.6g} s", '
            f'"{stop:.6g} s"]), in a scene leave them out with exclude = [["{first:.6g} s", "{last:.6g} s"]], or '
        )
        raise fail(
            f"the {which} force has no number in rows {row + 1} to {last_row + 1} ({first:.6g} to {last:.6g} s); at "
            f"most {LONGEST_GAP} such rows in a row are accepted; {part if stop > start else ''}export the log again"
        )
    total = int(np.count_nonzero(bad))
    message = f"{total} of {bad.size} rows hold no number in {starts.size} place(s), first at {time[starts[0]]:.6g} s; "
    return [Finding("missing_rows", "warning", message + "they stay empty and get no weight")]


WINDOW_START: Final = "window_start"
"""Metadata of a record that is a part of a log: how long the log had run before its first row [s]."""


@dataclass(frozen=True, eq=False)
class Record(Spelled):
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
        fail, time = self.error, _column(self.error, "time", self.time)
        n = time.size
        if n < 2:
            raise fail(f"{n} row(s) of data were found; at least two are needed; choose a longer step or log")
        normal = _column(fail, "normal force", self.normal_force, n)
        friction = _column(fail, "friction force", self.friction_force, n)
        _check_clock(fail, time)
        normal, lacks_normal = _force(fail, "normal force", normal)
        friction, lacks_friction = _force(fail, "friction force", friction)
        gaps: list[Finding] = []
        if lacks_normal or lacks_friction:
            begin = self.metadata.get(WINDOW_START, 0.0)
            begin = float(begin) if isinstance(begin, (int, float)) else 0.0
            # what a reader found in place of numbers is the cause of a gap
            causes = [finding.message for finding in self.findings if finding.code == "text_in_rows"][:1]
            gaps = _check_gaps(lambda text: fail("; ".join([text, *causes])), time, normal, friction, begin)
        speed = self.drive_speed
        if speed is not None:
            column = _column(fail, "drive speed", np.atleast_1d(speed), n if np.ndim(speed) else 1)
            if not np.isfinite(column).all():
                raise fail("the drive speed holds values that are no finite number; give it in m/s for every row")
            speed = column if np.ndim(speed) else float(column[0])
        for name in self.channels:
            if not name or not _is_plain(name) or name in COLUMN_ROLES:
                raise fail(f"a channel is called {name!r}; plain text other than {COLUMN_ROLES} is needed; rename it")
            if not _is_plain(unit := self.channel_units.get(name, "")):
                raise fail(f"the unit of channel {name!r} is {unit!r}; plain text was expected; correct it")
        channels = {name: _column(fail, f"channel {name!r}", values, n) for name, values in self.channels.items()}
        steps = tuple(self.steps) or (Step(1, 1, 0, n),)
        bounds = [step.start for step in steps] + [n]
        if bounds[0] != 0 or any(s.stop != b or s.stop <= s.start for s, b in zip(steps, bounds[1:], strict=True)):
            raise fail(f"the steps do not cover rows 0 to {n} one after the other; give each row to one step")
        if len({(step.run, step.number) for step in steps}) != len(steps):
            raise fail("two steps carry the same run and number; number them one after the other")
        values: dict[str, Any] = {
            "time": time,
            "normal_force": normal,
            "friction_force": friction,
            "drive_speed": speed,
            "channels": Frozen(channels),
            "channel_units": Frozen({name: self.channel_units.get(name, "") for name in channels}),
            "steps": steps,
            "metadata": Frozen(self.metadata),
            "findings": (*self.findings, *(g for g in gaps if g.code not in {f.code for f in self.findings})),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[object, ...]:
        # through the constructor, so that arrays are read-only in the other process as well
        return Record, tuple(getattr(self, name) for name in self.__dataclass_fields__)

    def __len__(self) -> int:
        return int(self.time.size)

    def error(self, sentence: str) -> LogError:
        """Return the error of this record with its path in front."""
        path = self.metadata.get("path")
        return LogError(f"{path}: {sentence}" if path else sentence)

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
        steps = tuple(Step(*step) for step in about.get("steps", ()))
        return cls(
            time=time,
            normal_force=columns["normal_force"],
            friction_force=columns["friction_force"],
            drive_speed=columns["drive_speed"] if "drive_speed" in columns else about.get("drive_speed"),
            channels={name: values for name, values in columns.items() if name not in COLUMN_ROLES},
            channel_units=about.get("channel_units", {}),
            steps=steps if steps and steps[-1].stop == time.size else (),  # rows may have been cut away since
            metadata=metadata,
            findings=tuple(Finding(*finding) for finding in about.get("findings", ())),
        )


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
