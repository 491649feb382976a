"""Record: one run of a tribometer as frozen SI columns; refuses what a fit could not trust."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeVar

import numpy as np
import numpy.typing as npt
import pandas as pd

from data_io.errors import LogError

FloatArray = npt.NDArray[np.float64]
Scalar = str | int | float | bool
Severity = Literal["info", "warning", "reject"]

LONGEST_GAP: Final = 5
"""Rows in a row without a finite number that are kept as NaN; a longer block is an error."""

COLUMN_ROLES: Final = ("time", "normal_force", "friction_force", "drive_speed")
"""Names that no channel may carry."""

K = TypeVar("K")
V = TypeVar("V")


class Frozen(Mapping[K, V]):
    """A mapping that cannot change and, unlike `types.MappingProxyType`, can be sent to another process."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[K, V] | None = None) -> None:
        self._items = dict(items or {})

    def __getitem__(self, key: K) -> V:
        return self._items[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return repr(self._items)


@dataclass(frozen=True)
class Finding:
    """Something a reader or the quality gate noticed: a code for programs, a sentence for people."""

    code: str
    severity: Severity
    message: str


@dataclass(frozen=True)
class Step:
    """Rows [start, stop) of a record that belong to one step of the test, with the step's own parameters."""

    run: int
    number: int
    start: int
    stop: int
    parameters: Mapping[str, str] = field(default_factory=Frozen)

    def __post_init__(self) -> None:
        plain = {str(key).replace("\0", ""): str(value).replace("\0", "") for key, value in self.parameters.items()}
        object.__setattr__(self, "parameters", Frozen({key: value for key, value in plain.items() if key}))


@dataclass(frozen=True, eq=False)
class Record:
    """One run in SI; arrays are read-only float64 of shape (n,), n >= 2. Building one validates it (`LogError`).

    time [s] starts at 0 and rises strictly; normal_force [N] is positive in compression; friction_force [N] has the
    sign of the file. Up to five rows in a row may hold NaN in a force, which adds a finding; infinities become NaN.
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
        time = _column(self, "time", self.time)
        n = time.size
        if n < 2:
            raise self._error(f"{n} row(s) of data were found; at least two are needed; choose a longer step or log")
        normal = _column(self, "normal force", self.normal_force, n)
        friction = _column(self, "friction force", self.friction_force, n)
        _check_clock(self, time)
        normal, friction = _frozen_finite(normal), _frozen_finite(friction)
        gaps = _check_gaps(self, time, normal, friction)
        values: dict[str, Any] = {
            "time": time,
            "normal_force": normal,
            "friction_force": friction,
            "drive_speed": _speed(self, self.drive_speed, n),
            "channels": Frozen({name: _channel(self, name, values, n) for name, values in self.channels.items()}),
            "channel_units": Frozen({name: _unit(self, name) for name in self.channels}),
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

    def _error(self, sentence: str) -> LogError:
        path = self.metadata.get("path")
        return LogError(f"{path}: {sentence}" if path else sentence)

    def to_frame(self) -> pd.DataFrame:
        """Return the columns as a data frame; what is no column stands in `frame.attrs["stickslip"]`."""
        frame = pd.DataFrame(dict(self.columns()))
        frame.attrs["stickslip"] = self.about()
        return frame

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, metadata: Mapping[str, Scalar] | None = None) -> "Record":
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
    def from_columns(cls, columns: Mapping[str, FloatArray], about: Mapping[str, Any]) -> "Record":
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


def _column(record: Record, name: str, values: Any, n: int | None = None) -> FloatArray:
    """Return a read-only float64 copy of shape (n,); what is already frozen is not copied again."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise record._error(f"the {name} holds {values!r:.60} where numbers were expected; convert it") from error
    if array.ndim != 1 or (n is not None and array.size != n):
        expected = "one column" if n is None else f"a column of {n} rows, as many as the time has,"
        raise record._error(f"the {name} has shape {array.shape} where {expected} was expected; give equal lengths")
    if array.base is None and not array.flags.writeable:
        return array
    array = np.array(array, dtype=np.float64, order="C")
    array.flags.writeable = False
    return array


def _frozen_finite(values: FloatArray) -> FloatArray:
    if not np.isinf(values).any():
        return values
    values = np.where(np.isfinite(values), values, np.nan)
    values.flags.writeable = False
    return values


def _channel(record: Record, name: str, values: Any, n: int) -> FloatArray:
    if not isinstance(name, str) or not name or not _is_plain(name) or name in COLUMN_ROLES:
        raise record._error(f"a channel is called {name!r}; plain text other than {COLUMN_ROLES} is needed; rename it")
    return _column(record, f"channel {name!r}", values, n)


def _unit(record: Record, name: str) -> str:
    unit = record.channel_units.get(name, "")
    if not isinstance(unit, str) or not _is_plain(unit):
        raise record._error(f"the unit of channel {name!r} is {unit!r}; plain text was expected; correct it")
    return unit


def _is_plain(text: str) -> bool:
    """Tell text that every file format keeps: printable, no blanks at its ends."""
    return text.isprintable() and text == text.strip()


def _speed(record: Record, speed: Any, n: int) -> float | FloatArray | None:
    if speed is None:
        return None
    values = _column(record, "drive speed", [speed] * 1 if np.ndim(speed) == 0 else speed, n if np.ndim(speed) else 1)
    if not np.isfinite(values).all():
        raise record._error("the drive speed holds values that are no finite number; give it in m/s for every row")
    return values if np.ndim(speed) else float(values[0])


def _check_clock(record: Record, time: FloatArray) -> None:
    if not np.isfinite(time).all():
        row = int(np.argmin(np.isfinite(time)))
        raise record._error(f"the time in row {row + 1} is no finite number; a clock without gaps is needed; repair it")
    if time[0] != 0:
        raise record._error(f"the time starts at {time[0]:g} s; 0 was expected; subtract the start")
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0))
        raise record._error(
            f"the clock does not rise from row {row + 1} ({time[row]:.9g} s) to row {row + 2} ({time[row + 1]:.9g} s); "
            "a rising clock was expected; cut or repair the log there"
        )


