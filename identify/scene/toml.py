"""Scene files: TOML with its overrides, the file of a rig it may name, and what is no scene refused with its remedy."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from data_io.open import contents_of
from data_io.source import Request, load
from data_io.values import LogError
from identify.base.errors import SceneError
from identify.scene.tables import RIG

DEEPEST = 10  # tables of a scene within each other
LONGEST_INTEGER = 10_000  # bits
Tables = dict[str, Any]
BACKSLASH = "a backslash within \" begins an escape: write paths of Windows within ', as in 'C:\\logs\\new.txt'"


def read_toml(path: Path, overrides: Sequence[str] = ()) -> Tables:
    """The tables of a TOML file with the overrides put in.

    Raises:
        SceneError: no such file, no TOML, or an override that fits nowhere. The path is not in the sentence.
    """
    try:
        document = parsed(path.read_text(encoding="utf-8-sig"))
    except (FileNotFoundError, IsADirectoryError):
        raise SceneError("no such scene file; give an existing one, or write one with: stickslip scene LOG") from None
    except ValueError as error:
        with suppress(LogError, OSError):
            contents_of(load(path), Request())
            raise SceneError(
                f"this is a log, not a scene; write a scene from it with: stickslip scene {path} --out SCENE.toml"
            ) from None
        if isinstance(error, UnicodeDecodeError):
            raise SceneError("this is not UTF-8 text; save the scene file as UTF-8") from None
        text, remedy = path.read_text(encoding="utf-8-sig"), "correct that line"
        if text.lstrip().startswith("{") and '"schema"' in text:
            remedy = "it is a result of stickslip fit: give the scene file, or the result where --result takes it"
        elif re.search(r'"[^"\n]*\\', text):
            remedy = BACKSLASH
        raise SceneError(f"this is not valid TOML ({error}); {remedy}") from None
    except OSError as error:
        raise SceneError(f"the scene file cannot be read ({error.strerror}); check its path and permissions") from None
    document = with_rig_file(document, path.parent)
    for override in overrides:
        put(document, override)
    return document


def parsed(text: str) -> Tables:
    """The tables that a TOML text holds.

    Raises:
        ValueError: no TOML, more tables within each other than a scene has, or a whole number that Python does not
            write out (hexadecimal ones are read whatever their length).
    """
    try:
        document = tomllib.loads(text)
    except RecursionError:
        raise ValueError("brackets without end") from None
    level: list[object] = [document]
    for _ in range(DEEPEST + 2):
        for value in level:
            if isinstance(value, int) and value.bit_length() > LONGEST_INTEGER:
                raise ValueError(f"a whole number of {value.bit_length()} bits: shorten it")
        inner = [v.values() if isinstance(v, dict) else v for v in level if isinstance(v, dict | list)]
        level = [item for items in inner for item in items]
        if not level:
            return document
    raise ValueError(f"more than {DEEPEST} tables within each other")


def is_rig(document: Mapping[str, object]) -> bool:
    """Whether a TOML document is what `stickslip rig` writes, and no scene: it holds quantities of the rig alone."""
    return bool(document) and not set(document) - set(RIG)


def with_rig_file(document: Mapping[str, object], folder: Path) -> Tables:
    """The tables with `rig = "RIG.toml"` replaced by what that file holds; its path is relative to the folder.

    Raises:
        SceneError: no such file, or no TOML.
    """
    named = document.get("rig")
    if not isinstance(named, str):
        return dict(document)
    try:
        return {**document, "rig": parsed(located(folder, named).read_text(encoding="utf-8-sig"))}
    except OSError as error:
        raise SceneError(
            f"rig = {named!r} cannot be read ({error.strerror}); give the path of a file that stickslip rig wrote, "
            "relative to the scene file, or a [rig] table"
        ) from None
    except ValueError as error:
        raise SceneError(f"rig = {named!r} is not valid TOML ({error}); correct that line") from None


def located(folder: Path, path: str) -> Path:
    """The file a scene or manifest names: relative to its folder; `~` is a home where there is such a user."""
    if any(letter < " " for letter in path):
        raise SceneError(f"the path {path!r} holds a control character; {BACKSLASH}")
    return folder / os.path.expanduser(path)  # noqa: PTH111 - that of pathlib raises where there is none


def put(document: Tables, override: str) -> None:
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
    place: object = document
    for key in keys[:-1]:
        if isinstance(place, list):
            if not key.isdecimal() or not 1 <= int(key) <= len(place):
                raise SceneError(f"the override {override!r} refers to log {key} of {len(place)}; count them from 1")
            place = place[int(key) - 1]
        elif isinstance(place, dict):
            place = place.setdefault(key, {})
    if not isinstance(place, dict):
        raise SceneError(f"the override {override!r} leads into {place!r}, which is no table; shorten the key")
    place[keys[-1]] = text.strip()  # where the shell took the quotes away
    with suppress(ValueError):
        value = parsed(f"value = {text}")
        place[keys[-1]] = value["value"] if len(value) == 1 else text.strip()


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


def question_bare_numbers(document: Mapping[str, object]) -> None:
    """Refuse a number without a unit that no tribometer has in SI: its unit was forgotten.

    Raises:
        SceneError: which one, and how to write it.
    """
    logs = document.get("logs")
    tables = {f"[[logs]] number {n}": log for n, log in enumerate(logs if isinstance(logs, list) else [], 1)}
    for where, table in (tables | {"[rig]": document.get("rig")}).items():
        for name, key in RIG.items() if isinstance(table, Mapping) else ():
            stated: object = table.get(name)
            value = stated.get("value") if isinstance(stated, Mapping) else stated
            pairs = value if isinstance(value, list) else [[0, value]]
            for number in (pair[1] for pair in pairs if isinstance(pair, list) and len(pair) > 1):
                plain = isinstance(number, (int, float)) and not isinstance(number, bool) and 0.0 < abs(number) < 1e300
                if key.usual and plain and not key.usual[0] <= abs(number) <= key.usual[1]:
                    raise SceneError(
                        f"{where} {name} is the bare number {number:g}, that is {number:g} {key.unit}, which no usual "
                        f'tribometer has; write its unit: "{number:g} {key.usual[2]}", or "{number:g} {key.unit}" if '
                        "so meant"
                    )
