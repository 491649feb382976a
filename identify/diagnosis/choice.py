"""Which effects a model takes and why: one reason per effect, for the result and the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from identify.effects import ALL


@dataclass(frozen=True)
class Reason:
    """Why one effect stays or goes.

    sentence: in lab words; group, value: the dimensionless group that tells, and its value ("" and None without one);
    error: relative error of the force or the period that leaving it out would make; cost: what it costs, in words;
    statistic: likelihood-ratio statistic that it gains on the data; held_out: by which factor the error on cycles kept
    back grows without it. None: not known.
    """

    effect: str
    kept: bool
    sentence: str
    group: str = ""
    value: float | None = None
    error: float | None = None
    cost: str = ""
    statistic: float | None = None
    held_out: float | None = None


@dataclass(frozen=True)
class Choice:
    """The effects of a model, in the order of their table, and a reason per effect that was looked at."""

    effects: tuple[str, ...]
    reasons: tuple[Reason, ...]


def as_listed(
    effects: Sequence[str], values: Mapping[str, float] | None, normal_force: float, drive_speed: float
) -> Choice:
    """The effects a scene lists, each with what it does and when it matters, at an operating point in SI; without
    values that can be relied on (None) what it does alone."""
    reasons = []
    for effect in ALL:
        if effect.name in effects:
            told = None if values is None else effect.importance(values, normal_force, drive_speed)
            sentence = effect.says + (f"; {told.sentence}" if told else "")
            reasons.append(
                Reason(effect.name, True, sentence, told.group if told else "", told.value if told else None)
            )
    return Choice(tuple(reason.effect for reason in reasons), tuple(reasons))


def document_of(choice: Choice, *, auto: bool) -> dict[str, Any]:
    """The effects as they stand in result.json."""
    return {
        "names": list(choice.effects),
        "chosen": "auto" if auto else "listed",
        "reasons": [asdict(reason) for reason in choice.reasons],
    }
