"""Whether what an answer leaves of a log, in which it slides to the end, still swings as stick-slip does.

Slips of a few samples, or smaller than the noise of one, count as noise while the noise is measured: an answer that
slides there fits, and takes the mean force of stick-slip for that of sliding.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identify.logs.hidden_rhythm import Swing, hidden_rhythm
from identify.logs.log_data import Guess, LogData
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]

HELD = 0.05  # share of the power of what is left: a line that is so clear by chance is no matter of its height


def swing_left(
    logs: Sequence[LogData], guesses: Sequence[Guess], unknowns: Unknowns, theta: Array, fitted: Sequence[Array]
) -> tuple[int, Swing] | None:
    """The first log whose last slide leaves a swing, with that; None where there is none.

    Args:
        theta: (n_p,) the solution; fitted: (n,) force at the samples of each log [N], NaN where none is fitted.
    """
    if unknowns.model.vibrates:
        return None
    for number, (log, guess, curve) in enumerate(zip(logs, guesses, fitted, strict=True)):
        if not guess.tail or guess.tail[-1].kind == "rest":
            continue
        values = dict(zip(unknowns.names, unknowns.values(guess.theta(theta), log.base).tolist(), strict=True))
        if not values.get("mass", 0.0) > 0.0:
            continue
        since = max((s.until for s in guess.tail if s.kind == "rest" or s.ended_by == "arrest"), default=log.begin)
        rows = slice(*np.searchsorted(log.time, [since, log.end]))
        left = np.where(log.weight[rows] > 0.0, log.force[rows] - curve[rows], np.nan)
        found = hidden_rhythm(
            log.time[rows],
            left,
            None,  # what the load does the answer follows
            stiffness=values["stiffness"],
            drive_speed=log.speed_at(log.end),
            half_period=float(np.pi * np.sqrt(values["mass"] / values["stiffness"])),
            least=HELD,
        )
        if found is not None:
            return number, found
    return None
