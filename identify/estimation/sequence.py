"""Is the sequence of modes that a course was solved with still that of the answer? Else the course is followed anew.

A stick that never ends, a slip that rests for a moment, a contact that re-ages in mid-slide: which of them happen is
decided at the start's parameters, and may be another at the answer's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.following import follow
from identify.shooting.shooting_trajectory import ShootingTrajectory

HAIR = 0.1  # of half a period: rests that are shorter are hardly any
TRIES = 3  # how often a course is followed anew


def modes_of(trajectory: ShootingTrajectory) -> tuple[tuple[str, str], ...]:
    """Mode and end of every stretch."""
    return tuple((kind, ended_by) for kind, ended_by, _ in trajectory.modes)


def followed(log: Prepared, unknowns: Unknowns) -> tuple[Prepared, ShootingTrajectory] | None:
    """A log of a course of its own as the parameters (unknowns.start) have it, cut to what can be followed."""
    p = unknowns.values(log.data.theta(unknowns.start), log.data.base)
    found = follow(unknowns.model, log.data, p, begins_sliding=log.fit_mode.begins_sliding)
    if found is None:
        return None
    return replace(log, data=replace(log.data, end=min(found.end, log.data.end))), found.trajectory


def is_near_grazing(log: Prepared, trajectory: ShootingTrajectory) -> bool:
    """Whether slips of a log that is solved cycle by cycle come to rest by a hair: how they rest is easily taken for
    something else where it is only told by when they fall."""
    half_period = log.rig.half_period
    if log.fit_mode.name != "cycles" or trajectory.sticks.size == 0 or half_period is None:
        return False
    return float(np.median(trajectory.sticks)) < HAIR * half_period


def resimulated(
    whole: Sequence[Prepared], logs: Sequence[Prepared], trajectories: Sequence[ShootingTrajectory], unknowns: Unknowns
) -> tuple[list[Prepared], list[ShootingTrajectory]] | None:
    """The logs and trajectories with the courses as they are at the answer (unknowns.start); None where nothing is new.

    Args:
        whole: the logs before they were cut to what could be followed.
    """
    found = _courses(whole, logs, trajectories, unknowns)
    other = [
        new and modes_of(new[1]) != modes_of(trajectory) for new, trajectory in zip(found, trajectories, strict=True)
    ]
    return _put_in([new if differs else None for new, differs in zip(found, other, strict=True)], logs, trajectories)


def resimulated_whole(
    whole: Sequence[Prepared], logs: Sequence[Prepared], trajectories: Sequence[ShootingTrajectory], unknowns: Unknowns
) -> tuple[list[Prepared], list[ShootingTrajectory]] | None:
    """As `resimulated`, with the logs whose slips rest by a hair followed as courses; None where none do."""
    found = [
        _at_answer(uncut.as_continuous, trajectory, unknowns) if is_near_grazing(log, trajectory) else None
        for uncut, log, trajectory in zip(whole, logs, trajectories, strict=True)
    ]
    return _put_in(found, logs, trajectories)


def is_clear(log: Prepared, trajectory: ShootingTrajectory, other: ShootingTrajectory) -> bool:
    """Whether a course has one sequence or another, and neither by a hair."""
    return modes_of(trajectory) != modes_of(other) and not (hardly(log, trajectory) or hardly(log, other))


def hardly(log: Prepared, trajectory: ShootingTrajectory) -> bool:
    """Whether the mass comes to rest, or slides on, by a hair somewhere in a course: a contact re-ages in mid-slide, or
    a rest between two slips is hardly one."""
    sticks = [i for i in trajectory.ending("onset").tolist() if i > 0]
    shortest = np.min(np.diff(trajectory.until, prepend=0.0)[sticks], initial=np.inf)
    return bool(trajectory.ending("release").size or shortest < HAIR * log.rig.half_period)


def _courses(
    whole: Sequence[Prepared], logs: Sequence[Prepared], trajectories: Sequence[ShootingTrajectory], unknowns: Unknowns
) -> list[tuple[Prepared, ShootingTrajectory] | None]:
    """The courses as they are at the answer, None in the place of what is none."""
    return [
        _at_answer(replace(uncut, fit_mode=log.fit_mode), trajectory, unknowns)
        if log.fit_mode.name == "continuous"
        else None
        for uncut, log, trajectory in zip(whole, logs, trajectories, strict=True)
    ]


def _at_answer(
    log: Prepared, trajectory: ShootingTrajectory, unknowns: Unknowns
) -> tuple[Prepared, ShootingTrajectory] | None:
    """A log followed with what it shares and what it has for itself at the answer."""
    found = followed(log, replace(unknowns, start=trajectory.theta(unknowns.start)))
    return None if found is None else (found[0], replace(found[1], own=trajectory.own))


def _put_in(
    found: Sequence[tuple[Prepared, ShootingTrajectory] | None],
    logs: Sequence[Prepared],
    trajectories: Sequence[ShootingTrajectory],
) -> tuple[list[Prepared], list[ShootingTrajectory]] | None:
    """The logs and trajectories with what was found in its place; None where nothing was."""
    if not any(found):
        return None
    made = [new or old for new, old in zip(found, zip(logs, trajectories, strict=True), strict=True)]
    return [log for log, _ in made], [trajectory for _, trajectory in made]
