"""The result of a fit from what it found: names, units, verdicts and provenance as the interface promises."""

from __future__ import annotations

import importlib.metadata
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.document import finite
from identify.base.outcome import Status
from identify.base.quantiles import LEVEL, NORMAL
from identify.base.result import (
    Correlation,
    EffectsResult,
    FitFigures,
    GateResult,
    LastValue,
    ParameterResult,
    Result,
    SearchTrial,
    Shift,
    ToleranceResult,
    WorstCycle,
)
from identify.diagnosis.effect_choice import Choice, as_listed, effects_result
from identify.diagnosis.findings import Findings, held_results
from identify.diagnosis.quantities import DIFFERENCE, load_gain, parameter
from identify.diagnosis.score_test import Column, marginal_covariance
from identify.estimation.covariance import (
    FARTHEST,
    TOLERANCE_WORDS,
    Estimate,
    added_by_tolerances,
    sizes,
    standard_deviations,
    verdict_of,
)
from identify.estimation.goodness_of_fit import stick_scatter
from identify.estimation.influence import largest_inflation
from identify.logs.parting import parts_of
from identify.logs.prepare import Prepared
from identify.logs.recorded_drive import DISAGREES
from identify.logs.unknowns import Unknowns, stated_rig
from identify.model.model import RIG_PARAMETERS
from identify.prediction.wording import listed
from identify.report.depth_document import noise_note, profile_ends, ridge_note, with_depth
from identify.report.log_document import creep_velocities, load_varies, log_result, outlooks_of
from identify.scene import Scene
from identify.scene.values import USUAL_TOLERANCES

# ----------------------------------------------------------------------------------------------------------------------
# The notes of a result: what was assumed, what was left out, what the search changed, each in a sentence.
# ----------------------------------------------------------------------------------------------------------------------

UNFOLLOWED = 0.02  # of a course: an end that is left out and worth a note


def notes_of(scene: Scene, prepared: list[Prepared], found: Findings) -> list[str]:
    """All notes on how the result came about, in the order a reader needs them."""
    notes = []
    guessed = [log.name for log in prepared if log.noise_estimated]
    if guessed:
        notes.append("The noise was estimated from straight lines through the stick phases, not given.")
    if found.sure is not None and found.status is Status.CONVERGED:
        said = (noise_note(found.sure), ridge_note(found.sure, found.unknowns))
        notes += [sentence for sentence in said if sentence]
    rig = (*RIG_PARAMETERS, "drive_speed")
    told = {e.name for e in found.estimates} if found.estimated is not None else set()
    exact = [name for name in rig if name not in {*scene.parameters, *scene.rig.tolerances, *told}]
    if exact and found.status is Status.CONVERGED:
        named = ", ".join(name.replace("_", " ") for name in exact)
        shown = "; the table of rig errors shows what 1 % would do" if found.estimated is None else ""
        notes.append(f"Taken as exact: {named}{shown}.")
    if found.status is Status.CONVERGED and "force_sensor" not in scene.effects:
        held = "" if found.sure is None else "; the intervals hold both"
        notes.append(
            "Zero and gain of both force sensors are taken as they are: what is off there moves the coefficients by as "
            f"much (1 % of the force by 1 %), which a fit hardly sees{held}. Check them with a known weight, or let "
            "the effect force_sensor estimate zero and gain of the friction force within priors."
        )
    if found.status is Status.CONVERGED and each_speed_alone(found):
        notes.append(
            "Each drive speed stands in one log: a difference between specimens, days or loads would count as one of "
            "speed, and the intervals hold a usual one. Repeat one speed, or state specimen = 0 under [tolerances] "
            "where all logs are of one specimen."
        )
    doubts = [(log.entry.path.name, f.message) for log in prepared for f in log.record.findings if f.code == DISAGREES]
    notes += [f"{name}: {message}." for name, message in dict.fromkeys(doubts)]
    notes += [f"{log.name}: {load_varies(log)}." for log in prepared if log.hidden_swing]
    notes += _events(prepared, found)
    notes += [] if found.estimated is None else found.estimated.notes
    for index, reason in sorted(found.left_out.items()):
        notes.append(f"Log {index + 1} took no part in the fit: {reason}.")
    return notes