def _check_gaps(record: Record, time: FloatArray, normal: FloatArray, friction: FloatArray) -> list[Finding]:
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
        raise record._error(
            f"the {which} force holds no number in rows {row + 1} to {row + count} "
            f"({time[row]:.6g} to {time[row + count - 1]:.6g} s); at most {LONGEST_GAP} such rows in a row are "
            "accepted; cut the log there or export it again"
        )
    if np.count_nonzero(~bad) < 2:
        raise record._error("no two rows hold finite forces; a log with numbers was expected; export it again")
    total, blocks = int(np.count_nonzero(bad)), starts.size
    message = f"{total} of {bad.size} rows hold no number in {blocks} place(s), first at {time[starts[0]]:.6g} s; "
    return [Finding("missing_rows", "warning", message + "they stay empty and get no weight")]


def _checked_steps(record: Record, n: int) -> tuple[Step, ...]:
    steps = tuple(record.steps) or (Step(1, 1, 0, n),)
    bounds = [step.start for step in steps] + [n]
    if bounds[0] != 0 or any(s.stop != b or s.stop <= s.start for s, b in zip(steps, bounds[1:], strict=True)):
        raise record._error(f"the steps do not cover rows 0 to {n} one after the other; give each row to one step")
    if len({(step.run, step.number) for step in steps}) != len(steps):
        raise record._error("two steps carry the same run and number; number them one after the other")
    return steps


def _steps_within(steps: Sequence[Step], n: int) -> tuple[Step, ...]:
    """Return the steps, or none where rows were cut away since they were noted."""
    return tuple(steps) if steps and steps[-1].stop == n else ()
