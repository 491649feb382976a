"""Which of its logs a fit describes worst."""

from __future__ import annotations

import numpy as np

from identify.diagnosis.fitted import Fitted


def misfits_of_logs(fitted: Fitted) -> list[float]:
    """By how many standard deviations the cycles of each log misfit in the middle of them; infinite where it took no
    part. One cycle with a slip that was missed does not count in it."""
    out = [np.inf] * len(fitted.prepared)
    if fitted.attempt is not None:
        gate = fitted.attempt.gate
        for place, number in enumerate(fitted.attempt.logs, 1):
            told = gate.z[gate.log == place]
            out[number] = float(np.median(told)) if told.size else np.inf
    return out
