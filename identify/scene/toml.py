"""From the tables of a scene file to the frozen values of a scene."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from data_io import list_steps
from data_io.thresholds import Thresholds
from data_io.values import LogError
from identify.base.budget import DEFAULT_TIME_LIMIT
from identify.base.errors import SceneError
from identify.effects import ALL, MAIN, NAMES
from identify.scene.parameters import declared_by, read_parameters
from identify.scene.rig import BACKSLASH, located, read_log_entry, read_rig, with_listed
from identify.scene.tables import AREA_LAW, CONTACT, INITIAL, RIG, Key, TomlTable, nearest, part, text
from identify.scene.values import USUAL_TOLERANCES, Contact, Initial

DEEPEST = 10  # tables of a scene within each other
LONGEST_INTEGER = 10_000  # bits
TOP: Mapping[str, Key] = {
    **{name: Key() for name in ("effects", "extrapolate", "rig", "contact", "initial", "parameters", "quality", "fit")},
    **{name: Key() for name in ("tolerances", "logs")},
    "name": Key(read=text),
}


def read_toml(path: Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """The tables of a TOML file with the overrides put in.

    Raises:
        SceneError: no such file, no TOML, or an override that fits nowhere. The path is not in the sentence.
    """
    try:
        document = parsed(path.read_text(encoding="utf-8-sig"))
    except (FileNotFoundError, IsADirectoryError):
        raise SceneError("no such scene file; give an existing one, or write one with: stickslip scene LOG") from None
    except UnicodeDecodeError:
        _refuse_a_log(path)
        raise SceneError("this is not UTF-8 text; save the scene file as UTF-8") from None
    except ValueError as error:
        _refuse_a_log(path)
        raise SceneError(f"this is not valid TOML ({error}); {_remedy(path, str(error))}") from None
    except OSError as error:
        raise SceneError(f"the scene file cannot be read ({error.strerror}); check its path and permissions") from None
    document = with_rig_file(document, path.parent)
    for override in overrides:
        put(document, override)
    return document


def parsed(text: str) -> dict[str, Any]:
    """The tables that a TOML text holds.

    Raises:
        ValueError: no TOML, more tables within each other than a scene has, or a whole number that Python does not
            write out.
    """
    try:
        document = tomllib.loads(text)
        _refuse_what_is_none(document, 0)
    except RecursionError:
        raise ValueError("brackets without end") from None
    return document


def _remedy(path: Path, complaint: str) -> str:
    """What mends a scene file that is no TOML."""
    text = path.read_text(encoding="utf-8-sig")
    if text.lstrip().startswith("{") and '"schema"' in text:
        return "it is a result of stickslip fit: give the scene file, or the result where a command takes --result"
    found = re.search(r"at line (\d+)", complaint)
    line = text.split("\n")[int(found[1]) - 1] if found else ""
    return BACKSLASH if re.search(r'"[^"]*\\', line) else "mend that line"


def is_rig(document: Mapping[str, object]) -> bool:
    """Whether a TOML document is what `stickslip rig` writes, and no scene: it holds quantities of the rig alone."""
    return bool(document) and not set(document) - set(RIG)


def with_rig_file(document: Mapping[str, object], folder: Path) -> dict[str, Any]:
    """The tables with `rig = "RIG.toml"` replaced by what that file holds; its path is relative to the folder.

    Raises:
        SceneError: no such file, or no TOML.
    """
    named = document.get("rig")
    if not isinstance(named, str):
        return dict(document)
    try:
        rig = parsed(located(folder, named).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise SceneError(
            f"rig = {named!r} cannot be read ({error.strerror}); give the path of a file that stickslip rig wrote, "
            "relative to the scene file, or a [rig] table"
        ) from None
    except ValueError as error:
        raise SceneError(f"rig = {named!r} is not valid TOML ({error}); mend that line") from None
    return {**document, "rig": rig}


def _refuse_what_is_none(value: object, deep: int) -> None:
    """Refuse dotted keys without end, and whole numbers that Python does not write out: hexadecimal ones are read
    whatever their length.

    Raises:
        ValueError: there is one.
    """
    if deep > DEEPEST:
        raise ValueError(f"more than {DEEPEST} tables within each other")
    if isinstance(value, int) and value.bit_length() > LONGEST_INTEGER:
        raise ValueError(f"a whole number of {value.bit_length()} bits: shorten it")
    for item in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _refuse_what_is_none(item, deep + 1)


def _refuse_a_log(path: Path) -> None:
    """Say so where a file that is no scene is a log.

    Raises:
        SceneError: it is one.
    """
    with suppress(LogError, OSError):
        list_steps(path)
        raise SceneError(
            f"this is a log, not a scene; write a scene from it with: stickslip scene {path} --out SCENE.toml"
        )


def put(document: dict[str, Any], override: str) -> None:
    """Replace one value, "dotted.key=value"; logs are counted from 1 ("logs.1.mass=0.3 kg").

    Raises:
        SceneError: no "=", or a path that leads into something that is no table.
    """
    path, equals, text = override.partition("=")
    keys = [key.strip() for key in path.split(".")]
    if len(keys) > DEEPEST:
        raise SceneError(
            f"the override {override[:60]!r}… leads {len(keys)} tables deep; at most {DEEPEST} were expected"
        )
    if not equals or not all(keys):
        raise SceneError(f'the override {override!r} has no form KEY=VALUE; write for instance rig.mass="0.3 kg"')
    place: Any = document
    for key in keys[:-1]:
        if isinstance(place, list):
            if not key.isdecimal() or not 1 <= int(key) <= len(place):
                raise SceneError(f"the override {override!r} asks for log {key} of {len(place)}; count them from 1")
            place = place[int(key) - 1]
        elif isinstance(place, dict):
            place = place.setdefault(key, {})
    if not isinstance(place, dict):
        raise SceneError(f"the override {override!r} leads into {place!r}, which is no table; shorten the key")
    place[keys[-1]] = _value(text.strip())


def _value(text: str) -> Any:
    try:
        document = parsed(f"value = {text}")
    except ValueError:
        return text  # the shell took the quotes away
    return document["value"] if len(document) == 1 else text


def to_fill_in(value: object, where: str = "") -> Iterator[str]:
    """The dotted keys whose text still holds TODO, as a draft leaves them; logs are counted from 1."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from to_fill_in(item, f"{where}.{key}" if where else str(key))
    elif isinstance(value, (list, tuple)):
        for number, item in enumerate(value, 1):
            yield from to_fill_in(item, f"{where}.{number}")
    elif isinstance(value, str) and "TODO" in value:
        yield where


