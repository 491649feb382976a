"""effects = "auto" with logs: which effects the data call for, and what each one gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.base.progress import Notice, Progress, to_nobody
from identify.diagnosis.choice import Choice, screen
from identify.diagnosis.compared_models import ALWAYS, ComparedModels
from identify.diagnosis.selection_words import reasons
from identify.diagnosis.subsets import Selection
from identify.effects import ALL
from identify.estimation.known_early import prefit_warnings, wrong_unit
from identify.estimation.search import alike
from identify.logs.prepare import Prepared
from identify.logs.prepared_scene import prepare_scene
from identify.logs.rhythms import SpectralLine, rhythms
from identify.scene import Scene
from identify.scene.variant import scene_with

Array = NDArray[np.float64]

NOT_COMPARED = "not compared: cycles differ so among themselves, or from the rig, that no sum of squares tells which"
UNCOMPARED = [effect.name for effect in ALL if effect.name not in ALWAYS]
LOOKED_AT = (*ALWAYS, "hysteresis_damping", "contact_ageing", "velocity_weakening", "varying_normal_force")


def choose_from_data(scene: Scene, records: Sequence[Record], progress: Progress | None = None) -> Choice:
    """The effects that the logs of a scene call for, each with its reason.

    Args:
        scene: its effects are to be chosen ("auto"); records: its logs, in their order.

    Raises:
        FitError: a log of which nothing is left.
        SceneError: what the scene says does not go together.
    """
    told = progress or to_nobody
    told("looking at the logs", 0.0)
    prepared = prepare_scene(scene_with(scene, LOOKED_AT, {}), records).logs
    for sentence in prefit_warnings(prepared):
        told(Notice(sentence), 0.0)
    if wrong_unit(prepared) or not alike([log for log in prepared if log.left_out is None]):
        effects = tuple(e.name for e in ALL if e.name in LOOKED_AT)
        return Choice(effects, tuple(reasons(effects, ALWAYS, [], {}, dict.fromkeys(UNCOMPARED, NOT_COMPARED))))
    lines, left = rhythms(prepared)
    looks = screen(prepared, lines)
    scene = _with_one_noise(scene, prepared, lines, left)
    asked = tuple(look.effect for look in looks if look.asked)
    starts = {name: value for look in looks if look.asked for name, value in look.starts}
    selection = Selection(ComparedModels(scene, tuple(records), asked, starts), told)
    selection.run([look.effect for look in looks if look.asked and look.sure])
    effects = tuple(e.name for e in ALL if e.name in (*ALWAYS, *selection.kept))
    decided = tuple(reasons(effects, ALWAYS, looks, selection.gains, selection.notes))
    return Choice(effects, decided, selection.unfinished)


def _with_one_noise(scene: Scene, prepared: Sequence[Prepared], lines: Sequence[SpectralLine], left: Array) -> Scene:
    """The scene with the noise of logs whose sticks swing said once for all models: what is estimated from the sticks
    counts the swings in where a model lacks them, and no two sums could be compared.

    Args:
        lines, left: the rhythms of the sticks, and per log the share of that variance that they leave.
    """
    if not lines or len(prepared) != len(scene.logs):
        return scene
    logs = [
        replace(entry, noise=float(log.data.noise * np.sqrt(share))) if log.noise_estimated and share < 1.0 else entry
        for entry, log, share in zip(scene.logs, prepared, left, strict=True)
    ]
    return replace(scene, logs=tuple(logs))
