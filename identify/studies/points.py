"""Where groups are compared: drive speeds and normal force that the fits have in common, rig and model of the fits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from identify.base.errors import IdentifyError
from identify.report.quantity_text import finite
from identify.scene import Scene
from identify.studies.compare import Comparison
from identify.studies.fits import FitEntry
from identify.studies.labels import CompareError

if TYPE_CHECKING:
    from identify.model.model import Model

MOST_SPEEDS = 4
DIGITS = 3


@dataclass(frozen=True)
class Common:
    """The common ground: model of most fits, rig and other parameters [SI] (median of the fits), drive speeds [m/s]
    and normal force [N]; spread: rig quantities that differ by more than 2 % between fits; others: fits with other
    effects."""

    model: Model
    values: Mapping[str, float]
    speeds: tuple[float, ...]
    normal_force: float
    spread: tuple[str, ...]
    others: tuple[str, ...]


def common(comparison: Comparison, speeds: Sequence[float] = (), normal_force: float | None = None) -> Common:
    """The common operating points of a comparison; speeds [m/s] and normal force [N] as asked, else from the logs.

    Raises:
        CompareError: no fit says enough of its rig.
    """
    entries = comparison.taken.entries
    effects = Counter(effects_of(entry) for entry in entries).most_common(1)[0][0]
    alike = [entry for entry in entries if effects_of(entry) == effects]
    once = {entry.folder: entry for entry in alike}.values()  # a fit of several parts has one scene
    scenes = [found for entry in once if (found := scene_of(entry, effects)) is not None]
    if not scenes or not effects:
        raise CompareError("no fit tells the scene it was made with; expected provenance in result.json: fit again")
    tables = [scene.values(scene.logs[0] if scene.logs else None) for scene in scenes]
    columns = {name: np.array([float(t[name]) for t in tables]) for name in tables[0] if _known(tables, name)}
    logs = list({id(log): log for entry in alike for log in entry.taken}.values())
    load = normal_force or _median([log.get("normal_force_N") for log in logs])
    chosen = tuple(speeds) or _usual([log.get("drive_speed_m_per_s") for log in logs])
    if load is None or not chosen:
        raise CompareError("the fits tell no normal force or no drive speed; give them: --load and --speeds")
    return Common(
        model=scenes[0].model,
        values={name: float(np.median(column)) for name, column in columns.items()},
        speeds=chosen,
        normal_force=float(load),
        spread=tuple(n for n, c in columns.items() if n in ("mass", "stiffness", "damping") and _differ(c)),
        others=tuple(dict.fromkeys(entry.whole for entry in entries if effects_of(entry) != effects)),
    )


def effects_of(entry: FitEntry) -> tuple[str, ...]:
    """The effects a fit was made with."""
    effects = entry.document.get("effects")
    names = effects.get("names") if isinstance(effects, Mapping) else None
    return tuple(str(name) for name in names) if isinstance(names, list) else ()


def scene_of(entry: FitEntry, effects: tuple[str, ...]) -> Scene | None:
    """The scene of a fit with its effects settled; None where it cannot be read."""
    try:
        scene = Scene.from_document(entry.document["provenance"]["scene"])
        return scene.with_effects(effects) if scene.effects != effects else scene
    except (IdentifyError, KeyError, TypeError, ValueError):
        return None


def _known(tables: Sequence[Mapping[str, float | None]], name: str) -> bool:
    return all(table.get(name) is not None for table in tables)


def _differ(column: np.ndarray) -> bool:
    return bool(np.ptp(column) > 0.02 * np.max(np.abs(column)))


def _median(found: Sequence[object]) -> float | None:
    numbers = [value for f in found if (value := finite(f)) is not None]
    return float(np.median(numbers)) if numbers else None


def _usual(found: Sequence[object]) -> tuple[float, ...]:
    """The drive speeds that most logs have, at most four, slowest first."""
    rounded = [float(f"{abs(v):.{DIGITS}g}") for f in found if (v := finite(f))]
    return tuple(sorted(speed for speed, _ in Counter(rounded).most_common(MOST_SPEEDS)))
