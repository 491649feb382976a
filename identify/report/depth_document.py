"""The parts of the result document that say how sure it is: profile, bootstrap, table of accuracies."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.document import finite
from identify.base.quantiles import LEVEL
from identify.base.result import (
    AccuracyLevel,
    AccuracyResult,
    BootstrapInterval,
    BootstrapResult,
    Interval,
    LevelCost,
    NoiseResult,
    OptimumResult,
    ProfileCurve,
    ProfileResult,
    Result,
)
from identify.diagnosis.findings import Findings
from identify.estimation.certainty import Certainty
from identify.estimation.covariance import parameter_value
from identify.estimation.profile import CRITICAL
from identify.estimation.strategies import Strategy
from identify.logs.unknowns import Unknowns
from identify.shooting.accuracy import FEWEST_STEPS, Accuracy, accuracy_costs, effect_shares

Array = NDArray[np.float64]

TELLING = 1.05  # by which factor a memory of the noise must widen an interval to be worth a note
BENT = 1.2  # by which factor likely points that were met must, for the same


def with_depth(result: Result, sure: Certainty, unknowns: Unknowns, base: Array) -> Result:
    """The result with noise, and with profile, bootstrap and table of accuracies where they were run.

    Args:
        base: (n_p,) of the rig the values are given for.
    """
    ratio = np.sqrt(sure.inflation)
    widening = {name: finite(float(ratio[k])) for k, (_, name) in enumerate(_names(unknowns))}
    return replace(
        result,
        noise=NoiseResult(tuple(finite(float(c.inflation)) for c in sure.noise), widening),
        profile=None if sure.profiles is None else _profile(sure, unknowns, base),
        optima=_optima(sure, unknowns, base) if sure.optima else None,
        bootstrap=None if sure.bootstrap is None else _bootstrap(sure, unknowns, base),
        accuracy_table=None if sure.accuracy_table is None else _accuracy(sure, unknowns),
    )


def noise_note(sure: Certainty) -> str:
    """A sentence where the noise has a memory that widens intervals; else empty."""
    widest = float(np.sqrt(np.max(sure.inflation))) if sure.inflation.size else 1.0
    if all(c.white for c in sure.noise) or widest < TELLING:
        return ""
    longest = max(c.inflation for c in sure.noise)
    return (
        f"Neighbouring residuals are alike (one sample in {longest:.2g} is new): the standard errors allow for it, and "
        f"are up to {widest:.2g} times those of white noise."
    )


def ridge_note(sure: Certainty, unknowns: Unknowns) -> str:
    """A sentence where the likelihood is no paraboloid and standard errors were widened for it; else empty."""
    if not sure.inflation.size:
        return ""
    ratios = np.sqrt(np.diag(sure.covariance) / (sure.inflation * np.diag(sure.white)))
    named = [(name, ratio) for (_, name), ratio in zip(_names(unknowns), ratios.tolist(), strict=True) if ratio > BENT]
    if not named:
        return ""
    return (
        f"The likelihood bends: the standard errors of {', '.join(name for name, _ in named)} are up to "
        f"{max(ratio for _, ratio in named):.2g} times those of its curvature, so that they hold every likely point "
        "that was met; the profile of a parameter (--profile) gives its own interval."
    )


def profile_ends(sure: Certainty | None, unknowns: Unknowns, base: Array) -> dict[str, Interval]:
    """The ends of every profile by name, SI: of a parameter at its bound, one is that bound. Empty without profiles."""
    if sure is None or sure.profiles is None:
        return {}
    out = {}
    for i, name in _names(unknowns):
        sides = sure.profiles.ends.get(name)
        if sides is not None:
            ends = (None if s.end is None else parameter_value(unknowns, i, s.end, base[i]) for s in sides)
            out[name] = next(ends), next(ends)
    return out


def _names(unknowns: Unknowns) -> list[tuple[int, str]]:
    return [(i, unknowns.names[i]) for i in np.flatnonzero(unknowns.free).tolist()]


def _optima(sure: Certainty, unknowns: Unknowns, base: Array) -> tuple[OptimumResult, ...]:
    """The optima that starts about the answer led to, the reported one first."""
    names = _names(unknowns)
    out = []
    for optimum in sure.optima:
        values = unknowns.values(optimum.attempt.solved.theta, base).tolist()
        out.append(OptimumResult(2.0 * optimum.cost, optimum.starts, {name: values[i] for i, name in names}))
    return tuple(out)


def _profile(sure: Certainty, unknowns: Unknowns, base: Array) -> ProfileResult:
    assert sure.profiles is not None
    inflation, ends = sure.inflation, profile_ends(sure, unknowns, base)
    out = {}
    for k, (i, name) in enumerate(_names(unknowns)):
        curve, sides = sure.profiles.curves.get(name), sure.profiles.ends.get(name)
        if curve is None or sides is None:
            continue
        out[name] = ProfileCurve(
            values=tuple(parameter_value(unknowns, i, float(t), base[i]) for t in curve.theta),
            loss=tuple(curve.loss.tolist()),
            interval=ends[name],
            failed=tuple(side.failed for side in sides),
            at_bound=tuple(side.walled for side in sides),
            standard_error=math.sqrt(float(inflation[k] * sure.white[k, k])),
            logarithmic=bool(unknowns.logarithmic[i]),
        )
    return ProfileResult(LEVEL, CRITICAL, out)


def _bootstrap(sure: Certainty, unknowns: Unknowns, base: Array) -> BootstrapResult:
    made = sure.bootstrap
    assert made is not None
    out = {}
    for k, (i, name) in enumerate(_names(unknowns)):
        low, high = (
            parameter_value(unknowns, i, float(end), base[i]) if math.isfinite(end) else None
            for end in made.interval[k]
        )
        spread = float(np.std(made.replicates[:, k])) if made.replicates.shape[0] > 1 else math.nan
        size = math.sqrt(float(sure.inflation[k] * sure.white[k, k]))
        out[name] = BootstrapInterval((low, high), finite(spread / size))
    return BootstrapResult(LEVEL, int(made.settled.size), int(np.count_nonzero(~made.settled)), out)


def _accuracy(sure: Certainty, unknowns: Unknowns) -> tuple[AccuracyLevel, ...]:
    assert sure.accuracy_table is not None

    def by_name(values: Array | None) -> dict[str, float | None] | None:
        names = _names(unknowns)
        return None if values is None else {name: finite(float(values[k])) for k, (_, name) in enumerate(names)}

    return tuple(
        AccuracyLevel(row.level.name, row.seconds, row.iterations, row.steps, by_name(row.shift), by_name(row.left))
        for row in sure.accuracy_table
    )


@dataclass(frozen=True)
class FitSeconds:
    """processor: seconds of it that a fit took; equations: share of them in functions of the model; solve: processor
    seconds of one of its solves."""

    processor: float
    equations: float
    solve: float


def accuracy_result(found: Findings, taken: Accuracy, seconds: FitSeconds) -> AccuracyResult | None:
    """What the accuracy of a fit cost and gives, what the other levels would, and what each effect took of the seconds
    (processor time, which no other program lengthens); None without an answer.

    Args:
        taken: the level of the fit; seconds: that it took.
    """
    if found.attempt is None or found.sure is None or not np.any(found.unknowns.free):
        return None
    size, tabled = np.sqrt(np.diag(found.sure.covariance)), found.sure.accuracy_table
    own = seconds.processor - max((row.seconds for row in tabled or ()), default=0.0)  # of the fit alone
    halvings = sum(trial.strategy == Strategy.FINER_STEPS.value for trial in found.trace.trials)
    steps = found.attempt.solved.grid.steps
    first = FEWEST_STEPS if steps < FEWEST_STEPS else max(steps // 2**halvings, FEWEST_STEPS)
    shares = effect_shares(found.unknowns.model)
    costs = accuracy_costs(found.attempt.solved, size, taken, first)
    return AccuracyResult(
        taken.name,
        seconds.equations * own,
        {name: share * seconds.equations * own for name, share in shares.items()},
        tuple(
            LevelCost(
                cost.level, cost.steps, max(own + cost.seconds, 0.0), finite(cost.error), cost.level != taken.name
            )
            for cost in costs
        ),
    )