def _message(prepared: list[Prepared], found: Findings) -> str:
    """The sentence of the result; an answer says first which part of each record it rests on."""
    if found.status is not Status.CONVERGED:
        return found.message
    taken = [log for i, log in enumerate(prepared) if i not in found.left_out]
    logs = found.attempt.fitted_logs if found.attempt else taken
    parts = [log.rests_on for log in logs if log.rests_on]
    whole = [log.name for log in logs if not log.rests_on]
    if len(whole) > MOST_NAMED:
        whole = [f"all {'other ' if parts else ''}{len(whole)} records"]
    elif whole:
        whole = [f"all of {listed(whole)}"]
    return f"from {listed([*parts, *whole])}: {found.message}"


def _found_by(found: Findings) -> tuple[str, ...]:
    """The strategies that led to the answer, or the estimator that is another one."""
    if found.estimated is not None and found.status is Status.CONVERGED:
        return (f"{found.estimator} estimator",)
    return () if found.attempt is None else tuple(found.attempt.found_by)


def _events(prepared: list[Prepared], found: Findings) -> list[str]:
    """Slips that the search put in or took out, and courses it could not follow to their end."""
    notes = []
    for number, log in zip(found.attempt.log_numbers, found.attempt.fitted_logs, strict=True) if found.attempt else ():
        before, after = prepared[number].falls, log.falls
        put = [f"{t:.4g} s" for t in after.tolist() if t not in before]
        out = [f"{t:.4g} s" for t in before.tolist() if t not in after]
        for word, times in (("that was missed put in", put), ("that is none taken out", out)):
            if times:
                notes.append(f"{log.name}: a slip {word} at {', '.join(times)}.")
        left = prepared[number].data.end - log.data.end
        if log.fit_mode.name == "continuous" and left > UNFOLLOWED * (log.data.end - log.data.begin):
            notes.append(
                f"{log.name}: fitted up to {log.data.end:.4g} s; from there on the motion of the answer is none that a "
                "fit follows (a swing that never fades, or a mass that is pulled back)."
            )
        if log.fit_mode.name == "sliding" and prepared[number].fit_mode.name == "continuous":
            notes.append(
                f"{log.name}: only what slides steadily is fitted, from {log.data.begin:.4g} s on: the way there is "
                "not described."
            )
    return notes


Array = NDArray[np.float64]

DISTRIBUTION = "stick-slip-workbench"
STAGES = ("read", "detect", "start", "place", "build", "solve", "intervals")
PACKAGES = ("casadi", "numpy", "scipy", "pandas", "h5py", "matplotlib")
MOST_NAMED = 3  # records that a sentence names where all of each is meant
SAME_SPEED = 1.05  # ratio below which two drive speeds are one
ALL = "all"  # of the covariances by errors, the one of all together
RIG_ERROR = 0.01  # what a rig quantity without a stated tolerance is tried with


