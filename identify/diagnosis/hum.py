"""Whether what a misfit leaves of a log hums with the mains."""

from __future__ import annotations

import numpy as np

from identify.estimation.attempt import Attempt
from identify.logs.spectrum import Spectrum

MAINS = (50.0, 60.0, 100.0, 120.0, 150.0, 180.0)  # Hz, with what a rectifier makes of it
NEAR = 0.01  # relative distance from them, or one step of the spectrum
BY_CHANCE = 1e-9
SHARE = 0.1  # of the power of what is left


def hum(attempt: Attempt | None) -> str:
    """What of the logs hums, to go behind a sentence on a misfit; "" where nothing does."""
    if attempt is None:
        return ""
    solved = attempt.solved
    for log, prepared, curve in zip(solved.problem.logs, attempt.prepared, solved.fitted, strict=True):
        swing = Spectrum.of(log.time, np.where(log.weight > 0.0, log.force - curve, np.nan))
        if swing is None or swing.chance > BY_CHANCE or swing.share(swing.peak) < SHARE:
            continue
        step = float(swing.frequency[1])
        if any(abs(swing.peak - mains) <= max(NEAR * mains, step) for mains in MAINS):
            height = 1e3 * swing.amplitude(swing.peak)
            return (
                f"; what is left of {prepared.name} swings {swing.peak:.3g} times a second by {height:.2g} mN, as hum "
                "of the mains does: shield or ground the sensor, or state a noise that holds it"
            )
    return ""
