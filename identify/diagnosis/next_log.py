"""Which log would tell what these do not: the shortest that is expected to bring parameters to `identified`.

Logs are rehearsed at many drive speeds at the answer; the best are rehearsed again at other places that the data find
as likely, since what is not known may be anywhere among them. What the fitted logs told in truth, against what their
own rehearsals promise, is the price: loads that tremble, noise on them and all that a rehearsal leaves out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.quantiles import NORMAL
from identify.base.wording import speed_text, three_figures
from identify.diagnosis.findings import Findings
from identify.diagnosis.rehearsal import Rehearsal, rehearse
from identify.estimation.covariance import IDENTIFIED, WEAK, Estimate, inverse, sizes
from identify.estimation.hints import WANTED, hints, onsets, round_up
from identify.estimation.profile import CRITICAL, Profiles
from identify.logs.log_data import Guess, LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.vibration import rhythmic

Array = NDArray[np.float64]

DIALS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)  # of a decade: speeds that one would set
BEYOND = 10.0  # times the fastest log, and below the slowest
LONGEST = 60.0  # [s] of a log that is proposed, where none of the fitted ones is longer
SAFE = 0.9  # of what `identified` allows
TRIED = 6  # logs that are rehearsed at all places
MOST = 3  # logs that are proposed


@dataclass(frozen=True)
class NextLog:
    """A log that would tell: drive speed [m/s], normal force [N], duration [s], sampling rate [Hz], slips in it, and of
    each parameter it tells the expected half length of the 95 % interval, as a share of what it is judged by."""

    drive_speed: float
    normal_force: float
    duration: float
    rate: float
    slips: int
    tells: Mapping[str, float]


@dataclass(frozen=True)
class Advice:
    """The logs that would tell, the one that tells most first; the parameters that no log of one speed, of up to
    `longest` [s], is expected to tell."""

    logs: tuple[NextLog, ...]
    untold: tuple[str, ...]
    longest: float


@dataclass(frozen=True)
class _Known:
    """What is known: unknowns, kept (k,) places among the free parameters, precision (k, k), names asked for; base
    (n_p,), normal force [N] and distance per cycle [m] of the log that others are to be like; apart: seconds that count
    as one sample at least, for the memory of the noise; variance of a sample [N^2], the price included; load_sd: error
    of the normal force from cycle to cycle [N]; fastest rate [Hz]; longest log [s]."""

    unknowns: Unknowns
    kept: NDArray[np.int64]
    precision: Array
    asked: tuple[str, ...]
    base: Array
    normal_force: float
    distance: float
    apart: float
    variance: float
    load_sd: float
    rate: float
    longest: float


@dataclass(frozen=True)
class _Trial:
    """A rehearsed log, repeated so many times over; half lengths (k,) of the intervals."""

    rehearsal: Rehearsal
    times: int
    halves: Array

    @property
    def duration(self) -> float:
        """[s]."""
        return self.rehearsal.duration * self.times


def next_logs(found: Findings) -> Advice | None:
    """The logs that would tell, one after the other, what a converged fit calls weak or not identifiable; None where
    nothing is left to tell, or fewer than two sticks end in a slip."""
    known = _known(found)
    if known is None:
        return None
    assert found.attempt is not None and found.sure is not None
    theta = found.attempt.solved.theta
    places = [theta, *_other_places(known, theta, found.sure.profiles)]
    trials = [trial for speed in _speeds(found) for trial in _at(known, theta, speed)]
    logs: list[NextLog] = []
    left = list(known.asked)
    while left and len(logs) < MOST:
        best = _best(known, trials, places, left)
        if best is None:
            break
        logs.append(best)
        left = [name for name in left if name not in best.tells]
    return Advice(tuple(logs), tuple(left), known.longest)


def _known(found: Findings) -> _Known | None:
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
    if onsets(attempt.solved.guesses) < 2:  # a single peak tells so little that no motion can be rehearsed
        return None
    begun = [_onsets(guess) for guess in attempt.solved.guesses]
    like = max(range(len(begun)), key=lambda i: begun[i].size)
    log, guess = attempt.prepared[like], attempt.solved.guesses[like]
    if not asked or not driven(log.data) or not np.all(np.isfinite(sure.covariance)):
        return None
    apart = np.diff(begun[like]) if begun[like].size > 1 else begun[like] - log.data.begin
    distance = float(np.median(apart)) * max(speed for speed, _ in driven(log.data))
    intervals = [log.data.interval for log in attempt.prepared]
    memory = max(log.data.interval * colour.memory for log, colour in zip(attempt.prepared, sure.colours, strict=True))
    known = _Known(
        unknowns=unknowns,
        kept=kept,
        precision=inverse(sure.covariance[np.ix_(kept, kept)]),
        asked=asked,
        base=log.data.base,
        normal_force=log.mean_load,
        distance=distance,
        apart=memory if any(not colour.white for colour in sure.colours) else 0.0,
        variance=log.data.noise**2,
        load_sd=_load_sd(log, guess),
        rate=1.0 / min(intervals),
        longest=max(LONGEST, *(log.data.end - log.data.begin for log in attempt.prepared)),
    )
    price = _price(known, attempt.prepared, found, [i for i in kept.tolist() if told[i] in ("identified", "weak")])
    return replace(known, variance=known.variance * price)


def _onsets(guess: Guess) -> Array:
    """When sticks of a log end in a slip [s]."""
    return np.concatenate([guess.onset, [s.until for s in guess.tail if s.ended_by == "onset"]])


def _load_sd(log: Prepared, guess: Guess) -> float:
    """By how much the normal force of a log may be off [N], in a typical cycle."""
    return float(np.median(log.data.onset_load_sd_at(guess.loaded_at))) if guess.parts else 0.0


def _price(known: _Known, logs: Sequence[Prepared], found: Findings, judged: Sequence[int]) -> float:
    """How much less the fitted logs told than rehearsals of them promise, as a factor on the variance of white noise:
    the volumes of the joint regions of what is known, per parameter; one at least."""
    assert found.attempt is not None and found.sure is not None
    free = np.flatnonzero(known.unknowns.free)
    if not judged:
        return 1.0
    total = np.diag(1.0 / known.unknowns.prior_sd[free] ** 2)
    for log, guess in zip(logs, found.attempt.solved.guesses, strict=True):
        theta, data = guess.theta(found.attempt.solved.theta), log.data
        for speed, seconds in driven(data):
            made = rehearse(known.unknowns, theta, data.base, speed, log.mean_load, known.distance, seconds)
            if made is not None:
                share = seconds / made.duration if made.slips else 1.0
                total += share * made.information(1.0 / data.interval, data.noise**2, _load_sd(log, guess))
    promised = inverse(total)[np.ix_(judged, judged)]
    told = found.sure.white[np.ix_(judged, judged)]
    difference = np.linalg.slogdet(told)[1] - np.linalg.slogdet(promised)[1]
    return float(np.exp(max(difference / len(judged), 0.0))) if np.isfinite(difference) else 1.0


def driven(data: LogData) -> list[tuple[float, float]]:
    """At which speeds [m/s] a log was driven, and for how long each [s]; rests of the drive left out."""
    if data.programme is None:
        return [(data.drive_speed, data.end - data.begin)]
    starts = np.clip([*data.programme.starts, data.end], data.begin, data.end)
    pieces = zip(data.programme.speeds, np.diff(starts).tolist(), strict=True)
    return [(abs(speed), seconds) for speed, seconds in pieces if speed != 0.0 and seconds > 0.0]


def _speeds(found: Findings) -> list[float]:
    """Drive speeds to try [m/s], rising."""
    assert found.attempt is not None
    own = [speed for log in found.attempt.prepared for speed, _ in driven(log.data)]
    low, high = min(own) / BEYOND, max(own) * BEYOND
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    dials = [float(f"{dial}e{decade}") for decade in decades for dial in DIALS]
    return [speed for speed in dials if low <= speed <= high]


def _other_places(known: _Known, theta: Array, walked: Profiles | None) -> list[Array]:
    """Theta (n_p,) of points that the data find as likely as the answer: the ends of what is known least, as far as a
    verdict asks."""
    if walked is None or not walked.likely.size:
        return []
    free = np.flatnonzero(known.unknowns.free)
    halves = _halves(known, known.precision, theta)
    worst = known.kept[int(np.argmax(halves))]
    reach = np.log(WEAK) if known.unknowns.logarithmic[free[worst]] else np.inf
    agreed = walked.likely[(walked.objection <= CRITICAL) & (np.abs(walked.likely[:, worst]) <= reach)]
    agreed = agreed[np.argsort(agreed[:, worst])]
    out = []
    for away in (agreed[:1], agreed[-1:]):
        if away.size:
            at = theta.copy()
            at[free] = walked.middle[free] + away[0]
            out.append(at)
    return out


def _at(known: _Known, theta: Array, speed: float) -> list[_Trial]:
    """The logs at a speed, of one to as many repetitions as there is time for."""
    made = rehearse(known.unknowns, theta, known.base, speed, known.normal_force, known.distance, known.longest)
    if made is None:
        return []
    most = int(known.longest / made.duration) if made.slips else 1
    times = [2**i for i in range(max(most, 1).bit_length())]
    return [_Trial(made, t, _expected(known, made, t, theta)) for t in times]


def _rate(known: _Known, slip: float) -> float:
    """The sampling rate to ask for [Hz]."""
    return round_up(max(known.rate, WANTED / slip))


def _expected(known: _Known, made: Rehearsal, times: int, theta: Array) -> Array:
    """Half lengths (k,) of the intervals with such a log more."""
    seconds = max(1.0 / _rate(known, made.slip), known.apart)
    added = times * made.information(1.0 / seconds, known.variance, known.load_sd)[np.ix_(known.kept, known.kept)]
    return _halves(known, known.precision + added, theta)


def _halves(known: _Known, precision: Array, theta: Array) -> Array:
    """Half lengths (k,) of the 95 % intervals, as shares of what each parameter is judged by."""
    unknowns = known.unknowns
    index = np.flatnonzero(unknowns.free)[known.kept]
    half = NORMAL * np.sqrt(np.diag(inverse(precision)))
    judged_by = sizes(unknowns, unknowns.values(theta, known.base))[index]
    return np.where(unknowns.logarithmic[index], np.expm1(np.minimum(half, 50.0)), half / judged_by)


def _best(known: _Known, trials: Sequence[_Trial], places: Sequence[Array], left: Sequence[str]) -> NextLog | None:
    """The log that tells most of what is left, the shortest of these, and tells it at most places too."""
    names = [known.unknowns.names[i] for i in np.flatnonzero(known.unknowns.free)[known.kept].tolist()]
    wanted = [names.index(name) for name in left]

    def told(halves: Array) -> list[int]:
        return [i for i in wanted if halves[i] <= SAFE * IDENTIFIED]

    hopeful = sorted(
        (trial for trial in trials if told(trial.halves)), key=lambda t: (-len(told(t.halves)), t.duration)
    )
    best: tuple[int, NextLog] | None = None
    for trial in hopeful[:TRIED]:
        made = trial.rehearsal
        halves = [trial.halves]
        for place in places[1:]:
            there = rehearse(
                known.unknowns, place, known.base, made.speed, known.normal_force, known.distance, known.longest
            )
            halves.append(
                np.full(len(names), np.inf)
                if there is None
                else _expected(known, there, max(1, round(trial.duration / there.duration)), place)
            )
        typical = np.median(halves, axis=0)
        if told(typical) and (best is None or len(told(typical)) > best[0]):
            log = NextLog(
                made.speed,
                known.normal_force,
                trial.duration,
                _rate(known, made.slip),
                made.slips * trial.times,
                {names[i]: float(typical[i]) for i in told(typical)},
            )
            best = len(told(typical)), log
    return None if best is None else best[1]


# ----------------------------------------------------------------------------------------------------------------------
# The logs that would tell, in words beside the verdicts, and in the result document.
# ----------------------------------------------------------------------------------------------------------------------


def advised(found: Findings, advice: Advice) -> Findings:
    """The findings with the log that would tell beside every verdict that leaves something to tell."""
    assert found.attempt is not None
    attempt = found.attempt
    told = hints(attempt.prepared, attempt.solved.guesses, found.unknowns, attempt.solved.theta)

    def with_log(estimate: Estimate) -> Estimate:
        name, reason = estimate.name, estimate.reason
        remedy, hint = _remedy(name, advice), told.get(name)
        if remedy and hint is not None and str(hint) in reason:
            return replace(estimate, reason=reason.replace(str(hint), f"{hint.shown}: {remedy}"))
        return replace(estimate, reason="; ".join(filter(None, (reason, remedy, _no_remedy(name, advice)))))

    return replace(found, estimates=[with_log(estimate) for estimate in found.estimates])


def document(advice: Advice | None) -> list[dict[str, Any]]:
    """The logs for result.json, SI; expected: half lengths of 95 % intervals, relative (of mu_s - mu_k0 for
    delta_mu_k)."""
    return [
        {
            "drive_speed": log.drive_speed,
            "normal_force": log.normal_force,
            "duration": _whole(log.duration),
            "sampling_rate": log.rate,
            "slips": log.slips,
            "expected": dict(log.tells),
        }
        for log in (() if advice is None else advice.logs)
    ]


def _remedy(name: str, advice: Advice) -> str:
    """The log to add for one parameter; "" where none is known."""
    for log in advice.logs:
        if name in log.tells:
            return f"add {_said(log)}, which is expected to tell it to {math.ceil(100.0 * log.tells[name])} %"
    return ""


def _no_remedy(name: str, advice: Advice) -> str:
    """That no log would tell a parameter; "" where one might: beside a log that tells others it is too soon to say."""
    if advice.logs or name not in advice.untold:
        return ""
    return (
        f"as far as these logs tell, none of up to {three_figures(advice.longest)} s at one speed, this load and on "
        f"this rig would tell it to {100.0 * IDENTIFIED:.0f} %"
    )


def _said(log: NextLog) -> str:
    return (
        f"a log of {_whole(log.duration):.6g} s at {speed_text(log.drive_speed, 3)} and "
        f"{three_figures(log.normal_force)} N, sampled at {log.rate:.0f} Hz"
    )


def _whole(duration: float) -> float:
    """A duration [s] with two figures, rounded up."""
    step = 10.0 ** (math.floor(math.log10(duration)) - 1)
    return float(f"{math.ceil(duration / step - 1e-9) * step:.6g}")
