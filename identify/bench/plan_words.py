"""A plan in the words of a laboratory, as a table of steps to type into a script, and as a document."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.wording import columns, speed_text, three_figures, wrapped
from identify.bench.design import SETUP, PlannedLog, promised
from identify.bench.plan import RecordingPlan
from identify.estimation.covariance import IDENTIFIED, WEAK
from identify.prediction.wording import listed

Array = NDArray[np.float64]

TABLE = "log,drive_speed_mm_per_s,duration_s,normal_force_N,sampling_rate_Hz,stiffness_N_per_m"
NOISE_ALONE = "these are intervals of noise alone; errors of the sensors, and of what is taken as exact of the rig, add"
WITH_TOLERANCES = (
    "the intervals include the errors of rig and sensors, which no log lowers, and a usual scatter of specimens where "
    "each speed stands in one log, which a repeat measures"
)
REPEAT = (
    "every drive speed stands in one log only, so that a difference between specimens counts as one of speed: repeat "
    "one speed, or state specimen = 0 under [tolerances] where all logs are of one specimen"
)


def shown_half(halves: Array) -> str:
    """Half lengths (d,) as "± 8 %", or "± 5 to 20 %" where they differ from place to place; two digits."""
    ends = (float(np.min(halves)), float(np.max(halves)))
    low, high = ("" if not end <= WEAK - 1.0 else f"{float(f'{100.0 * end:.2g}'):.15g}" for end in ends)
    if low == high:
        return f"± {low} %" if low else "open"
    return f"± {low} to {high} %" if high else f"± {low} % to open"


def verdict(half: float) -> str:
    """What a fit is expected to call a parameter whose interval has this half length."""
    return "identified" if half <= IDENTIFIED else "weak" if half <= WEAK - 1.0 else "not identifiable"


def described(log: PlannedLog) -> str:
    """A log in lab words."""
    design = log.design
    spring = "" if design.stiffness is None else f" on the spring of {three_figures(design.stiffness)} N/m"
    at = f"{speed_text(design.speed, 3)}, {three_figures(design.normal_force)} N{spring}, at {log.rate:.0f} Hz"
    again = ": a repeat with another specimen" * log.repeats
    return f"a log of {seconds_text(log.duration)} at {at} ({log.slips} slips){again}"


def seconds_text(seconds: float) -> str:
    """A duration, rounded up to what one would set."""
    return f"{math.ceil(seconds / 60.0)} min" if seconds > 180.0 else f"{two_figures(max(seconds, 0.1)):.3g} s"


def two_figures(seconds: float) -> float:
    """A duration [s] with two figures, rounded up."""
    step = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return float(f"{math.ceil(seconds / step - 1e-9) * step:.6g}")


def plan_text(plan: RecordingPlan, source: str = "") -> str:
    """The whole plan for a terminal; its first line says what it is of (`source`) and where the values come from."""
    known, now, then = plan.knowledge, promised(plan.now), promised(plan.then)
    if plan.logs:
        moved = [
            f"{known.names[i]} {shown_half(plan.now[:, i])} → {shown_half(plan.then[:, i])}"
            for i in known.targeted
            if then[i] < 0.8 * now[i]
        ]
        these = "this log" if len(plan.logs) == 1 else f"these {len(plan.logs)} logs"
        minutes = f"{math.ceil(_seconds(plan) / 60.0)} minutes, {SETUP / 60.0:.0f} for setting up each log included"
        summary = f"add {these}: {'; '.join(filter(None, [', '.join(moved), minutes]))}"
    elif all(then[i] <= IDENTIFIED for i in known.targeted):
        summary = "nothing to add: every target is identified already"
    else:
        summary = "no log among those that were tried, and within the budget, is expected to identify more; see below"
    rows = [["", "now", *(f"with {number}" for number in range(1, len(plan.logs) + 1)), "the fit will call it"]]
    for i, name in enumerate(known.names):
        cells = [shown_half(halves[:, i]) for halves in (plan.now, *(log.halves for log in plan.logs))]
        rows.append([name, *cells, verdict(float(then[i]))])
    lines = [wrapped(" ".join(filter(None, (source, plan.origins.text))), "", ""), wrapped(summary)]
    lines += [wrapped(f"{number}. {described(log)}", "  ") for number, log in enumerate(plan.logs, 1)]
    lines += [wrapped(REPEAT)] if any(log.repeats for log in plan.logs) else []
    lines += ["", columns(rows), wrapped(WITH_TOLERANCES if known.systematic.any() else NOISE_ALONE)]
    if any("to" in cell for row in rows[1:] for cell in row[1:-1]):
        lines.append(wrapped("ranges are over the values that the parameters may have"))
    open_ = [known.names[i] for i in known.targeted if then[i] > IDENTIFIED]
    if open_:
        lines.append(
            wrapped(
                f"{listed(open_)}: no set of logs within the budget, at the speeds, loads and springs that were tried, "
                f"identifies more; allow a longer --budget, or another --load or --stiffness"
            )
        )
    return "\n".join(lines)


def _seconds(plan: RecordingPlan) -> float:
    """That all logs take, setting each up included [s]."""
    return sum(log.duration + SETUP for log in plan.logs)


def step_table(plan: RecordingPlan) -> str:
    """The step programme, one row per log, as CSV in the units of a CETR script."""
    rows = [TABLE]
    for number, log in enumerate(plan.logs, 1):
        spring = "" if log.design.stiffness is None else f"{log.design.stiffness:.6g}"
        load, drive = f"{log.design.normal_force:.6g}", f"{1e3 * log.design.speed:.6g},{log.duration:.4g}"
        rows.append(f"{number},{drive},{load},{log.rate:.0f},{spring}")
    return "\n".join([*rows, ""])


def plan_document(plan: RecordingPlan) -> dict[str, Any]:
    """What --json prints, SI; half lengths as shares of what each parameter is judged by, null where they are open."""
    names, origins = plan.knowledge.names, plan.origins

    def by_name(halves: Array) -> dict[str, float | None]:
        return {n: h if math.isfinite(h) and h < 1e6 else None for n, h in zip(names, halves.tolist(), strict=True)}

    def ranges(halves: Array) -> dict[str, list[float | None]]:
        low, high = by_name(np.min(halves, axis=0)), by_name(np.max(halves, axis=0))
        return {name: [low[name], high[name]] for name in names}

    return {
        "measured": list(origins.measured),
        "stated": list(origins.stated),
        "assumed": list(origins.assumed),
        "now": by_name(promised(plan.now)),
        "then": by_name(promised(plan.then)),
        "ranges": {"now": ranges(plan.now), "then": ranges(plan.then)},
        "verdicts": {n: verdict(float(h)) for n, h in zip(names, promised(plan.then), strict=True)},
        "seconds": _seconds(plan),
        "logs": [
            {
                "words": described(log),
                "drive": log.design.speed,
                "normal_force": log.design.normal_force,
                "stiffness": log.design.stiffness,
                "duration": log.duration,
                "sampling_rate": log.rate,
                "slips": log.slips,
                "repeats": log.repeats,
                "expected": by_name(promised(log.halves)),
            }
            for log in plan.logs
        ],
    }