def result_of(
    scene: Scene,
    prepared: list[Prepared],
    found: Findings,
    seconds: Mapping[str, float],
    seed: int,
    choice: Choice | None = None,
) -> Result:
    """What a fit found, in SI, but for what is looked at when it is known.

    Args:
        seconds: of each stage, and in all ("total"). choice: how the effects were chosen, None where the scene lists
            them.
    """
    converged = found.status is Status.CONVERGED
    parts = parts_of(scene, [log.entry for log in prepared])
    tolerances = _tolerances(scene, found) if converged and found.attempt is not None else {}
    shares = {name: each.relative for name, each in tolerances.items()}
    errors = _by_errors(found, shares) if shares and found.covariance is not None else {}
    outlooks = outlooks_of(prepared, found, errors.get(ALL, 0.0))
    logs = enumerate(zip(prepared, outlooks, parts, strict=True))
    result = Result(
        status=found.status.value,
        message=_message(prepared, found),
        parameters=_parameters(found, converged) or _untold(found.unknowns),
        effects=_effects(prepared, found, choice),
        estimator=found.estimator,
        correlation=_correlation(found) if converged else None,
        gate=_gate(found),
        fit=_fit(found),
        derived=creep_velocities(prepared, found) if converged else {},
        logs=tuple(log_result(i, log, found, answer, part) for i, (log, answer, part) in logs),
        notes=tuple(notes_of(scene, prepared, found)),
        search=tuple(
            SearchTrial(t.strategy, t.logs, t.status, t.cost, round(t.seconds, 4)) for t in found.trace.trials
        ),
        found_by=_found_by(found),
        not_tried=tuple(found.trace.not_tried),
        more={} if found.estimated is None else found.estimated.more,
        rig_against_data=held_results(found.held) or None,
        causes=found.causes,
        timing_s={stage: seconds.get(stage, 0.0) for stage in (*STAGES, "total")},
        provenance={
            "version": _version(DISTRIBUTION),
            "scene": scene.as_document(),
            "seed": seed,
            "packages": {name: _version(name) for name in PACKAGES},
            "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        },
    )
    base = found.unknowns.base(stated_rig(scene))  # (n_p,) of the rig the parameters are given for
    if converged and found.attempt is not None:
        result = replace(
            result,
            rig_sensitivity=_rig_sensitivity(scene, found),
            tolerances=tolerances,
        )
        result = _published(result, found, shares, errors)
        return with_depth(result, found.sure, found.unknowns, base) if found.sure else result
    if converged:
        return result
    ends = profile_ends(found.sure, found.unknowns, base)  # of a parameter at its bound, one end is that bound
    iterate = {e.name: LastValue(e.value, e.unit, ends.get(e.name)) for e in found.estimates}
    untold = {name: LastValue(None, entry.unit) for name, entry in result.parameters.items()}
    return replace(result, last_iterate=iterate or untold)


@lru_cache
def _version(name: str) -> str:
    """Read once: what is imported does not change while it runs."""
    return importlib.metadata.version(name)


def _effects(prepared: list[Prepared], found: Findings, choice: Choice | None) -> EffectsResult:
    """Which effects and why; of those that are listed, what they amount to at the first log, if there is an answer."""
    if choice is not None:
        return effects_result(choice, auto=True)
    log, model = prepared[0].data, found.unknowns.model
    values: dict[str, float] | None = None
    if found.status is Status.CONVERGED and found.attempt is not None:
        with np.errstate(all="ignore"):
            p = found.unknowns.values(found.attempt.solved.theta, log.base)
        values = dict(zip(model.parameter_names, np.where(np.isfinite(p), p, 0.0).tolist(), strict=True))
    return effects_result(as_listed(model.effects, values, log.mean_normal_force, log.drive_speed), auto=False)


def _parameters(found: Findings, converged: bool) -> dict[str, ParameterResult]:
    """Every parameter by name; of those that differ between groups the first group's stands under the bare name."""
    out = {e.name: _parameter(e, converged) for e in _told(found)}
    if found.sure is None or not found.sure.shares:
        return out
    names, per = found.unknowns.names, found.unknowns.per
    for share in found.sure.shares:
        if share.place < 0:
            name = names[share.index]
            out[name] = replace(out[name], group=share.group, per=per[share.source] or "")
    for share, estimate in found.sure.of_groups:
        told = _parameter(estimate, converged)
        out[estimate.name] = replace(told, group=share.group, per=per[share.source] or "", parameter=names[share.index])
    return out


def _told(found: Findings) -> Sequence[Estimate]:
    """The friction parameters, and of the rig what was estimated."""
    free = set(np.array(found.unknowns.names)[found.unknowns.free])
    if found.estimated is not None:
        return found.estimates
    return [e for e in found.estimates if e.name not in RIG_PARAMETERS or e.name in free]


def _untold(unknowns: Unknowns) -> dict[str, ParameterResult]:
    """Where nothing was estimated: every parameter by name, without numbers."""
    reason = "nothing was fitted; see the message"
    return {
        q.name: _parameter(Estimate(q.name, q.unit, None, None, None, None, "not identifiable", reason), False)
        for q in unknowns.model.parameters
        if q.name not in RIG_PARAMETERS
    }


def _parameter(estimate: Estimate, converged: bool) -> ParameterResult:
    numbers = converged or estimate.verdict == "fixed"
    return ParameterResult(
        value=estimate.value if numbers else None,
        unit=estimate.unit,
        standard_error=estimate.standard_error if converged else None,
        interval=(estimate.lower, estimate.upper) if converged else (None, None),
        level=LEVEL,
        verdict=estimate.verdict if converged or estimate.verdict in ("fixed", "at bound") else "not identifiable",
        reason=estimate.reason if numbers else "the fit did not succeed; see the message",
    )


def _correlation(found: Findings, added: Array | float = 0.0) -> Correlation | None:
    """Correlation of all estimates and the standard errors [SI] that go with it, also of those that have none because
    the data do not tell them.

    Args:
        added: (f, f) to the covariance of the free theta by errors of rig and sensors.
    """
    if found.estimated is not None and len(found.estimated.names):
        return _correlation_of(found.estimated.names, found.estimated.covariance)
    if found.covariance is None:
        return None
    free = np.flatnonzero(found.unknowns.free).tolist()
    by_name = {e.name: e for e in found.estimates}
    told = [by_name[found.unknowns.names[i]] for i in free]
    covariance, index = found.covariance, free
    if found.sure is not None and found.sure.of_groups:
        beyond = [(share, e) for share, e in found.sure.of_groups if not share.tied]
        order = [*range(len(free)), *(len(free) + share.place for share, _ in beyond)]
        told, index = told + [e for _, e in beyond], free + [share.index for share, _ in beyond]
        covariance = found.sure.joint[np.ix_(order, order)]
    covariance = covariance.copy()
    covariance[: len(free), : len(free)] += added
    size = np.where(found.unknowns.logarithmic[index], np.array([e.value for e in told], dtype=float), 1.0)
    return _correlation_of([e.name for e in told], covariance, size)


def _correlation_of(names: Sequence[str], covariance: Array, size: ArrayLike = 1.0) -> Correlation:
    """Of estimates (f,) whose covariance (f, f) is in SI, or in parts of a size [SI]."""
    sd = np.sqrt(np.diag(covariance))
    matrix = (covariance / np.outer(sd, sd)).tolist()
    errors = tuple(finite(error) for error in (np.asarray(size) * sd).tolist())
    return Correlation(tuple(names), tuple(tuple(row) for row in matrix), errors)


def _gate(found: Findings) -> GateResult | None:
    if found.attempt is None:
        return None
    gate = found.attempt.gate
    worst = gate.worst
    log = found.attempt.log_numbers[int(gate.log[worst]) - 1] + 1 if worst >= 0 else None
    return GateResult(
        finite(float(gate.chi2_per_sample)),
        WorstCycle(log, int(gate.cycle[worst]), finite(float(gate.z[worst]))) if log else None,
        gate.solver,
        finite(float(gate.event_shift)),
        stick_scatter(found.attempt.solved),
    )


def _fit(found: Findings) -> FitFigures | None:
    if found.attempt is None:
        return None
    solved = found.attempt.solved
    # One weight holds for all samples of a log that count, so the compressed squares give the residual in newtons.
    squares, count = 0.0, solved.problem.samples
    variance = np.array([1.0 / np.max(log.data.weight) for log in found.attempt.fitted_logs])
    for family, cost in zip(solved.problem.layout.families, solved.problem.block_costs(solved.solution.z), strict=True):
        squares += float(variance[family.log] @ cost)
    return FitFigures(
        samples=count,
        cycles=int(sum(trajectory.arrests for trajectory in solved.trajectories)),
        iterations=solved.iterations,
        passes=solved.passes,
        unknowns=solved.problem.layout.size,
        rms_N=math.sqrt(squares / max(count, 1)),
        steps=solved.grid.steps,
        discretisation={} if found.sure is None else dict(found.sure.discretisation),
    )


def _rig_sensitivity(scene: Scene, found: Findings) -> dict[str, dict[str, Shift]]:
    """What an error of 1 % in a rig quantity taken as exact would do to every parameter."""
    assert found.information is not None and found.attempt is not None and found.covariance is not None
    exact = [n for n in (*RIG_PARAMETERS, "drive_speed") if n not in scene.parameters and n not in scene.rig.tolerances]
    out = {}
    for quantity in exact:
        if quantity == "drive_speed":
            values = found.unknowns.values(found.attempt.solved.theta, found.attempt.fitted_logs[0].data.base)
            move = found.information.drive_speed_shift(values)
        elif quantity in found.unknowns.names and getattr(scene.rig, quantity) > 0.0:
            move = found.information.shift(found.unknowns.names.index(quantity))
        else:
            continue
        out[quantity] = _shifts(found, RIG_ERROR * move)
    return out


def _tolerances(scene: Scene, found: Findings) -> dict[str, ToleranceResult]:
    """What the published intervals allow for beyond the fit, one standard deviation each."""
    settled = {*scene.parameters, *scene.rig.tolerances}  # the intervals of the fit hold these
    if "force_sensor" in scene.effects:
        settled.add("friction_force")
    return {
        name: ToleranceResult(share, "scene" if name in scene.tolerances else "usual")
        for name, share in {**USUAL_TOLERANCES, **scene.tolerances}.items()
        if name not in settled
        and not (name == "damping" and "damping" not in found.unknowns.names)
        and not (name == "specimen" and not each_speed_alone(found))
    }


def each_speed_alone(found: Findings) -> bool:
    """Whether several logs took part and no two of them share a drive speed."""
    logs = [] if found.attempt is None else [log.data for log in found.attempt.fitted_logs]
    speeds = sorted(log.drive_speed for log in logs)
    several = len(logs) > 1 and not any(log.programme is not None for log in logs)
    return several and all(fast > SAME_SPEED * slow for slow, fast in pairwise(speeds))


def _by_specimens(found: Findings, scatter: float, inflation: float) -> Array:
    """Covariance (f, f) of the free theta that a relative scatter from log to log of all friction, and of its static
    part by itself, adds."""
    assert found.attempt is not None
    unknowns, solved = found.unknowns, found.attempt.solved
    free, static = int(np.count_nonzero(unknowns.free)), unknowns.names.index("mu_s")
    columns = [Column("load_gain", load_gain, DIFFERENCE, "single")]
    columns.append(Column("mu_s", parameter(static, logarithmic=False), DIFFERENCE, "single"))
    sizes_of = {"load_gain": scatter, "mu_s": scatter * abs(float(solved.theta[static]))}
    try:
        return marginal_covariance(solved, columns, sizes_of, inflation)[:free, :free]
    except np.linalg.LinAlgError:  # directions that no log determines: their verdicts say so
        return np.zeros((free, free))


def _by_errors(found: Findings, tolerances: Mapping[str, float]) -> dict[str, Array]:
    """Covariances (f, f) of the free theta that each error of rig and sensors and the scatter of specimens add by
    themselves, by what is in error, and under `ALL` together."""
    assert found.information is not None and found.attempt is not None
    information = found.information
    values = found.unknowns.values(found.attempt.solved.theta, found.attempt.fitted_logs[0].data.base)
    inflation = largest_inflation(found.attempt, found.sure.noise) if found.sure is not None else 1.0
    of_rig = {name: share for name, share in tolerances.items() if name != "specimen"}
    out = {name: added_by_tolerances(information, values, {name: of_rig[name]}, inflation) for name in of_rig}
    out[ALL] = added_by_tolerances(information, values, of_rig, inflation)
    if scatter := tolerances.get("specimen", 0.0):
        out["specimen"] = _by_specimens(found, scatter, inflation)
        out[ALL] = out[ALL] + out["specimen"]
    return out


def _published(result: Result, found: Findings, tolerances: Mapping[str, float], errors: Mapping[str, Array]) -> Result:
    """The result with the interval, standard error, verdict and correlation to publish: errors of rig and sensors
    widen those of the fit, which stand beside as `interval_rig_exact`."""
    assert found.attempt is not None
    unknowns = found.unknowns
    values = unknowns.values(found.attempt.solved.theta, found.attempt.fitted_logs[0].data.base)
    size_of = dict(zip(unknowns.names, sizes(unknowns, values).tolist(), strict=True))
    free = np.flatnonzero(unknowns.free).tolist()

    def added(covariance: Array) -> dict[str, float]:
        sd = dict(zip(free, standard_deviations(covariance).tolist(), strict=True))
        sources = zip(unknowns.names, unknowns.source.tolist(), strict=True)  # a tied parameter follows another one
        return {name: sd[source] for name, source in sources if source in sd}

    of_each = {name: added(covariance) for name, covariance in errors.items()}
    of_all = of_each.pop(ALL, {})
    out = dict(result.parameters)
    for name, entry in result.parameters.items():
        base = entry.parameter or name
        if entry.verdict == "fixed" or base not in of_all or entry.value is None:
            continue
        scale = bool(unknowns.logarithmic[unknowns.names.index(base)])
        low, high = (_farther(entry.value, end, NORMAL * of_all[base], scale) for end in entry.ends)
        error = entry.standard_error
        error = None if error is None else math.hypot(error, of_all[base] * (entry.value if scale else 1.0))
        wider = replace(entry, interval=(low, high), interval_rig_exact=entry.interval, standard_error=error)
        judged = verdict_of(entry.value, low, high, size_of[base], scale)
        if entry.verdict in ("identified", "weak") and judged != entry.verdict:
            worst = max(of_each, key=lambda each: of_each[each][base])
            reason = (
                f"{TOLERANCE_WORDS[worst]} counts as known to {100.0 * tolerances[worst]:g} %, which leaves it this "
                "wide: measure it, and state it under [tolerances]"
            )
            wider = replace(wider, verdict=judged, reason="; ".join(filter(None, (entry.reason, reason))))
            wider = wider if judged == "weak" else replace(wider, standard_error=None)
        out[name] = wider
    correlation = result.correlation
    if correlation is not None and found.covariance is not None:
        correlation = _correlation(found, errors.get(ALL, 0.0))
    return replace(result, parameters=out, correlation=correlation)


def _farther(value: float, end: float | None, by: float, logarithmic: bool) -> float | None:
    """The end of an interval, moved out by an independent error, which is one of the logarithm where that counts; None
    where that leaves it open."""
    if end is None or end == value:
        return end
    if logarithmic and end > 0.0:
        reach = math.hypot(math.log(end / value), by)
        return value * math.exp(math.copysign(reach, end - value)) if reach < FARTHEST else None
    return value + math.copysign(math.hypot(end - value, by), end - value)


def _shifts(found: Findings, move: Array) -> dict[str, Shift]:
    """A move of the free theta (f,) as shifts of the parameters, in SI and in standard errors."""
    unknowns, estimates = found.unknowns, {e.name: e for e in found.estimates}
    out = {}
    for i, index in enumerate(np.flatnonzero(unknowns.free).tolist()):
        estimate = estimates[unknowns.names[index]]
        size = estimate.value if unknowns.logarithmic[index] and estimate.value is not None else 1.0
        shift, error = float(move[i] * size), estimate.standard_error
        out[estimate.name] = Shift(shift, estimate.unit, shift / error if error else None)
    return out
