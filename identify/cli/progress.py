"""Progress of long work: a bar on a terminal, plain lines or JSON lines elsewhere, always on standard error."""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Literal, Self, TextIO

from identify.base.progress import Notice
from identify.base.wording import wrapped
from identify.cli.interrupt import check_interrupted

if TYPE_CHECKING:
    from rich.progress import Progress as Bar
    from rich.progress import TaskID

HowToTell = Literal["shown", "verbose", "json"]


def write_line(text: str, stream: TextIO) -> None:
    """Write one line at once; a reader that has left does not end the work, nor change its exit code."""
    try:
        print(text, file=stream, flush=True)
    except BrokenPipeError:
        silence(stream)


def silence(stream: TextIO) -> None:
    """Send what is still to be written to a stream into nothing, so that Python does not fail at its end."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class Progress:
    """Called by the work as `progress(stage, share)`; share of the whole work done, 0 to 1 (None: unknown). A context,
    which ends its bar."""

    def __init__(self, stream: TextIO, how: HowToTell = "shown") -> None:
        self._stream, self._how, self._began = stream, how, time.monotonic()
        self._bar: Bar | None = None
        self._task: TaskID | None = None
        self._share: float | None = None
        self._stage = ""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __enter__(self) -> Self:
        moves = self._stream.isatty() and os.environ.get("TERM") not in ("dumb", "unknown")
        if moves and self._how == "shown":
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            stage, left = (
                TextColumn("{task.description:<34}", markup=False),
                TimeRemainingColumn(elapsed_when_finished=True),
            )
            columns = (stage, BarColumn(bar_width=18), TimeElapsedColumn(), TextColumn("left about"), left)
            self._bar = Bar(*columns, console=Console(file=self._stream), transient=True)
            self._task = self._bar.add_task("starting", total=1.0)
            self._bar.start()
        return self

    def __call__(self, stage: str, share: float | None = None) -> None:
        """The work is at this stage; KeyboardInterrupt if it was interrupted meanwhile."""
        check_interrupted()
        if self._bar is not None and isinstance(stage, Notice):
            self._bar.console.print(wrapped(stage), highlight=False, markup=False)
        elif self._bar is not None and self._task is not None:
            self._bar.update(self._task, description=stage, completed=share)
        elif self._how == "json" and (stage, share) != (self._stage, self._share):
            line = {"stage": stage, "share": share, "seconds": round(time.monotonic() - self._began, 3)}
            write_line(json.dumps(line), self._stream)
        elif self._how != "json" and stage != self._stage:
            since = f"{time.monotonic() - self._began:7.2f} s  " if self._how == "verbose" else ""
            write_line(wrapped(stage) if isinstance(stage, Notice) else f"{since}{stage}", self._stream)
        self._stage, self._share = stage, share
