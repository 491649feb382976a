"""The keys of a scene file: what each holds, in which unit and range; one table that reads and checks them all."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import PurePath
from typing import Any

from data_io.spelling import nearest
from data_io.units import UnitError, parse_quantity
from data_io.values import SIZES
from identify.base.document import EXPECTED, JSON_TYPES
from identify.base.errors import SceneError
from identify.model.composition import FORCE_SENSORS

LARGEST = 1e18  # of an SI unit, and its inverse the least: no rig has it, and what is made of several is a number still
Reader = Callable[[Any, str, str], Any]  # (value, SI unit, place in a sentence) -> what the scene takes, or SceneError


# Kinds of values.


def quantity(value: object, unit: str, where: str) -> float:
    """A number in SI from "text with a unit" or a bare SI number.

    Args:
        unit: the SI unit of the result ("" for a pure number).
        where: names the place in a sentence, such as "[rig] mass".

    Raises:
        SceneError: neither a number nor text, an unknown unit, or a number that is not finite.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        shape = f'"1.5 {unit}"' if unit else "0.5"
        raise SceneError(f"{where} is {value!r}; expected a quantity such as {shape}, or a bare SI number")
    try:
        number = float(parse_quantity(value, unit)) if isinstance(value, str) else float(value)
    except UnitError as error:
        raise SceneError(f"{where}: {error}") from None
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise SceneError(f"{where} is {value!r}; expected a finite number: correct it")
    return number


def stated(value: object, unit: str, where: str) -> float:
    """As `quantity`, of a scene file: quotes around a bare number mean that its unit was forgotten."""
    number = quantity(value, unit, where)
    if unit and isinstance(value, str) and is_number(value):
        raise SceneError(
            f'{where} is "{value}", a text without a unit; write for instance "{value} {unit}", or the bare SI number '
            f"{value.strip()} without quotes"
        )
    return number


