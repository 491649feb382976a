"""The range of speed, load and stiffness in which a pair was tested: what lies outside is extrapolated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from identify.base.outcome import numbers_of
from identify.prediction.outlook_words import listed, said

SLACK = 1.1  # beyond the range by this factor still counts as inside
QUANTITIES = ("drive_speed", "normal_force", "stiffness")
UNITS = {"drive_speed": "m/s", "normal_force": "N", "stiffness": "N/m"}


@dataclass(frozen=True)
class Tested:
    """Lowest and highest value [SI] by name (QUANTITIES); a name that is absent was not tested at any known value."""

    ranges: Mapping[str, tuple[float, float]]

    @staticmethod
    def of(points: Iterable[Mapping[str, float]]) -> Tested:
        """The range of tests, each given by its values."""
        given = list(points)
        seen = {name: [abs(p[name]) for p in given if name in p] for name in QUANTITIES}
        return Tested({name: (min(values), max(values)) for name, values in seen.items() if values})

    @staticmethod
    def joined(parts: Iterable[Tested]) -> Tested:
        """The range that several tests cover together."""
        found: dict[str, tuple[float, float]] = {}
        for name, (low, high) in ((n, r) for part in parts for n, r in part.ranges.items()):
            before = found.get(name, (low, high))
            found[name] = (min(low, before[0]), max(high, before[1]))
        return Tested(found)

    @staticmethod
    def of_result(document: Mapping[str, Any]) -> Tested:
        """The range of the logs that took part in a finished fit (the document of result.json)."""
        scene = document.get("provenance", {}).get("scene") or {}
        entries, rig = scene.get("logs") or (), scene.get("rig") or {}
        logs = document.get("logs", ())
        points = []
        for number, log in zip(numbers_of(logs), logs, strict=True):
            if log.get("reason_left_out"):
                continue
            own = entries[number] if number < len(entries) else {}
            said = {
                "drive_speed": log.get("drive_speed_m_per_s"),
                "normal_force": log.get("normal_force_N"),
                "stiffness": own.get("stiffness", rig.get("stiffness")),
            }
            plain = {name: v.get("value") if isinstance(v, Mapping) else v for name, v in said.items()}
            points.append({name: float(v) for name, v in plain.items() if v})
        return Tested.of(points)

    def beyond(self, values: Mapping[str, float]) -> str:
        """A sentence on what of these values [SI] was not tested; "" where all of it was."""
        out = []
        for name in QUANTITIES:
            if name in values and name in self.ranges and self.extrapolated(name, values[name]):
                low, high = (said(end, UNITS[name]) for end in self.ranges[name])
                span = low if low == high else f"{low} to {high}"
                out.append(f"a {name.replace('_', ' ')} of {said(abs(values[name]), UNITS[name])} ({span} tested)")
        return f"Extrapolated: the logs did not test {listed(out)}." if out else ""

    def extrapolated(self, name: str, value: float) -> bool:
        """Whether a value [SI] lies outside the tested range by more than a tenth; False for what is no such name."""
        if name not in QUANTITIES:
            return False
        if name not in self.ranges:
            return True
        low, high = self.ranges[name]
        return not low / SLACK <= abs(value) <= high * SLACK
