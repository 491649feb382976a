"""The result of a fit from what it found: names, units, verdicts and provenance as the interface promises."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from importlib.metadata import version
from itertools import pairwise, permutations

import numpy as np
from numpy.typing import NDArray

from identify.base import result as schema
from identify.base.document import finite
from identify.base.quantiles import LEVEL, NORMAL
from identify.base.result import ParameterResult, Result, Status, ToleranceResult
from identify.diagnosis.effect_choice import Choice, as_listed, effects_result
from identify.diagnosis.findings import Findings
from identify.diagnosis.score_test import score_table
from identify.diagnosis.specimens import columns_of, log_effects
from identify.estimation.attempt import Attempt
from identify.estimation.certainty import Certainty
from identify.estimation.covariance import (
    FARTHEST,
    TOLERANCE_WORDS,
    Estimate,
    added_by_tolerances,
    parameter_value,
    sizes,
    standard_deviations,
    verdict_of,
)
from identify.estimation.estimator import FINER_STEPS
from identify.estimation.goodness_of_fit import stick_scatter
from identify.estimation.profile import CRITICAL
from identify.logs.prepare import Prepared
from identify.logs.recorded_drive import DISAGREES
from identify.logs.scene_records import parts_of
from identify.logs.unknowns import Unknowns, stated_rig
from identify.model.model import RIG_PARAMETERS
from identify.prediction.wording import listed
from identify.report.log_document import log_result, with_answers
from identify.scene import Scene
from identify.scene.values import USUAL_TOLERANCES
from identify.shooting.accuracy import FEWEST_STEPS, FitOptions, accuracy_costs, effect_shares

Array = NDArray[np.float64]

DISTRIBUTION = "stick-slip-workbench"
STAGES = ("read", "detect", "start", "place", "build", "solve", "intervals")
PACKAGES = ("casadi", "numpy", "scipy", "pandas", "h5py", "matplotlib")
RIG = (*RIG_PARAMETERS, "drive_speed")
MOST_NAMED = 3  # records that a sentence names where all of each is meant
SAME_SPEED = 1.05  # ratio below which two drive speeds are one
ALL = "all"  # of the covariances by errors, the one of all together
RIG_ERROR = 0.01  # what a rig quantity without a stated tolerance is tried with
UNFOLLOWED = 0.02  # of a record: an end that is left out and worth a note
STATED_REST = 15.0  # [s] before a static coefficient: strength grows with rest, so that a standard has to fix one
VALIDITY = "creep velocity D/t_cr (eq. 2): the contact stays fresh while it slides faster"
DIFFERENCE = 1e-5  # relative steps of a derivative
NOTABLE = 1.05  # by which factor correlated noise must widen an interval to be worth a note


def result_of(
    scene: Scene,
    prepared: list[Prepared],
    findings: Findings,
    seconds: Mapping[str, float],
    seed: int,
    choice: Choice | None = None,
) -> Result:
    """What a fit found, in SI.

    Args:
        seconds: of each stage, and in all ("total"). choice: how the effects were chosen, None where the scene lists
            them.
    """
    converged, estimated = findings.status is Status.CONVERGED, findings.estimated
    parts = parts_of(scene, [log.entry for log in prepared])
    tolerances = _tolerances(scene, findings) if converged and findings.attempt is not None else {}
    shares = {name: each.relative for name, each in tolerances.items()}
    errors = _by_errors(findings, shares) if shares and findings.covariance is not None else {}
    gate, figures = (None, None) if findings.attempt is None else _gate_and_fit(findings.attempt)
    result = Result(
        status=findings.status.value,
        message=_message(prepared, findings),
        parameters=_parameters(findings, converged),
        effects=_effects(prepared, findings, choice),
        estimator=findings.estimator,
        correlation=_correlation(findings, errors.get(ALL)) if converged else None,
        gate=gate,
        fit=figures,
        logs=tuple(
            log_result(i, log, findings, part) for i, (log, part) in enumerate(zip(prepared, parts, strict=True))
        ),
        notes=tuple(_notes(scene, prepared, findings)),
        search=tuple(findings.trace.trials),
        not_tried=tuple(findings.trace.not_tried),
        more={} if estimated is None else estimated.more,
        rig_against_data=findings.held or None,
        causes=findings.causes,
        timing_s={stage: seconds.get(stage, 0.0) for stage in (*STAGES, "total")},
        provenance={
            "version": version(DISTRIBUTION),
            "scene": scene.as_document(),
            "seed": seed,
            "packages": {name: version(name) for name in PACKAGES},
            "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        },
    )
    base = findings.unknowns.base(stated_rig(scene))  # (n_p,) of the rig the parameters are given for
    if converged and findings.attempt is not None:
        result = replace(result, rig_sensitivity=_rig_sensitivity(scene, findings), tolerances=tolerances)
        parameters = _published(result.parameters, findings, shares, errors)
        result = replace(result, parameters=parameters, derived=derived_quantities(parameters, result.correlation))
        result = with_answers(result, prepared, findings)
        return _with_depth(result, findings.sure, findings.unknowns, base) if findings.sure else result
    if converged:
        return result
    ends = _profile_ends(findings.sure, findings.unknowns, base)  # of a parameter at its bound, one end is that bound
    iterate = {e.name: schema.Value(e.value, e.unit, ends.get(e.name)) for e in findings.estimates}
    nothing = {name: schema.Value(None, entry.unit) for name, entry in result.parameters.items()}
    return replace(result, last_iterate=iterate or nothing)


def _message(prepared: list[Prepared], findings: Findings) -> str:
    """The sentence of the result; an answer says first which part of each record it rests on."""
    if findings.status is not Status.CONVERGED:
        return findings.message
    taken = [log for i, log in enumerate(prepared) if i not in findings.left_out]
    logs = findings.attempt.fitted_logs if findings.attempt else taken
    parts = [log.rests_on for log in logs if log.rests_on]
    whole = [log.name for log in logs if not log.rests_on]
    if len(whole) > MOST_NAMED:
        whole = [f"all {'other ' if parts else ''}{len(whole)} records"]
    elif whole:
        whole = [f"all of {listed(whole)}"]
    return f"from {listed([*parts, *whole])}: {findings.message}"


def _effects(prepared: list[Prepared], findings: Findings, choice: Choice | None) -> schema.EffectsResult:
    """Which effects and why; of those that are listed, what they amount to at the first log, if there is an answer."""
    if choice is not None:
        return effects_result(choice, auto=True)
    log, model, values = prepared[0].data, findings.unknowns.model, None
    if findings.status is Status.CONVERGED and findings.attempt is not None:
        with np.errstate(all="ignore"):
            p = findings.unknowns.values(findings.attempt.solved.theta, log.base)
        values = dict(zip(model.parameter_names, np.where(np.isfinite(p), p, 0.0).tolist(), strict=True))
    return effects_result(as_listed(model.effects, values, log.mean_normal_force, log.drive_speed), auto=False)


# The notes of a result: what was assumed, what was left out, what the search changed, each in a sentence.


def _notes(scene: Scene, prepared: list[Prepared], findings: Findings) -> Iterator[str]:
    """All notes on how the result came about, in the order a reader needs them."""
    sure, attempt = findings.sure, findings.attempt
    if any(log.noise_estimated for log in prepared):
        yield "The noise was estimated from straight lines through the stick phases, not given."
    if findings.status is Status.CONVERGED:
        widest = float(np.sqrt(np.max(sure.allowed.inflation, initial=1.0))) if sure is not None else 1.0
        if attempt is not None and not all(c.white for c in attempt.noise) and widest >= NOTABLE:
            yield (
                f"Residuals are autocorrelated (one sample in {max(c.inflation for c in attempt.noise):.2g} is "
                f"new): standard errors are up to {widest:.2g} times those of white noise."
            )
        given = {e.name for e in findings.estimates} if findings.estimated is not None else set()
        exact = [name for name in RIG if name not in {*scene.parameters, *scene.rig.tolerances, *given}]
        if exact:
            yield f"Taken as exact by the fit: {', '.join(name.replace('_', ' ') for name in exact)}."
        if "force_sensor" not in scene.effects:
            yield (
                "Zero and gain of both force sensors are taken as they are: an error of 1 % there is one of 1 % in the "
                "coefficients, with little effect on the misfit. Check both with a known weight, or add force_sensor "
                "to effects."
            )
        if each_speed_alone(findings):
            yield (
                "Each drive speed was recorded once, so that specimens, days or loads that differ look like an effect "
                "of speed; the intervals include a usual difference. Repeat one speed; of one specimen state "
                "specimen = 0 under [tolerances]."
            )
    doubts = [(log.entry.path.name, f.message) for log in prepared for f in log.record.findings if f.code == DISAGREES]
    yield from (f"{name}: {message}." for name, message in dict.fromkeys(doubts))
    yield from _events(prepared, findings)
    yield from () if findings.estimated is None else findings.estimated.notes


def _events(prepared: list[Prepared], findings: Findings) -> Iterator[str]:
    """Slips that the search put in or took out, and records it could not follow to their end."""
    attempt = findings.attempt
    for number, log in zip(attempt.log_numbers, attempt.fitted_logs, strict=True) if attempt else ():
        before, after, mode = prepared[number].slip_times, log.slip_times, log.fit_mode.name
        put = [f"{t:.4g} s" for t in after.tolist() if t not in before]
        out = [f"{t:.4g} s" for t in before.tolist() if t not in after]
        for words, times in (("that was missed put in", put), ("that is none taken out", out)):
            if times:
                yield f"{log.name}: a slip {words} at {', '.join(times)}."
        left = prepared[number].data.end - log.data.end
        if mode == "continuous" and left > UNFOLLOWED * (log.data.end - log.data.begin):
            yield (
                f"{log.name}: fitted up to {log.data.end:.4g} s; from there on the motion of the answer is none that a "
                "fit follows (a swing that never fades, or a mass that is pulled back)."
            )
        if mode == "sliding" and prepared[number].fit_mode.name == "continuous":
            yield (
                f"{log.name}: only what slides steadily is fitted, from {log.data.begin:.4g} s on: the way there is "
                "not described."
            )


# Parameters, their correlation, and how well the fit follows.


def _parameters(findings: Findings, converged: bool) -> dict[str, ParameterResult]:
    """Every parameter by name; of those that differ between groups the first group's stands under the bare name."""
    names, per, sure = findings.unknowns.names, findings.unknowns.per, findings.sure
    free = set(np.array(names)[findings.unknowns.free])
    kept = [
        e
        for e in findings.estimates
        if findings.estimated is not None or e.name not in RIG_PARAMETERS or e.name in free
    ]
    if not kept:
        why = "nothing was fitted; see the message"
        return {
            q.name: ParameterResult(
                unit=q.unit, interval=(None, None), level=LEVEL, verdict="not identifiable", reason=why
            )
            for q in findings.unknowns.model.parameters
            if q.name not in RIG_PARAMETERS
        }
    out = {e.name: _parameter(e, converged) for e in kept}
    for share in sure.shares if sure is not None else ():
        if share.place < 0:
            name = names[share.index]
            out[name] = replace(out[name], group=share.group, per=per[share.index] or "")
    for share, estimate in sure.of_groups if sure is not None and sure.shares else ():
        own = _parameter(estimate, converged)
        out[estimate.name] = replace(own, group=share.group, per=per[share.index] or "", parameter=names[share.index])
    return out


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


