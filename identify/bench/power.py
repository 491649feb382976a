"""Where friction differs from stick to stick and from person to person: how many cycles and volunteers it takes.

The logarithm of a person's mean strength scatters by `scatter`/sqrt(cycles) about what the person has, and that by
`between` from person to person. Two materials are told apart by a t-test at 5 %: of two groups, or of the differences
within the same people, who need not respond alike (`response`). Its power is that of the noncentral t (J. Cohen,
Statistical Power Analysis for the Behavioral Sciences, 1988).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.special import nctdtr

from identify.base.errors import IdentifyError
from identify.base.quantiles import LEVEL, NORMAL, student

MOST_VOLUNTEERS = 1000
CHANCE = 0.8  # of telling two materials apart, that a study is usually planned for


@dataclass(frozen=True)
class TwoMaterials:
    """Two materials on people. difference: of the logarithms of their strength; scatter: from stick to stick; between:
    from person to person; response: of one person's difference from that of another; cycles: of each person on each
    material, all logs together; paired: whether everybody tries both materials."""

    difference: float
    scatter: float
    between: float
    response: float
    cycles: int
    paired: bool

    def __post_init__(self) -> None:
        """Refuse what cannot be.

        Raises:
            IdentifyError: a spread that is negative, no difference, or no cycle.
        """
        if not (self.difference > 0.0 and min(self.scatter, self.between, self.response) >= 0.0 and self.cycles >= 1):
            raise IdentifyError(
                "two materials differ by more than 0, spreads are 0 or more, cycles 1 or more; correct it"
            )

    @property
    def deviation(self) -> float:
        """Standard deviation of what the test is of: one person's mean, or one person's difference."""
        own = self.scatter**2 / self.cycles
        return math.sqrt(2.0 * own + self.response**2 if self.paired else own + self.between**2)

    def chance(self, volunteers: int) -> float:
        """Of telling the materials apart, with so many volunteers (of each material, where they are not the same)."""
        if volunteers < 2:
            return 0.0
        freedom = volunteers - 1 if self.paired else 2 * (volunteers - 1)
        error = max(self.deviation, 1e-12) * math.sqrt((1.0 if self.paired else 2.0) / volunteers)
        limit, shift = float(student(0.5 + LEVEL / 2.0, freedom)), self.difference / error
        if shift > 30.0 + limit:  # beyond what the series of the noncentral t is good for
            return 1.0
        return float(1.0 - nctdtr(freedom, shift, limit) + nctdtr(freedom, shift, -limit))

    def volunteers(self, chance: float = CHANCE) -> int | None:
        """The fewest that tell the materials apart with this chance; None: more than a thousand."""
        return next((n for n in range(2, MOST_VOLUNTEERS + 1) if self.chance(n) >= chance), None)


def cycles_needed(scatter: float, within: float) -> int:
    """Cycles until the mean strength of one pair is known to `within` (half the 95 % interval, relative), where sticks
    scatter by `scatter` about it, one independent of the other."""
    return max(math.ceil((NORMAL * scatter / math.log1p(within)) ** 2), 2)
