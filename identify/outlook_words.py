"""An outlook in plain words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

Document = Mapping[str, Any]
OPEN = "interval open: "  # how a reason begins
PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def said(value: float | None, unit: str) -> str:
    """A number with three digits and a unit of handy size ("0.56 N", "22 mm/s")."""
    if value is None:
        return "none"
    if not unit or value == 0:
        return f"{value:.3g}" + (f" {unit}" if unit else "")
    usual = 1e-3 if unit in ("m", "m/s") and abs(value) < 1 else 1.0
    factor, prefix = next(((f, s) for f, s in PREFIXES if abs(value) >= f and f <= usual), PREFIXES[-1])
    return f"{np.format_float_positional(value / factor, 3, fractional=False, trim='-')} {prefix}{unit}"


def _with_interval(entry: Mapping[str, Any]) -> str:
    words = said(entry["value"], entry["unit"])
    low, high = entry["interval"] or (None, None)
    if entry.get("reason"):
        words += " (interval open)"
    elif low is not None:
        words += f" (95 %: {said(low, entry['unit'])} to {said(high, entry['unit'])})"
    return words


def _why_open(entries: Iterable[Mapping[str, Any]]) -> str:
    """One sentence for all intervals that are open."""
    reasons = dict.fromkeys(entry["reason"].removeprefix(OPEN) for entry in entries if entry.get("reason"))
    return f" Intervals are open where {'; or '.join(reasons)}." if reasons else ""


def _where(document: Document) -> str:
    point = document["operating_point"]
    speed, force = point["drive_speed"], point["normal_force"]
    return f"{said(speed['value'], 'm/s')} and {said(force['value'], 'N')}"


def stability_text(document: Document) -> str:
    """What the pair does here, and where that changes."""
    answer = document["stability"]
    sentence = {
        "always sticks": "it sticks and slips, however the motion starts",
        "never sticks": "it slides steadily",
        "bistable": "both are possible, depending on the start: stick-slip that has begun goes on, steady sliding too",
        "sticks irregularly": "it sticks and slips, but the jumps do not settle on one size",
        "undecided": (
            "neither stick-slip nor stable sliding was found: the sliding speed oscillates without coming to rest"
        ),
    }[answer["outcome"]]
    lines = [f"At {_where(document)}: {answer['outcome']}; {sentence}."]
    end = answer["critical_speed"]
    if end["value"] is not None:
        lines.append(f"Stick-slip ends above a drive speed of {_with_interval(end)}.")
    else:
        lines.append(f"Drive speed above which stick-slip ends: none; {end['validity']}.")
    spans = answer["sliding_unstable_between"]
    low, high = answer["searched_between"]
    for begin, stop in spans:
        if begin <= low and stop >= high:
            lines.append(f"Steady sliding is unstable at every drive speed up to {said(high, 'm/s')}.")
        elif begin <= low:
            lines.append(f"Steady sliding is unstable below {said(stop, 'm/s')}.")
        elif stop >= high:
            lines.append(f"Steady sliding is unstable above {said(begin, 'm/s')}.")
        else:
            lines.append(f"Steady sliding is unstable between {said(begin, 'm/s')} and {said(stop, 'm/s')}.")
    if not spans:
        lines.append("Steady sliding is stable at every drive speed searched.")
    return " ".join(lines) + _why_open([end])


def amplitude_text(document: Document) -> str:
    """Size and timing of the jumps."""
    part = document["amplitude"]
    if part["drop"]["value"] is None:
        return f"Amplitude: none; {part['drop']['validity']}."
    plain = {name: said(entry["value"], entry["unit"]) for name, entry in part.items() if name != "text"}
    return (
        f"Each jump drops the force by {_with_interval(part['drop'])}, every {_with_interval(part['period'])}: "
        f"{plain['stick_duration']} of stick, {plain['slip_duration']} of slip over {plain['slip_distance']}, "
        f"at up to {_with_interval(part['peak_speed'])}; "
        f"the force rises to {plain['onset_force']} and falls to {plain['arrest_force']}."
        + _why_open(part[name] for name in ("drop", "period", "peak_speed"))
    )


def closed_form_text(document: Document) -> str:
    """What the paper's closed forms would have said."""
    part = document["closed_forms"]
    if part["ignores"]:
        return f"The paper's closed forms are not valid here: they know nothing of {' and '.join(part['ignores'])}."
    reach = part["a_V_max"]["value"]
    head = "The paper's closed forms need a V_max far below 1" + (
        "." if reach is None else f"; here it is {reach:.2g}."
    )
    if part["slip"] == "runaway":
        return f"{head} They are {part['drop']['validity']}."
    words = [f"{name} {said(part[key]['value'], part[key]['unit'])} ({part[key]['validity']})" for name, key in ROWS]
    return f"{head} They give: {'; '.join(words)}."


ROWS = (("drop", "drop"), ("period", "period"), ("end of stick-slip, of a saturated contact,", "critical_speed"))
