"""Fits in, comparison out: every parameter pooled by group, outliers by name, what follows at common points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from identify.scene.tables import DAMPING
from identify.scene.values import EACH_LOG
from identify.studies.fits import FitEntry, Quantity, Values, shared_labels, values
from identify.studies.labels import CompareError, ComparisonQuestion, Taken, take
from identify.studies.pooled import Pooled, PoolingError, pool

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
    common = {name: told for name, told in entry.result.parameters.items() if name not in keys}
    estimated = {name for name, told in common.items() if told.verdict != "fixed"}
    apart = {name for names in own.values() for name in names}
    groups = [_group(entry, group, names, estimated | apart) for group, names in own.items()]
    if not estimated:
        return tuple(groups)
    result = replace(entry.result, parameters=common)
    return (replace(entry, fit=entry.name, elsewhere=frozenset(apart - estimated), result=result), *groups)


def _own(entry: FitEntry) -> dict[Group, dict[str, str]]:
    """Of each group its parameters and under which key they stand; a label that makes one group only makes none."""
    found: dict[Group, dict[str, str]] = {}
    for key, told in entry.result.parameters.items():
        if told.per:
            found.setdefault((told.per, told.group), {})[told.parameter or key] = key
    several = [per for per, _ in found]
    return {group: keys for group, keys in found.items() if several.count(group[0]) > 1}


def _group(entry: FitEntry, group: Group, keys: Mapping[str, str], searched: set[str]) -> FitEntry:
    """One group with its own parameters under their plain names and with the labels of its logs."""
    per, value = group
    told = entry.result
    logs = tuple(
        log
        for number, log in enumerate(told.logs, 1)
        if (value == f"log {number}" if per == EACH_LOG else log.labels.get(per, "") == value)
    )
    said, mixed = shared_labels(logs)
    asked = {} if per == EACH_LOG else {per: value}
    own = {name: told.parameters[key] for name, key in keys.items()}
    return replace(
        entry,
        name=f"{entry.name}, {value if per == EACH_LOG else f'{per} {value}'}",
        labels={n: v for n, v in entry.labels.items() if n not in mixed} | said | asked,
        mixed=tuple(name for name in mixed if name != per),
        result=replace(told, parameters=own, logs=logs),
        fit=entry.name,
        elsewhere=frozenset(searched - set(keys)),
    )


def _with_known_rig(entry: FitEntry) -> FitEntry:
    """The fit with what its scene states of the rig, with a tolerance, as given: records of the rig told it, so that no
    group differs in it, and testing it would only widen what is said of friction."""
    rig = entry.result.scene.get("rig")
    stated = rig.items() if isinstance(rig, Mapping) else ()
    known = {"damping" if n in DAMPING else n for n, v in stated if isinstance(v, Mapping) and "tolerance" in v}
    parameters = {n: replace(p, verdict="fixed") if n in known else p for n, p in entry.result.parameters.items()}
    return replace(entry, result=replace(entry.result, parameters=parameters)) if known else entry


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
    every = tuple(part for entry in entries for part in parts(_with_known_rig(entry)))
    taken = take(every, question)
    told = values(taken.entries)
    if not told.quantities:
        raise CompareError("these fits tell no parameter; expected fits with parameters that are identified")
    names = [e.name for e in taken.entries]
    family = len(told.quantities)
    quantities, odd = [], []
    for k, quantity in enumerate(told.quantities):
        untold = tuple((names[i], reason) for i, reason in told.untold[quantity.name])
        try:
            pooled = pool(told.y[:, k], told.variance[:, k], taken.setting, family)
        except PoolingError as error:
            quantities.append(PooledQuantity(quantity, None, str(error), untold))
            continue
        quantities.append(PooledQuantity(quantity, pooled, "", untold))
        odd += [OddFit(names[pooled.rows[o.row]], quantity.name, o.z, o.p) for o in pooled.outliers]
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
