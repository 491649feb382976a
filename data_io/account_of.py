"""The account of a record as our files keep it: the file it came from keeps its name and hash, not its folder."""

from pathlib import PurePath
from typing import Any

import numpy as np

from data_io.frozen import Scalar
from data_io.record import Record


def about_of(record: Record) -> dict[str, Any]:
    """Return what is no column as plain values that JSON can hold."""
    about = record.about()
    metadata: dict[str, Scalar] = {k: _plain(v) for k, v in about["metadata"].items()}
    path, digest, form = (metadata.pop(key, None) for key in ("path", "sha256", "format"))
    if path is not None and "source_file" not in metadata:
        metadata["source_file"] = PurePath(str(path)).name
        metadata["source_sha256"] = str(digest)
        metadata["source_format"] = str(form)
    return {**about, "metadata": metadata}


def _plain(value: Scalar) -> Scalar:
    return value.item() if isinstance(value, np.generic) else value
