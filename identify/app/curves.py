"""Logs held in memory: read once in the background, shown as lowest and highest values of whatever window is asked."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from data_io import LogError, Record, read_log
from identify.app.folder import Document, Folder, PageError
from identify.logs.recorded_drive import recorded_drive
from identify.report.style import extremes

Array = NDArray[np.float64]

MOST_POINTS = 4_000  # of a curve that is sent
HELD = 2_000_000_000  # bytes of all logs in memory; the one that was asked for last stays


@dataclass
class OpenLog:
    """One log on its way into memory, or there: `share` of it read, `record` None until it is, `error` why not."""

    share: float = 0.0
    record: Record | None = None
    error: str = ""
    programme: tuple[tuple[float, float], ...] = ()
    done: threading.Event = field(default_factory=threading.Event)

    def window(self, begin: float, end: float) -> Array:
        """Time [s], friction force [N], normal force [N], drive speed [m/s] (NaN: unknown) of a window, (4, m) with
        m <= MOST_POINTS: of a longer one the samples with the lowest and highest forces of equal stretches.
        """
        record = self.record
        if record is None:
            raise PageError(self.error or "this log is still being read; wait a moment")
        first = max(int(np.searchsorted(record.time, begin)) - 1, 0)
        last = max(int(np.searchsorted(record.time, end, side="right")) + 1, first + 2)
        first = min(first, record.time.size - 2)
        forces = record.friction_force[first:last], record.normal_force[first:last]
        kept = first + np.union1d(*(extremes(force, MOST_POINTS // 4) for force in forces)).astype(int)
        time, speed = record.time[kept], np.full(kept.size, np.nan)
        if self.programme:
            starts, speeds = np.array(self.programme).T
            speed = speeds[np.maximum(np.searchsorted(starts, time, side="right") - 1, 0)]
        return np.stack([time, record.friction_force[kept], record.normal_force[kept], speed])


class OpenLogs:
    """The logs in memory, the one used last at the end."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._logs: OrderedDict[tuple[str, tuple[int, int], str], OpenLog] = OrderedDict()
        self._lock = threading.Lock()

    def opened(self, name: str, options: Document) -> OpenLog:
        """The log of that name, as `data_io.read_log` reads it with these options; reading begins where it has not."""
        path = self._folder.file(name)
        stat = path.stat()
        stamp = stat.st_mtime_ns, stat.st_size
        key = (name, stamp, repr(sorted(options.items())))
        with self._lock:
            if key in self._logs:
                self._logs.move_to_end(key)
                return self._logs[key]
            for old in [k for k in self._logs if k[0] == name and k[1] != stamp]:
                del self._logs[old]
            opened = self._logs[key] = OpenLog()
        threading.Thread(target=self._read, args=(opened, partial(read_log, path, **options)), daemon=True).start()
        return opened

    def wait(self, name: str, options: Document, seconds: float = 60.0) -> Record:
        """The record of a log, waited for."""
        opened = self.opened(name, options)
        opened.done.wait(seconds)
        if opened.record is None:
            raise PageError(opened.error or f"{name} is still being read; wait until the log view shows it")
        return opened.record

    def _read(self, opened: OpenLog, read: Callable[..., Record]) -> None:
        def progress(share: float) -> None:
            opened.share = share

        try:
            record = read(progress=progress)
            drive = recorded_drive(record)
            opened.programme = tuple((float(start), float(speed)) for start, speed in drive.programme or ())
            opened.record = record
        except (LogError, OSError) as error:
            opened.error = str(error)
        except Exception as error:  # noqa: BLE001 - of a thread nobody would hear
            opened.error = f"a defect of ours ({type(error).__name__}: {error}); report it"
        opened.done.set()
        with self._lock:
            records = [log.record for log in self._logs.values()]
            sizes = [0 if record is None else 8 * len(record) * (3 + len(record.channels)) for record in records]
            while sum(sizes) > HELD and len(sizes) > 1:
                del self._logs[next(iter(self._logs))], sizes[0]
