"""One group of a batch as plain values: what is to be fitted, and how that ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

CONVERGED = "converged"
FAILED, TIMED_OUT, CRASHED, DEFECT = "failed", "timed_out", "crashed", "defect"
OUTDATED = "outdated"  # a log or the program changed while the batch ran
UNWRITTEN = "unwritten"  # the disk is full or may not be written to: no end of a fit, but of the batch
WAITING = "waiting"
TRY_AGAIN = (TIMED_OUT, CRASHED, DEFECT, OUTDATED)  # ends that the content does not decide: a resumed batch tries again


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
        logs = tuple(LogFile(**log) for log in document["logs"])
        return Job(**{**document, "logs": logs})


@dataclass(frozen=True)
class End:
    """How a job ended: a status of batch's docstring, one sentence, traceback or None, seconds by stage."""

    status: str
    message: str
    detail: str | None = None
    timing_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def converged(self) -> bool:
        """Whether the fit passed its gate."""
        return self.status == CONVERGED
