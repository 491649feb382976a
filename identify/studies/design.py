"""From labels to a design: group means, covariates, and the sources of scatter that these fits can tell apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identify.studies.mixed import Component

Array = NDArray[np.float64]

RUN, SUBJECT, SUBJECT_BY_GROUP = "run", "subject", "subject by group"
TOLD_APART = 1e-6  # of a component's information, that the others must leave to it


@dataclass(frozen=True)
class Setting:
    """What is known of n fits: group (n,) labels; subject (n,): whose fit it is, None where nobody says;
    factors: further labels that are adjusted for; covariates: numbers that are adjusted for, each (n,)."""

    group: tuple[str, ...]
    subject: tuple[str, ...] | None = None
    factors: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    covariates: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def rows(self, kept: Sequence[int]) -> Setting:
        """The same of some of the fits, by index."""

        def take(labels: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(labels[i] for i in kept)

        return Setting(
            take(self.group),
            None if self.subject is None else take(self.subject),
            {name: take(labels) for name, labels in self.factors.items()},
            {name: tuple(numbers[i] for i in kept) for name, numbers in self.covariates.items()},
        )


@dataclass(frozen=True)
class Design:
    """Fixed effects X (n, p), the first len(groups) columns the means of the groups where all else is average;
    columns: their names; components: sources of scatter; dropped: what cannot be told apart here, and from what."""

    groups: tuple[str, ...]
    X: Array
    columns: tuple[str, ...]
    components: tuple[Component, ...]
    dropped: Mapping[str, str]


def design(setting: Setting) -> Design:
    """The design of a setting; what the labels cannot tell apart is left out and named."""
    groups = tuple(dict.fromkeys(setting.group))
    X, columns, dropped = _fixed(setting, groups)
    kept: list[Component] = []
    for component in candidates(setting):
        reason = _confounded(component, kept, X)
        if reason:
            dropped[component.name] = reason
        else:
            kept.append(component)
    return Design(groups, X, columns, tuple(kept), dropped)


def indicators(labels: Sequence[object]) -> Array:
    """One column per level, in the order of first appearance: shape (n, levels)."""
    levels = {label: k for k, label in enumerate(dict.fromkeys(labels))}
    out = np.zeros((len(labels), len(levels)))
    out[np.arange(len(labels)), [levels[label] for label in labels]] = 1.0
    return out


def _fixed(setting: Setting, groups: tuple[str, ...]) -> tuple[Array, tuple[str, ...], dict[str, str]]:
    X, columns, dropped = indicators(setting.group), list(groups), {}
    extra: list[tuple[str, Array]] = []
    for name, numbers in setting.covariates.items():
        extra.append((name, np.asarray(numbers, float)[:, None]))
    for name, labels in setting.factors.items():
        levels = indicators(labels)
        extra.append((name, levels[:, :-1] - levels[:, -1:]))  # sums to zero: means stand for the average level
    for name, block in extra:
        centred = block - block.mean(axis=0) if name in setting.covariates else block
        joined = np.hstack([X, centred])
        if block.shape[1] == 0 or np.ptp(block) == 0.0:
            dropped[name] = "it is the same in all these fits"
        elif _rank(joined) < joined.shape[1]:
            dropped[name] = "it goes with the groups, so that its part cannot be told from theirs"
        elif joined.shape[1] >= len(setting.group):
            dropped[name] = "there are too few fits to adjust for it"
        else:
            X = joined
            columns += [name] * block.shape[1]
    return X, tuple(columns), dropped


def _rank(X: Array) -> int:
    size = np.sqrt(np.sum(X**2, axis=0))
    return int(np.linalg.matrix_rank(X / np.where(size > 0.0, size, 1.0), tol=1e-8))


def candidates(setting: Setting) -> list[Component]:
    """Every source of scatter that the labels name, whether or not these fits tell it."""
    n = len(setting.group)
    found = [Component(RUN, np.eye(n))]
    if setting.subject is not None:
        found.append(Component(SUBJECT, indicators(setting.subject)))
        crossed = list(zip(setting.subject, setting.group, strict=True))
        found.append(Component(SUBJECT_BY_GROUP, indicators(crossed)))
        for name, labels in setting.factors.items():
            found.append(Component(f"subject by {name}", indicators(list(zip(setting.subject, labels, strict=True)))))
    return found


def _confounded(component: Component, kept: Sequence[Component], X: Array) -> str:
    """Why a source of scatter cannot be told from the others, or nothing."""
    inside = _projected(component.Z, X)
    own = float(np.sum(inside**2))
    if own <= 1e-9 * component.Z.shape[0]:
        return "it goes with the means of the groups"
    others = [_projected(c.Z, X) for c in kept]
    if not others:
        return ""
    gram = np.array([[np.sum(a * b) for a in others] for b in others])
    shared = np.array([np.sum(inside * a) for a in others])
    left = own - shared @ np.linalg.lstsq(gram, shared, rcond=None)[0]
    return "" if left > TOLD_APART * own else f"it goes with {' and '.join(c.name for c in kept)}"


def _projected(Z: Array, X: Array) -> Array:
    """M Z Z' M with M the projection away from X."""
    rest = Z - X @ np.linalg.lstsq(X, Z, rcond=None)[0]
    return np.asarray(rest @ rest.T)
