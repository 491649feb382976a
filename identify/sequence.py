"""Is the sequence of modes that a course was solved with still that of the answer? Else the course is followed anew.

A stick that never ends, a slip that rests for a moment, a contact that re-ages in mid-slide: which of them happen is
decided at the start's parameters, and may be another at the answer's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identify.following import follow
from identify.guess import Guess
from identify.prepare import Prepared
from identify.unknowns import Unknowns

HAIR = 0.1  # of half a period: rests that are shorter are hardly any
TRIES = 3  # how often a course is followed anew


def modes_of(guess: Guess) -> tuple[tuple[str, str], ...]:
    """Mode and end of every stretch of a tail."""
    return tuple((stretch.kind, stretch.ended_by) for stretch in guess.tail)


def followed(log: Prepared, unknowns: Unknowns) -> tuple[Prepared, Guess] | None:
    """A log of a course of its own as the parameters (unknowns.start) have it, cut to what can be followed."""
    p = unknowns.values(log.data.theta(unknowns.start), log.data.base)
    found = follow(unknowns.model, log.data, p, begins_sliding=log.manner.begins_sliding)
    if found is None:
        return None
    return replace(log, data=replace(log.data, end=min(found.end, log.data.end))), found.guess


def grazes(log: Prepared, guess: Guess) -> bool:
    """Whether slips of a log that is solved cycle by cycle come to rest by a hair: how they rest is easily taken for
    something else where it is only told by when they fall."""
    half_period = log.rig.half_period
    if log.manner.name != "cycles" or guess.sticks.size == 0 or half_period is None:
        return False
    return float(np.median(guess.sticks)) < HAIR * half_period


def resequenced(
    whole: Sequence[Prepared], logs: Sequence[Prepared], guesses: Sequence[Guess], unknowns: Unknowns
) -> tuple[list[Prepared], list[Guess]] | None:
    """The logs and guesses with the courses as they are at the answer (unknowns.start); None where nothing is new.

    Args:
        whole: the logs before they were cut to what could be followed.
    """
    new_logs, new_guesses, other = list(logs), list(guesses), False
    for i, (log, guess) in enumerate(zip(logs, guesses, strict=True)):
        if log.manner.name != "course":
            continue
        found = followed(whole[i], replace(unknowns, start=guess.theta(unknowns.start)))
        if found is not None and modes_of(found[1]) != modes_of(guess):
            new_logs[i], new_guesses[i] = found[0], replace(found[1], own=guess.own)
            other = True
    return (new_logs, new_guesses) if other else None
