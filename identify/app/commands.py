"""From what a form of the page asks to the words of the command line: only these commands, only paths of the folder."""

from __future__ import annotations

from collections.abc import Mapping

from identify.app.folder import Document, Folder, PageError

LONGEST = 500  # characters of a word
MOST = 10_000  # words of a list
# Of each command the page may run, what every option is; "logs", "source" and "fits" stand without a name; the option
# of kind "writes" names what it writes.
COMMANDS: Mapping[str, Mapping[str, str]] = {
    "fit": {"logs": "paths", "scene": "path", "out": "writes", "accuracy": "text", "time-limit": "text",
            "starts": "text", "set": "texts", "profile": "switch", "accuracy-table": "switch"},
    "scene": {"logs": "paths", "out": "writes"},
    "rig": {"logs": "paths", "out": "writes", "drive-speed": "texts", "added-mass": "texts"},
    "plan": {"source": "paths", "out": "writes", "budget": "text", "set": "texts"},
    "batch": {"source": "paths", "scene": "path", "out": "writes", "jobs": "text", "time-limit": "text",
              "resume": "switch"},
    "compare": {"fits": "paths", "out": "writes", "by": "text"},
    "stability": {"scene": "path", "result": "path", "plot": "path", "data": "writes", "points": "text",
                  "map": "quantities", "at": "texts", "range": "texts", "advice": "switch"},
}  # fmt: skip


def words_of(folder: Folder, asked: Document) -> tuple[list[str], str]:
    """The words after `stickslip`, and what the command writes (a path in the folder, "" for nothing)."""
    name = str(asked.get("command"))
    if name not in COMMANDS:
        raise PageError(f"the page runs no such command; expected one of {', '.join(COMMANDS)}")
    options = COMMANDS[name]
    if foreign := sorted(set(asked) - {"command", *options}):
        raise PageError(f"{name} has no option {foreign[0]!r} in the page; use the command line for it")
    words, out = [name], ""
    for key, kind in options.items():
        value = asked.get(key)
        if not value:
            continue
        if kind == "paths":
            words += [_path(folder, text) for text in _list(value)]
        elif kind == "switch":
            words.append(f"--{key}")
        elif kind == "quantities":
            words += [f"--{key}", *(_text(item, of_a_map=True) for item in _list(value))]
        elif kind in ("path", "writes"):
            words += [f"--{key}", _path(folder, value)]
            out = str(value) if kind == "writes" else out
        else:
            words += [f"--{key}={_text(item)}" for item in _list(value)]
    return words, out


def _path(folder: Folder, text: object) -> str:
    """A path that no command takes for an option."""
    name = folder.name(folder.path(text))
    return f"./{name}" if name.startswith("-") else name


def _list(value: object) -> list[object]:
    items = value if isinstance(value, list) else [value]
    if len(items) > MOST:
        raise PageError(f"{len(items)} items were chosen; at most {MOST} were expected; choose fewer")
    return items


def _text(value: object, of_a_map: bool = False) -> str:
    text = str(value)
    if not isinstance(value, (str, int, float)) or len(text) > LONGEST or not text.isprintable():
        raise PageError("an option is no short text; write it again")
    if of_a_map and not text.isidentifier():
        raise PageError(f"{text!r} is no quantity of a map; choose one from the list")
    return text
