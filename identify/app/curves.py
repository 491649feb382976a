"""Logs held in memory: read once in the background, shown as lowest and highest values of whatever window is asked."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io import LogError, Record, read_log
from identify.app.folder import Folder, PageError
from identify.logs.recorded_drive import recorded_drive

Array = NDArray[np.float64]

MOST_POINTS = 4_000  # of a curve that is sent
STRETCHES = MOST_POINTS // 2  # each with its lowest and its highest value
BLOCK = 64  # samples whose extremes are kept beside the samples
READERS = 2  # logs that are read at a time
HELD = 2_000_000_000  # bytes of all logs in memory; the one that was asked for last stays


@dataclass(frozen=True)
class Blocks:
    """Lowest and highest value (b,) of every `BLOCK` samples of a signal, NaN passed over."""

    lower: Array
    upper: Array

    @staticmethod
    def of(values: Array) -> Blocks:
        """Of a signal (n,); the last block may be shorter."""
        starts = np.arange(0, values.size, BLOCK)
        return Blocks(np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts))


def extremes(values: Array, blocks: Blocks, first: int, last: int, stretches: int) -> tuple[Array, Array]:
    """Time-ordered sample numbers (2 s,) and values (2 s,) that draw samples first to last (exclusive): lowest and
    highest of each of s <= `stretches` equal stretches; the samples themselves where they are no more than that."""
    count = last - first
    if count <= 2 * stretches:
        return np.arange(first, last, dtype=float), values[first:last]
    if count < 2 * stretches * BLOCK:
        each, begin, lower, upper = 1, first, values[first:last], values[first:last]
    else:
        a, b = first // BLOCK, -(-last // BLOCK)
        each, begin, lower, upper = BLOCK, a * BLOCK, blocks.lower[a:b], blocks.upper[a:b]
    size = -(-lower.size // stretches)
    starts = np.arange(0, lower.size, size)
    places = begin + each * (np.repeat(starts, 2) + np.tile([0.0, size / 2], starts.size))
    pairs = np.stack([np.fmin.reduceat(lower, starts), np.fmax.reduceat(upper, starts)], axis=1)
    return np.clip(places, first, last - 1), pairs.ravel()


@dataclass
class OpenLog:
    """One log on its way into memory, or there: `share` of it read, `record` None until it is, `error` why not."""

    share: float = 0.0
    record: Record | None = None
    error: str = ""
    blocks: dict[str, Blocks] = field(default_factory=dict)
    programme: tuple[tuple[float, float], ...] = ()

    @property
    def size(self) -> int:
        """Bytes, about."""
        return 0 if self.record is None else 8 * len(self.record) * (3 + len(self.record.channels))

    def window(self, begin: float, end: float) -> Array:
        """Time [s], friction force [N], normal force [N], drive speed [m/s] (NaN: not told) of a window, (4, m) with
        m <= MOST_POINTS.

        Raises:
            PageError: the log is not read yet.
        """
        record = self.record
        if record is None:
            raise PageError(self.error or "this log is still being read; wait a moment")
        time = record.time
        first = max(int(np.searchsorted(time, begin)) - 1, 0)
        last = min(int(np.searchsorted(time, end, side="right")) + 1, time.size)
        first = min(first, max(last - 2, 0))
        places, force = extremes(record.friction_force, self.blocks["friction_force"], first, last, STRETCHES)
        _, load = extremes(record.normal_force, self.blocks["normal_force"], first, last, STRETCHES)
        whole = places.astype(np.intp)
        at = time[whole] + (places - whole) * (time[np.minimum(whole + 1, time.size - 1)] - time[whole])
        return np.stack([at, force, load, self._speed(at)])

    def _speed(self, at: Array) -> Array:
        if not self.programme:
            return np.full(at.size, np.nan)
        starts, speeds = np.array(self.programme).T
        return np.asarray(speeds[np.maximum(np.searchsorted(starts, at, side="right") - 1, 0)])


class OpenLogs:
    """The logs in memory, the one used last at the end."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._logs: OrderedDict[tuple[Any, ...], OpenLog] = OrderedDict()
        self._lock = threading.Lock()
        self._readers = threading.Semaphore(READERS)

    def opened(self, name: str, options: Mapping[str, Any] | None = None) -> OpenLog:
        """The log of that name, as `data_io.read_log` reads it with these options; reading begins where it has not.

        Raises:
            PageError: there is no such file.
        """
        path = self._folder.file(name)
        stat, said = path.stat(), dict(options or {})
        key = (name, stat.st_mtime_ns, stat.st_size, repr(sorted(said.items())))
        with self._lock:
            known = self._logs.get(key)
            if known is not None:
                self._logs.move_to_end(key)
                return known
            for old in [k for k in self._logs if k[0] == name and k[1:3] != key[1:3]]:
                del self._logs[old]
            opened = self._logs[key] = OpenLog()
        read = partial(read_log, path, **said)
        threading.Thread(target=self._read, args=(opened, read), daemon=True).start()
        return opened

    def wait(self, name: str, options: Mapping[str, Any] | None = None, seconds: float = 60.0) -> Record:
        """The record of a log, waited for.

        Raises:
            PageError: it cannot be read, or not in that time.
        """
        opened, event = self.opened(name, options), threading.Event()
        for _ in range(int(seconds / 0.01)):
            if opened.record is not None:
                return opened.record
            if opened.error:
                raise PageError(opened.error)
            event.wait(0.01)
        raise PageError(f"{name} is still being read; wait until the log view shows it")

    def _read(self, opened: OpenLog, read: Callable[..., Record]) -> None:
        def told(share: float) -> None:
            opened.share = share

        try:
            with self._readers:
                record = read(progress=told)
            drive = recorded_drive(record)
            opened.programme = tuple((float(start), float(speed)) for start, speed in drive.programme or ())
            for role in ("friction_force", "normal_force"):
                opened.blocks[role] = Blocks.of(getattr(record, role))
            opened.record = record
        except (LogError, OSError) as error:
            opened.error = str(error)
        except Exception as error:  # noqa: BLE001 - of a thread nobody would hear
            opened.error = f"a defect of ours ({type(error).__name__}: {error}); report it"
        with self._lock:
            while sum(log.size for log in self._logs.values()) > HELD and len(self._logs) > 1:
                self._logs.popitem(last=False)
