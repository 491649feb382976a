"""What ASTM G115 asks to be reported with a friction coefficient: taken from labels and logs, or marked missing.

The items follow the data sheet that the guide suggests (test device, both members, conditions, results). A label of
that name in the manifest or the scene gives what the logs do not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from identify.base.document import Json, finite
from identify.base.table import Cell, OutputTable, visible
from identify.base.wording import quantity
from identify.studies.fits import FitEntry, natural

MOST_VALUES = 6
# Name on the data sheet, and the label that gives it.
LABELS = {
    "test device or method": "apparatus",
    "laboratory": "laboratory",
    "operator": "operator",
    "date of the test": "date",
    "moving member: material": "material",
    "moving member: form and dimensions": "specimen",
    "moving member: surface finish": "roughness",
    "moving member: treatment or coating": "treatment",
    "stationary member: material": "counterface",
    "stationary member: form and dimensions": "counterface_specimen",
    "stationary member: surface finish": "counterface_roughness",
    "cleaning and conditioning": "preparation",
    "contact geometry": "geometry",
    "apparent contact area": "contact_area",
    "type of motion": "motion",
    "sliding distance": "sliding_distance",
    "lubricant or third body": "lubricant",
    "temperature": "temperature",
    "relative humidity": "humidity",
    "atmosphere": "atmosphere",
}
INSTEAD = {"counterface": "site"}  # a label that gives the same under another name: skin
COEFFICIENTS = {
    "static coefficient": ("static_peak_coefficient", "logs: force peaks before slips"),
    "kinetic coefficient": ("kinetic_mean_coefficient", "logs: mean over time after breakaway"),
}


def reporting(entries: Sequence[FitEntry]) -> OutputTable:
    """The data sheet over all fits that converged; what is missing is marked, with the label that would give it."""
    fits = [entry for entry in entries if entry.converged]
    logs = [log for entry in fits for log in entry.fitted_logs]
    items = []
    for name, label in LABELS.items():
        source = next((n for n in (label, INSTEAD.get(label, label)) if any(n in e.labels for e in fits)), label)
        have = [entry.labels[source] for entry in fits if source in entry.labels]
        some = f" (in {len(have)} of {len(fits)} fits)" if 0 < len(have) < len(fits) else ""
        items.append((name, _listed(set(have)) + some, f"label {source}"))
    items.append(("normal force", _span((log.normal_force_N for log in logs), "N"), "logs"))
    items.append(("sliding velocity", _span((log.drive_speed_m_per_s for log in logs), "m/s"), "scenes: drive speed"))
    pairs: dict[str, list[Mapping[str, Json]]] = {}  # a median over several pairs of materials is none of any
    for entry in fits:
        pair = " on ".join(visible(entry.labels[n], 40) for n in ("material", "counterface") if n in entry.labels)
        pairs.setdefault(pair, []).extend(row for log in entry.fitted_logs for row in log.classical.rows)
    for name, (key, source) in COEFFICIENTS.items():
        found = {pair: text for pair in sorted(pairs, key=natural) if (text := _coefficient(pairs[pair], key))}
        for pair, text in found.items() if found else [("", "")]:
            items.append((f"{name}, {pair or 'material not stated'}" if len(found) > 1 else name, text, source))
    items.append(("number of tests", f"{len(logs)} logs in {len(fits)} fits" if logs else "", "batch"))
    method = "joint fit of a stick-slip model; analysis of variance of person means (Tukey)"
    items.append(("method of calculation", method if fits else "", "this program"))
    rows = tuple(
        (name, text, source) if text else (name, Cell("missing", kind="fair"), f"give it as {source}")
        for name, text, source in items
    )
    title = "What ASTM G115 asks to be reported with a friction coefficient"
    return OutputTable(title, ("item", "reported", "from"), rows, "reporting")


def _listed(values: Iterable[str]) -> str:
    names = sorted(values, key=natural)
    more = f" and {len(names) - MOST_VALUES} more" if len(names) > MOST_VALUES else ""
    return ", ".join(visible(name, 40) for name in names[:MOST_VALUES]) + more


def _span(found: Iterable[float | None], unit: str) -> str:
    numbers = [abs(value) for value in found if value is not None]
    ends = [quantity(end, unit, 3) for end in (min(numbers), max(numbers))] if numbers else []
    return " to ".join(dict.fromkeys(ends))


def _coefficient(rows: Sequence[Mapping[str, Json]], key: str) -> str:
    numbers = sorted(value for row in rows if (value := finite(row.get(key))) is not None)
    if not numbers:
        return ""
    middle = numbers[len(numbers) // 2]
    return f"{middle:.3g} (median of {len(numbers)} logs; {numbers[0]:.3g} to {numbers[-1]:.3g})"
