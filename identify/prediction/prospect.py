"""What happens at operating points, from the composed nonlinear model: stick-slip, steady sliding, or both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from identify.prediction.branch import Branch, follow, reach
from identify.prediction.cycle import SLIDES_AFTER, CycleMap, loads
from identify.prediction.orbit import Orbit, Settled, close, settle
from identify.prediction.sliding import Sliding, growth_rates, slidings, unstable_speeds

GROWN = 25.0  # e-foldings after which a disturbance of steady sliding is taken to have come to rest
LONGEST_PATIENCE = 100.0  # half periods
SMALL, FINE = 0.3, 1e-9  # a drop below this share of the load is found again with this tolerance
ALIKE = 1.03  # ratio of normal forces up to which one branch, its end moved by its derivative, serves both


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


def outcome_of(orbit: Orbit | None, sticks: bool, stable: bool) -> Outcome:
    """By the orbit there, whether the mass sticks at all, and whether steady sliding is stable."""
    if orbit is not None and orbit.stable:
        return Outcome.BISTABLE if stable else Outcome.ALWAYS_STICKS
    if orbit is not None or sticks:
        return Outcome.IRREGULAR
    return Outcome.NEVER_STICKS if stable else Outcome.UNDECIDED


def patience(map_: CycleMap, speed: float) -> float:
    """Half periods after which a mass that has not come to rest at this drive speed [m/s] is taken to slide on."""
    rates = growth_rates(map_.model, map_.p, np.array([speed]), map_.normal_force)
    return long_enough(float(rates[0]) * map_.half_period)


def long_enough(growth: float) -> float:
    """Half periods until a disturbance of steady sliding that grows by e^`growth` in each has come to rest."""
    return float(np.clip(GROWN / growth, SLIDES_AFTER, LONGEST_PATIENCE)) if growth > 0 else SLIDES_AFTER


def prospect(map_: CycleMap, drive_speed: float) -> Prospect:
    """The answer at drive speed [m/s], positive, and the speed above which stick-slip ends.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    return prospects([map_], [drive_speed])[0]


def prospects(maps: Sequence[CycleMap], drive_speeds: Sequence[float]) -> list[Prospect]:
    """The answers of one model at several drive speeds [m/s], positive, each under its own map.

    Where pair and rig are the same and the normal forces differ by a few percent at most, one branch of orbits
    serves all: it is followed from the fastest drive that sticks, its end carried to the other forces by its
    derivative.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    loads = np.array([m.normal_force for m in maps])
    steady = slidings(maps[0].model, np.stack([m.p for m in maps]), np.asarray(drive_speeds, float), loads)
    settled = [
        _refined(m, settle(m, s.drive_speed, patience=long_enough(s.growth * m.half_period)))
        for m, s in zip(maps, steady, strict=True)
    ]
    branches: list[Branch | None] = [None] * len(maps)
    done: list[Branch] = []
    for i in sorted(range(len(maps)), key=lambda j: -drive_speeds[j]):
        if settled[i].orbit is None and settled[i].sticks:
            continue
        shared = next((b for b in done if _serves(b, maps[i], settled[i], drive_speeds[i])), None)
        own = shared or _branch(maps[i], drive_speeds[i], settled[i])
        if own is not None and shared is None:
            done.append(own)
        branches[i] = None if own is None else own.under(maps[i].normal_force)
    return [_prospect(*each) for each in zip(maps, steady, settled, branches, strict=True)]


def _refined(map_: CycleMap, here: Settled) -> Settled:
    """A small jump closed again with tighter steps: what is left of it is a difference of large numbers."""
    orbit = here.orbit
    if orbit is None:
        return here
    onset, arrest = loads(map_, orbit.cycle)
    if onset - arrest > SMALL * abs(onset):
        return here
    again = close(map_.finer(FINE), orbit.y, orbit.drive_speed, patience=LONGEST_PATIENCE)
    return here if again is None else Settled(again, here.sticks)


def _serves(branch: Branch, map_: CycleMap, here: Settled, drive_speed: float) -> bool:
    """Whether a branch found for a faster drive is also that of this operating point."""
    ratio = map_.normal_force / branch.normal_force
    if not np.array_equal(map_.p, branch.orbits[0].cycle.setting[:-2]):
        return False
    if not 1 / ALIKE <= ratio <= ALIKE or here.orbit is None:
        return False
    if branch.ending is None:
        return True
    carried = ratio == 1.0 or bool(np.isfinite(branch.ending.slopes[-2]))
    return carried and drive_speed < float(np.exp(branch.ending.place))


def _branch(map_: CycleMap, drive_speed: float, here: Settled) -> Branch | None:
    """The branch through the orbit at an operating point, or through one at another drive speed."""
    typical, seed = typical_speed(map_), here.orbit
    if seed is None:
        slower = drive_speed * np.array([0.3, 0.1, 0.03, 0.01, 1e-3])
        tries = np.unique(np.concatenate([slower, typical * np.array([1.0, 0.3, 0.1, 0.03, 0.01, 1e-3])]))
        nearest = tries[np.argsort(np.abs(np.log(tries / drive_speed)))]
        found = (settle(map_, v, patience=patience(map_, v)) for v in nearest.tolist())
        seed = next((s.orbit for s in found if s.orbit is not None), None)
    return None if seed is None else follow(map_, seed, 30.0 * max(typical, drive_speed), patience)


def _prospect(map_: CycleMap, steady: Sliding, here: Settled, branch: Branch | None) -> Prospect:
    typical, drive_speed, orbit = typical_speed(map_), steady.drive_speed, here.orbit
    if orbit is None and branch is not None and not here.sticks:
        below = [o for o in branch.orbits if o.drive_speed < drive_speed]
        if below and (branch.end is None or branch.end > drive_speed):
            near = reach(map_, below[-1], drive_speed, patience)
            again = Settled(None, False) if near is None else settle(map_, drive_speed, near.y)
            orbit = again.orbit
    searched = (1e-3 * min(typical, drive_speed), 10.0 * max(typical, drive_speed, (branch and branch.end) or 0.0))
    unstable = unstable_speeds(map_.model, map_.p, map_.normal_force, *searched)
    return Prospect(outcome_of(orbit, here.sticks, steady.stable), orbit, steady, branch, unstable, searched)
