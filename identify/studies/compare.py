"""Fits in, comparison out: every parameter pooled by group, outliers by name, what follows at common points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identify.studies.comparison_parts import parts
from identify.studies.fits import FitEntry
from identify.studies.labels import CompareError, Question, Taken, take
from identify.studies.mixed import PoolingError
from identify.studies.outliers import outliers
from identify.studies.pooled import Pooled, pool
from identify.studies.quantities import Quantity, Values, values

FEW = 2  # fits that must tell a quantity


@dataclass(frozen=True)
class OddFit:
    """A fit that does not belong: its name, the quantity, how many standard deviations it is off, the chance."""

    name: str
    quantity: str
    z: float
    p: float


@dataclass(frozen=True)
class PooledQuantity:
    """A quantity and its pooled answer, or the reason why there is none; untold: fits by name that do not tell it."""

    quantity: Quantity
    pooled: Pooled | None
    reason: str
    untold: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Comparison:
    """A finished comparison. entries: all fits that were found; parts: what counts for itself of them; taken: what is
    compared of that; groups: in natural order."""

    question: Question
    entries: tuple[FitEntry, ...]
    parts: tuple[FitEntry, ...]
    taken: Taken
    values: Values
    quantities: tuple[PooledQuantity, ...]
    odd: tuple[OddFit, ...]
    groups: tuple[str, ...]

    @property
    def answered(self) -> Mapping[str, Pooled]:
        """The pooled quantities by name."""
        return {q.quantity.name: q.pooled for q in self.quantities if q.pooled is not None}

    @property
    def odd_fits(self) -> frozenset[str]:
        """The fits that do not belong, or a part of which does not."""
        odd = {o.name for o in self.odd}
        return frozenset(part.whole for part in self.parts if part.name in odd)


def compare(entries: Sequence[FitEntry], question: Question) -> Comparison:
    """Compare groups of fits.

    Raises:
        CompareError: nothing to compare; the text says why.
    """
    every = tuple(part for entry in entries for part in parts(entry))
    taken = take(every, question)
    told = values(taken.entries)
    if not told.quantities:
        raise CompareError("these fits tell no parameter; expected fits with parameters that are identified")
    names = [e.name for e in taken.entries]
    family = len(told.quantities)
    quantities, odd = [], []
    for k, quantity in enumerate(told.quantities):
        untold = tuple((names[i], reason) for i, reason in told.untold[quantity.name])
        if np.count_nonzero(np.isfinite(told.y[:, k])) < FEW:
            quantities.append(PooledQuantity(quantity, None, "fewer than two fits tell it", untold))
            continue
        try:
            pooled = pool(told.y[:, k], told.covariance[:, k, k], taken.setting, family)
        except PoolingError as error:
            quantities.append(PooledQuantity(quantity, None, str(error), untold))
            continue
        quantities.append(PooledQuantity(quantity, pooled, "", untold))
        odd += [OddFit(names[pooled.rows[o.row]], quantity.name, o.z, o.p) for o in outliers(pooled.mixed, family)]
    return Comparison(
        question=question,
        entries=tuple(entries),
        parts=every,
        taken=taken,
        values=told,
        quantities=tuple(quantities),
        odd=tuple(odd),
        groups=taken.groups,
    )
