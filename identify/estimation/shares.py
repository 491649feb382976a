"""Parameters that single logs or groups of logs have for themselves: their names, places and estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.estimation.attempt import Attempt
from identify.estimation.uncertainty import Estimate, estimates
from identify.logs.unknowns import Unknowns
from identify.shooting.layout import kept_parameters

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Share:
    """A parameter of one group: index among the parameters, group in words, theta; place (-1: the shared one, which is
    that of the first group) among those beyond the free ones; log: the first one that has it (index in the attempt);
    source: the parameter that it is tied to and takes its theta from, else its own index."""

    index: int
    group: str
    theta: float
    place: int
    log: int
    source: int

    @property
    def tied(self) -> bool:
        """Whether it follows another parameter, and has no place of its own in a covariance."""
        return self.source != self.index


def shares(attempt: Attempt, unknowns: Unknowns) -> list[Share]:
    """Every group's value of every parameter that the scene gives to groups, and of what is tied to one of these; the
    first group first."""
    layout, solved = attempt.solved.problem.layout, attempt.solved
    own = kept_parameters(layout)[layout.free.size :].tolist()
    out: list[Share] = []
    for index in np.flatnonzero(unknowns.grouped).tolist():
        seen: set[int] = set()
        for number, (place, log, guess) in enumerate(zip(layout.places, attempt.prepared, solved.guesses, strict=True)):
            unknown = int(place.own[index])
            where = own.index(unknown) if unknown in own else -1
            if where in seen:
                continue
            seen.add(where)
            group = log.data.groups[index] or f"log {attempt.logs[number] + 1}"
            out.append(Share(index, group, float(guess.theta(solved.theta)[index]), where, number, index))
    followers = [(i, to) for i, to, _ in unknowns.ties]
    return out + [replace(share, index=i) for i, to in followers for share in out if share.index == to]


def share_estimates(
    found: list[Share],
    unknowns: Unknowns,
    theta: Array,
    base: Array,
    covariance: Array,
    *,
    at_bound: Mapping[int, Mapping[str, str]],
    hints: Mapping[str, str],
) -> list[tuple[Share, Estimate]]:
    """Estimates of the groups beyond the first; named "D (V08)".

    Args:
        covariance: (f + o, f + o) of the free parameters and of those of single groups; at_bound: per log, sentences.
    """
    free = np.flatnonzero(unknowns.free)
    out = []
    for share in found:
        if share.place < 0:
            continue
        mine = int(np.flatnonzero(free == share.source)[0])
        order = np.arange(free.size)
        order[mine] = free.size + share.place
        at = theta.copy()
        at[share.source] = share.theta
        block = covariance[np.ix_(order, order)]
        bounds = at_bound.get(share.log, {})
        made = estimates(unknowns, at, base, block, at_bound=bounds, hints=hints, profiles={})[share.index]
        if share.tied:
            made = replace(made, reason=f"{made.reason} ({share.group})")
        out.append((share, replace(made, name=f"{made.name} ({share.group})")))
    return out