def _correlation(findings: Findings, added: Array | None) -> schema.Correlation | None:
    """Correlation of all estimates and the standard errors [SI] that go with it, also of those that have none because
    the data do not determine them.

    Args:
        added: (f, f) to the covariance of the free theta by errors of rig and sensors, which all groups share.
    """
    if findings.estimated is not None and len(findings.estimated.names):
        names, covariance, size = list(findings.estimated.names), findings.estimated.covariance, np.ones(1)
    elif findings.covariance is None:
        return None
    else:
        index = np.flatnonzero(findings.unknowns.free).tolist()
        by_name, covariance, free = {e.name: e for e in findings.estimates}, findings.covariance, len(index)
        estimates = [by_name[findings.unknowns.names[i]] for i in index]
        if findings.sure is not None and findings.sure.of_groups:
            beyond = findings.sure.of_groups
            order = [*range(free), *(free + share.place for share, _ in beyond)]
            estimates, index = estimates + [e for _, e in beyond], index + [share.index for share, _ in beyond]
            covariance = findings.sure.allowed.joint[np.ix_(order, order)]
        if added is not None:
            places = [index.index(i) for i in index]
            covariance = covariance + added[np.ix_(places, places)]
        names = [e.name for e in estimates]
        size = np.where(findings.unknowns.logarithmic[index], np.array([e.value for e in estimates], dtype=float), 1.0)
    sd = np.sqrt(np.diag(covariance))
    matrix = tuple(map(tuple, (covariance / np.outer(sd, sd)).tolist()))
    return schema.Correlation(tuple(names), matrix, tuple(map(finite, (size * sd).tolist())))


