"""Stick-slip that looks like steady sliding: a level force that swings as fast as a stick loads, too few samples in
each cycle for the cycles to be seen, so that the swing counts as noise.

The mean force of stick-slip is not that of steady sliding. While the mass slides the spring loads more slowly than in a
stick, dF/dt < k v_0; a swing that reaches that rate comes to rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.logs.spectrum import Spectrum

Array = NDArray[np.float64]

BY_CHANCE = 1e-6  # probability of so high a line in white noise
FEWEST = 8  # periods
MOST_OF_IT = 0.4  # share of the power that lies in the line: less moves the level less than noise does
LOADS, TOO_FAST = 0.5, 4.0  # times k v_0: how fast a swing of stick-slip loads; a saw-tooth's first harmonic does by 2
FASTER = 1.2  # times the natural frequency of the rig: no stick-slip is faster
FROM_LOAD = 0.2  # of the swing: with so much in the normal force it may come from there
ENOUGH = 25  # samples of a period in which its slip is seen
ALIASES = 3  # times the sampling rate up to which a swing may really be


@dataclass(frozen=True)
class Swing:
    """A swing: how many samples see one period, its frequency [Hz] if it is no faster than it looks, and its range
    [N]."""

    samples: float
    frequency: float
    range: float

    def __str__(self) -> str:
        """What the log does, to follow its name."""
        return (
            f"swings by {self.range:.2g} N, {self.frequency:.3g} times a second as far as "
            f"{self.samples:.2g} samples per period tell, as stick-slip does: sample it at "
            f"{ENOUGH * self.frequency:.2g} Hz or more"
        )


def hidden_rhythm(
    time: Array,
    force: Array,
    load: Array | None,
    *,
    stiffness: float,
    drive_speed: float,
    half_period: float,
    least: float = MOST_OF_IT,
) -> Swing | None:
    """The swing of what looks like steady sliding, where it is that of stick-slip; None where there is none.

    Args:
        time, force, load: (n,) [s], [N], [N]; NaN where nothing counts. load: None where the force is without what the
            load does to it.
        stiffness [N/m], drive_speed [m/s], half_period [s] of the rig; 0 where it is not known.
        least: share of the power that the swing holds.
    """
    if not (stiffness > 0.0 and drive_speed > 0.0 and half_period > 0.0):
        return None
    swing = Spectrum.of(time, force)
    if swing is None or swing.periods < FEWEST or swing.chance > BY_CHANCE or swing.share(swing.peak) < least:
        return None
    seen, rate, height = swing.peak, 1.0 / swing.interval, swing.amplitude(swing.peak)
    if load is not None:
        pressed = Spectrum.of(time, load)
        coefficient = abs(float(np.nanmean(force) / np.nanmean(load)))
        if pressed is None or coefficient * pressed.amplitude(seen) > FROM_LOAD * height:
            return None
    candidates = np.array([seen, *(n * rate + sign * seen for n in range(1, ALIASES + 1) for sign in (-1.0, 1.0))])
    candidates = candidates[candidates <= FASTER * 0.5 / half_period]
    loads = 2.0 * np.pi * candidates * height / (stiffness * drive_speed)
    if not np.any((loads >= LOADS) & (loads <= TOO_FAST)):
        return None
    return Swing(swing.samples, seen, 2.0 * height)
