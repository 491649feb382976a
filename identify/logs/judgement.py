"""The verdict on a log: accept, accept with warnings, or reject, with the reasons; from clock, forces and slips."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.quality import Quality, Verdict, assess, verdict_of
from data_io.thresholds import DEFAULTS, Thresholds
from data_io.values import Finding
from identify.logs.slip_quality import Part, SlipQuality, look_at_slips
from identify.logs.suspicions import suspicions
from identify.logs.told_drive import speed_of

FORCES_SWAPPED = "forces_swapped"
NO_ZERO = "residual_force"  # no zero error of a sensor, where its column holds another force


@dataclass(frozen=True)
class Judgement:
    """What the gate found: of the record, of the slips of every part, and everything that is to say, worst first.

    Before all comes that two columns look swapped: the other doubts come of it.
    """

    quality: Quality
    slips: tuple[SlipQuality, ...]
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> Verdict:
        """The worst finding decides."""
        return verdict_of(self.findings)

    @property
    def reason(self) -> str:
        """Why it is rejected: the first sentence that says so, "" where it is not."""
        return next((f.message for f in self.findings if f.severity == "reject"), "")

    @property
    def swapped(self) -> bool:
        """Whether normal force and friction force look exchanged."""
        return any(f.code == FORCES_SWAPPED for f in self.findings)

    @property
    def ends_loading(self) -> bool:
        """Whether the log was stopped before its first slip."""
        return any(part.loading for part in self.slips)

    def document(self) -> dict[str, Any]:
        """Verdict, findings and figures as plain values, SI."""
        lag = next((s.lag for s in self.slips if s.lag is not None), None)
        figures = {name: {"value": value, "unit": unit} for name, (value, unit) in self.quality.figures.items()}
        figures["spikes"] = {"value": sum(s.spikes for s in self.slips), "unit": ""}
        figures["sensor_lag"] = {"value": None if lag is None else lag.lag, "unit": "s"}
        for name, values in (
            ("stick_slope_error", [s.slope for s in self.slips]),
            ("friction_drift", [s.drift for s in self.slips]),
            ("uneven_cycles", [s.scatter for s in self.slips]),
            ("harmonic", [s.harmonic for s in self.slips]),
        ):
            figures[name] = {"value": next((value for value in values if value is not None), None), "unit": ""}
        findings = [asdict(finding) for finding in self.findings]
        return {"verdict": self.verdict, "findings": findings, "figures": figures}


def judge(
    record: Record,
    parts: Sequence[Part],
    thresholds: Thresholds = DEFAULTS,
    used: NDArray[np.bool_] | None = None,
) -> Judgement:
    """Judge a log.

    Args:
        record: as it was read, or as the scene has corrected it.
        parts: its steps with their phases, or the one part that the scene leaves of it.
        thresholds: where warnings and rejections begin.
        used: (n,) the rows that count (None: all).
    """
    quality = assess(record, used, thresholds, speed_of(record))
    slips = tuple(look_at_slips(part, thresholds) for part in parts)
    doubts = suspicions(record, [part.found for part in parts], thresholds)
    findings = dict.fromkeys((*quality.findings, *(f for s in slips for f in s.findings), *doubts))
    return Judgement(quality, slips, _in_order(findings))


def _in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Worst first; where two columns look swapped, that before all, and no advice to zero a sensor by the wrong one."""
    order = {"reject": 0, "warning": 1, "info": 2}
    listed = sorted(findings, key=lambda finding: order[finding.severity])
    swap = [finding for finding in listed if finding.code == FORCES_SWAPPED]
    if not swap:
        return tuple(listed)
    return (*swap, *(f for f in listed if f.code not in (FORCES_SWAPPED, NO_ZERO)))
