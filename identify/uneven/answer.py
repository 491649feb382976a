"""The estimator of uneven records: from prepared logs to what is told of the pair, with verdicts and reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.quantiles import LEVEL, NORMAL, chi_square
from identify.effects import ALL
from identify.estimation.covariance import Estimate
from identify.estimation.estimator import Estimated, EstimationTask
from identify.estimation.strategies import in_time, no_time_for
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS
from identify.scene import Scene
from identify.uneven import wording
from identify.uneven.drawn import Begin, Distribution, drawn_distributions
from identify.uneven.estimator import Maximum, Objective, maximise
from identify.uneven.events import Sticks, of_one_body, sticks_of
from identify.uneven.likelihood import Cycles, Likelihood
from identify.uneven.slip_functions import LAW, PARAMETERS, THETA, slip_functions
from identify.uneven.transfer import APART, Mass, agreement, alone, mass_of, pooled_mass
from identify.uneven.transfer import left_out as left_out_in_turn

Array = NDArray[np.float64]

SCALES = ("strength", "strength_scatter", "weakening_length", "level_wander", "level_roughness")  # told as logarithms
FEWEST = 12  # cycles of a log from which scatter and wander are told
IDENTIFIED, WEAK = 1.2, 3.0  # factors within which both ends of an interval lie
LARGEST_SCATTER = 0.6  # of the logarithm of the strength: beyond it the law of a stick is none
ODD_FROM = 0.9  # probability from which a slip is named odd
VELOCITY_LAW = "velocity law"  # role of the effects by which kinetic friction depends on velocity
USED = {*LAW, "friction_heterogeneity", "varying_normal_force", "skin_compliance"}  # effects that are followed
CREEP_REACH = 3.0  # logarithm of creep time over typical rest, or its inverse, beyond which none is looked for
AT_RESTS = 25  # places of the curve of strength against rest
# Unit, weights of entries of theta in its logarithm, and the power of the stiffness with which it goes.
QUANTITIES: Mapping[str, tuple[str, Mapping[str, float], float]] = {
    "strength": ("", {"strength": 1.0}, 0.0),
    "strength_scatter": ("", {"strength_scatter": 1.0}, 0.0),
    "weakening_length": ("m", {"strength": 1.0, "weakening_rate": -1.0}, -1.0),
    "mass": ("kg", {"mass": 1.0}, 1.0),
    "level_wander": ("1/m^0.5", {"level_wander": 1.0}, 0.5),
    "level_roughness": ("", {"level_roughness": 1.0}, 0.0),
    "damping": ("N/m", {"damping": 1.0}, 1.0),
}
BY_SLIPS = ("weakening_length", "mass", "damping")  # only the course of a slip tells them
BY_LAW = ("strength", "strength_scatter", "weakening_length")


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
        stated = stated_rig(task.scene, task.unknowns)
        records = of_one_body([sticks for _, sticks in taken], task.scene.rig.tolerances.get("stiffness"))
        maximum = maximise(records, stated)
        if not maximum.converged:
            if not maximum.in_time:
                no_time_for(wording.DESCRIBED)
            why = wording.NO_MAXIMUM if maximum.in_time else wording.CUT_SHORT
            return Estimated(Status.SOLVER_FAILED, why, (), left_out=left_out)
        seen = [
            UnevenLog(number, task.logs[number], sticks, Likelihood(sticks, nodes)(maximum.theta))
            for (number, _), sticks, nodes in zip(taken, records, maximum.nodes, strict=True)
        ]
        return described(seen, maximum, task, stated, left_out)


def stated_rig(scene: Scene, unknowns: Unknowns) -> dict[str, tuple[float, float]]:
    """Mean and standard error of the logarithms of mass and damping ratio where the scene has a tolerance or a prior;
    without one a value of [rig] is a nominal one, of which nothing is taken."""
    out: dict[str, tuple[float, float]] = {}
    # h over 2 k is the damping ratio
    for name, nominal in (("mass", scene.rig.mass), ("damping", scene.rig.zeta)):
        if name in unknowns.names and nominal > 0.0:
            place = unknowns.names.index(name)
            mean, sd = float(unknowns.prior_mean[place]), float(unknowns.prior_sd[place])
            out |= {name: (float(np.log(nominal)) + mean, sd)} if np.isfinite(sd) else {}
    return out


def described(
    seen: Sequence[UnevenLog],
    maximum: Maximum,
    task: EstimationTask,
    stated: Mapping[str, tuple[float, float]],
    left_out: Mapping[int, str],
) -> Estimated:
    """What follows from the maximum of the posterior, quantity by quantity."""
    records, rest = [s.sticks for s in seen], seen[0].sticks.usual_rest
    maxima = alone(records, maximum, stated) if len(seen) > 1 and in_time(wording.COMPARED) else []
    if not all(m.in_time for m in maxima):
        no_time_for(wording.COMPARED)
    if not all(m.in_time and m.converged for m in maxima):
        maxima = []
    transfer = left_out_in_turn([s.number for s in seen], records, maxima, stated, task.seed) if maxima else []
    mass = pooled_mass(records, maxima) if maxima else mass_of(maximum, records[0].rig.error)
    apart = _apart(seen, maxima) if maxima and agreement(maximum, maxima) < APART else ""
    withheld = apart or why_withheld(maximum, records)
    refused = dict.fromkeys(set(QUANTITIES) - {"mass"} if apart else BY_LAW, withheld) if withheld else {}
    if not any(sticks.resolved for sticks in records):
        refused |= dict.fromkeys(BY_SLIPS, wording.NOT_FOLLOWED)
    if not mass.shared:
        refused["mass"] = wording.no_one_mass(*mass.scatter[0])
    creep = creep_interval(records, maximum) if not withheld and in_time(wording.CREEP) else (None, None)
    untold = withheld or ("" if in_time(wording.CREEP) else wording.CUT_SHORT)
    own, names, covariance = _quantities(maximum, records, mass, refused, bool(withheld))
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
        "starts": [value if np.isfinite(value) else None for value in maximum.starts],
        "uneven_cycles": [_cycle_table(s) for s in seen],
        "transfer": [t.to_dict() for t in transfer],
        "mass_homogeneity": mass.to_dict() if mass.each else {"reason": wording.ONE_RECORD},
    }
    logs = [s.log for s in seen]
    return Estimated(
        status=Status.CONVERGED,
        message=wording.answered(logs, sum(s.sticks.count for s in seen), withheld),
        estimates=[*own, *_of_a_uniform_pair(task.unknowns, creep, rest, untold)],
        names=names,
        covariance=covariance,
        curves=[None for _ in task.logs],
        left_out=left_out,
        more=more,
        notes=[
            *wording.notes(logs, records, None if "mass" in refused else (mass.value, mass.lower, mass.upper)),
            *wording.of_bounds(
                [name for name in RIG_PARAMETERS if name in task.scene.parameters and name not in stated]
            ),
            *wording.of_effects([name for name in task.unknowns.model.effects if name not in USED], _velocity_laws()),
            *(wording.one_mass([log.name for log in logs], mass.each, *scatter) for scatter in mass.scatter),
            *(wording.transferred(task.logs[t.number].name, t.drive_speed, t.holds) for t in transfer),
        ],
    )


def _velocity_laws() -> set[str]:
    """Effects by which kinetic friction depends on velocity."""
    return {effect.name for effect in ALL if effect.role == VELOCITY_LAW}


def _apart(seen: Sequence[UnevenLog], maxima: Sequence[Maximum]) -> str:
    """A sentence on records that do not share their parameters."""
    values = []
    for s, maximum in zip(seen, maxima, strict=True):
        strength, weakening = np.exp(maximum.theta[:2]).tolist()
        values.append((s.log.name, strength, strength / weakening, float(np.sqrt(maximum.covariance[0, 0]))))
    return wording.apart(values)


def why_withheld(maximum: Maximum, records: Sequence[Sticks]) -> str:
    """Why strength and weakening length are not told; "" where they are. How fast it weakens tells that only where the
    slips of some record are followed: else the strength is what onset and arrest leave, however fast."""
    values = dict(zip(PARAMETERS, np.exp(maximum.theta[: len(PARAMETERS)]), strict=True))
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
    maximum: Maximum, records: Sequence[Sticks], mass: Mass, refused: Mapping[str, str], withheld: bool
) -> tuple[list[Estimate], list[str], Array]:
    """The estimates of this estimator, and names and covariance [SI] of those with a standard error.

    Args:
        refused: why a quantity is not told, by its name.
        withheld: whether the law is: a mass without it is known from no more than the time of a slip.
    """
    rig, rest = records[0].rig, records[0].usual_rest
    stiffness = rig.stiffness * rig.load
    factor = float(np.exp(NORMAL * rig.error))
    ends = stiffness / factor, stiffness * factor
    estimates = [_estimate("stiffness", "N/m", stiffness, ends, rig.error, "", rest)]
    names, errors = [], []
    for name, (unit, weights, power) in QUANTITIES.items():
        row = np.array([weights.get(entry, 0.0) for entry in THETA])
        value = float(np.exp(row @ maximum.theta))
        low, high = np.exp(maximum.interval(row, abs(power) * rig.error)).tolist()
        if name == "damping":
            value, low, high = (2.0 * stiffness * number for number in (value, low, high))
        if name == "mass":
            value, low, high = mass.value, mass.lower, mass.upper
        sd = float(np.log(high / low)) / (2.0 * maximum.quantile)
        estimate = _estimate(name, unit, value, (low, high), sd, refused.get(name, ""), rest)
        if name == "mass" and withheld and estimate.verdict == "identified":
            estimate = replace(estimate, verdict="weak", reason=wording.reason(name, "weak", rest))
        estimates.append(estimate)
        if estimate.standard_error is not None:
            names.append(name)
            errors.append(row * value * sd / np.sqrt(row @ maximum.covariance @ row))
    matrix = np.array(errors).reshape(-1, len(THETA))
    return estimates, names, matrix @ maximum.covariance @ matrix.T


def _estimate(
    name: str, unit: str, value: float, ends: tuple[float, float], sd: float, refused: str, rest: float
) -> Estimate:
    """One quantity with the verdict that its interval earns; sd of its logarithm, typical rest [s]."""
    if refused:
        return Estimate(name, unit, None, None, None, None, "not identifiable", refused)
    low, high = ends
    widest = max(high / value, value / low)
    if widest <= WEAK:
        verdict = "identified" if widest <= IDENTIFIED else "weak"
        return Estimate(name, unit, value, value * sd, low, high, verdict, wording.reason(name, verdict, rest))
    if name in ("level_wander", "level_roughness", "strength_scatter", "damping"):
        return Estimate(name, unit, None, None, None, high, "bounded", wording.reason(name, "bounded", rest))
    return Estimate(
        name, unit, None, None, None, None, "not identifiable", wording.reason(name, "not identifiable", rest)
    )


def _of_a_uniform_pair(
    unknowns: Unknowns, creep: tuple[float | None, float | None], rest: float, withheld: str
) -> list[Estimate]:
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
            velocity_dependent = not _velocity_laws().isdisjoint(unknowns.model.effects)
            out.append(_creep_estimate(creep, rest, velocity_dependent))
        else:
            reason = withheld if quantity.name == "t_cr" else wording.of_a_uniform_pair(quantity.name)
            out.append(Estimate(quantity.name, quantity.unit, None, None, None, None, "not identifiable", reason))
    return out


def creep_interval(records: Sequence[Sticks], maximum: Maximum) -> tuple[float | None, float | None]:
    """Ends of the 95 % interval of the creep time [s]; None on a side where a creep time CREEP_REACH away from the
    typical rest is about as likely, whatever the curvature at the maximum says."""
    row, typical = np.eye(len(THETA))[THETA.index("t_cr")], float(np.log(records[0].usual_rest))
    objective = Objective(records, maximum.prior, maximum.nodes)
    out: list[float | None] = []
    for side, end in zip((-1.0, 1.0), maximum.interval(row), strict=True):
        beyond = np.where(row > 0.0, typical + side * CREEP_REACH, maximum.theta)
        found = objective.climb(beyond, objective.free & (row == 0.0))
        fallen = 2.0 * (maximum.log_likelihood - found.value + maximum.prior.logarithm(found.theta)[0])
        bounded = fallen > chi_square(LEVEL, 1) and abs(end - typical) < CREEP_REACH
        out.append(float(np.exp(end)) if bounded else None)
    return out[0], out[1]


def _creep_estimate(creep: tuple[float | None, float | None], rest: float, velocity_dependent: bool) -> Estimate:
    """velocity_dependent: part of the strength may be lost to sliding speed instead of regained at rest. Then sticks
    that are as strong as longer ones say nothing of how long it takes; that strength grows with rest bounds it yet."""
    low, high = creep
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
        return np.log(slip_functions().aged([np.tile(theta, (AT_RESTS, 1)), contact])[0][:, 0])

    middle, step = logarithm(maximum.theta), 1e-4
    slopes = np.array([(logarithm(maximum.theta + step * unit) - middle) / step for unit in np.eye(len(THETA))])
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
