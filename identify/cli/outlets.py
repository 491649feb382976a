"""Where the words go: consoles of any encoding, outlets that are closed, readers that leave before the end."""

from __future__ import annotations

import codecs
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TextIO, TypeVar

# ----------------------------------------------------------------------------------------------------------------------
# Sentences that echo what was typed, kept readable: of a path of thousands of characters the two ends tell enough.
# ----------------------------------------------------------------------------------------------------------------------

LONGEST = 200  # characters of a word, or of an argument, that are echoed whole
ENDS = 80  # characters of each end of a longer one

_WORD = re.compile(rf"\S{{{LONGEST + 1},}}")


def shortened(sentence: str, given: Sequence[str] = ()) -> str:
    """The sentence with the middle of its long words, and of the long arguments among those given, left out."""
    for argument in given:
        if len(argument) > LONGEST:
            sentence = sentence.replace(argument, _ends(argument))
    return _WORD.sub(lambda word: _ends(word[0]), sentence)


def _ends(text: str) -> str:
    return f"{text[:ENDS]}…{text[-ENDS:]}"


T = TypeVar("T")

SPELLED = {
    "−": "-", "–": "-", "—": "-", "‐": "-", "…": "...", "×": "x", "·": "*", "±": "+/-", "≤": "<=", "≥": ">=", "≈": "~",
    "→": "->", "←": "<-", "√": "sqrt", "∞": "inf", "²": "2", "³": "3", "⁻": "-", "¹": "1", "°": " deg", "µ": "u",
    "μ": "mu", "Δ": "Delta", "α": "alpha", "γ": "gamma", "ζ": "zeta", "λ": "lambda", "ξ": "xi", "τ": "tau", "φ": "phi",
    "Φ": "Phi", "Π": "Pi", "Ω": "Omega", "ω": "omega", "σ": "sigma", "χ": "chi", "₀": "0", "‘": "'", "’": "'", "“": '"',
    "”": '"', "\u00a0": " ", "\u202f": " ", "\u2009": " ",
}  # fmt: skip
"""What stands for a letter that an encoding does not have: a minus must never be lost."""


def _spell(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    wrong = error.object[error.start : error.end]
    return "".join(SPELLED.get(letter, "?") for letter in wrong), error.end


codecs.register_error("stickslip.spelled", _spell)


class _Outlet:
    """A stream that goes on into nothing once its reader has left: the work and its exit code do not depend on it.

    answers: whether a full disk is an error; where it is the errors that cannot be written, nobody can be told.
    """

    def __init__(self, stream: TextIO, answers: bool) -> None:
        self._stream, self._answers = stream, answers

    def write(self, text: str) -> int:
        return self._lasting(lambda: self._stream.write(text), len(text))

    def flush(self) -> None:
        self._lasting(self._stream.flush, None)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _lasting(self, work: Callable[[], T], otherwise: T) -> T:
        try:
            return work()
        except OSError as error:
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, self._stream.fileno())
            os.close(nothing)
            if self._answers and not isinstance(error, BrokenPipeError):
                raise
            return otherwise


@contextmanager
def outlets() -> Iterator[None]:
    """While a command runs, standard output and standard error take every word, whatever they are.

    Where they were closed (`>&-`), the next file to be opened would take their place, and what a library prints would
    go into it: nothing takes it first.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _opened(sys.stdout, answers=True), _opened(sys.stderr, answers=False)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def _opened(stream: TextIO | None, answers: bool) -> Any:
    if stream is None:
        return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123 - open until the process ends
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors="stickslip.spelled")
    return _Outlet(stream, answers)
