"""The drive of a log whose scene says nothing of it: the programme of its own column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from data_io import Record
from data_io.speed_steps import Programme
from identify.base.errors import FitError
from identify.base.wording import programme_text
from identify.logs.scene_records import read_entry
from identify.logs.told_drive import ToldDrive, told_drive
from identify.scene import Scene
from identify.scene.values import LogEntry


def with_drives(scene: Scene, records: Sequence[Record] | None = None) -> tuple[Scene, list[str]]:
    """The scene in which every log has a drive speed, and a sentence for each that its own column told.

    Args:
        records: of the logs, in their order; None reads those whose drive the scene leaves out.

    Raises:
        FitError: a log without a drive speed whose columns do not tell it. LogError: one that cannot be read.
    """
    logs, said = list(scene.logs), []
    for i, entry in enumerate(scene.logs):
        if scene.rig_for(entry).drive_speed is not None:
            continue
        whole, record = (entry, records[i]) if records is not None and i < len(records) else read_entry(scene, i)
        if whole != entry:
            raise FitError(
                f"{entry.path.name} has no drive speed and is larger than memory, so that its columns are not searched "
                'for it; give drive_speed = "… mm/s" in its [[logs]] or under [rig]'
            )
        told = told_drive(record, scene.rig_for(entry).stiffness, entry.window)
        programme = _sure(told, entry)
        speed = programme if len(programme) > 1 else programme[0][1]
        logs[i] = replace(entry, drive_speed=speed)
        said.append(f"{entry.path.name}: the drive speed was taken from {told.place}: {programme_text(programme)}.")
    return (replace(scene, logs=tuple(logs)) if said else scene), said


def _sure(told: ToldDrive, entry: LogEntry) -> Programme:
    remedy = 'give drive_speed = "… mm/s" in its [[logs]] or under [rig]'
    if told.programme is None:
        raise FitError(f"{entry.path.name} has no drive speed, and {told.trouble}; {remedy}")
    if not told.named:
        raise FitError(
            f"{entry.path.name} has no drive speed; {told.source} it would be {programme_text(told.programme)}, but no "
            f"name says that this is the drive; {remedy}"
        )
    return told.programme
