"""How far long work is: told to whoever listens, as progress(stage, share of the whole or None)."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float | None], None]


class Notice(str):
    """A stage that is a sentence for people, to stay when the stage has gone."""


def to_nobody(_stage: str, _share: float | None) -> None:
    """Where nobody listens."""
