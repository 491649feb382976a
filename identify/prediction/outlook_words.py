"""An outlook in plain words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from identify.base.speeds import speed_scale

Document = Mapping[str, Any]
OPEN = "interval open: "  # how a reason begins
MOST_PLACES = 8
LEAST = 0.0999  # of a unit, from which on it is taken
WHOLE = ("s/m", "1/s", "1/m")  # units that are told as they are
KILO = ("N", "N/m", "Pa")  # units that are told in thousands
PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def said(value: float | None, unit: str, beside: float | None = None) -> str:
    """A number with three digits and a unit of handy size ("0.56 N", "22 mm/s"); in that of the number beside it, where
    there is one."""
    if value is None:
        return "none"
    name, factor = _scale(value if beside is None else beside, unit)
    return f"{_digits(value / factor, 3)} {name}".rstrip()


def listed(names: Sequence[str], word: str = "and") -> str:
    """Names in a sentence: "a", "a and b", "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {word} {names[-1]}"


def _scale(value: float, unit: str) -> tuple[str, float]:
    """A unit of handy size for a value, and its size in SI."""
    if unit == "m/s":
        return speed_scale(value)
    if not unit or unit in WHOLE or value == 0:
        return unit, 1.0
    if unit in KILO and abs(value) >= 1e4:
        return f"k{unit}", 1e3
    if unit == "kg":
        return ("kg", 1.0) if abs(value) >= 1.0 else ("g", 1e-3)
    usual = 1e-3 if unit == "m" and abs(value) < 1 else 1.0
    factor, prefix = next(((f, s) for f, s in PREFIXES if abs(value) >= LEAST * f and f <= usual), PREFIXES[-1])
    return f"{prefix}{unit}", factor


def _digits(value: float, digits: int) -> str:
    return f"{value:.3g}" if value == 0 else np.format_float_positional(value, digits, fractional=False, trim="-")


def with_interval(entry: Mapping[str, Any]) -> str:
    """The number and its interval in one unit, with as many decimals as tell the ends apart."""
    value, unit = entry["value"], entry["unit"]
    low, high = entry["interval"] or (None, None)
    if entry.get("reason"):
        return f"{said(value, unit)} (interval open)"
    if low is None or high is None:
        return said(value, unit)
    name, factor = _scale(value, unit)
    shown = [v / factor for v in (value, low, high)]
    if not shown[2] > shown[1]:
        return said(value, unit)
    places = max(_places(shown[0]) + 2, _places((shown[2] - shown[1]) / 2))
    middle, first, last = (f"{v:.{min(max(places, 0), MOST_PLACES)}f}" for v in shown)
    return f"{middle} {name} (95 %: {first} to {last})".replace("  ", " ")


def _places(value: float) -> int:
    """Decimals at which the first digit of a number stands."""
    return 0 if value == 0 or not np.isfinite(value) else -int(np.floor(np.log10(abs(value))))


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
        "never sticks": "it slides steadily, however the motion starts",
        "bistable": "it depends on the start: stick-slip that has begun goes on, and so does steady sliding",
        "sticks irregularly": "it sticks and slips, but the jumps do not settle on one size",
        "undecided": (
            "neither stick-slip nor stable sliding was found: the sliding speed oscillates without coming to rest"
        ),
    }[answer["outcome"]]
    lines = [f"At {_where(document)} {sentence}."]
    end = answer["critical_speed"]
    if end["value"] is not None:
        lines.append(f"Stick-slip ends above a drive speed of {with_interval(end)}.")
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
        return f"Amplitude at {_where(document)}: none; {part['drop']['validity']}."
    plain = {name: said(entry["value"], entry["unit"]) for name, entry in part.items() if name != "text"}
    return (
        f"At {_where(document)} the force falls by {with_interval(part['peak_to_valley'])} from peak to valley, "
        f"every {with_interval(part['period'])}: "
        f"{plain['stick_duration']} of stick, {plain['slip_duration']} of slip over {plain['slip_distance']}, "
        f"at up to {with_interval(part['peak_speed'])}; "
        f"the mass begins to slip at {plain['onset_force']}, before the peak, and rests again at "
        f"{plain['arrest_force']}, after the valley: a drop of {with_interval(part['drop'])} from onset to rest."
        + _why_open(part[name] for name in ("peak_to_valley", "drop", "period", "peak_speed"))
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
