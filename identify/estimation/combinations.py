"""What the data hold even where single parameters are loose: combinations of them, with units and in words.

Two views of one covariance: combinations that mean something by themselves (a creep velocity, an initial slope), listed
where they are sharper than what they are made of, and known to a factor of three; and its eigenvectors, from the best
known direction to the worst.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import NORMAL
from identify.estimation.attempt import Attempt
from identify.estimation.covariance import Estimate, estimates
from identify.logs.unknowns import Unknowns
from identify.prediction.wording import listed
from identify.shooting.layout import kept_parameters

Array = NDArray[np.float64]
Values = Mapping[str, float]

SHARPER = 1.5  # times: how much better a combination must be known than its worst part to be listed
WIDEST = float(np.log(3.0))  # half width of the logarithm: a combination that is known no better is not known
LOOSE = 3.0  # relative size from which a direction is not told in numbers: a line that is so long says nothing
SHOWN = 0.2  # of the largest part of a direction: smaller parts are not named


@dataclass(frozen=True)
class Natural:
    """A combination that means something: name, unit, words, the parameters in it, and its value from theirs (SI)."""

    name: str
    unit: str
    meaning: str
    parts: tuple[str, ...]
    of: Callable[[Values], float]


NATURAL = (
    Natural(
        "mu_s - mu_k0", "", "strengthening of a saturated contact", ("mu_s", "mu_k0"), lambda p: p["mu_s"] - p["mu_k0"]
    ),
    Natural(
        "mu_k0 + delta_mu_k",
        "",
        "kinetic coefficient at high speed",
        ("mu_k0", "delta_mu_k"),
        lambda p: p["mu_k0"] + p["delta_mu_k"],
    ),
    Natural(
        "a delta_mu_k",
        "s/m",
        "initial slope of friction against speed",
        ("a", "delta_mu_k"),
        lambda p: p["a"] * p["delta_mu_k"],
    ),
    Natural("D/t_cr", "m/s", "creep velocity", ("D", "t_cr"), lambda p: p["D"] / p["t_cr"]),
    Natural(
        "(mu_s - mu_k0)/D",
        "1/m",
        "loss of strength per length of sliding",
        ("mu_s", "mu_k0", "D"),
        lambda p: (p["mu_s"] - p["mu_k0"]) / p["D"],
    ),
    Natural(
        "(mu_s - mu_k0)/t_cr",
        "1/s",
        "gain of strength in the first moments of rest",
        ("mu_s", "mu_k0", "t_cr"),
        lambda p: (p["mu_s"] - p["mu_k0"]) / p["t_cr"],
    ),
    Natural(
        "stiffness/mass",
        "1/s^2",
        "square of the natural frequency",
        ("stiffness", "mass"),
        lambda p: p["stiffness"] / p["mass"],
    ),
)


@dataclass(frozen=True)
class Combination:
    """A natural combination at the answer: value and standard error in its unit; sharper: how many times better it is
    known, relative to its size, than the loosest of its parts."""

    natural: Natural
    value: float
    standard_error: float
    sharper: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval, in the logarithm: a combination keeps its sign."""
        with np.errstate(over="ignore"):
            wide = float(np.exp(NORMAL * self.standard_error / abs(self.value)))
        low, high = sorted((self.value / wide, self.value * wide))
        return low, high


@dataclass(frozen=True)
class Direction:
    """An eigenvector of the covariance: size of one standard error along it, relative; what each parameter does
    meanwhile, in SI; the sentence."""

    size: float
    moves: Mapping[str, float]
    text: str


def combinations(
    names: Sequence[str], logarithmic: Sequence[bool], values: Values, covariance: Array
) -> list[Combination]:
    """The natural combinations of free parameters that are sharper than their parts.

    Args:
        names, logarithmic: of the free parameters (f,); values: of all parameters (SI); covariance (f, f) of theta.
    """
    sizes = _sizes(names, logarithmic, values)
    loose = dict(zip(names, (np.sqrt(np.diag(covariance)) / sizes).tolist(), strict=True))
    out = []
    for natural in NATURAL:
        mine = [name for name in natural.parts if name in loose]
        if len(mine) < 2 or any(name not in values for name in natural.parts):
            continue
        value = natural.of(values)
        slope = np.array([_slope(natural, values, name, log) for name, log in zip(names, logarithmic, strict=True)])
        error = float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
        if value == 0.0 or not np.isfinite(error) or error == 0.0:
            continue
        sharper = max(loose[name] for name in mine) / (error / abs(value))
        if sharper >= SHARPER and NORMAL * error / abs(value) <= WIDEST:
            out.append(Combination(natural, value, error, sharper))
    return out


