"""Ctrl-C and SIGTERM: both end a command, also where a solver swallows the KeyboardInterrupt that was raised in it."""

from __future__ import annotations

import signal
import sys
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
    unraisable = sys.unraisablehook

    def without_interruptions(event: sys.UnraisableHookArgs) -> None:
        """A signal that comes within a callback of the garbage collector is not raised, but it is remembered."""
        if not isinstance(event.exc_value, KeyboardInterrupt):
            unraisable(event)

    sys.unraisablehook = without_interruptions
    try:
        yield
    finally:
        sys.unraisablehook = unraisable
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    _received.append(number)
    raise KeyboardInterrupt


def interrupted() -> bool:
    """Whether a signal came since the command began, whatever became of its KeyboardInterrupt."""
    return bool(_received)


def taken_as_handled() -> None:
    """Let the exit code stand, once a KeyboardInterrupt was caught.

    Where it came within the `exec` of a text, as dataclasses and namedtuples do, Python remembers it as unhandled and
    dies by the signal at its end (`python -m`); the next `exec` that ends well makes it forget.
    """
    exec("")


def check_interrupted() -> None:
    """Raise the KeyboardInterrupt again that CasADi turns into a solver that "stopped by itself"."""
    if interrupted():
        raise KeyboardInterrupt
