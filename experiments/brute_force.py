"""Settled stick-slip by plain simulation: the answer that orbits and maps are held against.

The motion is that of the tests' integrator (`tests/support/oracle.py`: scipy's DOP853, sticks in closed form), which
shares no line with the package.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice

import numpy as np

from tests.support import oracle

RTOL = 1e-9
SETTLED = 1e-6  # relative change of drop and period from cycle to cycle
LONGEST, DRIFTING = 2000, 10  # cycles of a motion that still drifts one way
SOON, SLIDES_AFTER = 3.0, 60.0  # natural periods in which a slip usually ends, and without rest
SAMPLES = 1000  # of a slip, for its largest speed
State = tuple[float, float]  # at rest: elongation [m], gamma


@dataclass(frozen=True)
class Pair:
    """Friction and rig by name, SI, and the load [N]."""

    values: Mapping[str, float]
    load: float = 1.0

    @staticmethod
    def of(values: Mapping[str, float], load: float = 1.0) -> Pair:
        """From named values."""
        return Pair(values, load)

    @property
    def natural_period(self) -> float:
        """2 pi sqrt(m/k) [s]."""
        return 2.0 * math.pi * math.sqrt(self.values["mass"] / self.values["stiffness"])

    def run(self, drive: float, duration: float, state: oracle.State) -> oracle.Oracle:
        """The motion from (elongation, speed, gamma)."""
        return oracle.simulate(self.values, drive, self.load, duration, state, rtol=RTOL)


@dataclass(frozen=True)
class Jump:
    """One cycle: drop [N], period [s], peak sliding speed [m/s], rest state at its arrest."""

    drop: float
    period: float
    peak: float
    end: State


def cycles_from(pair: Pair, drive: float, state: State) -> Iterator[Jump]:
    """Cycle after cycle from a rest state, until the mass slides for SLIDES_AFTER natural periods."""
    k = pair.values["stiffness"]
    while True:
        stick = max(pair.values["mu_s"] * pair.load / k - state[0], 0.0) / drive
        for periods in (SOON, SLIDES_AFTER):
            motion = pair.run(drive, stick + periods * pair.natural_period, (state[0], 0.0, state[1]))
            if motion.arrests.size:
                break
        # A mass that stops and is not held slides back: no arrest, and no onset after it.
        first, rests = ~np.isin(motion.onsets, motion.arrests), ~np.isin(motion.arrests, motion.onsets)
        begun, before = motion.onset_states[first], 0.0
        onsets, arrests = motion.onsets[first], motion.arrests[rests]
        for onset, arrest, start, end in zip(onsets, arrests, begun, motion.arrest_states[rests], strict=False):
            speed = float(np.max(motion.state(np.linspace(onset, arrest, SAMPLES))[1]))
            state = float(end[0]), float(end[2])
            yield Jump(k * float(start[0] - end[0]), float(arrest) - before, speed, state)
            before = float(arrest)
        if not arrests.size:
            return


def jump(pair: Pair, state: State, drive: float) -> Jump | None:
    """The stick from a rest state and the slip after it; None when the mass does not come to rest again."""
    return next(cycles_from(pair, drive, state), None)


def settled(pair: Pair, drive: float, start: State = (0.0, 1.0), cycles: int = 60) -> Jump | None:
    """The cycle on which the motion from a rest state settles (the last of `cycles`); None when it ends in sliding.

    More cycles are given to a drop that still falls or still grows: just beyond its end stick-slip lingers.
    """
    before: Jump | None = None
    drift, lasted = 0.0, 0
    for i, now in enumerate(islice(cycles_from(pair, drive, start), LONGEST)):
        if before is not None:
            if max(abs(now.drop / before.drop - 1), abs(now.period / before.period - 1)) < SETTLED:
                return now
            sign = math.copysign(1.0, now.drop - before.drop)
            drift, lasted = sign, lasted + 1 if sign == drift else 0
        if i + 1 >= cycles and lasted < DRIFTING:
            return now
        before = now
    return None
