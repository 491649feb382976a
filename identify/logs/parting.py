"""Logs that no single motion one way describes, in parts: strokes to and fro, and what excluded stretches part."""

from __future__ import annotations

from collections.abc import Sequence

from data_io import Record
from identify.logs.gaps import PART, gaps_apart
from identify.logs.one_way import STROKE, strokes_apart
from identify.scene import Scene
from identify.scene.values import LogEntry


def parted(scene: Scene, records: Sequence[Record]) -> tuple[Scene, list[Record]]:
    """The scene with its logs in parts, and the records to go with them; what is in one part comes back as it is."""
    return gaps_apart(*strokes_apart(scene, records))


def name_of(entry: LogEntry) -> str:
    """Short name of a log in sentences, with the part of it that it is."""
    said = [f"{word} {entry.labels[word]}" for word in (STROKE, PART) if word in entry.labels]
    return ", ".join([entry.path.name, *said])


def recordings(scene: Scene) -> list[list[int]]:
    """The numbers of the logs of a parted scene, those that are parts of one log together."""
    out: list[list[int]] = []
    for number, entry in enumerate(scene.logs):
        whole = next((some for some in out if _of_one_log(scene.logs[some[0]], entry)), None)
        if whole is None:
            out.append([number])
        else:
            whole.append(number)
    return out


def name_of_recording(scene: Scene, numbers: Sequence[int]) -> str:
    """Short name in sentences of what these logs are parts of."""
    entry = scene.logs[numbers[0]]
    return name_of(entry) if len(numbers) == 1 else entry.path.name


def _of_one_log(one: LogEntry, other: LogEntry) -> bool:
    return _read_as(one) == _read_as(other) and any(w in one.labels and w in other.labels for w in (STROKE, PART))


def parts_of(scene: Scene, entries: Sequence[LogEntry]) -> list[int | None]:
    """For each log of a parted scene the number (from 1) of the log of `scene` it is a part of, None where it is whole.

    Times of a whole log that was read in part have moved, so that it is not the entry of the scene any more.
    """
    whole = len(entries) == len(scene.logs)
    return [None if whole else _part_of(scene, entry) for entry in entries]


def _part_of(scene: Scene, entry: LogEntry) -> int | None:
    if entry in scene.logs:
        return None
    same = [i for i, whole in enumerate(scene.logs, 1) if _read_as(whole) == _read_as(entry)]
    inside = [i for i in same if _within(entry, scene.logs[i - 1])]
    return next(iter(inside or same), None)


def _read_as(entry: LogEntry) -> tuple[object, ...]:
    """What tells the records of two logs of one file apart."""
    return entry.path, entry.step, entry.run, entry.columns, entry.units


def _within(entry: LogEntry, whole: LogEntry) -> bool:
    if entry.window is None or whole.window is None:
        return whole.window is None
    return whole.window[0] <= entry.window[0] and entry.window[1] <= whole.window[1]
