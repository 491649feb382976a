"""A plan in the words of a laboratory, as a table of steps to type into a script, and as a document."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from typing import Any

from identify.base.wording import columns, speed_text, three_figures, wrapped
from identify.bench.designs import PlannedLog
from identify.bench.plan import SETUP, WRONG, RecordingPlan
from identify.estimation.covariance import IDENTIFIED, WEAK
from identify.prediction.wording import listed

TABLE = (
    "log",
    "step",
    "drive_speed_mm_per_s",
    "duration_s",
    "normal_force_N",
    "sampling_rate_Hz",
    "stiffness_N_per_m",
    "what",
)
NOISE_ALONE = (
    "these are intervals of noise alone, as the first ones of a fit; errors of sensors, and of what is taken as exact "
    "of the rig, come on top (its second ones)"
)
RIG_WORDS = {
    "mass": "the mass",
    "stiffness": "the stiffness",
    "damping": "the damping",
    "drive_speed": "the drive speed",
}


def shown_half(half: float) -> str:
    """A half length as "± 8 %", or that it is not told."""
    if not math.isfinite(half) or half > WEAK - 1.0:
        return "not told"
    return f"± {_percent(half)}"


def _percent(share: float) -> str:
    """Two digits of a share, without a power of ten."""
    return f"{float(f'{100.0 * share:.2g}'):.15g} %"


def verdict(half: float) -> str:
    """What a fit is expected to call a parameter whose interval has this half length."""
    return "identified" if half <= IDENTIFIED else "weak" if half <= WEAK - 1.0 else "not identifiable"


def described(log: PlannedLog) -> str:
    """A log in lab words."""
    design = log.design
    spring = "" if design.stiffness is None else f" on the spring of {three_figures(design.stiffness)} N/m"
    load = f"{three_figures(design.normal_force)} N{spring}"
    if design.holds:
        holds = listed([f"{hold:.4g}" for hold in design.holds])
        again = f", {log.times} times over" if log.times > 1 else ""
        runs = f"holds of {holds} s between runs at {speed_text(design.speed, 3)}{again}"
        return f"{runs}, {seconds_text(log.duration)} in all, {load}, at {log.rate:.0f} Hz"
    at = f"{speed_text(design.speed, 3)}, {load}, at {log.rate:.0f} Hz"
    return f"a log of {seconds_text(log.duration)} at {at} ({log.slips} slips)"


def seconds_text(seconds: float) -> str:
    """A duration, rounded up to what one would set."""
    if seconds > 180.0:
        return f"{math.ceil(seconds / 60.0)} min"
    step = 10.0 ** (math.floor(math.log10(max(seconds, 0.1))) - 1)
    return f"{math.ceil(seconds / step - 1e-9) * step:.3g} s"


def said(plan: RecordingPlan) -> str:
    """The whole plan for a terminal."""
    lines = [wrapped(_sentence(plan))]
    lines += [wrapped(f"{number}. {described(log)}", "  ") for number, log in enumerate(plan.logs, 1)]
    lines += ["", columns(_rows(plan)), wrapped(NOISE_ALONE)]
    open_ = [name for name, half in _asked(plan) if half > IDENTIFIED]
    if open_:
        lines.append(wrapped(_open_words(plan, open_)))
    return "\n".join([*lines, *_price_lines(plan)])


def _sentence(plan: RecordingPlan) -> str:
    if not plan.logs:
        told = all(half <= IDENTIFIED for _, half in _asked(plan))
        return (
            "nothing to add: what is at hand tells everything that is asked for"
            if told
            else "no log among those that were tried, and within the budget, is expected to tell more; see below"
        )
    now = dict(zip(plan.knowledge.names, plan.now, strict=True))
    moved = [
        f"{name} {shown_half(now[name])} → {shown_half(half)}" for name, half in _asked(plan) if half < 0.8 * now[name]
    ]
    one = len(plan.logs) == 1
    return f"add {'this log' if one else f'these {len(plan.logs)} logs'}: {', '.join(moved)}; {_minutes(plan.seconds)}"


def _minutes(seconds: float) -> str:
    return f"{math.ceil(seconds / 60.0)} minutes, {SETUP / 60.0:.0f} for setting up each log included"


def _asked(plan: RecordingPlan) -> list[tuple[str, float]]:
    k = plan.knowledge
    return [(k.names[i], float(plan.then[i])) for i in k.wanted]


def _rows(plan: RecordingPlan) -> list[list[str]]:
    """Parameter, interval now, after each log, expected verdict; the drop at the end."""
    names, steps = plan.knowledge.names, [plan.now, *(log.halves for log in plan.logs)]
    heads = ["", "now", *(f"with {number}" for number in range(1, len(plan.logs) + 1)), "the fit will call it"]
    rows = [heads]
    for i, name in enumerate(names):
        rows.append([name, *(shown_half(float(halves[i])) for halves in steps), verdict(float(plan.then[i]))])
    if math.isfinite(plan.drop_then):
        drop = [
            shown_half(plan.drop_now),
            *[""] * max(len(plan.logs) - 1, 0),
            *([shown_half(plan.drop_then)] * bool(plan.logs)),
        ]
        rows.append([f"drop at {speed_text(plan.drop_speed, 3)}", *drop, ""])
    return rows


def _open_words(plan: RecordingPlan, names: Sequence[str]) -> str:
    return (
        f"{listed(list(names))} stays open: no set of logs within the budget, at the speeds, loads and springs that "
        "were tried, tells more; allow a longer --budget, or another --load or --stiffness"
    )


def _price_lines(plan: RecordingPlan) -> list[str]:
    """The table of what a wrong rig does, and whether a record of the rig is worth making first."""
    if not plan.price:
        return []
    wanted = plan.knowledge.wanted
    rows = [[f"{100 * WRONG:.0f} % off in", *(plan.knowledge.names[i] for i in wanted)]]
    for name, shift in plan.price.items():
        rows.append([RIG_WORDS[name], *(_moved(float(shift[i])) for i in wanted)])
    lines = [
        "",
        wrapped("the price of a wrong rig, taken as exact, by how much it moves each parameter:"),
        columns(rows),
    ]
    # What is stated with a tolerance is part of the intervals already.
    exact = [name for name in plan.price if name not in plan.tolerances]
    if not exact:
        return [*lines, wrapped("the intervals above hold what the scene states to be uncertain of the rig")]
    worst = max(exact, key=lambda name: max(float(plan.price[name][i]) for i in wanted))
    most = max(wanted, key=lambda i: float(plan.price[worst][i]))
    moves, half = float(plan.price[worst][most]), float(plan.then[most])
    moved = f"moves {plan.knowledge.names[most]} by {_moved(moves)}"
    if moves > max(half, IDENTIFIED):
        remedy = "time a stroke of known length" if worst == "drive_speed" else "make the records of docs/measuring.md"
        words = (
            f"measure {RIG_WORDS[worst]} first: 5 % of it {moved}, which the logs tell to {shown_half(half)}; {remedy}"
        )
        return [*lines, wrapped(f"{words}, and state what stays open as a tolerance")]
    taken = f"of what is taken as exact ({listed([RIG_WORDS[name] for name in exact])}) nothing needs a record first"
    return [*lines, wrapped(f"{taken}: 5 % of {RIG_WORDS[worst]} {moved}, and no error does more")]


def _moved(shift: float) -> str:
    """A shift as a share; a linear one beyond the whole is only known to be that large."""
    return _percent(shift) if shift < 1.0 else "over 100 %"


def step_table(plan: RecordingPlan) -> str:
    """The step programme, one row per step of the drive, as CSV in the units of a CETR script."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(TABLE)
    for number, log in enumerate(plan.logs, 1):
        for step, (speed, seconds) in enumerate(_steps(log), 1):
            spring = "" if log.design.stiffness is None else f"{log.design.stiffness:.6g}"
            row = [number, step, f"{1e3 * speed:.6g}", f"{seconds:.4g}", f"{log.design.normal_force:.6g}"]
            writer.writerow([*row, f"{log.rate:.0f}", spring, "hold" if speed == 0.0 else "drive"])
    return out.getvalue()


