"""How far long work is: reported to a callback, as progress(stage, share of the whole or None), and shown in a bar."""

from __future__ import annotations

import html
import json
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Literal, Self, TextIO

from identify.base.wording import wrapped

Progress = Callable[[str, float | None], None]
Style = Literal["shown", "verbose", "json", "bar"]
STAGE, BAR = 34, 18  # characters
CLEARED = "\r\x1b[K"  # the line of a bar, gone


class Notice(str):
    """A stage that is a sentence for people, to stay when the stage has gone."""


def noticed_once(progress: Progress) -> Progress:
    """The same callback, which gets each notice once."""
    notices = set[str]()

    def once(stage: str, share: float | None) -> None:
        if not isinstance(stage, Notice) or stage not in notices:
            progress(stage, share)
        notices.add(stage)

    return once


def to_nobody(_stage: str, _share: float | None) -> None:
    """The callback that does nothing."""


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


class ProgressBar:
    """A bar for a notebook or a terminal: `fit(scene, progress=ProgressBar())`.

    Called with a stage and its share of the whole, 0 to 1 (None: unknown), it changes in place: in a notebook below the
    cell, on a terminal in its line. Sentences that are to stay do.

    Args:
        stream: of the terminal; None: standard error.
        style: what is written where the stream is no terminal: "bar" nothing, "shown" a line per stage, as "verbose"
            with its seconds; "json": a JSON document in each line, also on a terminal.
    """

    def __init__(self, stream: TextIO | None = None, style: Style = "bar") -> None:
        self._stream, self._style, self._began = stream or sys.stderr, style, time.monotonic()
        self._notices: list[str] = []
        self._show: Callable[[object], object] | None = None  # changes what stands below the cell of a notebook
        self._last: tuple[str, float | None] = ("", None)
        modules = sys.modules  # nobody is in a notebook who has not loaded IPython
        self._notebook = "IPython" in modules and getattr(modules["IPython"].get_ipython(), "kernel", None) is not None
        moves = self._stream.isatty() and os.environ.get("TERM") not in ("dumb", "unknown")
        self._moves = moves and style in ("bar", "shown")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._moves:
            self._stream.write(CLEARED)
            self._stream.flush()

    def __call__(self, stage: str, share: float | None = None) -> None:
        """The work is at this stage."""
        seconds, stays = time.monotonic() - self._began, isinstance(stage, Notice)
        if self._notebook:
            from IPython.display import HTML, display

            if stays:
                self._notices.append(html.escape(stage))
            value = "" if share is None else f' value="{share:.3f}"'
            bar = [] if stays else [f"<progress{value}></progress> {html.escape(stage)}"]
            shown = HTML("<br>".join([*self._notices, *bar]))
            if self._show is None:
                self._show = display(shown, display_id=True).update
            else:
                self._show(shown)
        elif self._moves:
            done = min(max(share or 0.0, 0.0), 1.0)
            left = f"left about {seconds / done - seconds:.0f} s" if done else ""
            bar_text = "#" * round(BAR * done) + "-" * (BAR - round(BAR * done))
            line = f"{stage[:STAGE]:<{STAGE}} {bar_text} {done:4.0%} {seconds:4.0f} s {left}"
            self._stream.write(f"{CLEARED}{wrapped(stage)}\n" if stays else f"{CLEARED}{line}")
            self._stream.flush()
        elif self._style == "json" and (stage, share) != self._last:
            write_line(json.dumps({"stage": stage, "share": share, "seconds": round(seconds, 3)}), self._stream)
        elif self._style in ("shown", "verbose") and stage != self._last[0]:
            text = wrapped(stage) if stays else stage
            write_line(f"{seconds:7.2f} s  {text}" if self._style == "verbose" else text, self._stream)
        self._last = stage, share