def _slope(natural: Natural, values: Values, name: str, logarithmic: bool) -> float:
    """Derivative with respect to theta of one parameter, by a central difference."""
    if name not in natural.parts:
        return 0.0
    step = 1e-5
    factor = (lambda s: values[name] * np.exp(s * step)) if logarithmic else (lambda s: values[name] + s * step)
    ahead, behind = (natural.of({**values, name: float(factor(sign))}) for sign in (1.0, -1.0))
    return (ahead - behind) / (2 * step)


def _sizes(names: Sequence[str], logarithmic: Sequence[bool], values: Values) -> Array:
    """What theta is measured by: 1 for a logarithm, mu_s - mu_k0 for a coefficient, else its own value."""
    step = abs(values.get("mu_s", 0.0) - values.get("mu_k0", 0.0)) or 0.1
    coefficients = {"mu_s", "mu_k0", "delta_mu_k"}
    return np.array(
        [
            1.0 if log else step if name in coefficients else abs(values.get(name, 0.0)) or 1.0
            for name, log in zip(names, logarithmic, strict=True)
        ]
    )


def directions(names: Sequence[str], logarithmic: Sequence[bool], values: Values, covariance: Array) -> list[Direction]:
    """The eigenvectors of the covariance (f, f) of theta, best known first; arguments as `combinations`."""
    sizes = _sizes(names, logarithmic, values)
    spread, vectors = np.linalg.eigh(covariance / np.outer(sizes, sizes))
    out = []
    for number, (variance, vector) in enumerate(zip(spread, vectors.T, strict=True)):
        size = float(np.sqrt(max(variance, 0.0)))
        lead = int(np.argmax(np.abs(vector)))
        vector = vector * np.sign(vector[lead])
        shown = np.flatnonzero(np.abs(vector) >= SHOWN * abs(vector[lead]))
        shown = shown[np.argsort(-np.abs(vector[shown]))]
        moves = {names[i]: float(size * vector[i] * sizes[i]) for i in shown.tolist()}
        logs = {names[i]: bool(logarithmic[i]) for i in shown.tolist()}
        out.append(Direction(size, moves, _sentence(number, len(spread), size, moves, logs)))
    return out


def _sentence(number: int, count: int, size: float, moves: Mapping[str, float], logs: Mapping[str, bool]) -> str:
    rank = "known best" if number == 0 else "known worst" if number == count - 1 else f"known {number + 1} of {count}"
    if size > LOOSE:
        return f"{rank}: {listed(list(moves))}{' together' if len(moves) > 1 else ''}, which these logs do not tell"
    with np.errstate(over="ignore"):
        percent = {name: 100 * np.expm1(move) for name, move in moves.items()}
    told = [f"{name} {percent[name]:+.2g} %" if logs[name] else f"{name} {move:+.2g}" for name, move in moves.items()]
    if len(told) == 1:
        return f"{rank}: {told[0]} by itself is one standard error"
    return f"{rank}: {listed(told)} together are one standard error"


# ----------------------------------------------------------------------------------------------------------------------
# Parameters that single logs or groups of logs have for themselves: their names, places and estimates.
# ----------------------------------------------------------------------------------------------------------------------


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
        for number, (place, log, trajectory) in enumerate(
            zip(layout.places, attempt.fitted_logs, solved.trajectories, strict=True)
        ):
            unknown = int(place.own[index])
            where = own.index(unknown) if unknown in own else -1
            if where in seen:
                continue
            seen.add(where)
            group = log.data.groups[index] or f"log {attempt.log_numbers[number] + 1}"
            out.append(Share(index, group, float(trajectory.theta(solved.theta)[index]), where, number, index))
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
