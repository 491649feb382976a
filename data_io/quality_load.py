"""The normal force: its level, drift and ripple, rows without load, a sensor at its end."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.frozen import Finding, FloatArray
from data_io.quality_signal import clipping
from data_io.record import Record
from data_io.thinned import kept, thinned
from data_io.thresholds import Thresholds
from data_io.wording import percent

UNLOADED: Final = 0.1
"""Share of the typical load below which a row counts as not loaded."""
_LOADED: Final = 0.3
"""Share of the load above which a row counts as loaded: a load that ripples is loaded in its troughs as well."""


@dataclass(frozen=True)
class Load:
    """level [N]: median of the loaded rows. drift, ripple: change from the first to the last tenth, and standard
    deviation about a straight line, both as share of the level. unloaded: share of the rows."""

    level: float
    drift: float
    ripple: float
    unloaded: float


def look_at_load(record: Record, used: npt.NDArray[np.bool_], limits: Thresholds) -> tuple[Load, list[Finding]]:
    """Measure the normal force of the rows that count, and say what lies beyond the thresholds."""
    time, normal = kept(record.time, used), kept(record.normal_force, used)
    level = typical_load(normal)
    if level <= 0:
        text = "the normal force is zero or pulls; a pressing load was expected; check its column, unit and zero point"
        return Load(level, 0.0, 0.0, 1.0), [Finding("no_load", "reject", text)]
    drift, ripple = _course(thinned(time), thinned(normal), level)
    load = Load(level, drift, ripple, np.count_nonzero(normal < UNLOADED * level) / normal.size)
    notes = []
    if np.ptp(normal) > 0:
        notes += clipping("normal force", normal, limits)[1]
    elif not str(record.metadata.get("normal_force_source", "")).startswith("constant"):
        text = f"the normal force is exactly {level:g} N in every row; it was set, not measured"
        notes.append(Finding("normal_force_not_measured", "info", text))
    return load, [*notes, *_findings(load, limits)]


def typical_load(normal: FloatArray) -> float:
    """Return the median normal force of the loaded rows [N], 0 where nothing presses; (n,) may hold NaN."""
    # In this order: every so many-th row may be the one without a load.
    finite = thinned(kept(normal, np.isfinite(normal)))
    size = np.abs(finite)
    if size.size == 0 or not size.any():
        return 0.0
    level = abs(float(np.median(finite[size >= 0.5 * np.quantile(size, 0.99)])))
    return float(np.median(finite[size >= _LOADED * level]))


def _course(time: FloatArray, normal: FloatArray, level: float) -> tuple[float, float]:
    """Return drift and ripple of the loaded rows as shares of the load."""
    loaded = normal > _LOADED * level
    if np.count_nonzero(loaded) < 3:
        return 0.0, 0.0
    t, force = time[loaded], normal[loaded]
    tenth = max(force.size // 10, 1)
    drift = float(np.median(force[-tenth:]) - np.median(force[:tenth])) / level
    centred = (t - t.mean()) / (t[-1] - t[0])
    slope = float(centred @ (force - force.mean()) / (centred @ centred))
    return drift, float(np.std(force - force.mean() - slope * centred)) / level


def _findings(load: Load, limits: Thresholds) -> list[Finding]:
    notes, level = [], f"{load.level:.3g} N"
    if severity := limits.severity("unloaded_rows", load.unloaded):
        share = f"{100 * load.unloaded:.1f} % of the rows press with less than {100 * UNLOADED:.0f} % of the load"
        text = f"{share} ({level}); leave them out with window or choose the loaded step"
        notes.append(Finding("unloaded_rows", severity, text))
    if severity := limits.severity("load_drift", abs(load.drift)):
        word = "rises" if load.drift > 0 else "falls"
        text = (
            f"the normal force {word} by {percent(abs(load.drift), of=level)} from the first to the "
            "last tenth; a fit follows it with the effect varying_normal_force, and else takes the mean"
        )
        notes.append(Finding("load_drift", severity, text))
    if severity := limits.severity("load_ripple", load.ripple):
        text = (
            f"the normal force ripples by {percent(load.ripple, of=level)} (standard deviation); check "
            "the load control and the flatness of the track"
        )
        notes.append(Finding("load_ripple", severity, text))
    return notes
