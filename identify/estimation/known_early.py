"""What the logs show of rig and scatter before anything is fitted: what is worth a word at once, what ends a fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identify.base.wording import three_figures
from identify.estimation.status_words import uneven_words
from identify.logs.prepare import Prepared

UNITS = 30.0  # factor by which sticks rise too slowly where a unit is wrong: nothing soft in series does that
STEEPER = 5.0  # and by which they rise too fast: nothing in series does that, and no rig value is so wrong
STICKS, AGREE = 2, 0.3  # sticks that a unit has to be wrong in, and how much they may differ: cycles may be misread


def prefit_warnings(prepared: Sequence[Prepared]) -> list[str]:
    """Sentences on a stiffness or drive speed that the sticks contradict, and on cycles that differ among
    themselves."""
    taken = [log for log in prepared if log.left_out is None]
    uneven = uneven_words(taken)
    said = [f"{uneven}: a strength of each stick is tried, then the estimator of uneven records"] if uneven else []
    return [*_stick_slopes(taken), *said]


def _stick_slopes(prepared: Sequence[Prepared]) -> list[str]:
    """What the quality gate found of the slopes, of all logs together where all say the same."""
    seen = [log for log in prepared if any(part.slope is not None for part in log.judgement.slips)]
    odd = [(log, f.message) for log in seen for f in log.judgement.findings if f.code == "stick_slope"]
    ratios = np.array([1.0 + next(p.slope for p in log.judgement.slips if p.slope is not None) for log, _ in odd])
    if len(odd) < max(len(seen), 2) or not (np.all(ratios < 1.0) or np.all(ratios > 1.0)):
        return [f"{log.name}: {message}" for log, message in odd]
    ratio, stated = float(np.median(ratios)), odd[0][0].rig.stiffness
    instead = f"{three_figures(ratio * stated)} N/m"
    return [
        f"in the sticks of all logs the force rises at {three_figures(ratio)} times stiffness times drive speed: the "
        f"stiffness is {instead} instead of {three_figures(stated)} N/m, or all drive speeds are off; mend [rig], or "
        f'let it be estimated: [parameters] stiffness = {{ start = "{instead}" }}'
    ]


def wrong_unit(prepared: Sequence[Prepared], *, placed: bool = True) -> str:
    """A sentence where the sticks of a log rise so differently from stiffness times drive speed that a unit must be
    wrong; "" where none do.

    Args:
        placed: False where the model could not be placed on the logs: less is enough to suspect a unit then.
    """
    slower = UNITS if placed else STEEPER
    for log in prepared:
        rise = log.segmentation.stick_slope
        if rise is None or log.segmentation.stick_slopes.size < STICKS or rise[1] > AGREE:
            continue
        for slope in (part.slope for part in log.judgement.slips if part.slope is not None):
            times = 1.0 + slope
            if not 1.0 / slower < times < STEEPER:
                return (
                    f"in the sticks of {log.name} the force rises {times:.3g} times as fast as stiffness times drive "
                    "speed says: check the units of its time and forces, its drive speed and the stiffness of the rig"
                )
    return ""
