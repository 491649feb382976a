"""result.json written as strict JSON, and that of an earlier fit read again with the scene it was fitted with."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from identify.base.document import Json
from identify.base.errors import DocumentError, FitError, SceneError
from identify.base.result import Result
from identify.scene import Scene

# ----------------------------------------------------------------------------------------------------------------------
# result.json: the document of a fit as strict JSON.
# ----------------------------------------------------------------------------------------------------------------------


def plain(value: object) -> Any:
    """The value as JSON knows it: dict, list, str, int, float, bool or None.

    NaN and infinities become None (the interface: infinite or missing is null); numpy scalars and
    arrays become numbers and lists; paths and enumerations their text. TypeError for anything else.
    """
    if value is None or (isinstance(value, bool | str | int) and not isinstance(value, Enum)):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        finite = np.isfinite(value)
        return (value if finite.all() else np.where(finite, value.astype(object), np.array(None))).tolist()
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, PurePath):
        return str(value)
    raise TypeError(f"a result holds {type(value).__name__}, which JSON does not know; make it numbers or text")


def as_json(document: Mapping[str, object]) -> str:
    """The text of a document: strict JSON, no NaN, readable by a person, ending in a newline."""
    return json.dumps(plain(document), ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def read_document(path: Path) -> dict[str, Json]:
    """The document of a stored result.

    Raises:
        FitError: no such file, or no result of ours.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FitError(f"{path}: no such file; give the result.json of a fit") from None
    except IsADirectoryError:
        raise FitError(f"{path}: this is a folder; give the result.json in it") from None
    except (ValueError, RecursionError):
        raise FitError(f"{path}: this is not JSON; give the result.json of a fit") from None
    if isinstance(document, Mapping) and document.get("schema", 1) != 1:
        raise FitError(
            f"{path}: its schema is {document['schema']!r}; expected 1; read it with the version that wrote it"
        )
    if not _is_result(document):
        raise FitError(f"{path}: this is no result of a fit; give a result.json that stickslip fit wrote")
    return dict(document)


def read_result(path: Path) -> Result:
    """A stored result; errors as `read_document`."""
    return Result.from_dict(read_document(path))


def scene_of(result: Result, path: Path | str) -> Scene:
    """The scene that a result was fitted with.

    Raises:
        FitError: what is recorded there is no scene any more.
    """
    try:
        return Scene.from_document(result.scene)
    except SceneError as error:
        raise FitError(f"{path}: the scene recorded there: {error}") from None


def _is_result(document: object) -> bool:
    """Whether the parts that commands read are there and of the right kind."""
    if not isinstance(document, Mapping) or not {"status", "parameters", "logs", "provenance"} <= set(document):
        return False
    try:
        result = Result.from_dict(document)
    except DocumentError:
        return False
    logs, estimated = result.scene.get("logs", ()), () if result.correlation is None else result.correlation.names
    if not isinstance(result.provenance.get("scene"), Mapping) or not isinstance(logs, Sequence):
        return False
    if set(result.numbers) != set(range(len(logs))):
        return False
    told = all(log.sha256 is not None for log in result.logs)
    return told and all(e.verdict for e in result.parameters.values()) and set(estimated) <= set(result.parameters)
