"""The covariance at an answer with all that is allowed for: memory and level of the noise, error of the drive speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.estimation.attempt import Attempt
from identify.estimation.coloured import Colour, colour, coloured_covariance
from identify.estimation.influence import Influence, influence, sample_moves
from identify.estimation.objection import Remembering
from identify.estimation.uncertainty import Information
from identify.shooting.passes import Solved

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Allowed:
    """Covariances of the free parameters (f,) at an answer.

    white (f, f) without the memory of the noise, joint (f + o, f + o) with it and with the parameters of single logs or
    groups; remembered (f,): by how much the memory and the level of the noise alone widen each variance; noise of all
    logs; reached: how the residuals reached the parameters, where the noise has a memory.
    """

    white: Array
    joint: Array
    remembered: Array
    noise: Remembering
    reached: Influence | None

    @property
    def covariance(self) -> Array:
        """(f, f)."""
        return self.joint[: len(self.white), : len(self.white)]

    @property
    def colours(self) -> list[Colour]:
        """Of the noise of each log."""
        return list(self.noise.colours)

    @property
    def memory(self) -> Array:
        """By how much what is allowed for widens the variance of each parameter (f,)."""
        return np.asarray(np.diag(self.covariance) / np.diag(self.white))


def allowed(attempt: Attempt, known: Information, speed_tolerance: float) -> Allowed:
    """What is allowed for at an answer; the memory of the noise where the answer is accepted.

    Args:
        speed_tolerance: relative error of all drive speeds together.
    """
    white, by_speed, noise = known.covariance(), known.drive_speed_shift(), noise_of(attempt)
    joint = known.joint_covariance()
    joint[: len(white), : len(white)] = white + speed_tolerance**2 * np.outer(by_speed, by_speed)
    if attempt.gate.status is not Status.CONVERGED or noise.white:
        return Allowed(white, joint, np.ones(len(white)), noise, None)
    reached = influence_at(attempt.solved)
    excess = _excess(attempt, reached, noise)
    remembered = 1.0 + np.diag(excess)[: len(white)] / np.diag(white)
    return Allowed(white, joint + excess, remembered, noise, reached)


def noise_of(attempt: Attempt) -> Remembering:
    """The noise of all logs of an attempt, coloured like its residuals."""
    logs, fitted = [log.data for log in attempt.prepared], attempt.solved.fitted
    colours = (
        colour(np.where(log.weight > 0, log.force - curve, np.nan)) for log, curve in zip(logs, fitted, strict=True)
    )
    levels = np.broadcast_to(attempt.gate.levels, len(logs)).tolist()
    return Remembering(tuple(log.weight for log in logs), tuple(colours), tuple(levels))


def slowness(attempt: Attempt, colours: Sequence[Colour]) -> float:
    """By how much the memory and the level of the noise widen the variance of what changes slowly, at most."""
    return max(1.0, attempt.gate.level) * max([1.0, *(colour.memory for colour in colours)])


def influence_at(solved: Solved) -> Influence:
    """How the residuals of every part of the logs reach the parameters at an answer."""
    cycles = [guess.parts for guess in solved.guesses]
    return influence(solved.problem, solved.solution.z, cycles, absorbed=False)


def _excess(attempt: Attempt, known: Influence, noise: Remembering) -> Array:
    """What the memory of the noise adds to the covariance of white noise."""
    problem = attempt.solved.problem
    moves = sample_moves(problem, attempt.solved.solution.z, known.columns)
    variances = [
        level / max(float(np.max(weight)), 1e-300) for weight, level in zip(noise.weights, noise.levels, strict=True)
    ]
    return coloured_covariance(moves, variances, noise.colours) - known.white.sum(axis=0)
