"""Slips that turn back on their way begin where the mass moves on for good.

A grip that trembles faster than the drive pulls dips below the pull more than once before a slip. A solve that put the
onset at an early dip has a mass that creeps, comes to a stop and goes backwards before it slips: no motion of the
model, in which it would rest in between. What it creeps is too little to be seen; the slip that is seen begins later.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import Guess
from identify.model.model import SPEED

Array = NDArray[np.float64]

BACKWARDS = 1e-3  # of the fastest speed of a slip


def turned_back(guess: Guess) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Nodes at which the mass moves backwards: of the slips (c, n1 + 1), and of their saturated parts (c, n2 + 1)."""
    least = -BACKWARDS * np.nanmax(np.abs(guess.slip[..., SPEED]), axis=1, initial=0.0)
    # A slip that never saturates has nodes after its saturation that stand for nothing.
    saturated = guess.saturates[:, None] & (guess.saturated[..., SPEED] < least[:, None])
    return guess.slip[..., SPEED] < least[:, None], saturated


def with_last_onsets(guess: Guess) -> Guess | None:
    """The guess with the slips begun anew that turn back before they saturate; None where none does."""
    back, _ = turned_back(guess)
    again = np.flatnonzero(np.any(back[:, :-1], axis=1) & ~back[:, -1])
    if again.size == 0:
        return None
    onset, slip = guess.onset.copy(), guess.slip.copy()
    ends = np.where(guess.saturates, guess.saturation, guess.arrest)
    last = back.shape[1] - 1
    for i in again.tolist():
        nodes, speed = guess.slip[i], guess.slip[i, :, SPEED]
        stop = int(np.flatnonzero(back[i])[-1])
        forward = stop + float(speed[stop] / (speed[stop] - speed[stop + 1]))  # where it moves on, in nodes
        onset[i] += (ends[i] - onset[i]) * forward / last
        places = np.linspace(forward, last, last + 1)
        slip[i] = np.stack([np.interp(places, np.arange(last + 1), column) for column in nodes.T], axis=1)
        slip[i, 0, SPEED] = 0.0
    return replace(guess, onset=onset, slip=slip)
