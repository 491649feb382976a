"""What a result and its report hold of one log: classical table, quality, what its pair does at its speed, curves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_io.record import WINDOW_START, within
from data_io.values import Finding
from identify.base.document import Json, to_dict
from identify.base.result import LogCurves, LogResult, QualityResult, Status
from identify.diagnosis.findings import Findings
from identify.estimation.preview import detected_curves
from identify.logs.classical import table_of
from identify.logs.prepare import Prepared
from identify.logs.regime import Known, look
from identify.logs.unknowns import Unknowns
from identify.prediction.axes import Site
from identify.prediction.predict import NoAnswer, predictions
from identify.shooting import batch
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]


DRAWS = 100  # of the parameters: ends of intervals are good to a tenth of their half width; the calculators take 200


def answers_of_logs(prepared: list[Prepared], findings: Findings, added: Array | float = 0.0) -> list[dict[str, Json]]:
    """Stability and amplitude of the fitted pair at every log's speed and load; empty where there is no answer.

    Args:
        added: (f, f) to the covariance of the free theta by errors of rig and sensors.
    """
    if findings.status is not Status.CONVERGED or findings.attempt is None or findings.covariance is None:
        return [{} for _ in prepared]
    unknowns = findings.unknowns
    free = np.flatnonzero(unknowns.free)
    names = [unknowns.names[i] for i in free]
    points: list[Site | NoAnswer] = []
    for number, log in enumerate(prepared):
        own = of_log(number, log, findings)
        if isinstance(own, str):
            points.append(NoAnswer(own))
            continue
        p = unknowns.values(own[0], log.data.base)
        slope = np.where(unknowns.logarithmic, p, 1.0)[free]
        covariance = (own[1] + added) * np.outer(slope, slope)
        values = dict(zip(unknowns.names, p.tolist(), strict=True))
        speed, load = log.data.drive_speed, log.mean_load
        points.append(Site(unknowns.model, values, speed, load, covariance=covariance, names=tuple(names)))
    answers = iter(predictions([point for point in points if isinstance(point, Site)], DRAWS))
    return [to_dict(point if isinstance(point, NoAnswer) else next(answers)) for point in points]


def of_log(number: int, log: Prepared, findings: Findings) -> tuple[Array, Array] | str:
    """Theta (n_p,) of one log and the covariance (f, f) of its free parameters, its own group's among them; a sentence
    where the log took no part and its group has no values."""
    attempt, sure, names = findings.attempt, findings.sure, findings.unknowns.names
    assert attempt is not None and findings.covariance is not None
    free = np.flatnonzero(findings.unknowns.free)
    theta, covariance = attempt.solved.theta, findings.covariance.copy()
    verdicts = {e.name: e.verdict for e in findings.estimates}
    if sure is not None and sure.of_groups:
        if number in attempt.log_numbers:
            theta = attempt.solved.trajectories[attempt.log_numbers.index(number)].theta(theta)
        theta, order = theta.copy(), np.arange(free.size)
        for i, index in enumerate(free.tolist()):
            if not findings.unknowns.grouped[index]:
                continue
            group = log.data.groups[index] or f"log {number + 1}"
            share = next((s for s in sure.shares if (s.index, s.group) == (index, group)), None)
            if share is None:
                return f"No answer: this log was left out, and no other log determines {names[index]} of {group}."
            theta[index] = share.theta
            if share.place >= 0:
                order[i] = free.size + share.place
                verdicts[names[index]] = next(e.verdict for other, e in sure.of_groups if other == share)
        covariance = sure.allowed.joint[np.ix_(order, order)].copy()
    # What is not identifiable has no variance to carry on: the curvature at one point says nothing of it.
    open_ = np.array([verdicts.get(names[index]) == "not identifiable" for index in free.tolist()], dtype=bool)
    covariance[open_, open_] = np.inf
    return theta, covariance


def log_result(
    index: int, log: Prepared, identified: Findings, answer: Mapping[str, Json], part_of: int | None
) -> LogResult:
    """One log in the result.

    Args:
        answer: what the parameters say of its stick-slip, see `answers_of_logs`.
        part_of: the number (from 1) of the log of the scene that it is a part of; None where it is whole.
    """
    record, verdict, window = log.record, log.regime_verdict, log.entry.window
    taken = identified.attempt is not None and index in identified.attempt.log_numbers
    if identified.estimated is not None and identified.status is Status.CONVERGED:
        taken = index not in identified.left_out
    begin = float(record.metadata.get(WINDOW_START, 0.0))  # of a log that was read in part
    # the classical table is of what the window of the scene leaves
    record = within(record, window and (begin + window[0], begin + window[1]))
    speed = log.data.drive_speed
    seen = look(record, speed, Known(log.rig.stiffness, plate=log.rig.plate), phases=log.segmentation)
    return LogResult(
        part_of=part_of,
        path=str(log.entry.path),
        sha256=str(log.record.metadata.get("sha256", "")),
        step=log.entry.step,
        rows=int(log.record.time.size),
        labels=dict(log.entry.labels),
        noise_N=float(log.rig.noise or log.segmentation.noise),
        friction_sign=log.sign,
        regime=None if log.regime is None else log.regime.value,
        confidence=None if verdict is None else verdict.confidence,
        evidence=() if verdict is None else tuple(verdict.evidence),
        slip_count=int(log.segmentation.count),
        normal_force_N=log.mean_load,
        drive_speed_m_per_s=speed,
        window_s=(log.data.begin, log.data.end),
        reason_left_out=None if taken else identified.left_out.get(index, "no fit was made"),
        classical=table_of(record, seen, log.rig.stiffness),
        quality=_quality(log),
        corrections=log.account.changes,
        derived=answer,
    )


def _quality(log: Prepared) -> QualityResult:
    """The verdict of the quality gate, and what a load that swings means for the fit."""
    judged = log.judgement.result()
    findings, verdict = list(judged.findings), judged.verdict
    if log.hidden_swing:
        verdict = "accept with warnings" if verdict == "accept" else verdict
        sentence = (
            f"the normal force varies by ±{100 * log.hidden_swing:.2g} % beyond its noise, and the fit takes its mean; "
            'add "varying_normal_force" to effects'
        )
        findings.append(Finding("load_varies", "warning", sentence))
    return replace(judged, verdict=verdict, findings=tuple(findings))


def fitted_curves(
    log: Prepared, unknowns: Unknowns, theta: Array, trajectory: ShootingTrajectory, fitted: Array, z: Array
) -> LogCurves:
    """Curves of a log that was fitted.

    Args:
        theta: (n_p,) solution; trajectory: the motion moved to it; fitted (n,) force at the samples, NaN outside;
            z (c,) misfit of each cycle in standard deviations.
    """
    p = unknowns.values(trajectory.theta(theta), log.data.base)
    forces = np.empty((2, trajectory.cycles))  # what the load cell shows at onsets and arrests [N]
    ends = (trajectory.ending("onset"), trajectory.ending("arrest")) if trajectory.cycles else ()
    for row, which in enumerate(ends):
        times, states = trajectory.until[which], trajectory.at_end(which)
        one = np.ones(times.size)
        speeds = np.array([log.data.speed_at(t) for t in times.tolist()])
        u = np.column_stack([speeds, log.data.normal_force.at(times), one, times])
        forces[row] = batch.load_cell(unknowns.model, states, np.tile(p, (times.size, 1)), u)
    return replace(
        detected_curves(log),
        fitted_force=np.where(log.used, fitted, np.nan),
        used=log.used & np.isfinite(fitted),
        noise=log.data.noise,
        cycles=np.column_stack([trajectory.onset, trajectory.arrest, *forces, z[: trajectory.cycles]]),
    )


def refused_curves(log: Prepared, fitted: LogCurves) -> LogCurves:
    """Curves of a fit that was refused: cycles as they were measured, for how they scatter is what the reader is sent
    to; the misfit of each where there are as many as were fitted."""
    cycles = detected_curves(log).cycles
    if cycles.shape == fitted.cycles.shape:
        cycles[:, -1] = fitted.cycles[:, -1]
    return replace(fitted, cycles=cycles)
