"""One group of a batch as plain values: what is to be fitted, how that ended, and the key of what its numbers are."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from identify.base.errors import IdentifyError

CONVERGED = "converged"
FAILED, TIMED_OUT, CRASHED, DEFECT = "failed", "timed_out", "crashed", "defect"
OUTDATED = "outdated"  # a log or the program changed while the batch ran
UNWRITTEN = "unwritten"  # the disk is full or may not be written to: no end of a fit, but of the batch
WAITING = "waiting"
TRY_AGAIN = (TIMED_OUT, CRASHED, DEFECT, OUTDATED)  # ends that the content does not decide: a resumed batch tries again
PACKAGES = ("casadi", "numpy", "scipy", "pandas", "h5py")  # whose numbers a fit uses
OUTSIDE = ("app", "cli", "examples", "report", "studies")  # rooms that make no number of a fit
LONGEST = 80  # characters of a folder name
# What a batch itself writes, and what Windows keeps for itself: no folder may be called so.
_PORTS = [f"{port}{i}" for port in ("com", "lpt") for i in range(1, 10)]
RESERVED = frozenset(["batch.json", "index.csv", "report.html", "con", "prn", "aux", "nul", *_PORTS])


class BatchError(IdentifyError):
    """A batch cannot begin. `complaints` holds one sentence per thing to mend; the text counts them."""

    def __init__(self, *complaints: str) -> None:
        self.complaints = complaints
        first, number = complaints[0], len(complaints)
        super().__init__(first if number == 1 else f"{number} things to mend, first {first}")


@dataclass(frozen=True)
class LogFile:
    """One log of a job: absolute path, SHA-256 of the file, labels."""

    path: str
    sha256: str
    labels: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Job:
    """One group: its name and folder, the document of its scene (SI, absolute paths), its logs in the scene's order.

    key: of the content, see `content_key`; numerics: version it was planned with; labels: of the group;
    size: bytes of all its logs.
    """

    group: str
    folder: str
    key: str
    numerics: str
    scene: Mapping[str, Any]
    logs: tuple[LogFile, ...]
    labels: Mapping[str, str]
    size: int

    def as_document(self) -> dict[str, Any]:
        """As JSON knows it; `from_document` takes it back."""
        return asdict(self)

    @staticmethod
    def from_document(document: Mapping[str, Any]) -> Job:
        """The job again."""
        return Job(**{**document, "logs": tuple(LogFile(**log) for log in document["logs"])})


@dataclass(frozen=True)
class End:
    """How a job ended: a status of the room's docstring, one sentence, traceback or None, seconds by stage."""

    status: str
    message: str
    detail: str | None = None
    timing_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def has_result(self) -> bool:
        """Whether a result.json was written."""
        return self.status not in (FAILED, *TRY_AGAIN)


def folder_names(groups: Sequence[str]) -> dict[str, str]:
    """A folder name for each group: its own where that is harmless and unlike all others, else with a hash behind."""
    plain = {group: _harmless(group) for group in groups}
    times = Counter(name.casefold() for name in plain.values())
    return {
        group: name
        if name == group and times[name.casefold()] == 1
        else f"{name}-{hashlib.sha256(group.encode('utf-8', 'surrogatepass')).hexdigest()[:8]}"
        for group, name in plain.items()
    }


def _harmless(group: str) -> str:
    """Word characters and a few signs; no leading or trailing dot, no reserved name, not too long."""
    name = re.sub(r"[^\w.+=@()\[\] -]+", "_", group).strip("._- ")
    name = name.encode()[:LONGEST].decode("utf-8", "ignore").rstrip("._- ")
    if not name or {name.split(".")[0].casefold(), name.casefold()} & RESERVED:
        name = f"group_{name}".rstrip("_")
    return name


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
        sha256: of each log's file, in the scene's order. version: as `numerics` gives it.
    """
    logs = [
        {key: value for key, value in log.items() if key != "path"} | {"sha256": digest}
        for log, digest in zip(scene["logs"], sha256, strict=True)
    ]
    content = {key: value for key, value in scene.items() if key != "name"} | {"logs": logs}
    text = json.dumps([content, version], sort_keys=True, ensure_ascii=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("ascii")).hexdigest()
