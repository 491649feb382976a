"""How far long work is: told to whoever listens, as progress(stage, share of the whole or None)."""

from __future__ import annotations

import html
import sys
from collections.abc import Callable
from typing import Any

Progress = Callable[[str, float | None], None]


class Notice(str):
    """A stage that is a sentence for people, to stay when the stage has gone."""


def noticed_once(progress: Progress) -> Progress:
    """The same listener, who hears each notice once."""
    heard = set[str]()

    def told(stage: str, share: float | None) -> None:
        if not isinstance(stage, Notice) or stage not in heard:
            progress(stage, share)
        heard.add(stage)

    return told


def to_nobody(_stage: str, _share: float | None) -> None:
    """Where nobody listens."""


WIDTH = 34  # characters of a stage


class ProgressBar:
    """A bar for a notebook or a terminal: `fit(scene, progress=ProgressBar())`.

    Called with a stage and its share of the whole, 0 to 1 (None: unknown), it changes in place: in a notebook below the
    cell, on a terminal in its line. Sentences that are to stay do. Where neither is there it is silent.
    """

    def __init__(self) -> None:
        self._notices: list[str] = []
        self._shown: Any = None  # the place in the notebook
        modules = sys.modules  # nobody is in a notebook who has not loaded IPython
        self._notebook = "IPython" in modules and getattr(modules["IPython"].get_ipython(), "kernel", None) is not None

    def __call__(self, stage: str, share: float | None = None) -> None:
        """The work is at this stage."""
        if isinstance(stage, Notice):
            self._notices.append(stage)
        if self._notebook:
            self._show_in_notebook(stage, share)
        elif sys.stderr.isatty():
            said = f"{stage}\n" if isinstance(stage, Notice) else f"{stage[:WIDTH]:<{WIDTH}} {share or 0.0:4.0%}"
            sys.stderr.write(f"\r{' ' * (WIDTH + 5)}\r{said}")
            sys.stderr.flush()

    def _show_in_notebook(self, stage: str, share: float | None) -> None:
        from IPython.display import HTML, display

        value = "" if share is None else f' value="{share:.3f}"'
        lines = [*map(html.escape, self._notices)]
        if not isinstance(stage, Notice):
            lines.append(f"<progress{value}></progress> {html.escape(stage)}")
        shown = HTML("<br>".join(lines))
        if self._shown is None:
            self._shown = display(shown, display_id=True)
        else:
            self._shown.update(shown)
