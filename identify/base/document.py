"""Frozen dataclasses as JSON documents, and back: their fields are the one schema for who writes and who reads."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path, PurePath
from types import MappingProxyType, NoneType, UnionType
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from identify.base.errors import DocumentError

if TYPE_CHECKING:
    Json: TypeAlias = "bool | int | float | str | Mapping[str, Json] | Sequence[Json] | None"
else:
    Json = object  # whatever stands there is passed on

T = TypeVar("T")

# Metadata of fields: a key is absent where the field has its default, or it holds further keys of the same object.
OMITTED = MappingProxyType({"omitted": True})
FURTHER = MappingProxyType({"further": True})
JSON_TYPES = {str: "string", bool: "boolean", int: "integer", float: "number", NoneType: "null"}
# What stands in the folder of a result, the document first.
RESULT_FILES = ("result.json", "report.html", "result.h5", "classical.csv", "parameters.tex", "figures")
EXPECTED = {str: "text", bool: "true or false", int: "a whole number", float: "a number"}


def finite(value: object) -> float | None:
    """The value as a finite float, else None (null, NaN, text, truth values)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def to_document(value: object) -> Json:
    """The value as JSON knows it: dict, list, str, int, finite float, bool or None.

    Dataclasses become dicts by their fields, arrays lists, paths and enumerations their text; NaN and infinities None
    (infinite or missing is null). TypeError for anything else.
    """
    if isinstance(value, Enum):
        return to_document(value.value)
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float):
        return finite(value)
    if isinstance(value, Mapping) or is_dataclass(value):
        return to_dict(value)
    if isinstance(value, tuple | list):
        return [to_document(item) for item in value]
    if isinstance(value, PurePath):
        return str(value)
    if hasattr(value, "tolist"):  # of numpy
        return to_document(value.tolist())
    raise TypeError(f"a document holds {type(value).__name__}, which JSON does not know; make it numbers or text")


def to_dict(value: object) -> dict[str, Json]:
    """The document of a dataclass or of a mapping."""
    if isinstance(value, Mapping):
        return {str(key): to_document(item) for key, item in value.items()}
    out: dict[str, Json] = {}
    for field in fields(value):  # type: ignore[arg-type]
        item = getattr(value, field.name)
        if "further" in field.metadata:
            out |= to_dict(item)
        elif not ("omitted" in field.metadata and item == field.default):
            out[field.metadata.get("key", field.name)] = to_document(item)
    return out


def read_json(path: Path) -> dict[str, Any] | None:
    """A JSON object that is whole; None where there is none, or it is half written."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) else None


def as_json(document: object) -> str:
    """The text of a document: strict JSON, no NaN, readable by a person, ending in a newline."""
    return json.dumps(to_document(document), ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def json_schema(kind: object) -> dict[str, object]:
    """The JSON schema (draft 2020-12) of the documents that `to_document` makes of values of a type; the metadata
    "schema" of a field narrows what may stand there."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is object:
        return {}
    if origin in (Union, UnionType):
        return {"anyOf": [json_schema(each) for each in arguments]}
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin is Mapping:
        return {"type": "object", "additionalProperties": json_schema(arguments[1])}
    if origin is tuple:
        if arguments[-1] is Ellipsis:
            return {"type": "array", "items": json_schema(arguments[0])}
        count = {"minItems": len(arguments), "maxItems": len(arguments)}
        return {"type": "array", "prefixItems": [json_schema(each) for each in arguments], **count}
    if not is_dataclass(kind):
        return {"type": JSON_TYPES[cast("type", kind)]}
    known = [(f.metadata.get("key", f.name), f, each) for f, each in _fields_of(cast("type", kind))]
    own = [(key, f, each) for key, f, each in known if "further" not in f.metadata]
    return {
        "type": "object",
        "properties": {key: json_schema(each) | f.metadata.get("schema", {}) for key, f, each in own},
        "required": [key for key, f, _ in own if "omitted" not in f.metadata],
        "additionalProperties": len(own) < len(known),
    }


def from_document(kind: type[T], document: object, where: str = "the document") -> T:
    """The dataclass of a document; keys that it does not know are left out, unless a field holds further ones.

    Numbers that are not finite are None where the field may be None; `where` names the document in sentences.

    Raises:
        DocumentError: something is missing, or of another kind than expected.
    """
    return cast("T", _read(kind, document, where))


def _read(kind: object, data: object, where: str) -> object:
    """What stands in a document as a value of a type."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is object:
        return data
    if origin in (Union, UnionType):
        if data is None or (isinstance(data, float) and not math.isfinite(data)):
            return None
        return _read(next(each for each in arguments if each is not NoneType), data, where)
    if origin is Mapping or is_dataclass(kind):
        if not isinstance(data, Mapping):
            raise DocumentError(f"{where} is {data!r:.80}; expected a table")
        if is_dataclass(kind):
            return _read_object(cast("type", kind), data, where)
        return {str(key): _read(arguments[1], item, f"{where} {key}") for key, item in data.items()}
    if origin is tuple:
        repeated = arguments[-1] is Ellipsis
        if isinstance(data, str) or not isinstance(data, Sequence):
            raise DocumentError(f"{where} is {data!r:.80}; expected a list")
        if not repeated and len(data) != len(arguments):
            raise DocumentError(f"{where} is {data!r:.80}; expected a list of {len(arguments)} items")
        kinds = arguments[:1] * len(data) if repeated else arguments
        return tuple(_read(each, item, where) for each, item in zip(kinds, data, strict=True))
    plain = str if origin is Literal else cast("type", kind)
    if plain in (int, float):
        right = isinstance(data, int | float) and not isinstance(data, bool) and (plain is float or data == data // 1)
    else:
        right = isinstance(data, plain)
    if not right:
        raise DocumentError(f"{where} is {data!r:.80}; expected {EXPECTED[plain]}")
    return cast("object", plain(data))


def _read_object(kind: type, table: Mapping[str, object], where: str) -> object:
    values: dict[str, object] = {}
    left = dict(table)
    for field, each in _fields_of(kind):
        key = field.metadata.get("key", field.name)
        needed = field.default is MISSING and field.default_factory is MISSING
        if "further" in field.metadata:
            continue
        if table.get(key) is not None or (key in table and needed):
            values[field.name] = _read(each, table[key], f"{where}: {key}")
        elif needed:
            raise DocumentError(f"{where} has no {key!r}; expected {kind.__name__} with it")
        left.pop(key, None)
    further = [(field.name, each) for field, each in _fields_of(kind) if "further" in field.metadata]
    return kind(**values, **{name: _read(each, left, where) for name, each in further})


@cache
def _fields_of(kind: type) -> list[tuple[Field[object], object]]:
    hints = get_type_hints(kind)
    return [(field, hints[field.name]) for field in fields(kind)]
