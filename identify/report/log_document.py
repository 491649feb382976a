"""What a result says of one log: where it is, its classical table, its quality."""

from __future__ import annotations

from typing import Any

from data_io import Record
from data_io.record import WINDOW_START, within
from identify.base.outcome import Status
from identify.diagnosis.findings import Findings
from identify.logs.classical import classical_table
from identify.logs.prepare import Prepared


def log_document(
    index: int, log: Prepared, found: Findings, answer: dict[str, Any], part_of: int | None
) -> dict[str, Any]:
    """One log in the result.

    Args:
        answer: what the parameters say of its stick-slip, see `log_outlook`.
        part_of: the number (from 1) of the log of the scene that it is a part of; None where it is whole.
    """
    record = log.record
    taken = found.attempt is not None and index in found.attempt.logs
    if found.estimated is not None and found.status is Status.CONVERGED:
        taken = index not in found.left_out
    table = classical_table(
        _looked_at(log), log.segmentation, drive_speed=log.data.drive_speed, stiffness=log.rig.stiffness
    )
    load = log.mean_load
    return {
        **({} if part_of is None else {"part_of": part_of}),
        "path": str(log.entry.path),
        "sha256": str(record.metadata.get("sha256", "")),
        "step": log.entry.step,
        "rows": int(record.time.size),
        "labels": dict(log.entry.labels),
        "noise_N": float(log.rig.noise or log.segmentation.noise),
        "friction_sign": log.sign,
        **_regime(log),
        "slip_count": int(log.segmentation.count),
        "normal_force_N": load,
        "drive_speed_m_per_s": log.data.drive_speed,
        "window_s": [log.data.begin, log.data.end],
        "reason_left_out": None if taken else found.left_out.get(index, "no fit was made"),
        "classical": table,
        "quality": _quality(log),
        **log.account.document(),
        "derived": answer,
    }


def _regime(log: Prepared) -> dict[str, Any]:
    """What the log shows, as `inspect` says it."""
    verdict, regime = log.verdict, log.regime
    return {
        "regime": None if regime is None else regime.value,
        "confidence": None if verdict is None else verdict.confidence,
        "evidence": [] if verdict is None else list(verdict.evidence),
    }


def _looked_at(log: Prepared) -> Record:
    """The record of which the classical table is made: what the window of the scene leaves."""
    record, window = log.record, log.entry.window
    if window is None:
        return record
    begin = float(record.metadata.get(WINDOW_START, 0.0))  # of a log that was read in part
    return within(record, (begin + window[0], begin + window[1]))


def _quality(log: Prepared) -> dict[str, Any]:
    seen = log.segmentation
    drop, period, slope = seen.drop, seen.period, seen.stick_slope
    figures = {
        "noise": {"value": float(seen.noise), "unit": "N"},
        "samples_per_slip": {"value": seen.samples_per_slip, "unit": ""},
        "samples_per_cycle": {"value": seen.samples_per_cycle, "unit": ""},
        "masked_samples": {"value": seen.spike_count, "unit": ""},
        "drop": {"value": drop[0] if drop else None, "unit": "N"},
        "drop_scatter": {"value": drop[1] if drop else None, "unit": "N"},
        "period": {"value": period[0] if period else None, "unit": "s"},
        "period_scatter": {"value": period[1] if period else None, "unit": "s"},
        "stick_slope": {"value": slope[0] if slope else None, "unit": "N/s"},
    }
    told = log.judgement.document()
    findings = list(told["findings"])
    verdict = told["verdict"]
    if log.hidden_swing:
        findings.append({"code": "load_varies", "severity": "warning", "message": load_varies(log)})
        verdict = "accept with warnings" if verdict == "accept" else verdict
    if log.data.calm or log.data.loose > 0.0:
        findings.append({"code": "load_trembles", "severity": "info", "message": load_trembles(log)})
    return {"verdict": verdict, "findings": findings, "figures": {**told["figures"], **figures}}


def load_varies(log: Prepared) -> str:
    """What to do where the normal force swings and the fit takes its mean."""
    return (
        f"the normal force varies by ±{100 * log.hidden_swing:.2g} % beyond its noise, and the fit takes its mean; "
        'add "varying_normal_force" to effects'
    )


def load_trembles(log: Prepared) -> str:
    """What a tremor of the normal force does to the fit, and what would help."""
    size = 1e3 * (log.data.tremor_sd if log.data.calm else log.data.loose)
    told, remedy = _untold_tremor(log)
    return (
        f"the normal force trembles by {size:.2g} mN (standard deviation), {told} from slip to slip; "
        f"for more certainty {remedy}, or let the hand rest"
    )


def _untold_tremor(log: Prepared) -> tuple[str, str]:
    """Why a tremor counts as unknown, and what would help."""
    if log.data.blurred:
        return "seen too badly to be followed: it is counted as unknown", "measure the normal force with less noise"
    if log.data.calm:
        return (
            "and no motion was found that follows it: it is counted as unknown",
            "cut the log to where the load is calmer (window), drive faster",
        )
    return "faster than the drive pulls: at the onset of a slip it is counted as unknown", "drive faster"
