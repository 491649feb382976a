"""A record without what could name a person, a place, a day or a file.

What stays is what a measurement needs: the numbers, usual names of columns, and settings whose names are made of the
words below.
"""

import re
import secrets
from dataclasses import replace
from typing import Final

from data_io.record import Record
from data_io.units import kind_of
from data_io.values import Scalar, free_name

WORDS: Final = frozenset(
    """
    acceleration angle angular applied approach area axial axis cell code cof coefficient column constant count cycle
    cycles data depth diameter dimension direction displacement distance drive duration elapsed fn force forces format
    frequency friction gain given holder hold humidity in interval lap laps lateral layout length limit linear load
    loading logging lower mass max maximum mean min minimum mode moving mu newton nominal none normal number of
    offset period pitch points position pressure programme radial radius ramp range rate raw relative resolution
    reciprocating rest rotary rotation rotational rows rpm run runs sample samples sampling sensor set slide sliding
    speed start step steps stiffness stop stroke strokes tangential target temperature test time torque total track type
    unit units upper user velocity voltage wear width x y z
    """.split()
)
"""What names of settings and columns may be made of; a name with any other word is free text."""

KEPT: Final = ("format", "source_format", "normal_force_source", "time_source", "friction_force_source")
_SHORT: Final = re.compile(r"[A-Za-z]{1,3}\d?")
_TOKEN: Final = re.compile(r"[^\W\d_]+")
_VALUE: Final = re.compile(r"\s*+[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?\s*+(\S{0,12})\s*+")
_COLUMN_SOURCE: Final = re.compile(r"column (.*) in (\S{0,12})(, given by the user)?")


def anonymous(record: Record) -> Record:
    """The record without paths, script names, operators, dates, free text and unusual names of columns, under a name
    drawn by lot.

    Of findings their code stays. The columns themselves are not touched.
    """
    secret = (*KEPT, "path", "sha256", "file_time_start")  # a clock that counts from 1970 tells the day
    kept = {k: v for k, v in record.metadata.items() if k not in secret and is_plain_setting(k, v)}
    sources = dict[str, str]()
    for origin in KEPT:
        text = str(record.metadata.get(origin, ""))
        if match := _COLUMN_SOURCE.fullmatch(text):
            text = f"column {match[1] if is_usual(match[1]) else '(renamed)'} in {_plain_unit(match[2])}"
        elif not (is_usual(text) or text.startswith("constant ")):
            text = ""
        sources |= {origin: text} if origin in record.metadata else {}
    steps = [{k: v for k, v in step.parameters.items() if is_plain_setting(k, v)} for step in record.steps]
    channels, usual = dict[str, str](), {name for name in record.channels if is_usual(name)}
    for old in record.channels:
        channels[old] = old if old in usual else free_name(f"channel {len(channels) + 1}", usual)
        usual.add(channels[old])
    return replace(
        record,
        channels={channels[old]: values for old, values in record.channels.items()},
        channel_units={channels[old]: _plain_unit(unit) for old, unit in record.channel_units.items()},
        steps=tuple(replace(step, parameters=s) for step, s in zip(record.steps, steps, strict=True)),
        metadata={**kept, **sources, "source_file": f"log-{secrets.token_hex(4)}"},
        findings=tuple(replace(f, message=f.code.replace("_", " ")) for f in record.findings),
    )


def is_plain_setting(name: str, value: Scalar) -> bool:
    """Tell a setting that names nobody: a number, perhaps with a unit, under a name of usual words."""
    if isinstance(value, (bool, int, float)):
        return is_usual(name)
    match = _VALUE.fullmatch(value)
    return match is not None and is_usual(name) and (not match[1] or kind_of(match[1]) is not None)


def is_usual(name: str) -> bool:
    """Tell a name that any tribometer might write: `Fx`, `V1`, `Set Force`."""
    if _SHORT.fullmatch(name):
        return True
    words = _TOKEN.findall(name)
    return bool(words) and name.isascii() and all(word.lower() in WORDS for word in words)


def _plain_unit(unit: str) -> str:
    return unit if not unit or kind_of(unit) is not None or _SHORT.fullmatch(unit) else "?"
