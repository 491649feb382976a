"""docs/python_reference.md from the docstrings of what is public: `python experiments/make_python_reference.py`."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from types import ModuleType

sys.path.insert(0, str(Path(__file__).parents[1]))

import data_io
import identify

PAGE = Path(__file__).parents[1] / "docs" / "python_reference.md"
HEAD = """# Python: every public name

Made from the docstrings by `python experiments/make_python_reference.py`; read [python.md](python.md) first.
Quantities are in SI; arrays are numpy arrays of the shape in brackets.
"""


def members(package: ModuleType) -> Iterator[tuple[str, object, str]]:
    """Every public function, class, method and property of a package: its name, itself, the docstring around it."""
    for name in package.__all__:
        public = getattr(package, name)
        if isinstance(public, ModuleType):
            about = inspect.getdoc(public) or ""
            here = [f for f in vars(public).values() if inspect.isfunction(f) and f.__module__ == public.__name__]
            yield from ((f"{name}.{f.__name__}", f, about) for f in here if not f.__name__.startswith("_"))
        elif isinstance(public, type):
            about = inspect.getdoc(public) or ""
            yield name, public, about
            methods = ((key, _function(value)) for key, value in vars(public).items() if not key.startswith("_"))
            yield from ((f"{name}.{key}", f, about) for key, f in methods if f is not None)
        elif callable(public):
            yield name, public, ""


def _function(value: object) -> object | None:
    """The function behind a method, a property or a class method; None for a plain value."""
    for kind, attribute in (
        (property, "fget"),
        (cached_property, "func"),
        (classmethod, "__func__"),
        (staticmethod, "__func__"),
    ):
        if isinstance(value, kind):
            return getattr(value, attribute)
    return value if inspect.isfunction(value) else None


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    for package in (identify, data_io):
        parts.append(f"## {package.__name__}\n\n{inspect.getdoc(package)}\n")
        for name, public, _ in members(package):
            level = "####" if "." in name else "###"
            parts.append(f"{level} {name}{_arguments(public)}\n\n```text\n{inspect.getdoc(public)}\n```\n")
    return "\n".join(parts)


def _arguments(public: object) -> str:
    """The names of the arguments of a function."""
    if not inspect.isfunction(public):
        return ""
    names = [name for name in inspect.signature(public).parameters if name not in ("self", "cls")]
    return f"({', '.join(names)})"


def main(fast: bool = False) -> None:
    """Write the page; fast: only make it."""
    text = page()
    if not fast:
        PAGE.write_text(text, encoding="utf-8")
    print(f"{text.count('###')} public names")


if __name__ == "__main__":
    main()
