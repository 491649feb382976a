"""Ctrl-C and SIGTERM: both end a command, also where a solver swallows the KeyboardInterrupt that was raised in it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

_received: list[int] = []  # signals since the command began


@contextmanager
def interruptible() -> Iterator[None]:
    """While a command runs, both signals raise KeyboardInterrupt and are remembered for `check_interrupted`."""
    _received.clear()
    signals = (signal.SIGINT, signal.SIGTERM)
    try:
        before = [signal.signal(number, _interrupt) for number in signals]
    except ValueError:  # not the main thread: signals do not come here
        yield
        return
    try:
        yield
    finally:
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    _received.append(number)
    raise KeyboardInterrupt


def check_interrupted() -> None:
    """Raise the KeyboardInterrupt again that CasADi turns into a solver that "stopped by itself"."""
    if _received:
        raise KeyboardInterrupt