def _gate_and_fit(attempt: Attempt) -> tuple[schema.GateResult, schema.FitFigures]:
    """How well an attempt follows the logs, and how large it is."""
    gate, solved, worst = attempt.gate, attempt.solved, None
    if (at := gate.worst) >= 0:
        log = attempt.log_numbers[int(gate.log[at]) - 1] + 1
        worst = schema.WorstCycle(log, int(gate.cycle[at]), finite(float(gate.z[at])))
    shift, scatter = finite(float(gate.event_shift)), stick_scatter(solved)
    # One weight holds for all samples of a log that count, so the compressed squares give the residual in newtons.
    variance = np.array([1.0 / np.max(log.data.weight) for log in attempt.fitted_logs])
    families = zip(solved.problem.layout.families, solved.problem.block_costs(solved.solution.z), strict=True)
    squares = sum(float(variance[family.log] @ cost) for family, cost in families)
    figures = schema.FitFigures(
        samples=solved.problem.samples,
        cycles=int(sum(trajectory.ending("arrest").size for trajectory in solved.trajectories)),
        iterations=solved.iterations,
        rms_N=math.sqrt(squares / max(solved.problem.samples, 1)),
    )
    return schema.GateResult(finite(float(gate.chi2_per_sample)), worst, gate.solver, shift, scatter), figures


