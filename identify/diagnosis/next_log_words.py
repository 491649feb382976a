"""The logs that would tell, in words beside the verdicts, and in the result document."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from identify.base.wording import speed_text, three_figures
from identify.diagnosis.findings import Findings
from identify.diagnosis.next_log import Advice, NextLog
from identify.estimation.hints import hints
from identify.estimation.uncertainty import IDENTIFIED, Estimate


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
