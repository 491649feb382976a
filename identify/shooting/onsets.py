"""Slips that turn back on their way begin where the mass moves on for good.

A grip that trembles faster than the drive pulls dips below the pull more than once before a slip. A solve that put the
onset at an early dip has a mass that creeps, comes to a stop and goes backwards before it slips: no motion of the
model, in which it would rest in between. What it creeps is too little to be seen; the slip that is seen begins later.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.model.model import SPEED, Model
from identify.shooting import batch as lanes
from identify.shooting.batch import Slips
from identify.shooting.grid import Grid
from identify.shooting.placing import PER_HALF_PERIOD, trajectory_of
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.simulation.resting import swing

Array = NDArray[np.float64]

BACKWARDS = 1e-3  # of the fastest speed of a slip


def turned_back(trajectory: ShootingTrajectory) -> list[NDArray[np.bool_]]:
    """Nodes at which the mass moves backwards: of every stretch (n,), none of rests and of steady sliding."""
    speeds = [stretch.nodes[:, SPEED] for stretch in trajectory.stretches]
    fastest = np.zeros(trajectory.parts)  # of the slip; what is worn throughout has its own
    for part, stretch, speed in zip(trajectory.part, trajectory.stretches, speeds, strict=True):
        if stretch.kind == "slip":
            fastest[part] = max(fastest[part], float(np.max(np.abs(speed))))
    return [
        (speed < -BACKWARDS * (fastest[part] or np.max(np.abs(speed)))) & (stretch.kind in ("slip", "worn"))
        for part, stretch, speed in zip(trajectory.part, trajectory.stretches, speeds, strict=True)
    ]


def turns_back(trajectory: ShootingTrajectory) -> bool:
    """Whether the mass moves backwards in a slip before its contact is worn."""
    backs = zip(trajectory.stretches, turned_back(trajectory), strict=True)
    return any(bool(np.any(back)) for stretch, back in backs if stretch.kind == "slip")


def with_last_onsets(trajectory: ShootingTrajectory) -> ShootingTrajectory | None:
    """The trajectory with the slips begun anew that turn back before they wear or rest; None where none does."""
    until, nodes = trajectory.until.copy(), trajectory.nodes.copy()
    for i, back in enumerate(turned_back(trajectory)):
        if not (i and trajectory.modes[i - 1][1] == "onset" and np.any(back[:-1]) and not back[-1]):
            continue
        onset, last = i - 1, len(back)
        mine = slice(trajectory.first[i] - 1, trajectory.first[i + 1])  # with the state at the onset
        old = trajectory.nodes[mine]
        stop, speed = 1 + int(np.flatnonzero(back)[-1]), old[:, SPEED]
        forward = stop + float(speed[stop] / (speed[stop] - speed[stop + 1]))  # where it moves on, in nodes
        until[onset] += (until[i] - until[onset]) * forward / last
        places = np.linspace(forward, last, last + 1)
        nodes[mine] = np.stack([np.interp(places, np.arange(last + 1), column) for column in old.T], axis=1)
        nodes[trajectory.first[i] - 1, SPEED] = 0.0
    return None if np.array_equal(until, trajectory.until) else replace(trajectory, until=until, nodes=nodes)


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
    after = trajectory.at_end(trajectory.ending("arrest")[:-1])
    begins = np.concatenate([[log.begin], trajectory.arrest[:-1]])
    time, slips = _simulated(model, log, np.concatenate([trajectory.start[None], after]), p, begins)
    late = np.flatnonzero(slips.rested & (begins + time < trajectory.onset - EARLIER * period))
    if late.size == 0:
        return None
    moved = trajectory_of(log, trajectory.start, slips, late, (begins + time)[late], grid)
    cycles = trajectory.by_part()
    for cycle, stretches in zip(late.tolist(), moved.by_part(), strict=True):
        cycles[cycle] = stretches
    made = ShootingTrajectory.of(trajectory.start, [s for cycle in cycles for s in cycle], trajectory.own)
    return replace(trajectory, modes=made.modes, until=made.until, nodes=made.nodes)


def _simulated(model: Model, log: LogData, x: Array, p: Array, begins: Array) -> tuple[Array, Slips]:
    """Rest and slip from the states x (c, n_x) at their times (c,) [s]."""
    speeds = np.array([log.speed_at(float(t)) for t in begins])
    u = np.stack([speeds, log.normal_force.at(begins), np.ones_like(begins), begins], axis=1)
    return lanes.break_away(model, x, np.repeat(p[None], begins.size, axis=0), u, PER_HALF_PERIOD)
