"""A scene ready to be fitted: its logs cut into parts and prepared, and what is searched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from data_io import Record
from identify.logs.parting import parted
from identify.logs.prepare import Prepared, prepare
from identify.logs.unknowns import Unknowns, from_scene
from identify.logs.vibration import tuned
from identify.scene import Scene


@dataclass(frozen=True)
class PreparedScene:
    """The scene with one entry per part of a log; the record of each; the logs, prepared; what is searched."""

    scene: Scene
    records: list[Record]
    logs: list[Prepared]
    unknowns: Unknowns


def prepare_scene(scene: Scene, records: Sequence[Record]) -> PreparedScene:
    """Part, cut, correct and segment all logs of a scene, and find starts for what is explicit in time.

    Raises:
        FitError: a log without drive speed, or of which nothing is left.
        SceneError: an effect outside its measured range.
    """
    scene, parts = parted(scene, records)
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, parts, strict=True)]
    return PreparedScene(scene, parts, *tuned(logs, unknowns))
