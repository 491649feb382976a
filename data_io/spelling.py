"""Misspelt names are answered by the nearest known one."""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, ParamSpec, TypeVar

Given = ParamSpec("Given")
Answer = TypeVar("Answer")
LONGEST_WORD = 60  # characters of a word that are compared with known ones


def nearest(word: str, known: Iterable[str]) -> str:
    """The known word that looks most like this one."""
    start = word[:LONGEST_WORD].lower()
    return max(known, key=lambda name: difflib.SequenceMatcher(None, start, name.lower()).ratio())


def spelled(function: Callable[Given, Answer]) -> Callable[Given, Answer]:
    """The function, which answers a keyword it does not know by the nearest of its own."""
    known = inspect.signature(function).parameters

    @functools.wraps(function)
    def called(*args: Given.args, **kwargs: Given.kwargs) -> Answer:
        for key in kwargs.keys() - known.keys():
            raise TypeError(f"{function.__name__} has no argument {key!r}; did you mean {nearest(key, known)!r}?")
        return function(*args, **kwargs)

    return called


class Spelled:
    """A dataclass that answers a misspelt field, and its objects a misspelt attribute, by the nearest of their own."""

    if not TYPE_CHECKING:  # types know the names

        def __new__(cls, *_: object, **fields: object) -> Spelled:  # noqa: D102
            for key in fields.keys() - cls.__dataclass_fields__.keys():
                raise TypeError(
                    f"{cls.__name__} has no {key!r}; did you mean {nearest(key, cls.__dataclass_fields__)!r}?"
                )
            return super().__new__(cls)

        def __getattr__(self, name: str) -> None:
            close = "" if name.startswith("_") else f"; did you mean {nearest(name, dir(self))!r}?"
            raise AttributeError(f"a {type(self).__name__} has no {name!r}{close}")
