"""Does every slip begin where the drive first overcomes the grip?

Where the drive vibrates, the pull rises and falls around the grip before it exceeds it for good, and the onset guard
holds at every such crossing. A solve that ended at a later one describes no motion of the model: the slip would have
begun before. Such slips are put where they begin.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import Grid, Guess, LogData
from identify.logs.unknowns import Unknowns
from identify.model.model import Model
from identify.shooting import lanes
from identify.shooting.placing import PER_HALF_PERIOD, guess_of
from identify.shooting.sliding_lanes import Slips
from identify.simulation.resting import swing

Array = NDArray[np.float64]

EARLIER = 0.25  # periods of the fastest vibration: crossings that are closer are one


def with_first_onsets(log: LogData, guess: Guess, unknowns: Unknowns, grid: Grid) -> Guess | None:
    """The guess with the slips moved that begin too late at these parameters (unknowns.start).

    Returns:
        None where none does, or nothing vibrates.
    """
    model = unknowns.model
    if not model.vibrates or guess.cycles == 0:
        return None
    p = unknowns.values(guess.theta(unknowns.start), log.base)
    period, force = swing(model, p)
    if force == 0.0:
        return None
    after = [guess.saturated[i, -1] if guess.saturates[i] else guess.slip[i, -1] for i in range(guess.cycles - 1)]
    begins = np.concatenate([[log.begin], guess.arrest[:-1]])
    time, slips = _simulated(model, log, np.stack([guess.start, *after]), p, begins)
    late = np.flatnonzero(slips.rested & (begins + time < guess.onset - EARLIER * period))
    if late.size == 0:
        return None
    moved = guess_of(model, log, p, guess.start, slips, late, (begins + time)[late], grid)
    new = {name: getattr(guess, name).copy() for name in ("onset", "saturation", "arrest", "slip", "saturated")}
    for name, array in new.items():
        array[late] = getattr(moved, name)
    return replace(guess, **new)


def _simulated(model: Model, log: LogData, x: Array, p: Array, begins: Array) -> tuple[Array, Slips]:
    """Rest and slip from the states x (c, n_x) at their times (c,) [s]."""
    speeds = np.array([log.speed_at(float(t)) for t in begins])
    u = np.stack([speeds, log.normal_force.at(begins), np.ones_like(begins), begins], axis=1)
    return lanes.break_away(model, x, np.repeat(p[None], begins.size, axis=0), u, PER_HALF_PERIOD)
