"""The estimator of uneven records: from prepared logs to parameters of the pair, with verdicts and reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.document import Json
from identify.base.quantiles import LEVEL, NORMAL, chi_square
from identify.base.result import Status
from identify.effects import ALL
from identify.estimation.covariance import WEAK, Estimate, verdict_of
from identify.estimation.estimator import Estimated, EstimationTask, in_time, no_time_for
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS
from identify.scene import Scene
from identify.uneven import wording
from identify.uneven.estimator import (
    APART,
    LAW,
    Mass,
    Maximum,
    Objective,
    agreement,
    mass_of,
    maximise,
    pooled_mass,
)
from identify.uneven.events import LEAST_SAMPLES, Sticks, of_one_body, sticks_of
from identify.uneven.likelihood import Cycles, Likelihood
from identify.uneven.slip_functions import PARAMETERS, THETA, slip_functions

Array = NDArray[np.float64]

SCALES = ("strength", "strength_scatter", "weakening_length", "level_wander", "level_roughness")  # pooled as logarithms
QUANTILES, REPLICATES = (0.05, 0.5, 0.95), 1000  # of distributions, and of their bootstrap
FEWEST = 12  # cycles of a log for an estimate of scatter and wander
CREEP_REACH = 3.0  # logarithm of creep time over typical rest, or its inverse, beyond which none is looked for
AT_RESTS = 25  # places of the curve of strength against rest
USED = {  # effects that are followed
    *("inertia", "hysteresis_damping", "contact_ageing", "friction_heterogeneity", "varying_normal_force"),
    "skin_compliance",
}
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
BY_LAW = ("strength", "strength_scatter", "weakening_length")
MAY_BE_ZERO = ("level_wander", "level_roughness", "strength_scatter", "damping")


@dataclass(frozen=True)
class UnevenLog:
    """One log of an estimate: number (from 0), sticks and slips, what the likelihood makes of them."""

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
        left_out, taken = dict[int, str](), dict[int, Sticks]()
        for number, log in enumerate(task.logs):
            reason = wording.why_left_out(log, FEWEST, LEAST_SAMPLES, FEWEST)
            if not reason:
                sticks = sticks_of(log, in_series=bool(task.unknowns.model.series_state))
                reason = wording.why_left_out(log, sticks.count, LEAST_SAMPLES, FEWEST)
                if not reason:
                    taken[number] = sticks
            if reason:
                left_out[number] = reason
        if not taken:
            return Estimated(Status.NO_CYCLES, "; ".join(left_out.values()), (), left_out=left_out)
        task.progress("cycles that differ", 0.6)
        stated = stated_rig(task.scene, task.unknowns)
        records = of_one_body(list(taken.values()), task.scene.rig.tolerances.get("stiffness"))
        maximum = maximise(records, stated)
        if not maximum.converged:
            if not maximum.in_time:
                no_time_for(wording.DESCRIBED)
            why = wording.NO_MAXIMUM if maximum.in_time else wording.CUT_SHORT
            return Estimated(Status.SOLVER_FAILED, why, (), left_out=left_out)
        logs = [
            UnevenLog(number, task.logs[number], sticks, Likelihood(sticks, nodes)(maximum.theta))
            for number, sticks, nodes in zip(taken, records, maximum.nodes, strict=True)
        ]
        return described(logs, maximum, task, stated, left_out)


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
    logs: Sequence[UnevenLog],
    maximum: Maximum,
    task: EstimationTask,
    stated: Mapping[str, tuple[float, float]],
    left_out: Mapping[int, str],
) -> Estimated:
    """What follows from the maximum of the posterior, quantity by quantity."""
    records, prepared = [log.sticks for log in logs], [log.log for log in logs]
    maxima: list[Maximum] = []
    if len(logs) > 1 and in_time(wording.COMPARED):
        maxima = [maximise([sticks], stated, maximum.theta) for sticks in records]
        if not all(m.in_time for m in maxima):
            no_time_for(wording.COMPARED)
        maxima = maxima if all(m.in_time and m.converged for m in maxima) else []
    mass = pooled_mass(records, maxima) if maxima else mass_of(maximum, records[0].rig.error)
    apart = ""
    if maxima and agreement(maximum, maxima) < APART:
        values = [(*np.exp(m.theta[:2]).tolist(), float(np.sqrt(m.covariance[0, 0]))) for m in maxima]
        apart = wording.apart([(p.name, s, s / w, sd) for p, (s, w, sd) in zip(prepared, values, strict=True)])
    withheld = apart or why_withheld(maximum, records)
    refused = dict.fromkeys(set(QUANTITIES) - {"mass"} if apart else BY_LAW, withheld) if withheld else {}
    scatter = wording.scatter_of_masses(*mass.scatter) if mass.scatter else ""
    if mass.scatter and mass.scatter[-1] < APART:
        refused["mass"] = wording.no_one_mass(scatter)
    own, names, covariance = _quantities(maximum, records, mass, refused, bool(withheld))
    has_creep = not withheld and in_time(wording.CREEP)
    creep = creep_interval(records, maximum) if has_creep else (None, None)
    none: dict[str, object] = {"reason": withheld}
    tables = []
    for log in logs:
        sticks = log.sticks
        columns = {"cycle": sticks.number, "onset_s": sticks.anchor, "rest_s": sticks.rest, "onset": sticks.line}
        columns |= {"drop": sticks.drop, "strength": np.exp(log.cycles.log_strength), "level": log.cycles.level}
        tables.append({"log": log.number + 1, **{name: values.tolist() for name, values in columns.items()}})
    more = {
        "distributions": none if withheld else observed_distributions(records[0], task.seed),
        "strength_against_rest": none if withheld else strength_against_rest(maximum, records),
        "log_likelihood": maximum.log_likelihood,
        "starts": [value if np.isfinite(value) else None for value in maximum.starts],
        "uneven_cycles": tables,
    }
    effects, speed_laws = task.unknowns.model.effects, {effect.name for effect in ALL if effect.role == "velocity law"}
    laws = [name for name in effects if name in speed_laws and name not in USED]
    others = [name for name in effects if name not in speed_laws and name not in USED]
    bounded = [name for name in RIG_PARAMETERS if name in task.scene.parameters and name not in stated]
    bound = creep_estimate(creep, records[0].usual_rest, not speed_laws.isdisjoint(effects))
    no_creep = withheld or ("" if has_creep else wording.CUT_SHORT)
    return Estimated(
        status=Status.CONVERGED,
        message=wording.answered(prepared, sum(sticks.count for sticks in records), withheld),
        estimates=[*own, *_of_a_uniform_pair(task.unknowns, _without("t_cr", "s", no_creep) if no_creep else bound)],
        names=names,
        covariance=covariance,
        curves=[None for _ in task.logs],
        left_out=left_out,
        more=more,
        notes=[
            *wording.notes(prepared, records, None if "mass" in refused else (mass.value, mass.lower, mass.upper)),
            *wording.of_scene(bounded, laws, others),
            *([wording.masses([log.name for log in prepared], mass.each, scatter)] if scatter else []),
            wording.EXTRAPOLATED,
        ],
    )


def observed_distributions(sticks: Sticks, seed: int) -> dict[str, Json]:
    """Quantiles of static peak [1], drop [1] and period [s] over the cycles of a record, as in result.json, with 95 %
    intervals by the circular block bootstrap: neighbours are alike (Politis and Romano 1992)."""
    random, out = np.random.default_rng(seed), dict[str, Json]()
    periods = np.diff(sticks.anchor)[sticks.follows[1:]]
    for name, unit, seen in (("static_peak", "", sticks.line), ("drop", "", sticks.drop), ("period", "s", periods)):
        length = max(round(seen.size ** (1.0 / 3.0)), 1)
        begins = random.integers(0, seen.size, (REPLICATES, -(-seen.size // length)))
        picked = (begins[..., None] + np.arange(length)).reshape(REPLICATES, -1)[:, : seen.size] % seen.size
        ends = np.quantile(np.quantile(seen[picked], QUANTILES, axis=1), (0.025, 0.975), axis=1).T
        values = zip(QUANTILES, np.quantile(seen, QUANTILES).tolist(), ends.tolist(), strict=True)
        quantiles = {f"{100 * q:.0f}": {"value": value, "interval": interval} for q, value, interval in values}
        out[name] = {"unit": unit, "quantiles": quantiles}
    return out


def why_withheld(maximum: Maximum, records: Sequence[Sticks]) -> str:
    """Why strength and weakening length are not given; "" where they are."""
    values = dict(zip(PARAMETERS, np.exp(maximum.theta[:LAW]), strict=True))
    if values["weakening_rate"] < max(sticks.rig.stiffness for sticks in records):
        return wording.SLOWER_THAN_SPRING
    length = values["strength"] / values["weakening_rate"]
    if length < min(sticks.noise / sticks.rig.stiffness for sticks in records):
        return wording.lost_at_once(length)
    if values["strength_scatter"] > 0.6:  # of the logarithm of the strength: beyond it the law of a stick is none
        return wording.scatters_too_much(values["strength_scatter"])
    return ""


def _quantities(
    maximum: Maximum, records: Sequence[Sticks], mass: Mass, refused: Mapping[str, str], withheld: bool
) -> tuple[list[Estimate], list[str], Array]:
    """The estimates but those refused, and names and covariance of those with an error; withheld: the law has none."""
    rig, rest = records[0].rig, records[0].usual_rest
    stiffness, factor = rig.stiffness * rig.load, float(np.exp(NORMAL * rig.error))
    estimates = [_estimate("stiffness", "N/m", stiffness, (stiffness / factor, stiffness * factor), rig.error, rest)]
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
        if name in refused:
            estimate = _without(name, unit, refused[name])
        else:
            estimate = _estimate(name, unit, value, (low, high), sd, rest)
        if name == "mass" and withheld and estimate.verdict == "identified":
            estimate = replace(estimate, verdict="weak", reason=wording.reason(name, "weak", rest))
        estimates.append(estimate)
        if estimate.standard_error is not None:
            names.append(name)
            errors.append(row * value * sd / np.sqrt(row @ maximum.covariance @ row))
    matrix = np.array(errors).reshape(-1, len(THETA))
    return estimates, names, matrix @ maximum.covariance @ matrix.T


def _without(name: str, unit: str, reason: str) -> Estimate:
    return Estimate(name, unit, None, None, None, None, "not identifiable", reason)


def _estimate(name: str, unit: str, value: float, ends: tuple[float, float], sd: float, rest: float) -> Estimate:
    """One quantity with the verdict that its interval earns; sd of its logarithm, typical rest [s]."""
    low, high = ends
    verdict = verdict_of(value, low, high, value, logarithmic=True)
    if verdict != "not identifiable":
        return Estimate(name, unit, value, value * sd, low, high, verdict, wording.reason(name, verdict, rest))
    if name in MAY_BE_ZERO:
        return Estimate(name, unit, None, None, None, high, "bounded", wording.reason(name, "bounded", rest))
    return _without(name, unit, wording.reason(name, verdict, rest))


def _of_a_uniform_pair(unknowns: Unknowns, creep: Estimate) -> list[Estimate]:
    """The parameters of a pair whose cycles are alike: without values, each with its reason, but the creep time."""
    out = []
    for i, quantity in enumerate(unknowns.model.parameters):
        if quantity.name in RIG_PARAMETERS:
            continue
        if not unknowns.free[i]:
            value = float(unknowns.values(unknowns.start, np.where(unknowns.logarithmic, 1.0, 0.0))[i])
            fixed = value, None, None, None, "fixed", wording.FIXED_NOT_USED
            out.append(Estimate(quantity.name, quantity.unit, *fixed))
        elif quantity.name == "t_cr":
            out.append(creep)
        else:
            out.append(_without(quantity.name, quantity.unit, wording.of_a_uniform_pair(quantity.name)))
    return out


def creep_interval(records: Sequence[Sticks], maximum: Maximum) -> tuple[float | None, float | None]:
    """Ends of the 95 % interval of the creep time [s]; None on a side where a creep time CREEP_REACH away from the
    typical rest is about as likely, whatever the curvature at the maximum is."""
    row, typical = np.eye(len(THETA))[THETA.index("t_cr")], float(np.log(records[0].usual_rest))
    objective = Objective(records, maximum.prior, maximum.nodes)
    out: list[float | None] = []
    for side, end in zip((-1.0, 1.0), maximum.interval(row), strict=True):
        beyond = np.where(row > 0.0, typical + side * CREEP_REACH, maximum.theta)
        optimum = objective.climb(beyond, row == 0.0)
        ratio = 2.0 * (maximum.log_likelihood - optimum.value + maximum.prior.logarithm(optimum.theta)[0])
        bounded = ratio > chi_square(LEVEL, 1) and abs(end - typical) < CREEP_REACH
        out.append(float(np.exp(end)) if bounded else None)
    return out[0], out[1]


def creep_estimate(creep: tuple[float | None, float | None], rest: float, by_speed: bool) -> Estimate:
    """by_speed: part of the strength may be lost to sliding speed instead of regained at rest. Then sticks that are as
    strong as longer ones bound nothing; strength that grows with rest still bounds it from below."""
    low, high = creep
    reason = wording.creep(low, high, rest, by_speed)
    high = None if by_speed else high
    if low is None or high is None:
        verdict = "not identifiable" if low is high else "bounded"
        return Estimate("t_cr", "s", None, None, low, high, verdict, reason)
    value, factor = float(np.sqrt(low * high)), float(np.sqrt(high / low))
    if factor > WEAK:
        return Estimate("t_cr", "s", None, None, low, high, "not identifiable", wording.creep(None, None, rest, False))
    return _estimate("t_cr", "s", value, (low, high), float(np.log(factor)) / NORMAL, rest)


def strength_against_rest(maximum: Maximum, records: Sequence[Sticks]) -> dict[str, object]:
    """Usual strength over the load after rests within the observed range (5 to 95 %), with its 95 % band."""
    rests = np.concatenate([sticks.rest[np.isfinite(sticks.rest)] for sticks in records])
    shortest, longest = np.quantile(rests, (0.05, 0.95)).tolist()
    at = np.linspace(shortest, longest, AT_RESTS)
    contact = np.column_stack([at, np.full(AT_RESTS, records[0].usual_rest)])

    def logarithm(theta: Array) -> Array:
        return np.log(slip_functions().aged([np.tile(theta, (AT_RESTS, 1)), contact])[0][:, 0])

    middle, step = logarithm(maximum.theta), 1e-4
    slopes = np.array([(logarithm(maximum.theta + step * unit) - middle) / step for unit in np.eye(len(THETA))])
    off = maximum.quantile * np.sqrt(np.einsum("ia,ij,ja->a", slopes, maximum.covariance, slopes))
    curves = {"strength": np.exp(middle), "lower": np.exp(middle - off), "upper": np.exp(middle + off)}
    return {"rest_s": at.tolist(), **{name: values.tolist() for name, values in curves.items()}}
