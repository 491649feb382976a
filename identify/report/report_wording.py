"""The plain words of the report: what a status, a verdict or a name means to somebody in the laboratory."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from identify.base.result import (
    VERDICTS,
    DistributionResult,
    Result,
    Status,
    ToleranceResult,
    UnevenResult,
)
from identify.base.wording import number, quantity, range_text
from identify.effects import ALL
from identify.estimation.covariance import TOLERANCE_WORDS

NOTHING = "there are no parameters to use"
# Word of the badge and headline of a status.
STATUS: Mapping[Status, tuple[str, str]] = {
    Status.CONVERGED: ("fit accepted", "The model follows every fitted log within its noise."),
    Status.SOLVER_FAILED: ("no result", f"The solver did not reach an answer: {NOTHING}."),
    Status.WRONG_EVENT_COUNT: ("no result", f"The number of slips does not fit the data: {NOTHING}."),
    Status.MODEL_MISFIT: ("no result", f"The model as stated and these logs do not agree: {NOTHING}."),
    Status.BETTER_START_FOUND: ("no result", f"A better answer exists than the one reached: {NOTHING} yet."),
    Status.NO_CYCLES: ("nothing to fit", "No complete stick-slip cycles were found to fit."),
    Status.AT_BOUND: ("no result", "A parameter stopped at the edge of its range: there is no result to use."),
}
DECLARED = {p.name: p for effect in ALL for p in effect.parameters}
MEANINGS: Mapping[str, str] = {
    **{name: p.meaning for name, p in DECLARED.items()},
    "mu_s": "static coefficient",
    "mu_k0": "kinetic coefficient at the start of sliding",
    "strength": "strength after the typical rest, over the load",
    "strength_scatter": "scatter of the strength from stick to stick",
    "weakening_length": "sliding that takes the strength away",
    "level_wander": "drift of the friction level along the track",
    "level_roughness": "fine roughness of the friction level",
    "stiffness": "stiffness of the rig",
    "damping": "hysteresis damping of the rig",
}
VERDICT_MARK = dict(zip(VERDICTS, "✓≈<…?|=", strict=True))
VERDICT_CLASS = dict(zip(VERDICTS, ("good", "fair", "fair", "fair", "bad", "bad", "plain"), strict=True))
ANSWER_WORDS: Mapping[str, str] = {
    "drop": "drop of the force (onset to rest)",
    "critical_speed": "stick-slip ends above",
}
# What is read from a record has another measure than the model's answer of the same name: peak and valley of the force
# lie beyond the forces at which the mass begins to slip and rests again.
RECORD_WORDS: Mapping[str, str] = {
    "drop": "drop (peak to valley)",
    "drop_scatter": "scatter of that drop from slip to slip",
}
OUTCOMES: Mapping[str, str] = {
    "never sticks": "steady sliding",
    "always sticks": "stick-slip",
    "bistable": "both: depends on the start",
    "sticks irregularly": "irregular stick-slip",
    "undecided": "oscillates without rest",
    "not possible": "not possible",
    "no answer": "no answer",
}
# Words for the verdict on the data of a log, and the class of their chip.
QUALITY: Mapping[str, tuple[str, str]] = {
    "accept": ("data: good", "good"),
    "accept with warnings": ("data: usable, with warnings", "fair"),
    "reject": ("data: not usable", "bad"),
}
EFFECTS_CHOSEN: Mapping[str, str] = {
    "auto": "Chosen from the numbers of the scene and from the data.",
    "listed": "Listed in the scene.",
}
EFFECT_SIZES = "Numbers are estimates for the first log, without damping and at full strength, to judge sizes by."
# Unicode has no subscript c, so that t_cr keeps its underscore where there is no markup.
PLAIN_SYMBOLS: Mapping[str, str] = {
    "mu_s": "μₛ",
    "mu_k0": "μₖ₀",
    "delta_mu_k": "Δμₖ",
    "drive_speed": "v₀",
    "stiffness": "k",
}


def plain_symbol(name: str) -> str:
    """The symbol of a parameter without markup, for figures and sentences: "mu_s" -> "μₛ", "D (V08)" as it is."""
    base, bracket, group = name.partition(" (")
    if bracket and (base in DECLARED or base in PLAIN_SYMBOLS):
        return f"{plain_symbol(base)} ({group}"
    if name in PLAIN_SYMBOLS or name not in DECLARED:
        return PLAIN_SYMBOLS.get(name, name.replace("_", " "))
    return DECLARED[name].symbol


def with_symbols(text: str) -> str:
    """A sentence with the symbols or words of parameters in place of their keys."""
    keys = r"\b(mu_s|mu_k0|delta_mu_k|strength_scatter|weakening_length|level_wander|level_roughness)\b"
    return re.sub(keys, lambda match: plain_symbol(match[0]), text)


def with_group(name: str, group: str) -> str:
    """The name of a parameter, with its group where it differs from group to group."""
    return name if not group or name.endswith(f"({group})") else f"{name} ({group})"


NOT_FOR = (
    "Use these numbers for this drive speed, stiffness and load only: whatever is computed from them for another is "
    "extrapolated, not supported by these records."
)
LABELS = {"static_peak": "static peak", "drop": "drop", "period": "period"}
BASES = {"static_peak": " of the load", "drop": " of the load", "period": ""}


def is_uneven(result: Result) -> bool:
    """Whether the estimator of uneven records gave this result."""
    return result.estimator == "uneven" and result.converged


def headline(result: Result) -> str:
    """What the friction of the pair is, how sure that is, and what not to use it for."""
    strength, scatter = result.parameters["strength"], result.parameters["strength_scatter"]
    if strength.value is None:
        return "Friction differs from cycle to cycle, and its strength is not identifiable from these records."
    low, high = (number(end, 2) for end in strength.ends)
    spread = f", and scatters by {100 * scatter.value:.0f} % from stick to stick" if scatter.value else ""
    peak = UnevenResult.of(result).distributions.get("static_peak")
    at = f" above a level that drifts (static peaks {_range(peak, '')} in nine of ten cycles)" if peak else ""
    return (
        f"Friction differs from cycle to cycle: a stick withstands {number(strength.value, 3)} ({low} to {high}) of "
        f"the load{at}{spread}."
    )


def distribution_lines(result: Result) -> Iterator[tuple[str, str, str]]:
    """Name, median with the interval, and range from 5 to 95 % of static peak, drop and period."""
    for name, entry in UnevenResult.of(result).distributions.items():
        if name in LABELS:
            middle = entry.quantiles["50"]
            value = f"{quantity(middle.value, entry.unit, 3)} ({range_text(*middle.ends, entry.unit)})"
            yield LABELS[name], value, f"{_range(entry, entry.unit)}{BASES[name]}"


def _range(entry: DistributionResult, unit: str) -> str:
    return range_text(entry.quantiles["5"].value, entry.quantiles["95"].value, unit, 2)


def tolerances_text(tolerances: Mapping[str, ToleranceResult]) -> str:
    """What the two intervals mean: "" where there is one only."""
    if not tolerances:
        return ""
    names: dict[float, list[str]] = {}
    for name, tolerance in tolerances.items():
        names.setdefault(tolerance.relative, []).append(TOLERANCE_WORDS.get(name, name).removeprefix("the "))
    listed = "; ".join(f"{100 * share:g} % of {', '.join(words)}" for share, words in names.items())
    usual = "" if all(t.source == "scene" for t in tolerances.values()) else "usual "
    return (
        f"Publish the 95 % interval: it includes {usual}errors of rig and sensors (standard deviations, changed by "
        f"[tolerances] in the scene: {listed}). Rig exact: noise alone, to compare runs on this rig"
    )
