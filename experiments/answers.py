"""The answer of a search, for studies that ask nothing about how sure it is."""

from __future__ import annotations

from collections.abc import Sequence

from data_io import Record
from identify.base.outcome import Status
from identify.estimation.attempt import Attempt
from identify.estimation.search import SearchProblem, search
from identify.logs.prepare import prepare
from identify.logs.unknowns import Unknowns, from_scene
from identify.scene import Scene


def answer(scene: Scene, records: Sequence[Record]) -> tuple[Attempt, Unknowns]:
    """What the search finds in the records of a scene, and what it looked for; neither profiles nor other valleys."""
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    found, _ = search(SearchProblem(logs, unknowns))
    assert found is not None and found.gate.status is Status.CONVERGED, "a study needs an answer to begin with"
    return found, unknowns
