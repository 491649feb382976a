"""Simulated logs as the fit takes them, and the search for their parameters started at the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from data_io import Record
from identify import Scene
from identify.effects import MAIN
from identify.estimation.attempt import Attempt
from identify.logs.prepare import Prepared, prepare
from identify.logs.unknowns import Unknowns, from_scene


def taken(
    records: Sequence[Record], drives: Sequence[tuple[float, ...]], pair: dict[str, float], rig: dict[str, float]
) -> tuple[list[Prepared], Unknowns]:
    """Logs as the fit takes them, and the search started at the truth."""
    entries = [{"path": f"log_{i}.csv", "drive_speed": drive[0]} for i, drive in enumerate(drives)]
    document = {"effects": [*MAIN, "varying_normal_force"], "rig": rig, "logs": entries}
    scene = Scene.from_document(document, Path())
    unknowns = from_scene(scene)
    prepared = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    theta = unknowns.theta(np.array([(pair | rig)[name] for name in unknowns.names]), unknowns.base(rig))
    return prepared, replace(unknowns, start=theta)


def error(found: Attempt, unknowns: Unknowns, name: str) -> float:
    """Of a logarithmic parameter, relative."""
    at = unknowns.names.index(name)
    return abs(float(np.expm1(found.solved.theta[at] - unknowns.start[at])))
