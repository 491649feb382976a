"""result.json: the document of a fit as strict JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
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
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, PurePath):
        return str(value)
    raise TypeError(f"a result holds {type(value).__name__}, which JSON does not know; make it numbers or text")


def as_json(result: Mapping[str, Any]) -> str:
    """The text of result.json: strict JSON, no NaN, readable by a person, ending in a newline."""
    return json.dumps(plain(result), ensure_ascii=False, allow_nan=False, indent=1) + "\n"
