"""Does the motion of a solution obey the inequalities that its mode sequence takes for granted?

The rows of the shooting problem hold what is equal: continuity, guards. What must be greater or smaller is checked
here: a mass that arrests stays at rest (nothing pulls it on or back), and slips go forward.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import Guess, LogData
from identify.logs.unknowns import Unknowns
from identify.model.model import SPEED
from identify.shooting.onsets import turned_back

Array = NDArray[np.float64]

MARGIN = 0.5  # standard deviations of the force noise: closer to being pulled back, the answer may hide that it is


def inconsistency(
    logs: Sequence[LogData], guesses: Sequence[Guess], unknowns: Unknowns, theta: Array, names: Sequence[str]
) -> str | None:
    """The first cycle whose motion breaks an inequality, in words with what to do; None where there is none.

    Args:
        theta: (n_p,) the solution; names: of the logs.
    """
    for log, guess, name in zip(logs, guesses, names, strict=True):
        p = unknowns.values(guess.theta(theta), log.base)
        pulled, back = _at_arrests(log, guess, unknowns, p)
        noise = log.noise
        for excess, what, allowed in ((back, "back", -MARGIN * noise), (pulled, "on", MARGIN * noise)):
            worst = int(np.argmax(excess)) if excess.size else 0
            if excess.size and excess[worst] > allowed:
                return (
                    f"{name}, cycle {worst + 1}: at this answer the mass is pulled {what} as soon as it stops, or all "
                    f"but ({excess[worst]:+.2g} N against what the contact holds, noise {noise:.2g} N), a motion that "
                    "the fit does not follow; leave this log out, or measure with more damping or less normal force"
                )
        cycle = _goes_back(guess)
        if cycle is not None:
            return (
                f"{name}, cycle {cycle + 1}: at this answer the slip runs backwards on its way, which the fit does not "
                "follow; exclude that stretch, or give start values"
            )
    return None


def _at_arrests(log: LogData, guess: Guess, unknowns: Unknowns, p: Array) -> tuple[Array, Array]:
    """By how much the pull exceeds what the contact holds at every arrest (c,) [N], forward and back; cycles first."""
    model = unknowns.model
    ends = np.where(guess.saturates[:, None], guess.saturated[:, -1], guess.slip[:, -1])
    rested = [(unit, s) for unit, s in zip(guess.units, guess.tail, strict=True) if s.ended_by == "arrest"]
    ends = np.concatenate([ends, *(stretch.nodes[-1:] for _, stretch in rested)])
    times = np.concatenate([guess.arrest, [stretch.until for _, stretch in rested]])
    parts = np.concatenate([np.arange(guess.cycles), [unit for unit, _ in rested]]).astype(int)
    ends[:, SPEED] = 0.0
    count = times.size
    if count == 0:
        return np.empty(0), np.empty(0)
    load = np.asarray(log.normal_force.at(times)) + guess.sliding_deviation[parts]
    drive = np.array([log.speed_at(t) for t in times.tolist()])
    u = np.column_stack([drive, load, np.ones(count), times])
    lanes = [ends.T, np.repeat(p[:, None], count, axis=1), u.T]
    pull = np.array(model.driving_force(*lanes)).ravel()
    grip = np.array(model.grip(*lanes)).ravel()
    return pull - grip, -pull - grip


def _goes_back(guess: Guess) -> int | None:
    """The first cycle with a node at which the mass moves backwards."""
    found = np.any(np.concatenate(turned_back(guess), axis=1), axis=1)
    return int(np.argmax(found)) if found.any() else None
