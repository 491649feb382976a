"""Which log of its scene each log of a result is: one that was cut into parts stands there once for each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


def numbers_of(logs: Sequence[Mapping[str, Any]]) -> list[int]:
    """The number in the scene (from 0) of every log of a result: `logs` of result.json, in the order of the scene."""
    numbers: list[int] = []
    for log in logs:
        part_of = log.get("part_of")
        numbers.append(part_of - 1 if part_of is not None else numbers[-1] + 1 if numbers else 0)
    return numbers


def places_of(logs: Sequence[Mapping[str, Any]], number: int) -> list[int]:
    """Where a result has log `number` (from 0) of its scene: one place (from 0), several where it was cut."""
    return [place for place, found in enumerate(numbers_of(logs)) if found == number]
