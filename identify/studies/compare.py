"""Fits in, comparison out: every parameter pooled by group, outliers by name, what follows at common points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from identify.scene.values import EACH_LOG
from identify.studies.fits import FitEntry, Quantity, Values, shared_labels, values
from identify.studies.joint import outliers
from identify.studies.labels import CompareError, ComparisonQuestion, Taken, take
from identify.studies.mixed import PoolingError
from identify.studies.pooled import Pooled, pool

# ----------------------------------------------------------------------------------------------------------------------
# A fit with parameters that differ between its logs, taken apart: what each group tells, and what all its logs share.
#
# `D` with per = "volunteer" is one estimate for each volunteer, told by that volunteer's logs; it counts with their
# labels. What all logs share is one estimate of the fit and counts once, with the labels that all its logs have.
# ----------------------------------------------------------------------------------------------------------------------

Group = tuple[str, str]  # the label that parameters differ by, and its value


def parts(entry: FitEntry) -> tuple[FitEntry, ...]:
    """What counts for itself of a fit: first what its logs share, then each group; the fit itself where no parameter
    differs between its logs."""
    if not entry.converged:
        return (entry,)
    own = _own(entry)
    if not own:
        return (entry,)
    keys = {key for names in own.values() for key in names.values()}
    common = {name: told for name, told in entry.document["parameters"].items() if name not in keys}
    estimated = {n for n, p in common.items() if isinstance(p, Mapping) and p.get("verdict") != "fixed"}
    apart = {name for names in own.values() for name in names}
    groups = [_group(entry, group, names, estimated | apart) for group, names in own.items()]
    if not estimated:
        return tuple(groups)
    document = dict(entry.document) | {"parameters": common}
    return (replace(entry, fit=entry.name, elsewhere=frozenset(apart - estimated), document=document), *groups)


def _own(entry: FitEntry) -> dict[Group, dict[str, str]]:
    """Of each group its parameters and under which key they stand; a label that makes one group only makes none."""
    found: dict[Group, dict[str, str]] = {}
    for key, told in entry.document["parameters"].items():
        if isinstance(told, Mapping) and told.get("per"):
            group = str(told["per"]), str(told.get("group"))
            found.setdefault(group, {})[str(told.get("parameter") or key)] = key
    several = [per for per, _ in found]
    return {group: keys for group, keys in found.items() if several.count(group[0]) > 1}


def _group(entry: FitEntry, group: Group, keys: Mapping[str, str], searched: set[str]) -> FitEntry:
    """One group with its own parameters under their plain names and with the labels of its logs."""
    per, value = group
    logs = [log for number, log in enumerate(entry.document.get("logs") or (), 1) if _of(log, number, group)]
    said, mixed = shared_labels(logs)
    asked = {} if per == EACH_LOG else {per: value}
    document = dict(entry.document) | {
        "parameters": {name: entry.document["parameters"][key] for name, key in keys.items()},
        "correlation": _renamed(entry.document.get("correlation"), keys),
        "logs": logs,
    }
    return replace(
        entry,
        name=f"{entry.name}, {value if per == EACH_LOG else f'{per} {value}'}",
        labels={n: v for n, v in entry.labels.items() if n not in mixed} | said | asked,
        mixed=tuple(name for name in mixed if name != per),
        document=document,
        fit=entry.name,
        elsewhere=frozenset(searched - set(keys)),
    )


def _of(log: Any, number: int, group: Group) -> bool:
    """Whether a log (counted from 1) belongs to a group."""
    per, value = group
    if per == EACH_LOG:
        return value == f"log {number}"
    labels = log.get("labels") if isinstance(log, Mapping) else None
    return isinstance(labels, Mapping) and str(labels.get(per, "")) == value


def _renamed(correlation: Any, keys: Mapping[str, str]) -> Any:
    """The correlation with a group's own parameters under their plain names; those of the others get no such name."""
    if not isinstance(correlation, Mapping):
        return correlation
    plain = {key: name for name, key in keys.items()}
    names = [str(name) for name in correlation.get("names") or ()]
    return dict(correlation) | {"names": [plain.get(n, f"{n} of another" if n in keys else n) for n in names]}


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

    question: ComparisonQuestion
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


def compare(entries: Sequence[FitEntry], question: ComparisonQuestion) -> Comparison:
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