# What errors of rig and sensors do: to single parameters, and to the intervals to publish.


def _rig_sensitivity(scene: Scene, findings: Findings) -> dict[str, dict[str, schema.Shift]]:
    """What an error of 1 % in a rig quantity taken as exact would do to every parameter."""
    assert findings.information is not None and findings.attempt is not None and findings.covariance is not None
    unknowns, estimates = findings.unknowns, {e.name: e for e in findings.estimates}
    out: dict[str, dict[str, schema.Shift]] = {}
    for quantity in RIG:
        if quantity in scene.parameters or quantity in scene.rig.tolerances:
            continue
        if quantity == "drive_speed":
            values = unknowns.values(findings.attempt.solved.theta, findings.attempt.fitted_logs[0].data.base)
            move = findings.information.drive_speed_shift(values)
        elif quantity in unknowns.names and getattr(scene.rig, quantity) > 0.0:
            move = findings.information.shift(unknowns.names.index(quantity))
        else:
            continue
        out[quantity] = {}
        for index, by in zip(np.flatnonzero(unknowns.free).tolist(), (RIG_ERROR * move).tolist(), strict=True):
            e = estimates[unknowns.names[index]]
            shift = by * (e.value if unknowns.logarithmic[index] and e.value is not None else 1.0)
            out[quantity][e.name] = schema.Shift(shift, e.unit, shift / e.standard_error if e.standard_error else None)
    return out


def _tolerances(scene: Scene, findings: Findings) -> dict[str, ToleranceResult]:
    """What the published intervals allow for beyond the fit, one standard deviation each."""
    settled = {*scene.parameters, *scene.rig.tolerances}  # the intervals of the fit hold these
    settled |= {"friction_force"} if "force_sensor" in scene.effects else set()
    settled |= {"damping"} if "damping" not in findings.unknowns.names else set()
    settled |= {"specimen"} if not each_speed_alone(findings) else set()
    out = {
        name: ToleranceResult(share, "scene" if name in scene.tolerances else "usual")
        for name, share in {**USUAL_TOLERANCES, **scene.tolerances}.items()
        if name not in settled
    }
    return out | ({"specimen": ToleranceResult(findings.scatter, "estimated")} if findings.scatter else {})


