"""Mass, stiffness and damping of a rig from all that was measured of it, and what the skin adds in series.

Least squares in the logarithms: ln w = (ln k - ln(m + added))/2 for each ring-down, ln k for each stick on a rigid
block, -ln(1/k + 1/k_skin) on skin, each over its standard error; an error of the drive speed, common to all sticks,
and one of the added masses are unknowns with their tolerance. Figures that scatter by more than their errors widen
the intervals (Birge ratio).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtrc

from identify.base.errors import IdentifyError
from identify.base.quantiles import NORMAL, student
from identify.bench.records import Measured

Array = NDArray[np.float64]

DISAGREE = 0.01  # probability below which figures that agree would scatter so much
UNKNOWN = 1.0  # standard deviation of a logarithm: beyond it a quantity is not known
LIKELY = {"mass": 0.2, "stiffness": 1470.0, "skin_stiffness": 4400.0}  # where the search starts, SI


@dataclass(frozen=True)
class RigValue:
    """A quantity of a rig [SI] and its relative standard deviation."""

    value: float
    tolerance: float

    @property
    def interval(self) -> tuple[float, float]:
        """Of 95 %, in which the logarithm is normal."""
        reach = math.exp(NORMAL * self.tolerance)
        return self.value / reach, self.value * reach


@dataclass(frozen=True)
class Agreement:
    """Of figures among each other: by how much intervals are widened (1: they agree), the probability that figures
    which agree scatter as these do, and the figure that is farthest off, in words."""

    widening: float
    chance: float
    worst: str


@dataclass(frozen=True)
class RigCalibration:
    """mass [kg], stiffness [N/m], damping ratio zeta; skin_stiffness [N/m]; natural_frequency sqrt(k/m) [rad/s]; None:
    not determined; agreement of the records among each other."""

    mass: RigValue | None
    stiffness: RigValue | None
    zeta: RigValue | None
    skin_stiffness: RigValue | None
    natural_frequency: RigValue | None
    agreement: Agreement

    @property
    def tied(self) -> float:
        """Tolerance of sqrt(k/m) where mass and stiffness are known together better than apart; 0 where they are not:
        a tap measures their ratio to a thousandth, so that what one is off by the other is off by too."""
        if self.mass is None or self.natural_frequency is None:
            return 0.0
        return self.natural_frequency.tolerance if 2.0 * self.natural_frequency.tolerance < self.mass.tolerance else 0.0

    @property
    def missing(self) -> tuple[str, ...]:
        """What a scene needs and no record determines."""
        names = ("mass", "stiffness", "zeta")
        return tuple(name for name in names if getattr(self, name) is None)


def calibrated(measured: Sequence[Measured], speed_tolerance: float, added_tolerance: float) -> RigCalibration:
    """The rig that fits all figures best.

    Args:
        measured: at least one.
        speed_tolerance, added_tolerance: of the drive speed, and of added masses; relative, one standard deviation.

    Raises:
        IdentifyError: added masses that did not lower the frequency.
    """
    if not measured:
        raise IdentifyError("no record determines anything of the rig; give a tap, or a stick on a rigid block")
    _check_added(measured)
    oscillator = [m for m in measured if m.kind != "zeta"]
    names = ["mass", "stiffness", *(["skin_stiffness"] if any(m.kind == "series" for m in measured) else [])]
    tolerances = np.array([max(speed_tolerance, 1e-9), max(added_tolerance, 1e-9)])

    def off(x: Array) -> Array:
        rig = dict(zip(names, x, strict=False))
        speed, added = x[len(names) :] * tolerances
        rows = [(_predicted(m, rig, speed, added) - math.log(m.value)) / m.error for m in oscillator]
        return np.array([*rows, *x[len(names) :]])

    begin = np.array([*(math.log(LIKELY[name]) for name in names), 0.0, 0.0])
    best = least_squares(off, begin, x_scale="jac", method="trf", max_nfev=500, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    _, seen, rows = np.linalg.svd(best.jac)
    singular = np.zeros(begin.size)
    singular[: seen.size] = seen
    # What is not determined has a singular value of zero, or of the rounding of differences: its deviation is huge.
    inverse = (rows.T / np.maximum(singular, 1e-9 * seen[0]) ** 2) @ rows
    agreed = _agreement(best.fun, int(np.count_nonzero(singular > 1e-6 * seen[0])), oscillator)
    deviations = np.sqrt(np.diag(inverse)) * agreed.widening
    found = {
        name: RigValue(math.exp(best.x[i]), float(deviations[i])) if deviations[i] < UNKNOWN else None
        for i, name in enumerate(names)
    }
    ratio = np.array([-0.5, 0.5] + [0.0] * (begin.size - 2))
    spread = float(np.sqrt(ratio @ inverse @ ratio)) * agreed.widening
    both = found["mass"] is not None and found["stiffness"] is not None
    natural = RigValue(math.exp(ratio @ best.x), spread) if both else None
    zeta, of_zeta = _zeta(measured)
    return RigCalibration(
        found["mass"],
        found["stiffness"],
        zeta,
        found.get("skin_stiffness"),
        natural,
        min(agreed, of_zeta, key=lambda a: a.chance),
    )


def _predicted(m: Measured, rig: dict[str, float], speed: float, added: float) -> float:
    """Logarithm of what a rig, in logarithms, would show: with relative errors of the drive speed and of added mass."""
    if m.kind == "mass":
        return rig["mass"]
    stiffness = rig["stiffness"]
    if m.kind == "frequency":
        return 0.5 * (stiffness - math.log(math.exp(rig["mass"]) + m.added * (1.0 + added)))
    if m.kind == "series":
        stiffness = -math.log(math.exp(-stiffness) + math.exp(-rig["skin_stiffness"]))
    return stiffness + (speed if m.by_speed else 0.0)


def _agreement(residuals: Array, unknowns: int, measured: Sequence[Measured]) -> Agreement:
    """Whether residuals over their errors scatter as those of figures that agree; the first of them are `measured`."""
    freedom, total = residuals.size - unknowns, float(residuals @ residuals)
    if freedom < 1 or not measured:
        return Agreement(1.0, 1.0, "")
    chance = float(chdtrc(freedom, total))
    birge = math.sqrt(total / freedom) * float(student(0.975, freedom)) / NORMAL
    worst = measured[int(np.argmax(np.abs(residuals[: len(measured)])))].source
    return Agreement(max(birge, 1.0) if chance < DISAGREE else 1.0, chance, worst)


def _zeta(measured: Sequence[Measured]) -> tuple[RigValue | None, Agreement]:
    """The damping ratio of the rig as it is used; with an added mass on it where no other record determines it."""
    zetas = [m for m in measured if m.kind == "zeta"]
    used = [m for m in zetas if m.added == 0.0] or zetas
    if not used:
        return None, Agreement(1.0, 1.0, "")
    weights = np.array([1.0 / m.error**2 for m in used])
    values = np.log([m.value for m in used])
    mean = float(weights @ values / weights.sum())
    off = np.sqrt(weights) * (values - mean)
    agreed = _agreement(off, 1, used)
    deviation = float(weights.sum() ** -0.5) * agreed.widening
    return (RigValue(math.exp(mean), deviation) if deviation < UNKNOWN else None), agreed


def _check_added(measured: Sequence[Measured]) -> None:
    """Refuse an added mass that did not lower the frequency.

    Raises:
        IdentifyError: which record.
    """
    bare = [m for m in measured if m.kind == "frequency" and m.added == 0.0]
    for m in measured:
        if m.kind == "frequency" and m.added > 0.0 and bare:
            low = min(bare, key=lambda other: other.value)
            if math.log(low.value / m.value) < -3.0 * math.hypot(low.error, m.error):
                raise IdentifyError(
                    f"{m.source}, faster than without the {1e3 * m.added:.4g} g that were added ({low.source}); a "
                    "heavier rig rings slower: check which record is which, and that the mass was fixed firmly"
                )
