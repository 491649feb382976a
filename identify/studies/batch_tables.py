"""batch.json and index.csv: the batch as a whole, from the plan and what has ended."""

from __future__ import annotations

import csv
import io
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from identify.studies.job import WAITING, Job
from identify.studies.planning import Plan

OWN = ("group", "status", "message", "result", "folder", "logs", "seconds")
FORMULA = ("=", "+", "-", "@", "\t", "\r", "|", "%")  # a text that begins so is a formula to some spreadsheet

TURNING = "\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"  # marks that turn the direction of text


@dataclass(frozen=True)
class Ended:
    """What the tables say of a group that has ended."""

    status: str
    message: str
    has_result: bool
    seconds: float | None

    @staticmethod
    def of(document: Mapping[str, Any]) -> Ended:
        """From the group's job.json."""
        seconds = (document.get("timing_s") or {}).get("total")
        return Ended(document["status"], document["message"], document.get("result_sha256") is not None, seconds)


def batch_document(plan: Plan, ended: Mapping[str, Ended], run: Mapping[str, Any]) -> dict[str, Any]:
    """The document of batch.json.

    Args:
        ended: by group. run: status, message, started, finished, seconds, jobs, scheduler.
    """
    statuses = [ended[job.group].status if job.group in ended else WAITING for job in plan.jobs]
    return {
        "schema": 1,
        "kind": "batch",
        "source": str(plan.source),
        "scene": str(plan.scene),
        "set": list(plan.overrides),
        "numerics": plan.numerics,
        **run,
        "columns": list(plan.labels),
        "counts": dict(Counter(statuses)),
        "groups": [_group(job, status) for job, status in zip(plan.jobs, statuses, strict=True)],
    }


def _group(job: Job, status: str) -> dict[str, Any]:
    return {
        "group": job.group,
        "folder": job.folder,
        "key": job.key,
        "status": status,
        "labels": dict(job.labels),
        "logs": [asdict(log) for log in job.logs],
    }


def index_csv(plan: Plan, ended: Mapping[str, Ended]) -> str:
    """The text of index.csv; one row per group in the order of the source."""
    names = label_columns(plan.jobs, plan.labels)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    headings = [f"label: {name}" if name in OWN else name for name in names]
    writer.writerow([harmless(text) for text in (*OWN[:-1], *headings, OWN[-1])])
    for job in plan.jobs:
        end = ended.get(job.group)
        result = f"{job.folder}/result.json" if end is not None and end.has_result else ""
        words = (end.status, end.message) if end is not None else (WAITING, "")
        seconds = "" if end is None or end.seconds is None else f"{end.seconds:.3f}"
        texts = [job.group, *words, result, job.folder]
        labels = [job.labels.get(name, "") for name in names]
        writer.writerow([*map(harmless, texts), len(job.logs), *map(harmless, labels), seconds])
    return out.getvalue()


def label_columns(jobs: Sequence[Job], first: Sequence[str]) -> list[str]:
    """The names of all labels: those of the manifest in its order, then those that only the scene gives."""
    return list(dict.fromkeys([*first, *(name for job in jobs for name in job.labels)]))


def harmless(text: str) -> str:
    """The text as one line that no spreadsheet takes for a formula."""
    line = " ".join(text.splitlines())
    line = "".join(c for c in line if unicodedata.category(c) != "Cc" and c not in TURNING)
    return f"'{line}" if line.lstrip().startswith(FORMULA) or line.startswith(FORMULA) else line