def each_speed_alone(findings: Findings) -> bool:
    """Whether several logs took part and no two of them share a drive speed."""
    logs = [] if findings.attempt is None else [log.data for log in findings.attempt.fitted_logs]
    speeds = sorted(log.drive_speed for log in logs)
    several = len(logs) > 1 and not any(log.programme is not None for log in logs)
    return several and all(fast > SAME_SPEED * slow for slow, fast in pairwise(speeds))


def _by_errors(findings: Findings, tolerances: Mapping[str, float]) -> dict[str, Array]:
    """Covariances (f, f) of the free theta that each error of rig and sensors and the scatter of specimens (of all
    friction of a log, and of its static part by itself) add by themselves, and under `ALL` together."""
    assert findings.information is not None and findings.attempt is not None
    information, unknowns, solved = findings.information, findings.unknowns, findings.attempt.solved
    values = unknowns.values(solved.theta, findings.attempt.fitted_logs[0].data.base)
    inflation = findings.attempt.inflation
    of_rig = {name: share for name, share in tolerances.items() if name != "specimen"}
    out = {name: added_by_tolerances(information, values, {name: of_rig[name]}, inflation) for name in of_rig}
    out[ALL] = added_by_tolerances(information, values, of_rig, inflation)
    if scatter := tolerances.get("specimen", 0.0):
        free, mu_s = int(np.count_nonzero(unknowns.free)), abs(float(solved.theta[unknowns.names.index("mu_s")]))
        table, out["specimen"] = score_table(solved, columns_of(unknowns, mu_s), inflation), np.zeros((free, free))
        if table.scores:  # of directions that no log determines their verdicts say so
            effects = log_effects(table, np.zeros(len(table.scores)), scatter, inflation, estimated=False)
            out["specimen"] = effects.added[:free, :free]
        out[ALL] = out[ALL] + out["specimen"]
    return out


def _published(
    parameters: Mapping[str, ParameterResult],
    findings: Findings,
    tolerances: Mapping[str, float],
    errors: Mapping[str, Array],
) -> dict[str, ParameterResult]:
    """The parameters with the interval, standard error and verdict to publish: errors of rig and sensors widen those of
    the fit, which stand beside as `interval_rig_exact`."""
    assert findings.attempt is not None
    unknowns = findings.unknowns
    values = unknowns.values(findings.attempt.solved.theta, findings.attempt.fitted_logs[0].data.base)
    size_of = dict(zip(unknowns.names, sizes(unknowns, values).tolist(), strict=True))
    free = [unknowns.names[i] for i in np.flatnonzero(unknowns.free)]
    added = {}  # standard deviation of theta by error and parameter
    for source, covariance in errors.items():
        added[source] = dict(zip(free, standard_deviations(covariance).tolist(), strict=True))
    of_all = added.pop(ALL, {})
    out = dict(parameters)
    for name, entry in parameters.items():
        base = entry.parameter or name
        if entry.verdict == "fixed" or base not in of_all or entry.value is None:
            continue
        logarithmic, by = bool(unknowns.logarithmic[unknowns.names.index(base)]), of_all[base]
        low, high = (_farther(entry.value, end, NORMAL * by, logarithmic) for end in entry.ends)
        error_si = by * (entry.value if logarithmic else 1.0)
        error = None if entry.standard_error is None else math.hypot(entry.standard_error, error_si)
        wider = replace(entry, interval=(low, high), interval_rig_exact=entry.interval, standard_error=error)
        judged = verdict_of(entry.value, low, high, size_of[base], logarithmic)
        if entry.verdict in ("identified", "weak") and judged != entry.verdict:
            worst = max(added, key=lambda each: added[each][base])
            reason = (
                f"an error of {100.0 * tolerances[worst]:g} % in {TOLERANCE_WORDS[worst]} is allowed for, which makes "
                "the interval this wide: measure it, and state its error under [tolerances]"
            )
            wider = replace(wider, verdict=judged, reason="; ".join(filter(None, (entry.reason, reason))))
            wider = wider if judged == "weak" else replace(wider, standard_error=None)
        out[name] = wider
    return out