def is_number(text: str) -> bool:
    """Whether a text is a number and nothing else, so that a unit is missing."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def share(value: object, where: str) -> float | None:
    """ "2 %" as 0.02; None for anything that is no percentage. SceneError: a percentage without a number."""
    if not isinstance(value, str) or not value.strip().endswith("%"):
        return None
    return quantity(value.strip()[:-1].strip(), "", where) / 100.0


def part(value: object, unit: str, where: str) -> float:
    """A pure number, or a share in percent."""
    percent = share(value, where)
    return quantity(value, unit, where) if percent is None else percent


def speed(value: object, unit: str, where: str) -> float | tuple[tuple[float, float], ...]:
    """A speed, or a programme: pairs of start [s] and speed [m/s]."""
    if not isinstance(value, (list, tuple)):
        pace = stated(value, unit, where)
        if pace < 0.0:
            raise SceneError(
                f"{where} is {value!r}; expected a positive speed, as both directions are alike: give it without its "
                "sign; a log that slides with a negative force is turned over by itself"
            )
        return pace
    if not all(isinstance(pair, (list, tuple)) and len(pair) == 2 for pair in value):
        raise SceneError(f'{where} is {value!r}; expected pairs of start and speed: [[0, "0.1 mm/s"], [30, "0 mm/s"]]')
    return tuple((stated(start, "s", where), stated(pace, unit, where)) for start, pace in value)


@dataclass(frozen=True)
class Course:
    """A drive whose speed changes gradually: the position sine[0] sin(2 pi sine[1] t + sine[2]), with amplitude [m],
    frequency [Hz] and phase [rad]; or, where that is None, ramps of the speed, straight from each (time [s], speed
    [m/s]) to the next, the last one kept."""

    sine: tuple[float, float, float] | None = None
    ramps: tuple[tuple[float, float], ...] = ()

    @property
    def fastest(self) -> float:
        """Highest speed, to either side [m/s]."""
        if self.sine is None:
            return max(abs(pace) for _, pace in self.ramps)
        return 2.0 * math.pi * self.sine[0] * self.sine[1]

    @property
    def table(self) -> dict[str, object]:
        """As a scene file has it, in SI."""
        if self.sine is None:
            return {"ramps": [list(pair) for pair in self.ramps]}
        return {"sine": dict(zip(("amplitude", "frequency", "phase"), self.sine, strict=True))}


def course(value: object, unit: str, where: str) -> Course:
    """A sine, or ramps between speeds."""
    table = TomlTable.of(value, where, ("sine", "ramps"), '{ sine = { amplitude = "2 mm", frequency = "1 Hz" } }')
    if len(table.data) != 1:
        raise SceneError(f"{where} is {value!r}; expected either sine = {{ … }} or ramps = [ … ]: keep exactly one")
    if "sine" in table.data:
        inner = TomlTable.of(table.data["sine"], f"{where} sine", SINE, '{ amplitude = "2 mm", frequency = "1 Hz" }')
        missing = [name for name in ("amplitude", "frequency") if name not in inner.data]
        if missing:
            raise SceneError(f'{where} sine has no {missing[0]}; give amplitude = "2 mm", frequency = "1 Hz"')
        return Course((inner.get("amplitude"), inner.get("frequency"), inner.get("phase") or 0.0))
    ramps = table.data["ramps"]
    pairs = speed(ramps, unit, f"{where} ramps") if isinstance(ramps, (list, tuple)) else ()
    if not isinstance(pairs, tuple) or len(pairs) < 2:
        raise SceneError(f'{where} ramps is {ramps!r}; expected two pairs at least: [[0, "0 mm/s"], [5, "1 mm/s"]]')
    return Course(ramps=pairs)


def span(value: object, _unit: str, where: str) -> tuple[float, float]:
    """A pair of times [s]."""
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise SceneError(f'{where} is {value!r}; expected two times ["5 s", "20 s"], of several pairs a list')
    return stated(value[0], "s", where), stated(value[1], "s", where)


def zero(value: object, unit: str, where: str) -> float | tuple[float, float]:
    """A force [N] to take off, or the times [s] between which it is measured."""
    return span(value, unit, where) if isinstance(value, (list, tuple)) else stated(value, unit, where)


def spans(value: object, unit: str, where: str) -> tuple[tuple[float, float], ...]:
    """Pairs of times [s], each a span."""
    return tuple(span(pair, unit, where) for pair in (value if isinstance(value, list | tuple) else [value]))


def of_kind(kind: type, value: object, _unit: str, where: str) -> object:
    """A value of just this type."""
    if type(value) is not kind:
        raise SceneError(f"{where} is {value!r}; expected {EXPECTED[kind]}: correct it")
    return value


def one_of(known: Sequence[str], value: object, _unit: str, where: str) -> object:
    """One of a few words."""
    if value not in known:
        raise SceneError(f"{where} is {value!r}; expected {' or '.join(map(repr, known))}: correct it")
    return value


def inner(where: str, keys: Mapping[str, Key], example: str, value: object, *_: str) -> dict[str, Any]:
    """The values of a table of the scene."""
    return TomlTable.of(value, where, keys, example).values()


def text(value: object, _unit: str, where: str) -> str:
    """A non-empty text; a path that Python gives is one."""
    value = str(value) if isinstance(value, PurePath) else value
    if not isinstance(value, str) or not value.strip():
        raise SceneError(f"{where} is {value!r}; expected a text in quotes: correct it")
    return value


def words(value: object, _unit: str, where: str) -> dict[str, str]:
    """A table of texts; numbers become text."""
    table = TomlTable.of(value, where, None, '{ time = "T", friction_force = "Fx" }')
    for name, word in table.data.items():
        if isinstance(word, (Mapping, list)):
            raise SceneError(f"{table.place(name)} is {word!r}; expected a text in quotes: correct it")
    return {name: str(word) for name, word in table.data.items()}


# Keys.


@dataclass(frozen=True)
class Key:
    """What a key of a scene holds: SI unit ("" of a pure number and of what is none), how it is read, sign (POSITIVE,
    NOT_NEGATIVE or "" for any), limit of its size, and the least and most that a tribometer has in SI with the unit
    that was probably meant where a bare number is something else."""

    unit: str = ""
    read: Reader = stated
    sign: str = ""
    limit: float = math.inf
    usual: tuple[float, float, str] | None = None

    @property
    def schema(self) -> dict[str, object]:
        """The JSON schema of what may stand there; of lists and of tables with any keys nothing is said."""
        if not isinstance(self.read, partial):
            types = [*["number"] * (self.read in (stated, part)), *["string"] * (self.read in (stated, part, text))]
            return {"type": types} if types else {}
        if self.read.func is inner:
            return table_schema(self.read.args[1])
        first = self.read.args[0]
        return {"type": JSON_TYPES[first]} if self.read.func is of_kind else {"enum": list(first)}


def table_schema(keys: Mapping[str, Key], *required: str) -> dict[str, object]:
    """The JSON schema of a table with none but these keys."""
    shapes = {name: key.schema for name, key in keys.items()}
    return {"type": "object", "properties": shapes, "required": list(required), "additionalProperties": False}


POSITIVE, NOT_NEGATIVE = "positive", "not negative"
SHARE = Key(read=part, sign=NOT_NEGATIVE, limit=1.0)
DAMPING = ("damping", "zeta", "loss_factor", "log_decrement")
TIED = "natural_frequency_tolerance"  # of sqrt(k/m), in which errors of stiffness and mass that are the same cancel
RIG: Mapping[str, Key] = {
    "mass": Key("kg", sign=NOT_NEGATIVE, usual=(1e-5, 50.0, "g")),
    "stiffness": Key("N/m", sign=POSITIVE, usual=(10.0, 1e9, "N/mm")),
    TIED: Key(read=part),
    "damping": Key("N/m", sign=NOT_NEGATIVE),
    "zeta": Key(),
    "loss_factor": Key(),
    "log_decrement": Key(),
    "drive_speed": Key("m/s", speed, usual=(1e-9, 1.0, "mm/s")),
    "drive": Key("m/s", course),
    "normal_force": Key("N", sign=POSITIVE, usual=(1e-4, 1e4, "mN")),
    "noise": Key("N", sign=POSITIVE),
    "force_sensor": Key(read=partial(one_of, FORCE_SENSORS)),
    "arm": Key("m", sign=POSITIVE, usual=(1e-4, 10.0, "mm")),
}
SINE: Mapping[str, Key] = {
    "amplitude": Key("m", sign=POSITIVE),
    "frequency": Key("Hz", sign=POSITIVE),
    "phase": Key("rad"),
}
AREA_LAW: Mapping[str, Key] = {"coefficient": Key("m^2", sign=POSITIVE), "exponent": Key()}
CONTACT: Mapping[str, Key] = {
    "area": Key("m^2", sign=POSITIVE),
    "area_law": Key(read=partial(inner, "[contact] area_law", AREA_LAW, "{ coefficient, exponent }")),
}
INITIAL: Mapping[str, Key] = {"elongation": Key("m"), "sliding_speed": Key("m/s"), "gamma": Key()}


def check(where: str, key: Key, value: object) -> None:
    """Refuse a value that no rig has.

    Raises:
        SceneError: its sign or its size; a programme whose times do not rise from 0.
    """
    value = value.ramps if isinstance(value, Course) else value
    if isinstance(value, tuple) and value and key.read in (speed, course):
        starts = [start for start, _ in value]
        if not starts or starts[0] != 0.0 or any(b <= a for a, b in pairwise(starts)):
            raise SceneError(
                f"the programme of {where} starts at {starts} s; expected rising times from 0: begin it with [0, speed]"
            )
        for start, pace in value:
            check(f"the start of a step of {where}", Key("s"), start)
            check(where, Key(key.unit), pace)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return
    if abs(value) > sys.float_info.max:  # a whole number has no end
        value = math.inf if value > 0 else -math.inf
    shown = f"{value:g} {key.unit}".rstrip()
    least, most = SIZES.get(key.unit, (1.0 / LARGEST, LARGEST))
    if key.sign == POSITIVE and not value > 0.0:
        raise SceneError(f"{where} is {shown}; expected a positive number: correct it")
    if key.sign == NOT_NEGATIVE and not value >= 0.0:
        raise SceneError(f"{where} is {shown}; expected zero or a positive number: correct it")
    if abs(value) >= key.limit:
        raise SceneError(f"{where} is {value:g}; expected less than {key.limit:.3g} to either side: correct it")
    if value and not least <= abs(value) <= most:
        raise SceneError(
            f"{where} is {shown}, which no rig has; expected a number between {least:g} and {most:g}: correct it, or "
            "its unit"
        )


@dataclass(frozen=True)
class TomlTable:
    """A TOML table, where it stands ("[rig]"), and what its keys hold."""

    data: Mapping[str, Any]
    where: str
    keys: Mapping[str, Key]

    @staticmethod
    def of(value: object, where: str, known: Mapping[str, Key] | Iterable[str] | None, example: str) -> TomlTable:
        """The value as a table with none but the known keys (None: any).

        Raises:
            SceneError: not a table, or an unknown key; the nearest known one is named.
        """
        if not isinstance(value, Mapping):
            raise SceneError(f"{where} is {value!r}; expected a table such as {example}")
        names = list(value if known is None else known)
        for key in value:
            if key not in names:
                raise SceneError(
                    f"{where} has a key {key!r} that is not known; did you mean {nearest(str(key), names)!r}? "
                    f"Known are {', '.join(names)}"
                )
        return TomlTable(value, where, known if isinstance(known, Mapping) else {})

    def place(self, key: str) -> str:
        """What a sentence calls this key."""
        return f"{self.where} {key}"

    def get(self, name: str) -> Any:
        """The value of a key, as its table says; None where it is absent."""
        if name not in self.data:
            return None
        key = self.keys[name]
        value = key.read(self.data[name], key.unit, self.place(name))
        check(self.place(name), key, value)
        return value

    def values(self) -> dict[str, Any]:
        """The values of all keys that are there."""
        return {name: self.get(name) for name in self.data}
