"""The logs that would identify what a converged fit leaves open, beside its verdicts and in its result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.base.result import NextLogResult
from identify.base.wording import speed_text, three_figures
from identify.bench.design import Knowledge, LogDesign, choose
from identify.bench.plan import BUDGET, LONGEST, dialled, drawn_places, driven, two_figures
from identify.diagnosis.findings import Findings
from identify.estimation.covariance import Estimate, inverse
from identify.estimation.fit_wording import hints, onsets
from identify.logs.vibration import rhythmic

Array = NDArray[np.float64]


def next_logs(findings: Findings) -> tuple[NextLogResult, ...] | None:
    """The logs that would identify what a converged fit calls weak or not identifiable, one after the other; None where
    nothing is left, fewer than two sticks end in a slip, or the time is up before they are chosen."""
    knowledge = _knowledge(findings)
    if knowledge is None:
        return None
    assert findings.attempt is not None
    logs = findings.attempt.fitted_logs
    load = float(np.median([log.mean_load for log in logs]))
    speeds = [speed for log in logs for speed, _ in driven(log.data)]
    planned = choose(knowledge, [LogDesign(speed, load) for speed in dialled(speeds)], BUDGET)
    if time_is_up():
        return None
    return tuple(
        NextLogResult(log.design.speed, load, two_figures(log.duration), log.rate, log.slips, log.identifies)
        for log in planned
        if log.identifies
    )


def _knowledge(findings: Findings) -> Knowledge | None:
    """What the fit knows; None where there is nothing to ask or nothing to start from."""
    if findings.status is not Status.CONVERGED or findings.attempt is None or findings.sure is None:
        return None
    unknowns, attempt, sure = findings.unknowns, findings.attempt, findings.sure
    verdicts = {e.name: e.verdict for e in findings.estimates}
    free = np.flatnonzero(unknowns.free)
    verdict = [verdicts[unknowns.names[i]] for i in free.tolist()]
    # What a log has for itself, another one has anew; harmonics are those of a drive at its speed.
    own = unknowns.own[free] & ~unknowns.grouped[free] | rhythmic(unknowns)[free]
    kept = np.flatnonzero(~own & np.array([each != "at bound" for each in verdict]))
    targets = tuple(
        unknowns.names[free[i]] for i in kept.tolist() if verdict[i] in ("weak", "not profiled", "not identifiable")
    )
    # A single peak informs so little that no motion can be simulated.
    if onsets(attempt.solved.trajectories) < 2 or not targets or not np.all(np.isfinite(sure.covariance)):
        return None
    pairs = list(zip(attempt.fitted_logs, attempt.solved.trajectories, strict=True))
    log, trajectory = max(pairs, key=lambda pair: pair[1].when("onset").size)
    if not driven(log.data):
        return None
    theta = attempt.solved.theta
    precision = inverse(sure.covariance)
    places = drawn_places(unknowns, theta, precision, log.data.base)
    shared = inverse(sure.covariance[np.ix_(kept, kept)])
    load_sd = float(np.median(log.data.onset_load_sd_at(trajectory.loaded_at))) if trajectory.parts else 0.0
    apart = [each.data.interval * model.inflation for (each, _), model in zip(pairs, sure.allowed.noise, strict=True)]
    return Knowledge(
        unknowns,
        kept,
        targets,
        places,
        np.array([shared] * len(places)),
        np.zeros(kept.size),
        log.data.base,
        log.data.noise**2,
        load_sd / log.mean_load,
        1.0 / min(each.data.interval for each, _ in pairs),
        LONGEST,
        apart=max(apart) if any(not model.white for model in sure.allowed.noise) else 0.0,
    )


def advised(findings: Findings, logs: Sequence[NextLogResult]) -> Findings:
    """The findings with the log to add beside every verdict that leaves something open."""
    assert findings.attempt is not None and findings.sure is not None
    attempt = findings.attempt
    shown = hints(attempt.fitted_logs, attempt.solved.trajectories, findings.unknowns, attempt.solved.theta)

    def with_log(estimate: Estimate) -> Estimate:
        log, hint = next((log for log in logs if estimate.name in log.expected), None), shown.get(estimate.name)
        if log is None:
            return estimate
        remedy = (
            f"add a log of {log.duration:.6g} s at {speed_text(log.drive_speed, 3)} and "
            f"{three_figures(log.normal_force)} N, sampled at {log.sampling_rate:.0f} Hz, which is expected to "
            f"identify it to {math.ceil(100.0 * log.expected[estimate.name])} %"
        )
        if hint is not None and str(hint) in estimate.reason:
            return replace(estimate, reason=estimate.reason.replace(str(hint), f"{hint.shown}: {remedy}"))
        return replace(estimate, reason="; ".join(filter(None, (estimate.reason, remedy))))

    return replace(
        findings, sure=replace(findings.sure, estimates=[with_log(each) for each in findings.sure.estimates])
    )
