"""What a result and its report hold of one log: classical table, quality, what its pair does at its speed, curves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_io.record import WINDOW_START, within
from data_io.values import Finding
from identify.base.document import to_dict
from identify.base.result import LogCurves, LogResult, QualityResult, Result, Status
from identify.diagnosis.findings import Findings
from identify.logs.classical import table_of
from identify.logs.prepare import Prepared
from identify.logs.regime import Known, look
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS
from identify.prediction.axes import Site
from identify.prediction.predict import NoAnswer, predictions
from identify.prediction.sources import pair_of
from identify.shooting import batch
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]


DRAWS = 100  # of the parameters: ends of intervals are good to a tenth of their half width; the calculators take 200


def with_answers(result: Result, prepared: list[Prepared], findings: Findings) -> Result:
    """The result with stability and amplitude of the fitted pair at every log's speed and load, as the calculators say
    it of a stored result."""
    unknowns, attempt = findings.unknowns, findings.attempt
    assert attempt is not None
    pairs, sites = [pair_of(result, number) for number in range(len(prepared))], []
    for number, (log, pair) in enumerate(zip(prepared, pairs, strict=True)):
        theta = attempt.solved.theta
        if number in attempt.log_numbers:
            theta = attempt.solved.trajectories[attempt.log_numbers.index(number)].theta(theta)
        own = dict(zip(unknowns.names, unknowns.values(theta, log.data.base).tolist(), strict=True))  # on its own rig
        scale = np.array([own[n] / pair.values[n] if n in RIG_PARAMETERS else 1.0 for n in pair.names])
        covariance = None if pair.covariance is None else pair.covariance * np.outer(scale, scale)
        values = own | {name: value for name, value in pair.values.items() if name not in RIG_PARAMETERS}
        point = log.data.drive_speed, log.mean_load
        sites.append(Site(unknowns.model, values, *point, covariance=covariance, names=pair.names))
    known = iter(predictions([site for site, pair in zip(sites, pairs, strict=True) if not pair.refusal], DRAWS))
    answers = [NoAnswer(f"No answer: {pair.refusal}.") if pair.refusal else next(known) for pair in pairs]
    told = zip(result.logs, answers, strict=True)
    return replace(result, logs=tuple(replace(log, derived=to_dict(answer)) for log, answer in told))


def log_result(index: int, log: Prepared, identified: Findings, part_of: int | None) -> LogResult:
    """One log in the result, but for what the parameters say of it.

    Args:
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
        log.curves,
        fitted_force=np.where(log.used, fitted, np.nan),
        used=log.used & np.isfinite(fitted),
        noise=log.data.noise,
        cycles=np.column_stack([trajectory.onset, trajectory.arrest, *forces, z[: trajectory.cycles]]),
    )


def refused_curves(log: Prepared, fitted: LogCurves) -> LogCurves:
    """Curves of a fit that was refused: cycles as they were measured, for how they scatter is what the reader is sent
    to; the misfit of each where there are as many as were fitted."""
    cycles = log.curves.cycles
    if cycles.shape == fitted.cycles.shape:
        cycles[:, -1] = fitted.cycles[:, -1]
    return replace(fitted, cycles=cycles)