def stated_drives(plan: RecordingPlan) -> str:
    """How a scene states the drive of each log when it is recorded as the step table has it: lines to paste."""
    lines = []
    for number, log in enumerate(plan.logs, 1):
        at, pairs = 0.0, list[str]()
        for speed, seconds in _steps(log):
            pairs.append(f'[{at:.6g}, "{1e3 * speed:.6g} mm/s"]')
            at += float(f"{seconds:.4g}")
        lines.append(f"drive_speed = [{', '.join(pairs)}]   # log {number}, times from its first row on")
    return "\n".join(lines)


def _steps(log: PlannedLog) -> list[tuple[float, float]]:
    """Speed [m/s] and duration [s] of each step."""
    drive = log.design.drive
    if not isinstance(drive, tuple):
        return [(drive, log.duration)]
    ends = [*(start for start, _ in drive[1:]), log.design.duration]
    return [(speed, end - start) for (start, speed), end in zip(drive, ends, strict=True)] * log.times


def plan_document(plan: RecordingPlan) -> dict[str, Any]:
    """What --json prints, SI; half lengths as shares of what each parameter is judged by, null where it is not told."""
    names = plan.knowledge.names

    def told(halves: Sequence[float]) -> dict[str, float | None]:
        return {n: float(h) if math.isfinite(h) and h < 1e6 else None for n, h in zip(names, halves, strict=True)}

    return {
        "now": told(plan.now.tolist()),
        "then": told(plan.then.tolist()),
        "verdicts": {n: verdict(float(h)) for n, h in zip(names, plan.then, strict=True)},
        "seconds": plan.seconds,
        "logs": [
            {
                "words": described(log),
                "drive": [list(pair) for pair in log.design.drive]
                if isinstance(log.design.drive, tuple)
                else log.design.drive,
                "holds": list(log.design.holds),
                "normal_force": log.design.normal_force,
                "stiffness": log.design.stiffness,
                "duration": log.duration,
                "sampling_rate": log.rate,
                "slips": log.slips,
                "expected": told(log.halves.tolist()),
            }
            for log in plan.logs
        ],
        "drop": {"drive_speed": plan.drop_speed, "now": plan.drop_now, "then": plan.drop_then},
        "price": {name: told(shift.tolist()) for name, shift in plan.price.items()},
        "price_of": WRONG,
    }
