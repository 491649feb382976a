"""A prediction in plain words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from identify.base.result import Number
from identify.base.wording import number, range_text, scale_for, value_and_interval

if TYPE_CHECKING:
    from identify.prediction.predict import PointPrediction

OPEN = "interval open: "  # how a reason begins


def shown(value: float | None, unit: str, beside: float | None = None) -> str:
    """A number with three digits and a unit of handy size ("0.56 N", "22 mm/s"); in that of the number beside it, where
    there is one."""
    if value is None:
        return "none"
    scale = scale_for(value if beside is None else beside, unit)
    return f"{number(float(f'{value / scale.factor:.3g}'), 3)} {scale.unit}".rstrip()


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: "a", "a and b", "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def with_interval(entry: Number) -> str:
    """The number and its interval in one unit, with as many decimals as separate the ends."""
    value, (low, high) = entry.value, entry.ends
    if entry.reason:
        return f"{shown(value, entry.unit)} (interval open)"
    if value is None or low is None or high is None or not high > low:
        return shown(value, entry.unit)
    scale = scale_for(value, entry.unit)
    text, interval = value_and_interval(value, entry.ends, scale, positive=True)
    return f"{text} {scale.unit}".rstrip() + f" (95 %: {interval})"


def _why_open(entries: Iterable[Number]) -> str:
    """One sentence for all intervals that are open."""
    reasons = dict.fromkeys(entry.reason.removeprefix(OPEN) for entry in entries if entry.reason)
    return f" Intervals are open where {'; or '.join(reasons)}." if reasons else ""


def _where(prediction: PointPrediction) -> str:
    point = prediction.operating_point
    return f"{shown(point['drive_speed'].value, 'm/s')} and {shown(point['normal_force'].value, 'N')}"


OUTCOMES = {
    "always sticks": "it sticks and slips, however the motion starts",
    "never sticks": "it slides steadily, however the motion starts",
    "bistable": "it depends on the start: stick-slip that has begun goes on, and so does steady sliding",
    "sticks irregularly": "it sticks and slips, but the jumps do not settle on one size",
    "undecided": "neither stick-slip nor stable sliding was found: the sliding speed oscillates without coming to rest",
}
WINDOWS = {
    "always sticks": "stick-slip",
    "never sticks": "steady sliding",
    "bistable": "stick-slip or steady sliding, depending on the start,",
    "undecided": "oscillation without rest",
}  # what holds over a range of drive speeds


def stability_text(prediction: PointPrediction) -> str:
    """What the pair does here, and over which drive speeds."""
    answer, fastest = prediction.stability, shown(prediction.stability.searched_between[1], "m/s")
    lines = [f"At {_where(prediction)} {OUTCOMES[answer.outcome]}."]
    if not answer.stick_slip_between:
        validity = answer.critical_speed.validity
        lines.append(f"{validity[:1].upper()}{validity[1:]}.")
    for part in answer.stick_slip_between:
        if part.high is None:
            begins = f"begins above {with_interval(part.low)} and " if part.low else ""
            lines.append(f"Stick-slip {begins}still exists at the highest speed tried ({fastest}).")
        elif part.low is None:
            lines.append(f"Stick-slip ends above a drive speed of {with_interval(part.high)}.")
        else:
            lines.append(f"Stick-slip exists from {with_interval(part.low)} to {with_interval(part.high)}.")
    ends = [limit for part in answer.stick_slip_between for limit in (part.low, part.high) if limit]
    if len(answer.windows) == 1:
        lines.append(f"At every drive speed searched: {WINDOWS[answer.windows[0].outcome].rstrip(',')}.")
    else:
        first, *between, last = answer.windows
        middle = [f"{WINDOWS[w.outcome]} from {range_text(w.low, w.high, 'm/s')}" for w in between]
        slow, fast = f"up to {shown(first.high, 'm/s')}", f"above {shown(last.low, 'm/s')}"
        parts = [f"{WINDOWS[first.outcome]} {slow}", *middle, f"{WINDOWS[last.outcome]} {fast}"]
        lines.append(f"By drive speed: {'; '.join(parts)}.")
    return " ".join(lines) + _why_open(ends)


SHOWN = ("peak_to_valley", "drop", "period", "peak_speed")  # with their intervals


def amplitude_text(prediction: PointPrediction) -> str:
    """Size and timing of the jumps."""
    part = prediction.amplitude.numbers
    if part["drop"].value is None:
        return f"Amplitude at {_where(prediction)}: none; {part['drop'].validity}."
    plain = {name: shown(entry.value, entry.unit) for name, entry in part.items()}
    ends = {name: with_interval(part[name]) for name in SHOWN}
    return (
        f"At {_where(prediction)} the force falls by {ends['peak_to_valley']} from peak to valley, every "
        f"{ends['period']}: {plain['stick_duration']} of stick, {plain['slip_duration']} of slip over "
        f"{plain['slip_distance']}, at up to {ends['peak_speed']}; the mass begins to slip at {plain['onset_force']}, "
        f"before the peak, and rests again at {plain['arrest_force']}, after the valley: a drop of {ends['drop']} from "
        f"onset to rest.{_why_open(part[name] for name in SHOWN)}"
    )


def ranges_text(prediction: PointPrediction, part: str) -> str:
    """The ranges of the answers ("stability" or "amplitude") where values were assumed, without one number."""

    def ranged(entry: Number) -> str:
        low, high = entry.ends
        return "not known" if low is None or high is None else range_text(low, high, entry.unit)

    if part == "stability":
        end = prediction.stability.critical_speed
        why = f"; {end.validity}" if end.value is None else ""
        return f"Over the ranges of what is assumed stick-slip ends above a drive speed: {ranged(end)}{why}."
    numbers = prediction.amplitude.numbers
    names = {"peak_to_valley": "the force falls by", "period": "period", "peak_speed": "highest speed"}
    ranges = ", ".join(f"{words} {ranged(numbers[name])}" for name, words in names.items())
    return f"Over the ranges of what is assumed, at {_where(prediction)}: {ranges}."


def closed_form_text(prediction: PointPrediction) -> str:
    """What the paper's closed forms have in place of it."""
    part = prediction.closed_forms
    if part.ignores:
        return f"The paper's closed forms are not valid here: they do not include {' and '.join(part.ignores)}."
    reach = "" if part.a_V_max.value is None else f"; here it is {part.a_V_max.value:.2g}"
    head = f"The paper's closed forms need a V_max far below 1{reach}."
    if part.slip == "runaway":
        return f"{head} They are {part.numbers['drop'].validity}."
    words = []
    for name in ("drop", "period", "critical_speed"):
        entry, label = part.numbers[name], name.replace("critical_speed", "end of stick-slip, of a saturated contact")
        if not entry.validity.startswith("not valid"):  # a number that is off by a factor of a hundred helps nobody
            words.append(f"{label} {shown(entry.value, entry.unit)}, {entry.validity}")
    if not words:
        return f"{head} None of them holds here."
    return f"{head} They give: {'; '.join(words)}."
