"""The estimation of `fit` by multiple shooting, without its report."""

from __future__ import annotations

from collections.abc import Sequence

from data_io import Record
from identify.base.budget import time_limit
from identify.base.progress import Progress, to_nobody
from identify.diagnosis.findings import Findings
from identify.identification import _estimated, _prepared
from identify.logs.prepare import Prepared
from identify.scene import Scene
from identify.shooting.accuracy import DEFAULT_OPTIONS


def find(
    scene: Scene, records: Sequence[Record] | None = None, progress: Progress = to_nobody
) -> tuple[list[Prepared], Findings]:
    """The logs as they were fitted, and what was found."""
    task = _prepared(scene, records, DEFAULT_OPTIONS, None, 0, progress)
    with time_limit(task.scene.time_limit):
        return _estimated(task)
