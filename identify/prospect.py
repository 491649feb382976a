"""What happens at an operating point, from the composed nonlinear model: stick-slip, steady sliding, or both."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from identify.branch import Branch, follow, reach
from identify.cycle import SLIDES_AFTER, CycleMap
from identify.orbit import Orbit, Settled, settle
from identify.sliding import Sliding, sliding, unstable_speeds

GROWN = 25.0  # e-foldings after which a disturbance of steady sliding is taken to have come to rest
LONGEST_PATIENCE = 100.0  # half periods


class Outcome(Enum):
    """What the pair does at an operating point; the value is the word in answers."""

    ALWAYS_STICKS = "always sticks"
    NEVER_STICKS = "never sticks"
    BISTABLE = "bistable"
    IRREGULAR = "sticks irregularly"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Prospect:
    """The answer of the nonlinear model at one drive speed [m/s].

    orbit: periodic stick-slip there, None without one; steady: steady sliding there; branch: the orbits followed
    to faster drives, None where none was found at any speed; unstable: intervals of drive speed [m/s] in which
    steady sliding is unstable, within `searched`.
    """

    outcome: Outcome
    orbit: Orbit | None
    steady: Sliding
    branch: Branch | None
    unstable: tuple[tuple[float, float], ...]
    searched: tuple[float, float]

    @property
    def end(self) -> float | None:
        """Drive speed above which stick-slip ends [m/s]; None without stick-slip, or without an end."""
        return None if self.branch is None else self.branch.end


def typical_speed(map_: CycleMap) -> float:
    """Speed that the whole fall of friction gives the mass, (mu_s - mu_k) F_n / sqrt(m k) [m/s]."""
    values = dict(zip(map_.model.parameter_names, map_.p.tolist(), strict=True))
    kinetic = values["mu_k0"] + min(0.0, values.get("delta_mu_k", 0.0))
    fall = max(values["mu_s"] - kinetic, 1e-3 * values["mu_s"])
    return float(fall * map_.normal_force / np.sqrt(values["mass"] * values["stiffness"]))


def _outcome(orbit: Orbit | None, sticks: bool, stable: bool) -> Outcome:
    if orbit is not None and orbit.stable:
        return Outcome.BISTABLE if stable else Outcome.ALWAYS_STICKS
    if orbit is not None or sticks:
        return Outcome.IRREGULAR
    return Outcome.NEVER_STICKS if stable else Outcome.UNDECIDED


def prospect(map_: CycleMap, drive_speed: float) -> Prospect:
    """The answer at drive speed [m/s], positive, and the speed above which stick-slip ends.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    typical = typical_speed(map_)

    def patience(speed: float) -> float:
        growth = sliding(map_.model, map_.p, speed, map_.normal_force).growth * map_.half_period
        return float(np.clip(GROWN / growth, SLIDES_AFTER, LONGEST_PATIENCE)) if growth > 0 else SLIDES_AFTER

    steady = sliding(map_.model, map_.p, drive_speed, map_.normal_force)
    here = settle(map_, drive_speed, patience=patience(drive_speed))
    seed, highest = here.orbit, 30.0 * max(typical, drive_speed)
    if seed is None and not here.sticks:
        slower = drive_speed * np.array([0.3, 0.1, 0.03, 0.01, 1e-3])
        tries = np.unique(np.concatenate([slower, typical * np.array([1.0, 0.3, 0.1, 0.03, 0.01, 1e-3])]))
        nearest = tries[np.argsort(np.abs(np.log(tries / drive_speed)))]
        found = (settle(map_, v, patience=patience(v)) for v in nearest.tolist())
        seed = next((s.orbit for s in found if s.orbit is not None), None)
    branch = None if seed is None else follow(map_, seed, highest, patience)
    orbit = here.orbit
    if orbit is None and branch is not None and not here.sticks:
        below = [o for o in branch.orbits if o.drive_speed < drive_speed]
        if below and (branch.end is None or branch.end > drive_speed):
            near = reach(map_, below[-1], drive_speed, patience)
            again = Settled(None, False) if near is None else settle(map_, drive_speed, near.y)
            orbit = again.orbit
    searched = (1e-3 * min(typical, drive_speed), 10.0 * max(typical, drive_speed, (branch and branch.end) or 0.0))
    unstable = unstable_speeds(map_.model, map_.p, map_.normal_force, *searched)
    return Prospect(_outcome(orbit, here.sticks, steady.stable), orbit, steady, branch, unstable, searched)