def read_parts(document: Mapping[str, object], folder: Path) -> dict[str, Any]:
    """The frozen values behind the tables of a scene file, as a `Scene` takes them; "name" is None where none is given.

    Args:
        folder: what relative log paths are relative to.

    Raises:
        SceneError: one sentence: what was found where, what was expected, what to do.
    """
    if is_rig(document):
        raise SceneError(
            "it holds a rig, as stickslip rig writes it, and no scene; give a scene that names it: "
            'rig = "RIG.toml" in place of its [rig] table'
        )
    top = TomlTable.of(document, "the scene", TOP, '[rig] mass = "0.2 kg"')
    missing = list(to_fill_in(document))
    if missing:
        raise SceneError(f"still to fill in: {', '.join(missing)}; replace each TODO by a quantity with its unit")
    effects = _effects(document.get("effects"))
    declared = declared_by(effects)
    example = '[rig] mass = "0.2 kg", stiffness = "1470 N/m"'
    said = TomlTable.of(document.get("rig"), "[rig]", RIG, example).data
    rig_table = TomlTable.of(with_listed(said, document.get("parameters")), "[rig]", RIG, example)
    listed = effects if effects != "auto" else MAIN[:1]
    damped_by = [e.name for e in ALL if e.name in listed and any(p.name == "damping" for p in e.parameters)]
    rig, damped = read_rig(rig_table, damped_by[0] if damped_by else None, "inertia" in listed)
    contact = _contact(document.get("contact", {}))
    logs = document.get("logs", [])
    if not isinstance(logs, Sequence) or isinstance(logs, str):
        raise SceneError(f'[[logs]] is {logs!r}; expected one [[logs]] table per log, each with path = "…"')
    name = top.get("name")
    if name is not None and set(name) & set("/\0"):
        raise SceneError(f"name is {name!r}; expected a word that a folder can be called: leave out the slashes")
    elsewhere = _damping_frequency(rig_table, effects) | contact.parameters
    return {
        "name": name,
        "effects": effects,
        "extrapolate": _extrapolate(document.get("extrapolate", []), effects),
        "rig": rig,
        "parameters": read_parameters(document.get("parameters", {}), declared, elsewhere),
        "logs": tuple(read_log_entry(entry, number, folder, rig, damped) for number, entry in enumerate(logs, 1)),
        "initial": _initial(document.get("initial", {})),
        "contact": contact,
        "thresholds": _thresholds(document.get("quality", {})),
        "time_limit": _time_limit(document.get("fit", {})),
        "tolerances": _tolerances(document.get("tolerances", {})),
    }


