"""Scene files as the page edits them: the text is the scene, the form writes into it, drafts are kept until saved."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Table

from data_io.atomic import atomic_write
from identify.app.folder import Document, Folder, PageError, mapping
from identify.base.errors import SceneError
from identify.effects import ALL, MAIN
from identify.effects.quantities import Effect
from identify.report.report_wording import plain_symbol
from identify.scene import Scene
from identify.scene.parts import declared_by
from identify.scene.toml import parsed, question_bare_numbers

LONGEST = 1_000_000  # characters of a scene file
INVALID = "the text beside the form is no valid TOML; correct it there first"
NEEDED = ("mass", "stiffness", "damping")
RIG_FIELDS = {
    "mass": ("moving mass", "kg", "Weigh what moves with the contact: holder, specimen, half of the springs."),
    "stiffness": ("stiffness", "N/m", "Hang a known weight on the holder and read the deflection; or take the stick "
                  "slope over the drive speed, beside each log."),
    "damping": ("damping h", "N/m", "Pluck the holder out of contact and record it ringing down: if n swings later 1/e "
                "is left, the damping ratio is 1/(2 pi n); `stickslip rig` reads it off such a record."),
    "drive_speed": ("drive speed", "m/s", "Where it is the same in all logs; else in each log."),
    "normal_force": ("normal force", "N", "Only where the logs have no column of it."),
    "noise": ("noise of the force", "N", "Left out it is estimated from straight sticks."),
    "force_sensor": ("force measured", "", "Between drive and mass (drive), or by a plate under the counterface."),
}  # fmt: skip
DAMPINGS = {
    "damping": ("damping h", "N/m"),
    "zeta": ("damping ratio zeta", "no unit"),
    "loss_factor": ("loss factor", "no unit"),
    "log_decrement": ("logarithmic decrement", "no unit"),
}
LOG_FIELDS = ("path", "drive_speed", "step", "window", "exclude", "skip_cycles", "tare", "normal_force", "labels")
PLACES = (  # where a sentence about a scene names a field
    re.compile(r"still to fill in: ([\w.]+)"),
    re.compile(r"\[(rig|fit|contact|initial|tolerances|quality)\] (?:has no )?(\w+)"),
    re.compile(r"\[(parameters)\] (\w+)(?: (\w+))?"),
    re.compile(r"\[\[(logs)\]\] number (\d+)(?: (\w+))?"),
    re.compile(r"(effects)"),
)


class Scenes:
    """The scene files of a folder and their drafts."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder

    def text(self, name: str) -> str:
        """The draft of a scene, else its file."""
        path, draft = self._folder.path(name), self._draft(name)
        if draft.is_file() and (not path.is_file() or draft.stat().st_mtime_ns > path.stat().st_mtime_ns):
            path = draft
        try:
            return path.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError:
            raise PageError(f"{name} is not UTF-8 text; save it as UTF-8") from None
        except OSError:
            raise PageError(f"{name}: there is no such scene; choose one from the list") from None

    def keep(self, name: str, text: str) -> Document:
        """Keep a draft, valid or not, so that nothing typed is lost; how it is seen then."""
        if not name.endswith(".toml") or len(text) > LONGEST:
            raise PageError(f"{name!r} is no scene; expected a name that ends in .toml, and a text that people write")
        path, draft = self._folder.path(name), self._draft(name)
        with atomic_write(draft) as handle:
            handle.write(text)
        if path.is_file():  # newer than its file also where the clock was set back
            os.utime(draft, ns=(newest := max(path.stat().st_mtime_ns + 1, draft.stat().st_mtime_ns), newest))
        return self.seen(name)

    def save(self, name: str) -> Document:
        """Write the draft to its file; how it is seen then."""
        text, path = self.text(name), self._folder.path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as handle:
            handle.write(text)
        self._draft(name).unlink(missing_ok=True)
        return self.seen(name)

    def scene(self, name: str) -> Scene:
        """The scene that the text makes, draft or not."""
        path = self._folder.path(name)
        try:
            document = parsed(self.text(name))
        except ValueError as error:
            raise SceneError(f"this is not valid TOML ({error}); correct that line") from None
        question_bare_numbers(document)
        return Scene.from_document({"name": path.stem, **document}, path.parent)

    def seen(self, name: str) -> Document:
        """What the page shows of a scene: its text, whether it differs from the file, the fields of its form, and what
        is wrong with it (a sentence and the dotted name of the field)."""
        text, path = self.text(name), self._folder.path(name)
        file = path.read_text(encoding="utf-8-sig") if path.is_file() else None
        scene, wrong, form = None, "", None
        try:
            scene = self.scene(name)
        except SceneError as error:
            wrong = str(error)
        with suppress(ValueError):
            form = form_of(parsed(text), scene)
        found = next((match for pattern in PLACES if (match := pattern.search(wrong))), None)
        place = ".".join(part for part in found.groups() if part) if found else ""
        return {"path": name, "text": text, "saved": text == file, "form": form, "error": wrong, "place": place}

    def _draft(self, name: str) -> Path:
        return self._folder.own("drafts", name.replace("/", "⁄"))


# Fields into the text, comments and order kept.


