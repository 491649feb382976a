"""Which log would tell what these do not: the fewest that are expected to bring parameters to `identified`.

The core is that of the plan (`designs`): logs at many drive speeds, at the answer and at other places that the data
find as likely. What the fitted logs told in truth, against what their own rehearsals promise, is the price: loads that
tremble, noise on them and all that a rehearsal leaves out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.base.result import NextLogResult
from identify.base.wording import speed_text, three_figures
from identify.bench.designs import Knowledge, Rehearsals, choose, dials, driven, told_by
from identify.bench.rehearsal import LogDesign
from identify.diagnosis.findings import Findings
from identify.estimation.covariance import IDENTIFIED, WEAK, Estimate, inverse
from identify.estimation.hints import hints, onsets
from identify.estimation.profile import CRITICAL, Profiles
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import rhythmic
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

DIALS = (1.0, 2.0, 5.0)  # of a decade: speeds that one would set
BEYOND = 10.0  # times the fastest log, and below the slowest
LONGEST = 60.0  # [s] of a log that is proposed, where none of the fitted ones is longer
SETUP = 30.0  # [s] that a log costs beside its duration
MOST = 3  # logs that are proposed


@dataclass(frozen=True)
class Advice:
    """The logs that would tell, one after the other; the parameters that no log of one speed, of up to `longest` [s],
    is expected to tell."""

    logs: tuple[NextLogResult, ...]
    untold: tuple[str, ...]
    longest: float


def next_logs(found: Findings) -> Advice | None:
    """The logs that would tell, one after the other, what a converged fit calls weak or not identifiable; None where
    nothing is left to tell, fewer than two sticks end in a slip, or the time is up before they are chosen."""
    known = _known(found)
    if known is None:
        return None
    load = _typical(found)[0].mean_load
    designs = [LogDesign(speed, load) for speed in _speeds(found)]
    planned = choose(Rehearsals(known), designs, math.inf, SETUP, MOST)
    if time_is_up():
        return None
    logs = tuple(
        NextLogResult(log.design.speed, load, _whole(log.duration), log.rate, log.slips, log.tells)
        for log in planned
        if log.tells
    )
    untold = tuple(name for name in known.asked if not any(name in log.expected for log in logs))
    return Advice(logs, untold, known.longest)


def _typical(found: Findings) -> tuple[Prepared, ShootingTrajectory]:
    """The log that others are to be like, with the motion behind it: the one of most slips."""
    assert found.attempt is not None
    pairs = zip(found.attempt.fitted_logs, found.attempt.solved.trajectories, strict=True)
    return max(pairs, key=lambda pair: _onsets(pair[1]).size)


def _known(found: Findings) -> Knowledge | None:
    """What the fit knows; None where there is nothing to ask or nothing to start from."""
    if found.status is not Status.CONVERGED or found.attempt is None or found.sure is None:
        return None
    unknowns, attempt, sure = found.unknowns, found.attempt, found.sure
    verdicts = {e.name: e.verdict for e in found.estimates}
    free = np.flatnonzero(unknowns.free)
    told = [verdicts[unknowns.names[i]] for i in free.tolist()]
    # What a log has for itself, another one has anew; harmonics are those of a drive at its speed.
    own = unknowns.own[free] & ~unknowns.grouped[free] | rhythmic(unknowns)[free]
    kept = np.flatnonzero(~own & np.array([verdict != "at bound" for verdict in told]))
    asked = tuple(unknowns.names[free[i]] for i in kept.tolist() if told[i] in ("weak", "not identifiable"))
    if onsets(attempt.solved.trajectories) < 2:  # a single peak tells so little that no motion can be rehearsed
        return None
    log, trajectory = _typical(found)
    begun = _onsets(trajectory)
    if not asked or not driven(log.data) or not np.all(np.isfinite(sure.covariance)):
        return None
    apart = np.diff(begun) if begun.size > 1 else begun - log.data.begin
    theta = attempt.solved.theta
    precision = inverse(sure.covariance[np.ix_(kept, kept)])
    places = np.array([theta, *_other_places(unknowns, kept, theta, sure.profiles)])
    intervals = [log.data.interval for log in attempt.fitted_logs]
    memory = max(
        log.data.interval * colour.memory for log, colour in zip(attempt.fitted_logs, sure.colours, strict=True)
    )
    known = Knowledge(
        unknowns=unknowns,
        kept=kept,
        asked=asked,
        places=places,
        known=np.array([precision] * len(places)),
        base=log.data.base,
        variance=log.data.noise**2,
        load_error=_load_sd(log, trajectory) / log.mean_load,
        rate=1.0 / min(intervals),
        distance=float(np.median(apart)) * max(speed for speed, _ in driven(log.data)),
        longest=max(LONGEST, *(log.data.end - log.data.begin for log in attempt.fitted_logs)),
        apart=memory if any(not colour.white for colour in sure.colours) else 0.0,
    )
    price = _price(known, found, [i for i in kept.tolist() if told[i] in ("identified", "weak")])
    return replace(known, variance=known.variance * price)


def _onsets(trajectory: ShootingTrajectory) -> Array:
    """When sticks of a log end in a slip [s]."""
    return trajectory.when("onset")


def _load_sd(log: Prepared, trajectory: ShootingTrajectory) -> float:
    """By how much the normal force of a log may be off [N], in a typical cycle."""
    return float(np.median(log.data.onset_load_sd_at(trajectory.loaded_at))) if trajectory.parts else 0.0


def _price(known: Knowledge, found: Findings, judged: Sequence[int]) -> float:
    """How much less the fitted logs told than rehearsals of them promise, as a factor on the variance of white noise:
    the volumes of the joint regions of what is known, per parameter; one at least."""
    assert found.attempt is not None and found.sure is not None
    solved, unknowns = found.attempt.solved, known.unknowns
    if not judged:
        return 1.0
    total = unknowns.prior_precision[np.ix_(unknowns.free, unknowns.free)]
    for log, trajectory in zip(found.attempt.fitted_logs, solved.trajectories, strict=True):
        total += told_by(unknowns, trajectory.theta(solved.theta), log, _load_sd(log, trajectory), known.distance)
    promised = inverse(total)[np.ix_(judged, judged)]
    told = found.sure.white[np.ix_(judged, judged)]
    difference = np.linalg.slogdet(told)[1] - np.linalg.slogdet(promised)[1]
    return float(np.exp(max(difference / len(judged), 0.0))) if np.isfinite(difference) else 1.0


def _speeds(found: Findings) -> list[float]:
    """Drive speeds to try [m/s], rising."""
    assert found.attempt is not None
    own = [speed for log in found.attempt.fitted_logs for speed, _ in driven(log.data)]
    return dials(min(own) / BEYOND, max(own) * BEYOND, DIALS)


def _other_places(unknowns: Unknowns, kept: NDArray[np.int64], theta: Array, walked: Profiles | None) -> list[Array]:
    """Theta (n_p,) of points that the data find as likely as the answer: the ends of what they leave most open, as far
    as a verdict asks."""
    if walked is None or not walked.likely.size:
        return []
    free = np.flatnonzero(unknowns.free)
    worst = kept[int(np.argmax(np.ptp(walked.likely[:, kept], axis=0) / unknowns.spread[free[kept]]))]
    reach = np.log(WEAK) if unknowns.logarithmic[free[worst]] else np.inf
    agreed = walked.likely[(walked.ratios <= 1.1 * CRITICAL) & (np.abs(walked.likely[:, worst]) <= reach)]
    agreed = agreed[np.argsort(agreed[:, worst])]
    out = []
    for away in (agreed[:1], agreed[-1:]):
        if away.size:
            at = theta.copy()
            at[free] = walked.best[free] + away[0]
            out.append(at)
    return out


# ----------------------------------------------------------------------------------------------------------------------
# The logs that would tell, in words beside the verdicts, and in the result document.
# ----------------------------------------------------------------------------------------------------------------------


def advised(found: Findings, advice: Advice) -> Findings:
    """The findings with the log that would tell beside every verdict that leaves something to tell."""
    assert found.attempt is not None
    attempt = found.attempt
    told = hints(attempt.fitted_logs, attempt.solved.trajectories, found.unknowns, attempt.solved.theta)

    def with_log(estimate: Estimate) -> Estimate:
        name, reason = estimate.name, estimate.reason
        remedy, hint = _remedy(name, advice), told.get(name)
        if remedy and hint is not None and str(hint) in reason:
            return replace(estimate, reason=reason.replace(str(hint), f"{hint.shown}: {remedy}"))
        return replace(estimate, reason="; ".join(filter(None, (reason, remedy, _no_remedy(name, advice)))))

    assert found.sure is not None
    return replace(found, sure=replace(found.sure, estimates=[with_log(each) for each in found.sure.estimates]))


def _remedy(name: str, advice: Advice) -> str:
    """The log to add for one parameter; "" where none is known."""
    for log in advice.logs:
        if name in log.expected:
            return f"add {_said(log)}, which is expected to tell it to {math.ceil(100.0 * log.expected[name])} %"
    return ""


def _no_remedy(name: str, advice: Advice) -> str:
    """That no log would tell a parameter; "" where one might: beside a log that tells others it is too soon to say."""
    if advice.logs or name not in advice.untold:
        return ""
    return (
        f"as far as these logs tell, none of up to {three_figures(advice.longest)} s at one speed, this load and on "
        f"this rig would tell it to {100.0 * IDENTIFIED:.0f} %"
    )


def _said(log: NextLogResult) -> str:
    return (
        f"a log of {log.duration:.6g} s at {speed_text(log.drive_speed, 3)} and "
        f"{three_figures(log.normal_force)} N, sampled at {log.sampling_rate:.0f} Hz"
    )


def _whole(duration: float) -> float:
    """A duration [s] with two figures, rounded up."""
    step = 10.0 ** (math.floor(math.log10(duration)) - 1)
    return float(f"{math.ceil(duration / step - 1e-9) * step:.6g}")