def _tolerances(value: object) -> dict[str, float]:
    """What the published intervals hold, relative: "2 %" or 0.02; 0 takes that quantity as exact."""
    known = {name: Key(read=part) for name in USUAL_TOLERANCES}
    table = TomlTable.of(value, "[tolerances]", known, '[tolerances] stiffness = "2 %"')
    found = {name: table.get(name) for name in table.data}
    for name, relative in found.items():
        if not 0.0 <= relative < 1.0:
            raise SceneError(f'{table.place(name)} is {relative:g}; expected a share from 0 to below 1, such as "2 %"')
    return found


def _time_limit(value: object) -> float:
    """How long a fit may take [s]."""
    table = TomlTable.of(value, "[fit]", {"time_limit": Key("s")}, '[fit] time_limit = "60 s"')
    limit: float | None = table.get("time_limit")
    if limit is not None and not limit > 0.0:
        raise SceneError(f'{table.place("time_limit")} is {limit:g} s; expected a positive time, such as "60 s"')
    return DEFAULT_TIME_LIMIT if limit is None else limit


def _thresholds(value: object) -> Thresholds:
    """The user's own thresholds of the quality gate: pure numbers, or shares in percent."""
    table = TomlTable.of(value, "[quality]", None, "[quality] jitter = 0.1")
    numbers = {}
    for name, number in table.data.items():
        numbers[name] = math.inf if number in (math.inf, "inf") else part(number, "", table.place(name))
    try:
        return Thresholds(numbers)
    except LogError as error:
        raise SceneError(f"[quality]: {error}") from None


def known_effects(value: Sequence[str], where: str = "effects") -> tuple[str, ...]:
    """The effects named, in the order of the table of effects.

    Raises:
        SceneError: an unknown name; the nearest known one is named.
    """
    for name in value:
        if name not in NAMES:
            raise SceneError(
                f"{where} names {name!r}, which is not known; did you mean {nearest(name, NAMES)!r}? "
                f"Known are {', '.join(NAMES)}"
            )
    return tuple(name for name in NAMES if name in value)


def _effects(value: object) -> tuple[str, ...] | Literal["auto"]:
    if value == "auto":
        return "auto"
    if not isinstance(value, (list, tuple)) or not all(isinstance(name, str) for name in value):
        found = "no effects" if value is None else f"effects = {value!r}"
        listed = ", ".join(f'"{name}"' for name in MAIN)
        raise SceneError(f'the scene has {found}; expected a list: effects = [{listed}, …], or "auto"')
    twice = next((name for place, name in enumerate(value) if name in value[:place]), None)
    if twice is not None:
        raise SceneError(f"effects names {twice!r} twice; expected each effect once: remove one of the two")
    return known_effects(value)


def _extrapolate(value: object, effects: tuple[str, ...] | Literal["auto"]) -> tuple[str, ...]:
    if not isinstance(value, (list, tuple)) or not all(isinstance(name, str) for name in value):
        raise SceneError(f'extrapolate is {value!r}; expected a list of effects: extrapolate = ["power_law"]')
    names = known_effects(value, "extrapolate")
    off = [name for name in names if effects != "auto" and name not in effects]
    if off:
        raise SceneError(f"extrapolate names {off[0]}, which is not among the effects; add it there, or drop it here")
    return names


def _damping_frequency(rig: TomlTable, effects: tuple[str, ...] | Literal["auto"]) -> dict[str, tuple[str, float]]:
    value = rig.get("damping_frequency")
    if value is None:
        return {}
    if effects != "auto" and "driven_damping" not in effects:
        raise SceneError(
            "[rig] damping_frequency belongs to the effect driven_damping; add it to effects instead of "
            "hysteresis_damping, or drop damping_frequency"
        )
    return {"damping_frequency": (rig.place("damping_frequency"), value)}


def _initial(value: object) -> Initial:
    table = TomlTable.of(value, "[initial]", INITIAL, '[initial] elongation = "0 mm"')
    return Initial(**{name: table.get(name) for name in table.data})


def _contact(value: object) -> Contact:
    table = TomlTable.of(value, "[contact]", CONTACT, '[contact] area = "0.8 cm^2"')
    example = "{ coefficient = …, exponent = … }"
    law = TomlTable.of(table.data.get("area_law", {}), "[contact] area_law", AREA_LAW, example)
    if len(table.data) == 2 or len(law.data) == 1:
        raise SceneError(f"[contact] expects either an area or area_law = {example}; keep exactly one")
    return Contact(table.get("area"), law.get("coefficient"), law.get("exponent"))
