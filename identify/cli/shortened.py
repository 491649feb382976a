"""Sentences that echo what was typed, kept readable: of a path of thousands of characters the two ends tell enough."""

from __future__ import annotations

import re
from collections.abc import Sequence

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
