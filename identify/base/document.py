"""Frozen dataclasses as JSON documents, and back: their fields are the one schema for who writes and who reads."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import MappingProxyType, NoneType, UnionType
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from identify.base.errors import DocumentError

if TYPE_CHECKING:
    Json: TypeAlias = "bool | int | float | str | Mapping[str, Json] | Sequence[Json] | None"
else:
    Json = object  # whatever stands there is passed on

T = TypeVar("T")
Converter = Callable[[object, str], object]

# Metadata of fields: a key is absent where the field has its default, or it holds further keys of the same object.
OMITTED = MappingProxyType({"omitted": True})
FURTHER = MappingProxyType({"further": True})


def finite(value: object) -> float | None:
    """The value as a finite float, else None (null, NaN, text, truth values)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def to_document(value: object) -> Json:
    """A dataclass as nested dicts and lists of what JSON knows; values that are none of ours stay as they are."""
    if isinstance(value, Mapping):
        return {str(key): to_document(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [to_document(item) for item in value]
    if not is_dataclass(value):
        return cast("Json", value)
    out: dict[str, Json] = {}
    for field in fields(value):
        item = getattr(value, field.name)
        if "further" in field.metadata:
            out |= cast("dict[str, Json]", to_document(item))
        elif not ("omitted" in field.metadata and item == field.default):
            out[field.metadata.get("key", field.name)] = to_document(item)
    return out


def to_dict(value: object) -> dict[str, Json]:
    """The document of a dataclass."""
    document = to_document(value)
    assert isinstance(document, dict)
    return document


def from_document(kind: type[T], document: object, where: str = "the document") -> T:
    """The dataclass of a document; keys that it does not know are left out, unless a field holds further ones.

    Numbers that are not finite are None where the field may be None. Where `kind` is read from must be told, for
    sentences on what is wrong.

    Raises:
        DocumentError: something is missing, or of another kind than expected.
    """
    return cast("T", _converter(cast("object", kind))(document, where))


@cache
def _converter(kind: object) -> Converter:
    """How what stands in a document becomes a value of a type."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind in (object, str, bool, int, float):
        return _PLAIN[cast("type", kind)]
    if origin is Literal:
        return _text
    if origin in (Union, UnionType):
        inner = _converter(next(each for each in arguments if each is not NoneType))
        return lambda data, where: None if _is_nothing(data) else inner(data, where)
    if origin is Mapping:
        item = _converter(arguments[1])
        return lambda data, where: {
            str(key): item(value, f"{where} {key}") for key, value in _table(data, where).items()
        }
    if origin is tuple:
        repeated = len(arguments) == 2 and arguments[1] is Ellipsis
        items = [_converter(argument) for argument in arguments if argument is not Ellipsis]

        def listed(data: object, where: str) -> tuple[object, ...]:
            found = _list(data, where)
            if not (repeated or len(found) == len(items)):
                raise DocumentError(f"{where} is {data!r:.80}; expected a list of {len(items)} items")
            each = items * len(found) if repeated else items
            return tuple(item(value, where) for item, value in zip(each, found, strict=True))

        return listed
    assert is_dataclass(kind), kind
    return _object(cast("type", kind))


def _object(kind: type) -> Converter:
    hints, known = get_type_hints(kind), fields(kind)
    further = next((field.name for field in known if "further" in field.metadata), None)
    plan = [
        (field.name, field.metadata.get("key", field.name), _converter(hints[field.name]), _is_needed(field))
        for field in known
        if field.name != further
    ]

    own = {key for _, key, *_ in plan}

    def read(data: object, where: str) -> object:
        table, values = _table(data, where), {}
        for name, key, convert, needed in plan:
            if table.get(key) is not None or (key in table and needed):
                values[name] = convert(table[key], f"{where}: {key}")
            elif needed:
                raise DocumentError(f"{where} has no {key!r}; expected {kind.__name__} with it")
        if further is not None:
            rest = {key: value for key, value in table.items() if key not in own}
            values[further] = _converter(hints[further])(rest, where)
        return kind(**values)

    return read


def _is_needed(field: object) -> bool:
    return field.default is MISSING and field.default_factory is MISSING  # type: ignore[attr-defined]


def _is_nothing(data: object) -> bool:
    return data is None or (isinstance(data, float) and not math.isfinite(data))


def _table(data: object, where: str) -> Mapping[str, object]:
    if not isinstance(data, Mapping):
        raise DocumentError(f"{where} is {data!r:.80}; expected a table")
    return data


def _list(data: object, where: str) -> Sequence[object]:
    if isinstance(data, str) or not isinstance(data, Sequence):
        raise DocumentError(f"{where} is {data!r:.80}; expected a list")
    return data


def _text(data: object, where: str) -> str:
    if not isinstance(data, str):
        raise DocumentError(f"{where} is {data!r:.80}; expected text")
    return data


def _truth(data: object, where: str) -> bool:
    if not isinstance(data, bool):
        raise DocumentError(f"{where} is {data!r:.80}; expected true or false")
    return data


def _number(data: object, where: str) -> float:
    if isinstance(data, bool) or not isinstance(data, int | float):
        raise DocumentError(f"{where} is {data!r:.80}; expected a number")
    return float(data)


def _whole(data: object, where: str) -> int:
    if isinstance(data, bool) or not isinstance(data, int | float) or not math.isfinite(data) or data != int(data):
        raise DocumentError(f"{where} is {data!r:.80}; expected a whole number")
    return int(data)


_PLAIN: Mapping[type, Converter] = {
    object: lambda data, _where: data,
    str: _text,
    bool: _truth,
    int: _whole,
    float: _number,
}