# What follows from parameters alone: name, unit, parameters, law, whether its logarithm has the symmetric interval,
# validity.
DERIVED: tuple[tuple[str, str, tuple[str, ...], Callable[..., float], bool, str], ...] = (
    ("v_cr", "m/s", ("D", "t_cr"), lambda length, time: length / time, True, VALIDITY),
    (
        "static_15s",  # of a contact that was fresh before the rest (eqs. 3 and 5)
        "",
        ("mu_s", "mu_k0", "t_cr"),
        lambda static, kinetic, time: static - (static - kinetic) * math.exp(-STATED_REST / time),
        False,
        f"after a rest of {STATED_REST:g} s; ISO 8295 fixes the rest, since strength grows with it",
    ),
)


def derived_quantities(
    parameters: Mapping[str, ParameterResult], known: schema.Correlation | None
) -> dict[str, schema.Number]:
    """DERIVED of the first group, and as "v_cr (V08)" of the others; those of which a parameter has no value absent.
    Intervals are to first order, by central differences."""
    keys = {(entry.parameter or name, entry.group): name for name, entry in parameters.items()}
    names = known.names if known is not None else ()
    out: dict[str, schema.Number] = {}
    for title, unit, wanted, law, by_logarithm, validity in DERIVED:
        for group in dict.fromkeys(g for name, g in keys if name in wanted and g) or ("",):
            of = [keys.get((name, group)) or keys.get((name, ""), "") for name in wanted]
            entries = [parameters.get(key) or ParameterResult() for key in of]
            values = np.array([entry.value for entry in entries if entry.value])
            if len(values) < len(of):
                continue
            value, key = law(*values.tolist()), f"{title} ({group})" if title in out else title
            if any(e.standard_error is None and e.verdict != "fixed" for e in entries):
                reason = f"interval open: these data do not determine {' or '.join(wanted)}"
                out[key] = schema.Number(value, unit, (None, None), validity, reason, group=group)
                continue
            rho = np.eye(len(of))
            for (i, one), (j, other) in permutations(enumerate(of), 2):
                if known is not None and one in names and other in names:
                    rho[i, j] = known.matrix[names.index(one)][names.index(other)] or 0.0
            steps = np.diag(DIFFERENCE * values)
            changes = np.array([law(*(values + h).tolist()) - law(*(values - h).tolist()) for h in steps])
            errors = changes / (2.0 * np.diag(steps)) * [e.standard_error or 0.0 for e in entries]
            half = NORMAL * math.sqrt(max(float(errors @ rho @ errors), 0.0))
            ends = (value * math.exp(-half / value), value * math.exp(half / value))
            interval = ends if by_logarithm else (value - half, value + half)
            out[key] = schema.Number(value, unit, interval, validity, group=group)
    return out


def _farther(value: float, end: float | None, by: float, logarithmic: bool) -> float | None:
    """The end of an interval, moved out by an independent error, which is one of the logarithm where that counts; None
    where that leaves it open."""
    if end is None or end == value:
        return end
    if logarithmic and end > 0.0:
        reach = math.hypot(math.log(end / value), by)
        return value * math.exp(math.copysign(reach, end - value)) if reach < FARTHEST else None
    return value + math.copysign(math.hypot(end - value, by), end - value)


# How sure it is: profile, bootstrap, and what the accuracy of the fit cost.


