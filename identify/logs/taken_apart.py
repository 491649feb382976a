"""A scene with every log replaced by the parts that some rule makes of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from data_io import Record
from identify.scene import Scene
from identify.scene.values import LogEntry


def taken_apart(
    scene: Scene, records: Sequence[Record], parts_of: Callable[[Scene, LogEntry, Record], list[LogEntry]]
) -> tuple[Scene, list[Record]]:
    """The scene with the parts of its logs, each the log itself where it is whole, and the records to go with them. A
    scene of whole logs comes back as it is."""
    entries: list[LogEntry] = []
    kept: list[Record] = []
    for entry, record in zip(scene.logs, records, strict=True):
        made = parts_of(scene, entry, record)
        entries += made
        kept += [record] * len(made)
    if len(entries) == len(scene.logs):
        return scene, list(records)
    return replace(scene, logs=tuple(entries)), kept
