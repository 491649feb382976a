"""Small frozen values that everything here is made of: errors, findings, steps, a mapping that cannot change."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, TypeVar, cast

import numpy as np
import numpy.typing as npt


class LogError(Exception):
    """A log cannot be read, written or accepted as a record; the text is the whole sentence, path included."""


class LogTooLargeError(LogError):
    """The columns of a log do not fit into memory."""


class UnitError(ValueError):
    """A quantity or unit cannot be understood; the text is the whole sentence."""


FloatArray = npt.NDArray[np.float64]
Scalar = str | int | float | bool
Severity = Literal["info", "warning", "reject"]
SEVERITIES: Final = ("info", "warning", "reject")

LONGEST_GAP: Final = 5
"""Rows in a row without a finite number that are kept as NaN; a longer block is an error."""

SIZES: Final = {"s": (1e-9, 1e9), "m/s": (1e-12, 1e4), "N": (1e-12, 1e9)}
"""The least and the largest size, by unit, of what is measured or stated; what lies beyond has a wrong unit."""

LARGEST_FORCE: Final = SIZES["N"][1]
"""Newtons that no tribometer measures; larger numbers (9.9e37, 1e30) are marks of overflow."""

COLUMN_ROLES: Final = ("time", "normal_force", "friction_force", "drive_speed")
"""Names that no channel may carry."""

K = TypeVar("K")
V = TypeVar("V")


class Frozen(Mapping[K, V]):
    """A mapping that cannot change and, unlike `types.MappingProxyType`, can be sent to another process.

    A value that is a function is called, once, when it is first asked for.
    """

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[K, V] | None = None) -> None:
        # a mapping of this kind may hold values that nobody has asked for yet
        self._items: dict[K, object] = dict(items._items if isinstance(items, Frozen) else items or {})

    def __getitem__(self, key: K) -> V:
        value = self._items[key]
        if callable(value):
            value = self._items[key] = value()
        return cast(V, value)

    def __reduce__(self) -> tuple[object, ...]:
        return Frozen, (dict(self),)

    def __iter__(self) -> Iterator[K]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return repr(dict(self))


@dataclass(frozen=True)
class Finding:
    """Something a reader or the quality gate noticed: a code for programs, a sentence for people."""

    code: str
    severity: Severity
    message: str


@dataclass(frozen=True)
class Step:
    """Rows [start, stop) of a record that belong to one step of the test, with the step's own parameters."""

    run: int
    number: int
    start: int
    stop: int
    parameters: Mapping[str, str] = field(default_factory=Frozen)

    def __post_init__(self) -> None:
        plain = {str(key).replace("\0", ""): str(value).replace("\0", "") for key, value in self.parameters.items()}
        object.__setattr__(self, "parameters", Frozen({key: value for key, value in plain.items() if key}))


def listed(items: Iterable[object], most: int = 12) -> str:
    """Return the first of many things for a sentence, and how many more there are."""
    words = [str(item) for item in items]
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")


def free_name(name: str, taken: Collection[str]) -> str:
    """Return the name, with a number behind it where it is already taken."""
    if name not in taken:
        return name
    return next(other for i in range(2, len(taken) + 3) if (other := f"{name} ({i})") not in taken)
