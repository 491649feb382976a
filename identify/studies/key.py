"""The content key of a fit: what its numbers depend on, and nothing else."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

PACKAGES = ("casadi", "numpy", "scipy", "pandas", "h5py")  # whose numbers a fit uses
OUTSIDE = (
    "cli",
    "report",
    "comparing",
    "pooling",
    "batch",
    "examples",
)  # folders of identify that make no number of a fit


@lru_cache(maxsize=1)
def numerics() -> str:
    """The version of the numerics: this package's version, a hash of the source that makes the numbers, libraries."""
    import data_io
    import identify

    digest = hashlib.sha256()
    for package in (data_io, identify):
        folder = Path(str(package.__file__)).parent
        for path in sorted(folder.rglob("*.py")):
            inside = path.relative_to(folder)
            if inside.parts[0] not in OUTSIDE:
                digest.update(f"{folder.name}/{inside.as_posix()}\n".encode())
                digest.update(path.read_bytes())
    versions = " ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    return f"{importlib.metadata.version('stick-slip-workbench')}+{digest.hexdigest()[:12]} {versions}"


def content_key(scene: Mapping[str, Any], sha256: Sequence[str], version: str) -> str:
    """SHA-256 over the scene, the contents of its logs and the version of the numerics.

    Args:
        scene: the document of the scene, SI. Its name and where the logs lie do not count.
        sha256: of each log's file, in the scene's order.
        version: as `numerics` gives it.
    """
    logs = [
        {key: value for key, value in log.items() if key != "path"} | {"sha256": digest}
        for log, digest in zip(scene["logs"], sha256, strict=True)
    ]
    content = {key: value for key, value in scene.items() if key != "name"} | {"logs": logs}
    text = json.dumps([content, version], sort_keys=True, ensure_ascii=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("ascii")).hexdigest()
