"""What the look at the logs, before a fit, found wrong with them that may be why it misfits."""

from __future__ import annotations

from collections.abc import Sequence

from identify.logs.prepare import Prepared

# What spoils samples, or is no part of the model, by what it explains best first; codes of the quality gate.
SPOILS = (
    "friction_clipped",
    "sensor_lag",
    "spikes",
    "dropouts",
    "jitter",
    "repeated_time",
    "normal_clipped",
    "unloaded_rows",
    "load_ripple",
    "friction_drift",
)
TOLD = 2  # of them


def seen_before(prepared: Sequence[Prepared]) -> str:
    """What the quality gate warns of in logs that take part, to go behind a sentence on a misfit; "" where nothing
    that could explain it."""
    found: dict[str, str] = {}
    for log in prepared:
        for finding in log.judgement.findings if log.left_out is None else ():
            if finding.code in SPOILS and finding.severity != "info":
                found.setdefault(finding.code, f"{log.entry.path.name}: {finding.message}")
    told = [found[code] for code in SPOILS if code in found][:TOLD]
    return f"; before the fit this was seen: {'; '.join(told)}" if told else ""


def look_swapped(prepared: Sequence[Prepared]) -> str:
    """The names of the logs in which the forces look exchanged, where no other takes part; "" where one does."""
    others = [log for log in prepared if log.left_out is None and not log.judgement.swapped]
    names = dict.fromkeys(log.entry.path.name for log in prepared if log.judgement.swapped)
    return "" if others else ", ".join(names)
