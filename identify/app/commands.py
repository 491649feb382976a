"""From what a form of the page asks to the words of the command line: only these commands, only paths of the folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from identify.app.folder import Folder, PageError

LONGEST = 500  # characters of a word
MOST = 10_000  # words of a list


@dataclass(frozen=True)
class PageCommand:
    """One command the page may run: what of it are paths (several, one), what is text, what is yes or no; `out` names
    what it writes."""

    name: str
    positional: str
    paths: tuple[str, ...]
    texts: tuple[str, ...] = ()
    lists: tuple[str, ...] = ()
    switches: tuple[str, ...] = ()
    out: str = "out"


KINDS = {
    kind.name: kind
    for kind in (
        PageCommand("fit", "logs", ("scene", "out"), ("accuracy", "time-limit", "starts"), ("set",),
             ("profile", "accuracy-table")),
        PageCommand("scene", "logs", ("out",)),
        PageCommand("rig", "logs", ("out",), (), ("drive-speed", "added-mass")),
        PageCommand("plan", "source", ("out",), ("budget",), ("set",)),
        PageCommand("batch", "source", ("scene", "out"), ("jobs", "time-limit"), (), ("resume",)),
        PageCommand("compare", "fits", ("out",), ("by",)),
        PageCommand("stability", "", ("scene", "result", "plot", "data"), ("points",), ("map", "at", "range"),
             ("advice",), out="data"),
    )
}  # fmt: skip


def words_of(folder: Folder, asked: Mapping[str, Any]) -> tuple[list[str], str]:
    """The words after `stickslip`, and what the command writes (a path in the folder, "" for nothing).

    Raises:
        PageError: an unknown command or option, or a path outside the folder.
    """
    kind = KINDS.get(str(asked.get("command")))
    if kind is None:
        raise PageError(f"the page runs no such command; expected one of {', '.join(KINDS)}")
    known = {"command", kind.positional, *kind.paths, *kind.texts, *kind.lists, *kind.switches}
    if foreign := sorted(set(asked) - known):
        raise PageError(f"{kind.name} has no option {foreign[0]!r} in the page; use the command line for it")
    words = [kind.name]
    if kind.positional:
        words += [_path(folder, text) for text in _list(asked.get(kind.positional))]
    for key in kind.paths:
        if asked.get(key):
            words += [f"--{key}", _path(folder, asked[key])]
    for key in kind.texts:
        if asked.get(key):
            words.append(f"--{key}={_text(asked[key])}")
    for key in kind.lists:
        if key == "map" and asked.get(key):
            words += ["--map", *(_name(item) for item in _list(asked[key]))]
        else:
            words += [f"--{key}={_text(item)}" for item in _list(asked.get(key))]
    words += [f"--{key}" for key in kind.switches if asked.get(key)]
    return words, str(asked.get(kind.out) or "")


def _path(folder: Folder, text: object) -> str:
    """A path that no command takes for an option."""
    name = folder.name(folder.path(text))
    return f"./{name}" if name.startswith("-") else name


def _list(value: Any) -> Sequence[Any]:
    items = [] if value is None else value if isinstance(value, list) else [value]
    if len(items) > MOST:
        raise PageError(f"{len(items)} items were chosen; at most {MOST} were expected; choose fewer")
    return items


def _text(value: Any) -> str:
    text = str(value)
    if not isinstance(value, (str, int, float)) or len(text) > LONGEST or not text.isprintable():
        raise PageError("an option holds something else than a short text; write it again")
    return text


def _name(value: Any) -> str:
    text = _text(value)
    if not text.isidentifier():
        raise PageError(f"{text!r} is no quantity of a map; choose one from the list")
    return text
