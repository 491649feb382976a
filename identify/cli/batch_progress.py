"""Live progress of a batch on standard error: a bar on a terminal, one line per group elsewhere."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from identify.cli.interrupt import check_interrupted
from identify.cli.progress import Shown, draws, progress_line
from identify.studies.running import in_words

if TYPE_CHECKING:
    from identify.studies.batch_store import Ended


class BatchProgress(Shown):
    """Told by the batch what has ended; shows how many are done, how many did not converge, and the time left."""

    _failures = 0
    _until: float | None = None

    def begins(self, total: int, kept: int) -> None:
        """So many groups in all, of which `kept` had ended before."""
        if draws(self._stream) and self._how != "json":
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
            from rich.progress import Progress as Bar

            columns = (TextColumn("{task.description}"), BarColumn(bar_width=24), TimeElapsedColumn())
            self._bar = Bar(*columns, console=Console(file=self._stream), transient=True)
            self._task = self._bar.add_task(self._words(kept, total), total=total, completed=kept)
            self._bar.start()
        else:
            words = f"{total} groups, {kept} of them done before" if kept else f"{total} groups"
            self._line(words, kept / max(total, 1))

    def ended(self, group: str, end: Ended, done: int, total: int, remaining: float | None) -> None:
        """A group has ended; `remaining` is the expected time to the end [s]."""
        check_interrupted()
        self._failures += end.status != "converged"
        self._until = None if remaining is None else time.monotonic() + remaining
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, description=self._words(done, total))
        else:
            took = "" if end.seconds is None else f" in {in_words(end.seconds)}"
            name = "".join(c if c.isprintable() else " " for c in group[:60])
            self._line(f"{done}/{total} {name}: {end.status.replace('_', ' ')}{took}{self._left()}", done / total)

    def tick(self) -> None:
        """Some time has passed; KeyboardInterrupt if a signal came meanwhile."""
        check_interrupted()
        if self._bar is not None and self._task is not None:
            task = self._bar.tasks[0]
            self._bar.update(self._task, description=self._words(int(task.completed), int(task.total or 0)))

    def _words(self, done: int, total: int) -> str:
        failed = f", {self._failures} not converged" if self._failures else ""
        return f"{done} of {total} groups{failed}{self._left()}"

    def _left(self) -> str:
        if self._until is None or self._until - time.monotonic() < 1.0:
            return ""
        return f"; about {in_words(self._until - time.monotonic())} left"

    def _line(self, text: str, share: float) -> None:
        if self._how == "json":
            text = progress_line(text, share, time.monotonic() - self._began)
        print(text, file=self._stream, flush=True)
