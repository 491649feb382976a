"""The parts of the result document that say how sure it is: profile, bootstrap, table of accuracies, combinations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import LEVEL
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


def depth_document(sure: Certainty, unknowns: Unknowns, base: Array) -> dict[str, Any]:
    """`combinations`, `noise`, and `profile`, `bootstrap`, `accuracy_table` where they were run.

    Args:
        base: (n_p,) of the rig the values are given for.
    """
    out: dict[str, Any] = {"combinations": _combinations(sure), "noise": _noise(sure, unknowns)}
    if sure.profiles is not None:
        out["profile"] = _profile(sure, unknowns, base)
    if sure.bootstrap is not None:
        out["bootstrap"] = _bootstrap(sure, unknowns, base)
    if sure.accuracy_table is not None:
        out["accuracy_table"] = _accuracy(sure, unknowns)
    return out


def noise_note(sure: Certainty) -> str:
    """A sentence where the noise has a memory that widens intervals; else empty."""
    widest = float(np.sqrt(np.max(sure.memory))) if sure.memory.size else 1.0
    if all(c.white for c in sure.colours) or widest < TELLING:
        return ""
    longest = max(c.memory for c in sure.colours)
    return (
        f"Neighbouring residuals are alike (one sample in {longest:.2g} is new): the standard errors allow for it, and "
        f"are up to {widest:.2g} times those of white noise."
    )


def ridge_note(sure: Certainty, unknowns: Unknowns) -> str:
    """A sentence where the likelihood is no paraboloid and standard errors were widened for it; else empty."""
    if not sure.memory.size:
        return ""
    ratios = np.sqrt(np.diag(sure.covariance) / (sure.memory * np.diag(sure.white)))
    named = [(name, ratio) for (_, name), ratio in zip(_names(unknowns), ratios.tolist(), strict=True) if ratio > BENT]
    if not named:
        return ""
    return (
        f"The likelihood bends: the standard errors of {', '.join(name for name, _ in named)} are up to "
        f"{max(ratio for _, ratio in named):.2g} times those of its curvature, so that they hold every likely point "
        "that was met; the profile of a parameter (--profile) gives its own interval."
    )


def profile_ends(sure: Certainty | None, unknowns: Unknowns, base: Array) -> dict[str, list[float | None]]:
    """The ends of every profile by name, SI: of a parameter at its bound, one is that bound. Empty without profiles."""
    if sure is None or sure.profiles is None:
        return {}
    out = {}
    for i, name in _names(unknowns):
        sides = sure.profiles.ends.get(name)
        if sides is not None:
            out[name] = [None if s.end is None else parameter_value(unknowns, i, s.end, base[i]) for s in sides]
    return out


def _names(unknowns: Unknowns) -> list[tuple[int, str]]:
    return [(i, unknowns.names[i]) for i in np.flatnonzero(unknowns.free).tolist()]


def _combinations(sure: Certainty) -> dict[str, Any]:
    natural = [
        {
            "name": c.natural.name,
            "meaning": c.natural.meaning,
            "value": c.value,
            "unit": c.natural.unit,
            "standard_error": c.standard_error,
            "interval": [_finite(end) for end in c.interval],
            "sharper": c.sharper,
        }
        for c in sure.combinations
    ]
    told = [{"size": d.size, "moves": dict(d.moves), "text": d.text} for d in sure.directions]
    return {"natural": natural, "directions": told}


def _noise(sure: Certainty, unknowns: Unknowns) -> dict[str, Any]:
    ratio = np.sqrt(sure.memory)
    return {
        "memory_samples": [_finite(c.memory) for c in sure.colours],
        "widening": {name: _finite(ratio[k]) for k, (_, name) in enumerate(_names(unknowns))},
    }


def _profile(sure: Certainty, unknowns: Unknowns, base: Array) -> dict[str, Any]:
    assert sure.profiles is not None
    memory, ends = sure.memory, profile_ends(sure, unknowns, base)
    out = {}
    for k, (i, name) in enumerate(_names(unknowns)):
        curve, sides = sure.profiles.curves.get(name), sure.profiles.ends.get(name)
        if curve is None or sides is None:
            continue
        out[name] = {
            "values": [parameter_value(unknowns, i, float(t), base[i]) for t in curve.theta],
            "loss": curve.loss.tolist(),
            "interval": ends[name],
            "failed": [side.failed for side in sides],
            "at_bound": [side.walled for side in sides],
            "standard_error": math.sqrt(float(memory[k] * sure.white[k, k])),  # of theta, by the curvature
            "logarithmic": bool(unknowns.logarithmic[i]),
        }
    return {"level": LEVEL, "limit": CRITICAL, "parameters": out}


def _bootstrap(sure: Certainty, unknowns: Unknowns, base: Array) -> dict[str, Any]:
    made = sure.bootstrap
    assert made is not None
    out = {}
    for k, (i, name) in enumerate(_names(unknowns)):
        ends = [
            parameter_value(unknowns, i, float(end), base[i]) if math.isfinite(end) else None
            for end in made.interval[k]
        ]
        spread = float(np.std(made.replicates[:, k])) if made.replicates.shape[0] > 1 else math.nan
        size = math.sqrt(float(sure.memory[k] * sure.white[k, k]))
        out[name] = {
            "interval": ends,
            "spread_in_standard_errors": _finite(spread / size),
            "pieces": _finite(made.freedom[k]),
        }
    return {
        "level": LEVEL,
        "replicates": int(made.settled.size),
        "failed": int(np.count_nonzero(~made.settled)),
        "parameters": out,
    }


def _accuracy(sure: Certainty, unknowns: Unknowns) -> list[dict[str, Any]]:
    assert sure.accuracy_table is not None

    def by_name(values: Array | None) -> dict[str, float | None] | None:
        return None if values is None else {name: _finite(values[k]) for k, (_, name) in enumerate(_names(unknowns))}

    return [
        {
            "accuracy": row.level.name,
            "seconds": row.seconds,
            "iterations": row.iterations,
            "steps": row.steps,
            "shift_in_standard_errors": by_name(row.shift),
            "left_in_standard_errors": by_name(row.left),
        }
        for row in sure.accuracy_table
    ]


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


@dataclass(frozen=True)
class FitSeconds:
    """processor: seconds of it that a fit took; equations: share of them in functions of the model; solve: processor
    seconds of one of its solves."""

    processor: float
    equations: float
    solve: float


def accuracy_document(found: Findings, taken: Accuracy, seconds: FitSeconds) -> dict[str, Any] | None:
    """What the accuracy of a fit cost and gives, what the other levels would, and what each effect took of the seconds
    (processor time, which no other program lengthens); None without an answer.

    Args:
        taken: the level of the fit; seconds: that it took.
    """
    if found.attempt is None or found.information is None or not np.any(found.unknowns.free):
        return None
    size = np.sqrt(np.diag(found.information.covariance() if found.covariance is None else found.covariance))
    tabled = found.sure.accuracy_table if found.sure is not None else None
    own = seconds.processor - sum(row.seconds for row in tabled or ())  # of the fit alone
    halvings = sum(trial.strategy == Strategy.FINER_STEPS.title for trial in found.trace.trials)
    steps = found.attempt.solved.grid.steps
    first = FEWEST_STEPS if steps < FEWEST_STEPS else max(steps // 2**halvings, FEWEST_STEPS)
    shares = effect_shares(found.unknowns.model)
    return {
        "taken": taken.name,
        "equations_s": seconds.equations * own,
        "effects_s": {name: share * seconds.equations * own for name, share in shares.items()},
        "levels": [
            {
                "accuracy": cost.level,
                "steps": cost.steps,
                "seconds": max(own + cost.seconds, 0.0),
                "error_in_standard_errors": cost.error if np.isfinite(cost.error) else None,
                "estimated": cost.level != taken.name,
            }
            for cost in accuracy_costs(found.attempt.solved, size, taken, first, seconds.solve)
        ],
    }
