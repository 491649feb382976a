"""Cycles kept back from a fit, and how well it predicts them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.diagnosis.fitted import Fitted
from identify.logs.log_data import Guess
from identify.logs.prepare import Prepared
from identify.shooting.passes import Solved, solve_in_passes

KEPT_BACK = 3  # every such cycle is kept back to be predicted
FEWEST = 4  # cycles of a log of which one can be kept back


def held_out_error(fitted: Fitted) -> float:
    """Mean square of the force residuals, in noise variances, of cycles kept back from a second solve; NaN without any.

    The dynamics and the cycles around carry the motion through a kept-back cycle; its samples do not count.
    """
    attempt = fitted.attempt
    if attempt is None or not np.isfinite(fitted.excess):
        return float("nan")
    masks = [_kept_back(log, g) for log, g in zip(attempt.prepared, attempt.solved.guesses, strict=True)]
    if not any(np.any(mask) for mask in masks):
        return float("nan")
    data = [
        replace(log.data, weight=np.where(mask, 0.0, log.data.weight))
        for log, mask in zip(attempt.prepared, masks, strict=True)
    ]
    start = replace(fitted.unknowns, start=attempt.solved.theta).softened()
    solved: Solved = solve_in_passes(data, attempt.solved.guesses, start)
    if not solved.solution.success:
        return float("inf")
    total, count = 0.0, 0
    for log, mask, force in zip(attempt.prepared, masks, solved.fitted, strict=True):
        inside = mask & np.isfinite(force) & (log.data.weight > 0)
        total += float(np.sum(log.data.weight[inside] * (log.data.force[inside] - force[inside]) ** 2))
        count += int(np.count_nonzero(inside))
    return total / count if count else float("nan")


def _kept_back(log: Prepared, guess: Guess) -> NDArray[np.bool_]:
    """The samples of the cycles of a log that are kept back."""
    mask = np.zeros(log.data.time.size, bool)
    if guess.cycles < FEWEST:
        return mask
    for cycle in range(KEPT_BACK - 1, guess.cycles, KEPT_BACK):
        mask |= (log.data.time > guess.arrest[cycle - 1]) & (log.data.time <= guess.arrest[cycle])
    return mask
