"""What ASTM G115 asks to be reported with a friction coefficient: taken from labels and logs, or marked missing.

The items follow the data sheet that the guide suggests (test device, both members, conditions, results). Where logs
do not tell one, a label of that name in the manifest or the scene does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from identify.base.document import Json, finite
from identify.base.result import LogResult
from identify.base.table import Cell, OutputTable, visible
from identify.base.wording import quantity
from identify.studies.fits import FitEntry, natural

MOST_VALUES = 6


@dataclass(frozen=True)
class Item:
    """One item: its name, what is told ("" where nothing is), and where that comes from or which label to give."""

    name: str
    text: str
    source: str


# Name on the data sheet, and the label that tells it.
ASKED: tuple[tuple[str, str], ...] = (
    ("test device or method", "apparatus"),
    ("laboratory", "laboratory"),
    ("operator", "operator"),
    ("date of the test", "date"),
    ("moving member: material", "material"),
    ("moving member: form and dimensions", "specimen"),
    ("moving member: surface finish", "roughness"),
    ("moving member: treatment or coating", "treatment"),
    ("stationary member: material", "counterface"),
    ("stationary member: form and dimensions", "counterface_specimen"),
    ("stationary member: surface finish", "counterface_roughness"),
    ("cleaning and conditioning", "preparation"),
    ("contact geometry", "geometry"),
    ("apparent contact area", "contact_area"),
    ("type of motion", "motion"),
    ("sliding distance", "sliding_distance"),
    ("lubricant or third body", "lubricant"),
    ("temperature", "temperature"),
    ("relative humidity", "humidity"),
    ("atmosphere", "atmosphere"),
)
PAIR = ("material", "counterface")  # labels that make a pair of materials
INSTEAD = {"counterface": ("site", "skin site")}  # a label that tells the same under another name


def reporting(entries: Sequence[FitEntry]) -> OutputTable:
    """The data sheet as a table; what is missing is marked, with the label that would give it."""
    rows = tuple(
        (i.name, i.text, i.source) if i.text else (i.name, Cell("missing", kind="fair"), f"give it as {i.source}")
        for i in items(entries)
    )
    title = "What ASTM G115 asks to be reported with a friction coefficient"
    return OutputTable(title, ("item", "reported", "from"), rows, "reporting")


def items(entries: Sequence[FitEntry]) -> tuple[Item, ...]:
    """The data sheet over all fits that converged."""
    told = [entry for entry in entries if entry.converged]
    logs = [log for entry in told for log in entry.taken]
    asked = [_asked(name, label, told) for name, label in ASKED]
    return (*asked, *_measured(told, logs))


def _asked(name: str, label: str, entries: Sequence[FitEntry]) -> Item:
    values = {e.labels[label] for e in entries if label in e.labels}
    other = INSTEAD.get(label)
    if not values and other is not None:
        values = {e.labels[other[0]] for e in entries if other[0] in e.labels}
        if values:
            return Item(name, f"{other[1]}: {_listed(values)}", f"label {other[0]}")
    have = sum(label in e.labels for e in entries)
    part = "" if have in (0, len(entries)) else f" (told by {have} of {len(entries)} fits)"
    return Item(name, _listed(values) + part if values else "", f"label {label}")


def _listed(values: Iterable[str]) -> str:
    names = sorted(values, key=natural)
    more = f" and {len(names) - MOST_VALUES} more" if len(names) > MOST_VALUES else ""
    return ", ".join(visible(name, 40) for name in names[:MOST_VALUES]) + more


def _measured(entries: Sequence[FitEntry], logs: Sequence[LogResult]) -> tuple[Item, ...]:
    """What the logs and fits tell themselves."""
    return (
        Item("normal force", _span([log.normal_force_N for log in logs], "N"), "logs"),
        Item(
            "sliding velocity",
            _span([log.drive_speed_m_per_s for log in logs], "m/s"),
            "scenes: drive speed",
        ),
        *_coefficients(entries, "static coefficient", "static_peak_coefficient", "logs: force peaks before slips"),
        *_coefficients(
            entries, "kinetic coefficient", "kinetic_mean_coefficient", "logs: mean over time after breakaway"
        ),
        Item("number of tests", f"{len(logs)} logs in {len(entries)} fits" if logs else "", "batch"),
        Item(
            "method of calculation",
            "joint fit of a stick-slip model; analysis of variance of person means (Tukey)" if entries else "",
            "this program",
        ),
    )


def _coefficients(entries: Sequence[FitEntry], name: str, key: str, source: str) -> list[Item]:
    """A coefficient of each pair of materials: a median over several is none of any."""
    pairs: dict[str, list[Mapping[str, Json]]] = {}
    for entry in entries:
        pair = " on ".join(visible(entry.labels[label], 40) for label in PAIR if label in entry.labels)
        rows = [row for log in entry.taken for row in log.classical.rows]
        pairs.setdefault(pair, []).extend(rows)
    told = {pair: text for pair in sorted(pairs, key=natural) if (text := _coefficient(pairs[pair], key))}
    if len(told) < 2:
        return [Item(name, next(iter(told.values()), ""), source)]
    return [Item(f"{name}, {pair or 'material not told'}", text, source) for pair, text in told.items()]


def _span(found: Sequence[float | None], unit: str) -> str:
    numbers = [abs(value) for value in found if value is not None]
    if not numbers:
        return ""
    low, high = min(numbers), max(numbers)
    ends = quantity(low, unit, 3), quantity(high, unit, 3)
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"


def _coefficient(rows: Sequence[Mapping[str, Json]], key: str) -> str:
    numbers = sorted(value for row in rows if (value := finite(row.get(key))) is not None)
    if not numbers:
        return ""
    middle = numbers[len(numbers) // 2]
    return f"{middle:.3g} (median of {len(numbers)} logs; {numbers[0]:.3g} to {numbers[-1]:.3g})"
