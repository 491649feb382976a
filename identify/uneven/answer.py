"""The estimator of uneven records: from prepared logs to what is told of the pair, with verdicts and reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.quantiles import NORMAL
from identify.effects import ALL
from identify.estimation.covariance import Estimate
from identify.estimation.estimator import Estimated, EstimationTask
from identify.estimation.strategies import in_time, no_time_for
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS
from identify.uneven import wording
from identify.uneven.creep import CreepTime, creep_interval
from identify.uneven.drawn import Begin, Distribution, drawn_distributions
from identify.uneven.estimator import Maximum, maximise
from identify.uneven.events import Sticks, of_one_rest, sticks_of
from identify.uneven.likelihood import Cycles, Likelihood
from identify.uneven.slip_functions import LAW, PARAMETERS, slip_functions
from identify.uneven.transfer import APART, agreement, alone
from identify.uneven.transfer import left_out as left_out_in_turn

Array = NDArray[np.float64]

SCALES = ("strength", "strength_scatter", "weakening_length", "level_wander", "level_roughness")  # told as logarithms
FEWEST = 12  # cycles of a log from which scatter and wander are told
IDENTIFIED, WEAK = 1.2, 3.0  # factors within which both ends of an interval lie
LARGEST_SCATTER = 0.6  # of the logarithm of the strength: beyond it the law of a stick is none
ODD_FROM = 0.9  # probability from which a slip is named odd
VELOCITY_LAW = "velocity law"  # role of the effects by which kinetic friction depends on velocity
AT_RESTS = 25  # places of the curve of strength against rest


@dataclass(frozen=True)
class UnevenLog:
    """One log as the estimator saw it: number (from 0), sticks and slips, what the likelihood finds of them."""

    number: int
    log: Prepared
    sticks: Sticks
    cycles: Cycles


@dataclass(frozen=True)
class UnevenEstimator:
    """Filtered marginal likelihood with strength and level of every stick integrated out; keeps to `Estimator`."""

    name: str = "uneven"

    def estimate(self, task: EstimationTask) -> Estimated:
        """Strength, its scatter, weakening length, mass, wander and roughness of the level, creep time as a bound, and
        distributions of static peak, drop and period."""
        left_out = {i: log.left_out for i, log in enumerate(task.logs) if log.left_out is not None}
        taken: list[tuple[int, Sticks]] = []
        for number, log in enumerate(task.logs):
            if number in left_out:
                continue
            reason: str | None = wording.not_cycling(log.name) if log.fit_mode.name != "cycles" else None
            sticks = None if reason else sticks_of(log, in_series=bool(task.unknowns.model.series_state))
            if sticks is not None and sticks.count < FEWEST:
                reason = wording.too_few(log.name, sticks.count, log.segmentation.count, FEWEST)
            if reason is None and sticks is not None:
                taken.append((number, sticks))
            else:
                left_out[number] = reason or ""
        if not taken:
            return Estimated(Status.NO_CYCLES, "; ".join(left_out.values()), (), left_out=left_out)
        task.progress("cycles that differ", 0.6)
        records = of_one_rest([sticks for _, sticks in taken])
        maximum = maximise(records)
        if not maximum.converged:
            if not maximum.in_time:
                no_time_for(wording.DESCRIBED)
            why = wording.NO_MAXIMUM if maximum.in_time else wording.CUT_SHORT
            return Estimated(Status.SOLVER_FAILED, why, (), left_out=left_out)
        seen = [
            UnevenLog(number, task.logs[number], sticks, Likelihood(sticks, nodes)(maximum.theta))
            for (number, _), sticks, nodes in zip(taken, records, maximum.nodes, strict=True)
        ]
        return told(seen, maximum, task, left_out)


def told(seen: Sequence[UnevenLog], maximum: Maximum, task: EstimationTask, left_out: Mapping[int, str]) -> Estimated:
    """What follows from the maximum of the likelihood, quantity by quantity."""
    records, first = [s.sticks for s in seen], seen[0]
    maxima = alone(records, maximum) if len(seen) > 1 and in_time(wording.COMPARED) else []
    if not all(m.in_time for m in maxima):
        no_time_for(wording.COMPARED)
    if not all(m.in_time and m.converged for m in maxima):
        maxima = []
    transfer = left_out_in_turn([s.number for s in seen], records, maxima, task.seed) if maxima else []
    seen_so: dict[str, Any] = {
        "uneven_cycles": [_cycle_table(s) for s in seen],
        "transfer": [t.to_dict() for t in transfer],
    }
    if maxima and agreement(maximum, maxima) < APART:
        return Estimated(Status.MODEL_MISFIT, _apart(seen, maxima), (), left_out=left_out, more=seen_so)
    withheld = why_withheld(maximum, records)
    tells_creep = not withheld and in_time(wording.CREEP)
    creep = creep_interval(records, maximum) if tells_creep else CreepTime(None, None)
    untold = withheld or ("" if in_time(wording.CREEP) else wording.CUT_SHORT)
    followed = any(sticks.resolved for sticks in records)
    own, names, covariance = _quantities(maximum, withheld, followed, first.sticks.usual_rest)
    distributions: dict[str, Any] = {}
    curve = None
    if not withheld and in_time(wording.DRAWN):
        drawn = [_drawn(s, maximum, task.seed) for s in seen]
        distributions = {d.name: d.to_dict() for d in drawn[0]}
        curve = strength_against_rest(maximum, records)
    more = {
        "distributions": distributions or {"reason": withheld or wording.CUT_SHORT},
        "strength_against_rest": curve or {"reason": withheld or wording.CUT_SHORT},
        "odd_slips": [{"log": s.number + 1, "cycle": int(c)} for s in seen for c in _odd(s)],
        "log_likelihood": maximum.log_likelihood,
        **seen_so,
    }
    estimates = [*own, *_of_a_uniform_pair(task.unknowns, creep, first.sticks.usual_rest, untold)]
    return Estimated(
        status=Status.CONVERGED,
        message=wording.answered([s.log for s in seen], sum(s.sticks.count for s in seen), withheld),
        estimates=estimates,
        names=names,
        covariance=covariance,
        curves=[None for _ in task.logs],
        left_out=left_out,
        more=more,
        notes=[
            *wording.notes([s.log for s in seen], [s.sticks for s in seen], _found_mass(own)),
            *(wording.transferred(task.logs[t.number].name, t.drive_speed, t.holds) for t in transfer),
        ],
    )


def _apart(seen: Sequence[UnevenLog], maxima: Sequence[Maximum]) -> str:
    """A sentence on records that do not share their parameters."""
    values = []
    for s, maximum in zip(seen, maxima, strict=True):
        strength, weakening = np.exp(maximum.theta[:2]).tolist()
        values.append((s.log.name, strength, strength / weakening, float(np.sqrt(maximum.covariance[0, 0]))))
    return wording.apart(values)


def _found_mass(estimates: Sequence[Estimate]) -> tuple[float, float, float] | None:
    """Value and ends of the interval of the mass [kg]; None where it is not told."""
    mass = next(e for e in estimates if e.name == "mass")
    if mass.value is None or mass.lower is None or mass.upper is None:
        return None
    return mass.value, mass.lower, mass.upper


def why_withheld(maximum: Maximum, records: Sequence[Sticks]) -> str:
    """Why strength and weakening length are not told; "" where they are. How fast it weakens tells that only where the
    slips of some record are followed: else the strength is what onset and arrest leave, however fast."""
    values = dict(zip(PARAMETERS, np.exp(maximum.theta), strict=True))
    followed = [sticks for sticks in records if sticks.resolved]
    if followed and values["weakening_rate"] < max(sticks.rig.stiffness for sticks in followed):
        return wording.SLOWER_THAN_SPRING
    length = values["strength"] / values["weakening_rate"]
    if followed and length < min(sticks.noise / sticks.rig.stiffness for sticks in followed):
        return wording.lost_at_once(length)
    if values["strength_scatter"] > LARGEST_SCATTER:
        return wording.scatters_too_much(values["strength_scatter"])
    return ""


def _quantities(
    maximum: Maximum, withheld: str, followed: bool, rest: float
) -> tuple[list[Estimate], list[str], Array]:
    """The estimates of this estimator, and names and covariance [SI] of those with a standard error; followed: whether
    slips were; rest: the typical one [s]."""
    theta, n = maximum.theta, len(PARAMETERS)
    # Rows: logarithms of what is told, from those of the parameters.
    rows = {
        "strength": np.eye(n)[PARAMETERS.index("strength")],
        "strength_scatter": np.eye(n)[PARAMETERS.index("strength_scatter")],
        "weakening_length": np.eye(n)[PARAMETERS.index("strength")] - np.eye(n)[PARAMETERS.index("weakening_rate")],
        "mass": np.eye(n)[PARAMETERS.index("mass")],
        "level_wander": np.eye(n)[PARAMETERS.index("level_wander")],
        "level_roughness": np.eye(n)[PARAMETERS.index("level_roughness")],
    }
    units = {"weakening_length": "m", "mass": "kg", "level_wander": "1/m^0.5"}
    estimates, names, errors = [], [], []
    for name, row in rows.items():
        value = float(np.exp(row @ theta))
        sd = float(np.sqrt(row @ maximum.covariance @ row))
        refused = withheld if name in ("strength", "strength_scatter", "weakening_length") else ""
        if not followed and name in ("weakening_length", "mass"):
            refused = wording.NOT_FOLLOWED
        factor = float(np.exp(maximum.quantile * sd))
        estimates.append(_estimate(name, units.get(name, ""), value, sd, factor, refused, rest))
        if estimates[-1].standard_error is not None:
            names.append(name)
            errors.append(row * value)
    matrix = np.array(errors).reshape(-1, n)
    return estimates, names, matrix @ maximum.covariance @ matrix.T


def _estimate(name: str, unit: str, value: float, sd: float, factor: float, withheld: str, rest: float) -> Estimate:
    """One quantity with the verdict that its interval earns; sd of its logarithm, factor to the ends of its interval,
    typical rest [s]."""
    if withheld:
        return Estimate(name, unit, None, None, None, None, "not identifiable", withheld)
    low, high = value / factor, value * factor
    if factor <= WEAK:
        verdict = "identified" if factor <= IDENTIFIED else "weak"
        return Estimate(name, unit, value, value * sd, low, high, verdict, wording.reason(name, verdict, rest))
    if name in ("level_wander", "level_roughness", "strength_scatter"):
        return Estimate(name, unit, None, None, None, high, "bounded", wording.reason(name, "bounded", rest))
    return Estimate(
        name, unit, None, None, None, None, "not identifiable", wording.reason(name, "not identifiable", rest)
    )


def _of_a_uniform_pair(unknowns: Unknowns, creep: CreepTime, rest: float, withheld: str) -> list[Estimate]:
    """The parameters of a pair whose cycles are alike: without values, each with its reason; the creep time as far as
    the record bounds it."""
    out = []
    for i, quantity in enumerate(unknowns.model.parameters):
        if quantity.name in RIG_PARAMETERS:
            continue
        if not unknowns.free[i] and quantity.name not in {unknowns.names[j] for j, _, _ in unknowns.ties}:
            value = float(unknowns.values(unknowns.start, np.where(unknowns.logarithmic, 1.0, 0.0))[i])
            out.append(Estimate(quantity.name, quantity.unit, value, None, None, None, "fixed", wording.FIXED_NOT_USED))
        elif quantity.name == "t_cr" and not withheld:
            velocity_dependent = any(e.role == VELOCITY_LAW and e.name in unknowns.model.effects for e in ALL)
            out.append(_creep_estimate(creep, rest, velocity_dependent))
        else:
            reason = withheld if quantity.name == "t_cr" else wording.of_a_uniform_pair(quantity.name)
            out.append(Estimate(quantity.name, quantity.unit, None, None, None, None, "not identifiable", reason))
    return out


def _creep_estimate(creep: CreepTime, rest: float, velocity_dependent: bool) -> Estimate:
    """velocity_dependent: part of the strength may be lost to sliding speed instead of regained at rest. Then sticks
    that are as strong as longer ones say nothing of how long it takes; that strength grows with rest bounds it yet."""
    low, high = creep.lower, creep.upper
    if velocity_dependent and high is not None:
        if low is None:
            why = wording.creep_if_rest_alone(high, rest)
            return Estimate("t_cr", "s", None, None, None, None, "not identifiable", why)
        high = None
    if low is None and high is None:
        return Estimate("t_cr", "s", None, None, None, None, "not identifiable", wording.creep_untold(rest))
    if low is None or high is None:
        return Estimate("t_cr", "s", None, None, low, high, "bounded", wording.creep_bounded(low, high, rest))
    value, factor = float(np.sqrt(low * high)), float(np.sqrt(high / low))
    if factor > WEAK:
        return Estimate("t_cr", "s", None, None, low, high, "not identifiable", wording.creep_untold(rest))
    verdict = "identified" if factor <= IDENTIFIED else "weak"
    sd = float(np.log(factor)) / NORMAL
    return Estimate("t_cr", "s", value, value * sd, low, high, verdict, wording.reason("t_cr", verdict, rest))


def _drawn(seen: UnevenLog, maximum: Maximum, seed: int) -> tuple[Distribution, Distribution, Distribution]:
    sticks = seen.sticks
    begin = Begin(seen.cycles.level_after, sticks.arrest, float(np.min(sticks.drop)), sticks.usual_rest)
    return drawn_distributions(sticks.rig, begin, maximum.theta, maximum.covariance, seed)


def strength_against_rest(maximum: Maximum, records: Sequence[Sticks]) -> dict[str, Any]:
    """Usual strength over the load after rests within the observed range (5 to 95 %), with its 95 % band."""
    rests = np.concatenate([sticks.rest[np.isfinite(sticks.rest)] for sticks in records])
    shortest, longest = np.quantile(rests, (0.05, 0.95)).tolist()
    at = np.linspace(shortest, longest, AT_RESTS)

    def logarithm(theta: Array) -> Array:
        contact = np.column_stack([at, np.full(AT_RESTS, records[0].usual_rest), np.zeros(AT_RESTS)])
        return np.log(slip_functions(LAW).aged([np.tile(theta, (AT_RESTS, 1)), contact])[0][:, 0])

    middle, step = logarithm(maximum.theta), 1e-4
    slopes = np.array([(logarithm(maximum.theta + step * unit) - middle) / step for unit in np.eye(len(PARAMETERS))])
    sd = np.sqrt(np.einsum("ia,ij,ja->a", slopes, maximum.covariance, slopes))
    return {
        "rest_s": at.tolist(),
        "strength": np.exp(middle).tolist(),
        "lower": np.exp(middle - maximum.quantile * sd).tolist(),
        "upper": np.exp(middle + maximum.quantile * sd).tolist(),
    }


def _odd(seen: UnevenLog) -> Array:
    """Numbers of the odd slips of a log (from 1)."""
    return np.asarray(seen.sticks.number[seen.cycles.odd > ODD_FROM])


def _cycle_table(seen: UnevenLog) -> dict[str, Any]:
    """What is known of every cycle of a log."""
    sticks, cycles = seen.sticks, seen.cycles
    return {
        "log": seen.number + 1,
        "cycle": sticks.number.tolist(),
        "onset_s": sticks.anchor.tolist(),
        "rest_s": sticks.rest.tolist(),
        "onset": sticks.line.tolist(),
        "drop": sticks.drop.tolist(),
        "strength": np.exp(cycles.log_strength).tolist(),
        "level": cycles.level.tolist(),
        "odd": cycles.odd.tolist(),
    }
