"""Cut and correct a record as the user says: every change is a line of the account, and the raw forces are kept."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.quality import noise_of
from data_io.record import Record, zero_of_times
from data_io.values import Finding, FloatArray

Span = tuple[float, float]
RAW: Final = {"friction_force": "raw friction force", "normal_force": "raw normal force"}
"""Channels of a corrected record that hold the forces as they were read [N]."""


@dataclass(frozen=True)
class Corrections:
    """What to cut and correct. Times in seconds of the record.

    tare, normal_tare: a force [N] to subtract, or the (start, stop) [s] over which the signal is averaged while nothing
    rubs; what crosstalk and tilt make of a load there is no part of the zero.
    crosstalk: share of the normal force that the friction sensor shows. tilt [rad]: by how much the surface climbs
    along positive friction force.
    window: the part to use; exclude: parts to leave out.
    """

    tare: float | Span | None = None
    normal_tare: float | Span | None = None
    crosstalk: float | None = None
    tilt: float | None = None
    window: Span | None = None
    exclude: tuple[Span, ...] = ()


@dataclass(frozen=True)
class Change:
    """One line of the account: which correction, in words, and its number with unit and standard error."""

    kind: str
    text: str
    value: float | None = None
    unit: str = ""
    standard_error: float | None = None


@dataclass(frozen=True)
class Corrected:
    """record: with corrected forces; the raw ones stand in its channels `RAW`, if a force was changed. used (n,): rows
    that count. changes: the account. What is doubtful about it stands among the findings of the record."""

    record: Record
    used: npt.NDArray[np.bool_]
    changes: tuple[Change, ...]


def correct(record: Record, given: Corrections) -> Corrected:
    """Apply the corrections to a record; the record itself is not changed.

    Raises `LogError` for an interval that holds no sample.
    """
    friction, normal = record.friction_force, record.normal_force
    changes: list[Change] = []
    doubts: list[Finding] = []
    if given.normal_tare is not None:
        zero, doubt = _zero(record, normal, given.normal_tare, "normal")
        normal = normal - (zero.value or 0.0)
        changes, doubts = [zero], doubt
    if given.tare is not None:
        share = (given.crosstalk or 0.0) + float(np.tan(given.tilt or 0.0))  # what the load shows is no zero
        zero, doubt = _zero(record, friction - share * normal if share else friction, given.tare, "friction")
        friction = friction - (zero.value or 0.0)
        changes, doubts = [*changes, zero], [*doubts, *doubt]
    if given.crosstalk is not None:
        friction = friction - given.crosstalk * normal
        text = f"{100 * given.crosstalk:.3g} % of the normal force taken off the friction force (crosstalk), as given"
        changes.append(Change("crosstalk", text, given.crosstalk))
    if given.tilt is not None:
        cos, sin = np.cos(given.tilt), np.sin(given.tilt)
        friction, normal = friction * cos - normal * sin, normal * cos + friction * sin
        text = f"forces turned by {np.degrees(given.tilt):.3g}° into the tilted surface, as given"
        changes.append(Change("tilt", text, given.tilt, "rad"))
    time, end = record.time, float(record.time[-1])
    used = np.ones(time.size, dtype=bool)
    if given.window is not None:
        start, stop = given.window
        used &= (time >= start) & (time <= stop)
        changes.append(Change("window", f"only {start:g} to {stop:g} s of {end:.6g} s used, as given"))
    for start, stop in given.exclude:
        used &= (time < start) | (time > stop)
        changes.append(Change("exclude", f"{start:g} to {stop:g} s left out, as given"))
    new = {"friction_force": friction, "normal_force": normal}
    raw = {RAW[role]: own for role, values in new.items() if values is not (own := getattr(record, role))}
    corrected = (
        record
        if not raw
        else replace(
            record,
            friction_force=friction,
            normal_force=normal,
            channels={**record.channels, **raw},
            channel_units={**record.channel_units, **dict.fromkeys(raw, "N")},
            findings=(*record.findings, *doubts),
        )
    )
    return Corrected(corrected, used, tuple(changes))


def _zero(record: Record, values: FloatArray, tare: float | Span, which: str) -> tuple[Change, list[Finding]]:
    """Return the zero of a force (n,) [N] as a line of the account, and a finding where something moves meanwhile."""
    kind, name = "tare" if which == "friction" else "normal_tare", f"{which} force"
    if not isinstance(tare, tuple):
        return Change(kind, f"{tare:.4g} N taken off the {name}, as given", float(tare), "N"), []
    rows = (record.time >= tare[0]) & (record.time <= tare[1]) & np.isfinite(values)
    if not rows.any():
        raise record.error(
            f"the tare interval {tare[0]:g} to {tare[1]:g} s holds no sample; the record runs from 0 to "
            f"{record.time[-1]:g} s{zero_of_times(record)}: move it inside"
        )
    time, inside = record.time[rows], values[rows]
    zero, spread = float(np.mean(inside)), float(np.std(inside))
    text = f"{zero:.4g} N taken off the {name}: its mean from {tare[0]:g} to {tare[1]:g} s"
    change = Change(kind, text, zero, "N", spread / float(np.sqrt(inside.size)))
    noise = noise_of(values[np.isfinite(values)])
    drift = float(np.ptp(np.polyval(np.polyfit(time - time[0], inside, 1), time - time[0]))) if time.size > 2 else 0.0
    if max(spread, drift) <= 5.0 * noise:
        return change, []
    text = (
        f"the {name} moves in the tare interval {tare[0]:g} to {tare[1]:g} s (by {max(drift, spread):.3g} N; "
        f"its noise is {noise:.2g} N): choose a stretch before anything touches or moves"
    )
    return change, [Finding("tare_not_quiet", "warning", text)]
