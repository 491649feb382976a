"""What a result says of one log: its classical table, its quality, and what its pair does at its speed."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from data_io.record import WINDOW_START, within
from data_io.values import Finding
from identify.base.document import Json, to_dict
from identify.base.outcome import Status
from identify.base.quantiles import NORMAL
from identify.base.result import ClassicalTable, LogResult, Number, QualityFigure, QualityResult
from identify.diagnosis.findings import Findings
from identify.logs.classical import table_of
from identify.logs.prepare import Prepared
from identify.logs.regime import Known, look
from identify.prediction.draws import OperatingPoint
from identify.prediction.predict import NoAnswer, predictions
from identify.prediction.sources import with_tied
from identify.scene.values import Tie

# ----------------------------------------------------------------------------------------------------------------------
# Stability and amplitude of the fitted pair, at the speed and load of every log and with its own parameters.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


DRAWS = 100  # of the parameters: ends of intervals are good to a tenth of their half width; the calculators take 200


def outlooks_of(prepared: list[Prepared], found: Findings, added: Array | float = 0.0) -> list[dict[str, Json]]:
    """Stability and amplitude of the fitted pair at every log's speed and load; empty where there is no answer.

    Args:
        added: (f, f) to the covariance of the free theta by errors of rig and sensors.
    """
    if found.status is not Status.CONVERGED or found.attempt is None or found.covariance is None:
        return [{} for _ in prepared]
    unknowns = found.unknowns
    free = np.flatnonzero(unknowns.free)
    names = [unknowns.names[i] for i in free]
    # of tied parameters, as far as their errors go: a factor, or none where they differ by an offset
    ties = {
        unknowns.names[i]: Tie(unknowns.names[to], factor=base if unknowns.logarithmic[i] else 1.0)
        for i, to, base in unknowns.ties
    }
    points: list[OperatingPoint | str] = []
    for number, log in enumerate(prepared):
        mine = of_log(number, log, found)
        if isinstance(mine, str):
            points.append(mine)
            continue
        theta, covariance = mine
        p = unknowns.values(theta, log.data.base)
        slope = np.where(unknowns.logarithmic, p, 1.0)[free]
        values = dict(zip(unknowns.names, p.tolist(), strict=True))
        told, covariance = with_tied(names, (covariance + added) * np.outer(slope, slope), ties)
        points.append(OperatingPoint(values, log.data.drive_speed, log.mean_load, covariance))
    told = (*names, *ties)
    if found.sure is not None and found.sure.of_groups:  # what points have in common is only shared within a pair
        answers = [
            NoAnswer(point) if isinstance(point, str) else predictions(unknowns.model, [point], told, DRAWS)[0]
            for point in points
        ]
    else:
        known = [point for point in points if not isinstance(point, str)]
        answers = predictions(unknowns.model, known, told, DRAWS)
    return [to_dict(answer) for answer in answers]


def of_log(number: int, log: Prepared, found: Findings) -> tuple[Array, Array] | str:
    """Theta (n_p,) of one log and the covariance (f, f) of its free parameters, its own group's among them; a sentence
    where the log took no part and its group has no values."""
    attempt, sure, names = found.attempt, found.sure, found.unknowns.names
    assert attempt is not None and found.covariance is not None
    free = np.flatnonzero(found.unknowns.free)
    theta, covariance = attempt.solved.theta, found.covariance.copy()
    verdicts = {e.name: e.verdict for e in found.estimates}
    if sure is not None and sure.of_groups:
        if number in attempt.log_numbers:
            theta = attempt.solved.trajectories[attempt.log_numbers.index(number)].theta(theta)
        theta, order = theta.copy(), np.arange(free.size)
        for i, index in enumerate(free.tolist()):
            if not found.unknowns.grouped[index]:
                continue
            group = log.data.groups[index] or f"log {number + 1}"
            share = next((s for s in sure.shares if (s.index, s.group) == (index, group)), None)
            if share is None:
                return f"No answer: this log took no part, and no other log tells {names[index]} of {group}."
            theta[index] = share.theta
            if share.place >= 0:
                order[i] = free.size + share.place
                verdicts[names[index]] = next(e.verdict for other, e in sure.of_groups if other == share)
        covariance = sure.joint[np.ix_(order, order)].copy()
    # What these data do not tell has no variance to carry on: the curvature at one point says nothing of it.
    open_ = np.array([verdicts.get(names[index]) == "not identifiable" for index in free.tolist()], dtype=bool)
    covariance[open_, open_] = np.inf
    return theta, covariance


def log_result(
    index: int, log: Prepared, found: Findings, answer: Mapping[str, Json], part_of: int | None
) -> LogResult:
    """One log in the result.

    Args:
        answer: what the parameters say of its stick-slip, see `outlooks_of`.
        part_of: the number (from 1) of the log of the scene that it is a part of; None where it is whole.
    """
    record, verdict, regime = log.record, log.regime_verdict, log.regime
    taken = found.attempt is not None and index in found.attempt.log_numbers
    if found.estimated is not None and found.status is Status.CONVERGED:
        taken = index not in found.left_out
    return LogResult(
        part_of=part_of,
        path=str(log.entry.path),
        sha256=str(record.metadata.get("sha256", "")),
        step=log.entry.step,
        rows=int(record.time.size),
        labels=dict(log.entry.labels),
        noise_N=float(log.rig.noise or log.segmentation.noise),
        friction_sign=log.sign,
        regime=None if regime is None else regime.value,
        confidence=None if verdict is None else verdict.confidence,
        evidence=() if verdict is None else tuple(verdict.evidence),
        slip_count=int(log.segmentation.count),
        normal_force_N=log.mean_load,
        drive_speed_m_per_s=log.data.drive_speed,
        window_s=(log.data.begin, log.data.end),
        reason_left_out=None if taken else found.left_out.get(index, "no fit was made"),
        classical=_classical(log),
        quality=_quality(log),
        corrections=log.account.changes,
        cuts=log.account.cuts,
        derived=answer,
    )


def _classical(log: Prepared) -> ClassicalTable:
    """The classical table of what the window of the scene leaves of a log."""
    record, window = log.record, log.entry.window
    begin = float(record.metadata.get(WINDOW_START, 0.0))  # of a log that was read in part
    record = within(record, window and (begin + window[0], begin + window[1]))
    seen = look(record, log.data.drive_speed, Known(log.rig.stiffness), found=log.segmentation)
    return table_of(record, seen, log.rig.stiffness)


def _quality(log: Prepared) -> QualityResult:
    seen, told = log.segmentation, log.judgement.result()
    drop, period, slope = seen.drop_mean_and_sd, seen.period_mean_and_sd, seen.stick_slope
    figures = {
        "noise": QualityFigure(float(seen.noise), "N"),
        "samples_per_slip": QualityFigure(seen.samples_per_slip),
        "samples_per_cycle": QualityFigure(seen.samples_per_cycle),
        "masked_samples": QualityFigure(seen.spike_count),
        "drop": QualityFigure(drop[0] if drop else None, "N"),
        "drop_scatter": QualityFigure(drop[1] if drop else None, "N"),
        "period": QualityFigure(period[0] if period else None, "s"),
        "period_scatter": QualityFigure(period[1] if period else None, "s"),
        "stick_slope": QualityFigure(slope[0] if slope else None, "N/s"),
    }
    findings, verdict = list(told.findings), told.verdict
    if log.hidden_swing:
        findings.append(Finding("load_varies", "warning", load_varies(log)))
        verdict = "accept with warnings" if verdict == "accept" else verdict
    if log.data.loose > 0.0:
        findings.append(Finding("load_trembles", "info", load_trembles(log)))
    return QualityResult(verdict, tuple(findings), {**told.figures, **figures})


def load_varies(log: Prepared) -> str:
    """What to do where the normal force swings and the fit takes its mean."""
    return (
        f"the normal force varies by ±{100 * log.hidden_swing:.2g} % beyond its noise, and the fit takes its mean; "
        'add "varying_normal_force" to effects'
    )


def load_trembles(log: Prepared) -> str:
    """How a normal force that jitters counts in the fit, and what would help."""
    return (
        f"the normal force trembles by {1e3 * log.data.loose:.2g} mN (standard deviation) from slip to slip: at the "
        "onset of a slip it is counted as unknown; for narrower intervals drive faster, measure the normal force with "
        "less noise, or cut the log to where the load is steadier (window)"
    )


# ----------------------------------------------------------------------------------------------------------------------
# The creep velocity D/t_cr of every pair of a fit, below which the contact ages while it slides.
# ----------------------------------------------------------------------------------------------------------------------

VALIDITY = "creep velocity D/t_cr (eq. 2): the contact stays fresh while it slides faster"


def creep_velocities(prepared: list[Prepared], found: Findings) -> dict[str, Number]:
    """ "v_cr" of the first group and "v_cr (V08)" of the others, as numbers of the result; empty without one."""
    unknowns, names = found.unknowns, found.unknowns.names
    if found.attempt is None or found.covariance is None or not {"D", "t_cr"} <= set(names):
        return {}
    free, places = np.flatnonzero(unknowns.free), [names.index("D"), names.index("t_cr")]
    sources = [int(unknowns.source[place]) for place in places]
    out: dict[str, Number] = {}
    seen = set()
    for number in found.attempt.log_numbers:
        log = prepared[number]
        own = [log.data.groups[i] or f"log {number + 1}" for i in sources if unknowns.grouped[i]]
        group = ", ".join(dict.fromkeys(own))
        if group in seen:
            continue
        seen.add(group)
        known = of_log(number, log, found)
        assert not isinstance(known, str), "a log that took part has values"
        theta, covariance = known
        p = unknowns.values(theta, log.data.base)
        value = float(p[places[0]] / p[places[1]])
        slope = (free == sources[0]).astype(float) - (free == sources[1])
        moved = slope != 0.0
        variance = covariance[np.ix_(moved, moved)]
        if np.all(np.isfinite(variance)):
            half = NORMAL * math.sqrt(float(slope[moved] @ variance @ slope[moved]))
            interval = (value * math.exp(-half), value * math.exp(half) if half < 700.0 else None)
            result = Number(value, "m/s", interval, VALIDITY, group=group)
        else:
            reason = "interval open: these data do not determine D or t_cr"
            result = Number(value, "m/s", (None, None), VALIDITY, reason, group=group)
        out[f"v_cr ({group})" if out else "v_cr"] = result
    return out
