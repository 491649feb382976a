"""Ctrl-C and SIGTERM: both end a command within seconds, also where a solver swallows the KeyboardInterrupt or works on
in compiled code that no interrupt reaches."""

from __future__ import annotations

import io
import os
import shutil
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn, TextIO

GRACE = 1.0  # seconds in which a command may end by itself
SIGNALS = (signal.SIGINT, signal.SIGTERM)
_received: list[int] = []  # signals since the command began
_unfinished: set[Path] = set()  # folders that must not be left behind
_muted: list[TextIO] = []  # standard error, while nothing but the last words is of interest
_stands_down = threading.Event()  # set where the command ends by itself, however long that takes


@contextmanager
def interruptible(last_words: Callable[[], None] | None = None) -> Iterator[None]:
    """While a command runs, both signals raise KeyboardInterrupt and are remembered for `check_interrupted`; where it
    does not end within `GRACE`, this process ends with exit code 130 after its last words (None: it may take its time).
    """

    def interrupt(number: int, _frame: FrameType | None) -> NoReturn:
        _received.append(number)
        if not _muted and not _stands_down.is_set():  # a solver complains of a failed evaluation
            _muted.append(sys.stderr)
            sys.stderr = io.StringIO()
        raise KeyboardInterrupt

    _stands_down.clear()
    try:
        before = [signal.signal(number, interrupt) for number in SIGNALS]
    except ValueError:  # not the main thread: signals do not come here
        yield
        return
    # A thread learns of a signal at once, while Python's own handler waits until compiled code returns.
    sender, receiver = socket.socketpair()
    sender.setblocking(False)
    wakeup, ended = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False), threading.Event()

    def watch() -> None:
        while (byte := receiver.recv(1)) and byte[0] not in SIGNALS:
            pass
        if not byte or last_words is None or ended.wait(GRACE) or _stands_down.is_set():
            return
        for folder in _unfinished:
            shutil.rmtree(folder, ignore_errors=True)
        with suppress(Exception):
            _end_noise()
            if sys.stderr.isatty():
                sys.stderr.write("\r\x1b[K")  # the line of a progress bar
            last_words()
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(130)

    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        ended.set()
        _received.clear()
        signal.set_wakeup_fd(wakeup)
        sender.close()
        if _muted:
            sys.stderr = _muted.pop()
        for number, handler in zip(SIGNALS, before, strict=True):
            signal.signal(number, handler)


def _end_noise() -> None:
    """Stop compilers at work, and let standard error be heard again."""
    if native := sys.modules.get("identify.base.native"):
        native.stop()
    if _muted:
        sys.stderr = _muted.pop()


def ends_by_itself() -> None:
    """The command heeds signals between short steps and has to put things in order before it ends: no last resort."""
    _stands_down.set()


@contextmanager
def unfinished(folder: Path) -> Iterator[None]:
    """Have a temporary folder removed however the command ends."""
    _unfinished.add(folder)
    try:
        yield
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        _unfinished.discard(folder)


def interrupted() -> bool:
    """Whether a signal came since the command began, whatever became of its KeyboardInterrupt."""
    return bool(_received)


def check_interrupted() -> None:
    """Raise the KeyboardInterrupt again that CasADi turns into a solver that "stopped by itself"."""
    if interrupted():
        raise KeyboardInterrupt


def taken_as_handled() -> None:
    """Let the exit code stand, once a KeyboardInterrupt was caught, and leave no compiler at work.

    Where it came within the `exec` of a text, as dataclasses and namedtuples do, Python remembers it as unhandled and
    dies by the signal at its end (`python -m`); the next `exec` that ends well makes it forget.
    """
    exec("")
    _end_noise()