def edited(text: str, keys: Sequence[str], value: object) -> str:
    """The text with one value put in, everything else as it stands, comments too.

    Args:
        keys: the way there; logs are counted from 1. value: text as a person types it (a number without a unit becomes
            a number), a list or a table; None or "" takes the key out.
    """
    if not keys or not all(isinstance(key, str) and re.fullmatch(r"[\w-]{1,60}", key) for key in keys):
        raise PageError("no field of a scene has this name; load the page again")
    document = _document(text)
    place: Any = document
    for number, key in enumerate(keys[:-1]):
        if isinstance(place, (AoT, list)):
            if not key.isdecimal() or not 1 <= int(key) <= len(place):
                raise PageError(f"the scene has {len(place)} logs; there is no number {key}")
            place = place[int(key) - 1]
        else:
            if key not in place:
                _put(place, key, tomlkit.table() if number == 0 else tomlkit.inline_table())
            place = place[key]
    last = keys[-1]
    if isinstance(place, (AoT, list)) and last.isdecimal() and value is None:
        del place[int(last) - 1]
    elif not isinstance(place, (dict, Table)):
        raise PageError(f"{'.'.join(keys)} leads into something that is no table; correct the text beside the form")
    elif value is None or value in ("", []):
        place.pop(last, None)
    else:
        if isinstance(place.get(last), Table) and not isinstance(value, Mapping):
            del place[last]  # a value stands before all tables, wherever the table was
        _put(place, last, _typed(value))
    return tomlkit.dumps(document)


def with_log(text: str, path: str) -> str:
    """The text with one more log at its end."""
    document, entry = _document(text), tomlkit.table()
    entry["path"] = path
    logs = document.setdefault("logs", tomlkit.aot())
    if not isinstance(logs, AoT):
        raise PageError("[[logs]] of the scene is no list of tables; correct the text beside the form")
    logs.append(entry)
    return tomlkit.dumps(document)


def _document(text: str) -> tomlkit.TOMLDocument:
    try:
        return tomlkit.parse(text)
    except (TOMLKitError, ValueError):
        raise PageError(INVALID) from None


def _put(table: Any, key: str, value: object) -> None:
    """Put a value into a table, a new one before the comments at its end, which belong to what follows."""
    tail: list[object] = []
    if isinstance(table, Table):
        body = table.value.body
        while body and body[-1][0] is None:
            tail.insert(0, body.pop())
    table[key] = value
    if tail:
        table.value.body.extend(tail)


def _typed(value: object) -> object:
    """Text as TOML: a list, a table, a number, else the text."""
    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        table.update({key: _typed(item) for key, item in value.items()})
        return table
    if not isinstance(value, str):
        return value
    text = value.strip()
    if text.startswith(("[", "{")):
        with suppress(TOMLKitError, ValueError):
            return tomlkit.value(text)
        return text
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


# The form.


def form_of(document: Document, scene: Scene | None) -> Document:
    """The fields of the form with what the text has in each, as text; of effects and parameters what they are."""
    listed = document.get("effects")
    on = [name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []
    rig, stated = mapping(document.get("rig")), mapping(document.get("parameters"))
    damping = next((key for key in DAMPINGS if key in rig), "damping")
    fields = []
    for name, (label, unit, how) in RIG_FIELDS.items():
        key = damping if name == "damping" else name
        label, unit = DAMPINGS.get(key, (label, unit))
        field = {"key": key, "label": label, "unit": unit, "help": how, "value": _shown(rig.get(key))}
        fields.append(field | {"needed": name in NEEDED, "guess": key in NEEDED, "searched": _shown(stated.get(key))})
    return {
        "name": _shown(document.get("name")),
        "auto": listed == "auto",
        "rig": fields,
        "rig_file": document["rig"] if isinstance(document.get("rig"), str) else "",
        "time_limit": _shown(mapping(document.get("fit")).get("time_limit")),
        "effects": [_effect(effect, effect.name in on, scene) for effect in ALL],
        "parameters": _parameters(on if listed != "auto" else MAIN, stated, scene),
        "logs": [{key: _shown(mapping(log).get(key)) for key in LOG_FIELDS} for log in document.get("logs") or []],
    }


def _shown(value: object) -> str:
    """A value of the text as a person would type it."""
    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        table.update(value)
        return str(table.as_string())
    return "" if value is None else str(tomlkit.item(value).as_string()) if isinstance(value, list) else str(value)


def _effect(effect: Effect, on: bool, scene: Scene | None) -> Document:
    """An effect as a switch: what it is for, what it adds to the model, and when it matters by the numbers of the
    scene."""
    matters = ""
    if scene is not None and on:
        drives = [scene.rig.drive_speed, *(scene.rig_for(entry).drive_speed for entry in scene.logs)]
        speed = next((abs(drive) for drive in drives if isinstance(drive, float) and drive), 1e-3)
        with suppress(KeyError, ZeroDivisionError, OverflowError, ValueError):
            importance = effect.importance(scene.values(), scene.rig.normal_force or 1.0, speed)
            matters = importance.sentence if importance else ""
    names = ("name", "says", "role")
    return {name: getattr(effect, name) for name in names} | {
        "on": on,
        "needs": list(effect.needs),
        "states": len(effect.states),
        "parameters": [p.name for p in effect.parameters],
        "searched": sum(p.kind == "friction" for p in effect.parameters),
        "matters": matters,
    }


def _parameters(on: Sequence[str], stated: Mapping[str, object], scene: Scene | None) -> list[Document]:
    """What the form shows of the parameters of these effects; of the rig's it has fields of their own."""
    try:
        declared = declared_by(tuple(effect.name for effect in ALL if effect.name in on))
    except SceneError:
        return []
    values = scene.values() if scene is not None else {}
    rows = []
    for p in (one for one in declared if one.kind != "rig"):
        given = stated.get(p.name)
        table = given if isinstance(given, Mapping) else {} if given is None else {"fixed": given}
        typed = {word: _shown(table.get(word)) for word in ("start", "lower", "upper", "fixed")}
        names = ("name", "unit", "meaning", "kind")
        numbers = {"lowest": p.lower, "highest": p.upper, "value": values.get(p.name, p.default)}
        described = {name: getattr(p, name) for name in names} | {"symbol": plain_symbol(p.name)}
        rows.append(described | {"logarithmic": p.scale == "log"} | numbers | typed)
    return rows