def _with_depth(result: Result, sure: Certainty, unknowns: Unknowns, base: Array) -> Result:
    """The result with its optima, and with profile and bootstrap where they were run.

    Args:
        base: (n_p,) of the rig the values are given for.
    """
    free = np.flatnonzero(unknowns.free).tolist()
    names = [unknowns.names[i] for i in free]
    errors = np.sqrt(sure.allowed.inflation * np.diag(sure.allowed.white))  # (f,) of theta

    optima = []
    for optimum in sure.optima or ():
        values = unknowns.values(optimum.attempt.solved.theta, base)[free].tolist()
        at = dict(zip(names, values, strict=True))
        optima.append(schema.OptimumResult(2.0 * optimum.cost, optimum.starts, at))
    curves, resampled = {}, {}
    ends = _profile_ends(sure, unknowns, base)
    for k, (i, name) in enumerate(zip(free, names, strict=True)):
        if sure.profiles is not None and name in ends and (curve := sure.profiles.curves.get(name)) is not None:
            curves[name] = schema.ProfileCurve(
                values=tuple(parameter_value(unknowns, i, float(t), base[i]) for t in curve.theta),
                loss=tuple(curve.loss.tolist()),
                interval=ends[name],
                failed=tuple(side.failed for side in sure.profiles.ends[name]),
                at_bound=tuple(side.walled for side in sure.profiles.ends[name]),
                standard_error=float(errors[k]),
                logarithmic=bool(unknowns.logarithmic[i]),
            )
        if (drawn := sure.bootstrap) is not None:
            interval = drawn.interval[k].tolist()
            low, high = (parameter_value(unknowns, i, t, base[i]) if math.isfinite(t) else None for t in interval)
            spread = float(np.std(drawn.replicates[:, k])) if drawn.replicates.shape[0] > 1 else math.nan
            resampled[name] = schema.BootstrapInterval((low, high), finite(spread / float(errors[k])))
    if (drawn := sure.bootstrap) is not None:
        unsettled = int(np.count_nonzero(~drawn.settled))
        result = replace(result, bootstrap=schema.BootstrapResult(LEVEL, drawn.settled.size, unsettled, resampled))
    return replace(
        result,
        profile=None if sure.profiles is None else schema.ProfileResult(LEVEL, CRITICAL, curves),
        optima=tuple(optima) or None,
    )


def _profile_ends(sure: Certainty | None, unknowns: Unknowns, base: Array) -> dict[str, schema.Interval]:
    """The ends of every profile by name, SI: of a parameter at its bound, one is that bound. Empty without profiles."""
    out: dict[str, schema.Interval] = {}
    profiles = sure.profiles if sure is not None else None
    for name, sides in profiles.ends.items() if profiles is not None else ():
        i = unknowns.names.index(name)
        low, high = (None if side.end is None else parameter_value(unknowns, i, side.end, base[i]) for side in sides)
        out[name] = low, high
    return out


def with_accuracy(result: Result, findings: Findings, options: FitOptions, processor: float, share: float) -> Result:
    """The result with what the accuracy of a fit cost and gives, what the other levels would, and what each effect took
    of the seconds (processor time, which no other program lengthens); as it is without an answer.

    Args:
        options: with the level of the fit; processor: seconds that it took; share: of them in functions of the model.
    """
    taken, unknowns = options.accuracy, findings.unknowns
    if findings.attempt is None or findings.sure is None or not np.any(unknowns.free):
        return result
    size = np.sqrt(np.diag(findings.sure.covariance))
    halvings = sum(trial.strategy == FINER_STEPS for trial in findings.trace.trials)
    steps = findings.attempt.solved.grid.steps
    first = FEWEST_STEPS if steps < FEWEST_STEPS else max(steps // 2**halvings, FEWEST_STEPS)
    costs = accuracy_costs(findings.attempt.solved, size, taken, first)
    names = np.array(unknowns.names)[unknowns.free].tolist()
    levels = []
    for cost in costs:
        seconds, worst = max(processor + cost.seconds, 0.0), finite(float(np.max(np.abs(cost.errors))))
        errors = dict(zip(names, map(finite, cost.errors.tolist()), strict=True))
        estimated = cost.level != taken.name
        levels.append(schema.AccuracyLevel(cost.level, seconds, cost.steps, worst, estimated, errors))
    equations, shares = share * processor, effect_shares(unknowns.model)
    effects = {name: part * equations for name, part in shares.items()}
    return replace(
        result,
        accuracy=schema.AccuracyResult(taken.name, equations, effects, tuple(levels)),
        accuracy_table=tuple(levels) if options.accuracy_table else None,
    )
