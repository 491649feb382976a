"""How far long work is: told to whoever listens, as progress(stage, share of the whole or None)."""

from __future__ import annotations

from collections.abc import Callable

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
