"""The drive speed of one log may be what logs misfit by: a suspect for each whose sticks rise otherwise than stated.

Where the sticks of all logs do, rig or drive are wrong for all of them, and no single log is suspected.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identify.base.wording import speed_scale
from identify.diagnosis.fitted import Fitted
from identify.diagnosis.suspects import REACH, SHIFTED, Freed, Suspect, Words, constant_speed, with_speeds
from identify.logs.parting import name_of_recording, recordings
from identify.logs.prepare import Prepared
from identify.scene import Scene

TRIED = 2  # logs at most


def log_speeds(scene: Scene, prepared: Sequence[Prepared], misfits: Sequence[float]) -> tuple[Suspect, ...]:
    """A suspect for each log whose sticks say another speed than the one stated, and than those of the others do.

    Args:
        misfits: of each log; the logs that misfit most come first.
    """
    logs = recordings(scene)
    slopes = [_slope([prepared[i] for i in some]) for some in logs]
    found = []
    for number, (some, slope) in enumerate(zip(logs, slopes, strict=True)):
        others = [other for n, other in enumerate(slopes) if n != number and other is not None]
        if slope is None or not others or any(constant_speed(scene, i) is None for i in some):
            continue
        stands_out = min(abs(slope), abs(slope - float(np.median(others)))) > SHIFTED
        if stands_out and 1.0 / REACH < 1.0 + slope < REACH:
            found.append((max(misfits[i] for i in some), _suspect(scene, some, 1.0 + slope)))
    found.sort(key=lambda each: -each[0])
    return tuple(suspect for _, suspect in found[:TRIED])


def _slope(log: Sequence[Prepared]) -> float | None:
    """Slope of the sticks of a log, or of its parts, over stiffness times drive speed, less 1; None without one."""
    slopes = [slip.slope for part in log for slip in part.judgement.slips if slip.slope is not None]
    return float(np.median(slopes)) if slopes else None


def _suspect(scene: Scene, logs: Sequence[int], times: float) -> Suspect:
    def nearby(freed: Scene, factor: float) -> Scene:
        return with_speeds(freed, logs, factor)

    words = _words(name_of_recording(scene, logs))
    return Suspect("drive_speed", _at(logs, times), words, logs=tuple(logs), nearby=nearby)


def _at(logs: Sequence[int], times: float) -> Freed:
    def freed(scene: Scene, _prepared: Sequence[Prepared]) -> Scene:
        return with_speeds(scene, logs, times)

    return freed


def _words(name: str) -> Words:
    def words(_fitted: Fitted, value: float, stated: float) -> str:
        unit, scale = speed_scale(stated)
        return (
            f"a drive speed of {name} {value / stated:.3g} times the stated one ({value / scale:.3g} {unit} instead of "
            f"{stated / scale:.3g} {unit}: look at the position of the drive, or time it over a known way)"
        )

    return words
