"""Slips that turn back on their way begin where the mass moves on for good.

A grip that trembles faster than the drive pulls dips below the pull more than once before a slip. A solve that put the
onset at an early dip has a mass that creeps, comes to a stop and goes backwards before it slips: no motion of the
model, in which it would rest in between. What it creeps is too little to be seen; the slip that is seen begins later.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import Grid, LogData, ShootingTrajectory
from identify.logs.unknowns import Unknowns
from identify.model.model import SPEED, Model
from identify.shooting import batch as lanes
from identify.shooting.batch import Slips
from identify.shooting.placing import PER_HALF_PERIOD, trajectory_of
from identify.simulation.resting import swing

Array = NDArray[np.float64]

BACKWARDS = 1e-3  # of the fastest speed of a slip


def turned_back(trajectory: ShootingTrajectory) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Nodes at which the mass moves backwards: of the slips (c, n1 + 1), and of their saturated parts (c, n2 + 1)."""
    least = -BACKWARDS * np.nanmax(np.abs(trajectory.slip[..., SPEED]), axis=1, initial=0.0)
    # A slip that never saturates has nodes after its saturation that stand for nothing.
    saturated = trajectory.saturates[:, None] & (trajectory.saturated[..., SPEED] < least[:, None])
    return trajectory.slip[..., SPEED] < least[:, None], saturated


def with_last_onsets(trajectory: ShootingTrajectory) -> ShootingTrajectory | None:
    """The trajectory with the slips begun anew that turn back before they saturate; None where none does."""
    back, _ = turned_back(trajectory)
    again = np.flatnonzero(np.any(back[:, :-1], axis=1) & ~back[:, -1])
    if again.size == 0:
        return None
    onset, slip = trajectory.onset.copy(), trajectory.slip.copy()
    ends = np.where(trajectory.saturates, trajectory.saturation, trajectory.arrest)
    last = back.shape[1] - 1
    for i in again.tolist():
        nodes, speed = trajectory.slip[i], trajectory.slip[i, :, SPEED]
        stop = int(np.flatnonzero(back[i])[-1])
        forward = stop + float(speed[stop] / (speed[stop] - speed[stop + 1]))  # where it moves on, in nodes
        onset[i] += (ends[i] - onset[i]) * forward / last
        places = np.linspace(forward, last, last + 1)
        slip[i] = np.stack([np.interp(places, np.arange(last + 1), column) for column in nodes.T], axis=1)
        slip[i, 0, SPEED] = 0.0
    return replace(trajectory, onset=onset, slip=slip)


# ----------------------------------------------------------------------------------------------------------------------
# Does every slip begin where the drive first overcomes the grip?
#
# Where the drive vibrates, the pull rises and falls around the grip before it exceeds it for good, and the onset guard
# holds at every such crossing. A solve that ended at a later one describes no motion of the model: the slip would have
# begun before. Such slips are put where they begin.
# ----------------------------------------------------------------------------------------------------------------------

EARLIER = 0.25  # periods of the fastest vibration: crossings that are closer are one


def with_first_onsets(
    log: LogData, trajectory: ShootingTrajectory, unknowns: Unknowns, grid: Grid
) -> ShootingTrajectory | None:
    """The trajectory with the slips moved that begin too late at these parameters (unknowns.start).

    Returns:
        None where none does, or nothing vibrates.
    """
    model = unknowns.model
    if not model.vibrates or trajectory.cycles == 0:
        return None
    p = unknowns.values(trajectory.theta(unknowns.start), log.base)
    period, force = swing(model, p)
    if force == 0.0:
        return None
    after = [
        trajectory.saturated[i, -1] if trajectory.saturates[i] else trajectory.slip[i, -1]
        for i in range(trajectory.cycles - 1)
    ]
    begins = np.concatenate([[log.begin], trajectory.arrest[:-1]])
    time, slips = _simulated(model, log, np.stack([trajectory.start, *after]), p, begins)
    late = np.flatnonzero(slips.rested & (begins + time < trajectory.onset - EARLIER * period))
    if late.size == 0:
        return None
    moved = trajectory_of(log, trajectory.start, slips, late, (begins + time)[late], grid)
    new = {name: getattr(trajectory, name).copy() for name in ("onset", "saturation", "arrest", "slip", "saturated")}
    for name, array in new.items():
        array[late] = getattr(moved, name)
    return replace(trajectory, **new)


def _simulated(model: Model, log: LogData, x: Array, p: Array, begins: Array) -> tuple[Array, Slips]:
    """Rest and slip from the states x (c, n_x) at their times (c,) [s]."""
    speeds = np.array([log.speed_at(float(t)) for t in begins])
    u = np.stack([speeds, log.normal_force.at(begins), np.ones_like(begins), begins], axis=1)
    return lanes.break_away(model, x, np.repeat(p[None], begins.size, axis=0), u, PER_HALF_PERIOD)
