"""Advice that several parameters share is said in full once."""

from __future__ import annotations

import re
from collections.abc import Sequence

_ADVICE = re.compile(r"add (a log of .+?), which is expected to tell it to ")


def said_once(reasons: Sequence[str]) -> list[str]:
    """Reasons of parameters in their order: a log that one of them has asked for already is "the same log"."""
    told: set[str] = set()
    out = []
    for reason in reasons:
        asked = _ADVICE.search(reason)
        if asked is not None and asked[1] in told:
            reason = reason.replace(asked[0], "the same log is expected to tell it to ")
        elif asked is not None:
            told.add(asked[1])
        out.append(reason)
    return out
