"""The quality gate: what a record's clock and force channels look like, in numbers and in sentences.

Knows sampling and sensors only; whether a slip holds enough samples is for those who know slips.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from data_io.frozen import Finding, FloatArray
from data_io.record import Record
from data_io.sampling import Sampling, describe_sampling

_COEFFICIENT_NAMES: Final = ("cof", "mu", "µ", "μ", "friction coefficient", "coefficient of friction")
_COEFFICIENT_TOLERANCE: Final = 0.05
_UNLOADED: Final = 0.1
"""Share of the typical load below which a row counts as not loaded."""
_DRIFT: Final = 0.05
_RIPPLE: Final = 0.05
_CLIPPED_RUN: Final = 10
_CLIPPED_EXCESS: Final = 5.0
"""A sensor at its end shows the last value this many times more often than the values before it."""
_COARSE: Final = 0.02


@dataclass(frozen=True)
class Quality:
    """What the gate measured. Findings hold the record's own first, then those of the gate.

    sampling: see `Sampling`. resolution [N]: smallest step between two friction values. load [N]: median normal force
    of the loaded rows; load_drift, load_ripple: change from the first to the last tenth and standard deviation about a
    straight line, both as share of the load. coefficient_error: median share by which the file's own coefficient
    differs from friction / normal force, None where the file has none.
    """

    sampling: Sampling
    resolution: float
    load: float
    load_drift: float
    load_ripple: float
    coefficient_error: float | None
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> Literal["good", "usable", "reject"]:
        """The worst finding decides: "reject", "usable" with warnings, or "good"."""
        severities = {finding.severity for finding in self.findings}
        return "reject" if "reject" in severities else "usable" if "warning" in severities else "good"


def assess(record: Record) -> Quality:
    """Look at a record's clock and forces; never changes it and never fails on a valid record."""
    sampling, notes = describe_sampling(record)
    friction = record.friction_force[np.isfinite(record.friction_force)]
    normal = record.normal_force
    load = _typical_load(normal)
    drift, ripple = _load_course(record.time, normal, load)
    error = _coefficient_error(record, load)
    resolution = _resolution(friction)
    notes += _friction_findings(friction, resolution)
    notes += _load_findings(record, load, drift, ripple)
    if error is not None and error > _COEFFICIENT_TOLERANCE:
        text = (
            f"the file's own coefficient differs from friction force / normal force by {100 * error:.0f} % (median); "
            "check zero points and columns"
        )
        notes.append(Finding("coefficient_disagrees", "warning", text))
    return Quality(sampling, resolution, load, drift, ripple, error, (*record.findings, *notes))


def _typical_load(normal: FloatArray) -> float:
    finite = normal[np.isfinite(normal)]
    size = np.abs(finite)
    if size.size == 0 or not size.any():
        return 0.0
    return float(np.median(finite[size >= 0.5 * np.quantile(size, 0.99)]))


def _load_course(time: FloatArray, normal: FloatArray, load: float) -> tuple[float, float]:
    """Return drift and ripple of the loaded rows as shares of the load; zeros where there is no load."""
    loaded = np.isfinite(normal) & (normal > 0.5 * load)
    if load <= 0 or np.count_nonzero(loaded) < 3:
        return 0.0, 0.0
    t, force = time[loaded], normal[loaded]
    tenth = max(force.size // 10, 1)
    drift = float(np.median(force[-tenth:]) - np.median(force[:tenth])) / load
    centred = (t - t.mean()) / (t[-1] - t[0])
    slope = float(centred @ (force - force.mean()) / (centred @ centred))
    return drift, float(np.std(force - force.mean() - slope * centred)) / load


def _load_findings(record: Record, load: float, drift: float, ripple: float) -> list[Finding]:
    normal = record.normal_force[np.isfinite(record.normal_force)]
    if load <= 0:
        text = "the normal force is zero or pulls; a pressing load was expected; check its column, unit and zero point"
        return [Finding("no_load", "reject", text)]
    notes = []
    if np.ptp(normal) == 0 and not str(record.metadata.get("normal_force_source", "")).startswith("constant"):
        text = f"the normal force is exactly {load:g} N in every row; it was set, not measured"
        notes.append(Finding("normal_force_not_measured", "info", text))
    unloaded = float(np.mean(normal < _UNLOADED * load))
    if unloaded > 0:
        share = f"{100 * unloaded:.1f} % of the rows press with less than {100 * _UNLOADED:.0f} % of the typical load"
        text = f"{share} ({load:.3g} N); leave them out or choose the loaded step"
        notes.append(Finding("unloaded_rows", "warning", text))
    if abs(drift) > _DRIFT:
        word = "rises" if drift > 0 else "falls"
        text = f"the normal force {word} by {100 * abs(drift):.0f} % of {load:.3g} N from the first to the last tenth"
        notes.append(Finding("load_drift", "info", text))
    if ripple > _RIPPLE:
        text = f"the normal force ripples by {100 * ripple:.0f} % of {load:.3g} N (standard deviation)"
        notes.append(Finding("load_ripple", "warning", text))
    return notes


def _friction_findings(friction: FloatArray, resolution: float) -> list[Finding]:
    span = float(np.ptp(friction))
    if span == 0:
        text = f"the friction force is exactly {friction[0]:g} N in every row; a living signal was expected; check it"
        return [Finding("friction_constant", "reject", text)]
    notes = []
    for end, values in (("highest", friction), ("lowest", -friction)):
        rows = _clipped_rows(values)
        if rows:
            level = friction.max() if end == "highest" else friction.min()
            text = (
                f"the friction force stays at its {end} value {level:.4g} N in {rows} rows: the sensor was at its end"
            )
            notes.append(Finding("friction_clipped", "warning", text))
    if resolution > _COARSE * span:
        text = f"the friction force comes in steps of {resolution:.3g} N, coarse against its range of {span:.3g} N"
        notes.append(Finding("friction_coarse", "warning", text))
    return notes


def _clipped_rows(values: FloatArray) -> int:
    """Return how many rows stand at the largest value if that looks like a sensor at its end, else 0."""
    levels, counts = np.unique(values, return_counts=True)
    if counts[-1] < _CLIPPED_RUN or levels.size < 3:
        return 0
    usual = max(float(np.mean(counts[-6:-1])), 1.0)
    at_end = np.concatenate(([0], (values == levels[-1]).astype(np.int8), [0]))
    edges = np.flatnonzero(np.diff(at_end))
    longest = int(np.max(edges[1::2] - edges[::2]))
    return int(counts[-1]) if longest >= _CLIPPED_RUN and counts[-1] > _CLIPPED_EXCESS * usual else 0


def _resolution(values: FloatArray) -> float:
    """Return the smallest step between two values, rounding of the number format aside."""
    levels = np.unique(values)
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * np.max(np.abs(levels), initial=0.0)]
    return float(steps.min()) if steps.size else 0.0


def _coefficient_error(record: Record, load: float) -> float | None:
    name = next((n for n in record.channels if n.strip().casefold() in _COEFFICIENT_NAMES), None)
    if name is None or record.channel_units[name] not in ("", "-", "1"):
        return None
    told = np.abs(record.channels[name])
    usable = np.isfinite(told) & np.isfinite(record.friction_force) & (record.normal_force > 0.5 * load)
    usable &= np.abs(record.friction_force) > 0.1 * np.nanmax(np.abs(record.friction_force))
    if load <= 0 or not usable.any():
        return None
    own = np.abs(record.friction_force[usable]) / record.normal_force[usable]
    return float(np.median(np.abs(told[usable] - own) / own))
