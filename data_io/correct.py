"""Cut and correct a record as the user says: every change is a line of the account, and the raw forces are kept."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from data_io.arrays import true_runs
from data_io.record import Record, zero_of_times
from data_io.signals import noise_of
from data_io.values import Finding, FloatArray

# Crosstalk and tilt from the two directions of a reciprocating test: what does not change sign with the motion.

FEWEST: Final = 20
"""Rows of a stroke that is worth a mean."""
_MIDDLE: Final = (0.25, 0.95)
"""Part of a stroke that is averaged: behind the turn the spring is still being loaded the other way."""
_CLEAR: Final = 0.3
"""Share of the swing of the ratio between both directions that counts as a direction."""
_TURNING: Final = 0.4
"""Share of the rows that may lie between both directions: the turns. A saw-tooth of one direction has 0.75."""
_WIDTH: Final = 0.01


@dataclass(frozen=True)
class BothWays:
    """A mean over pairs of neighbouring strokes, its standard error (None with one pair), and how many pairs."""

    value: float
    standard_error: float | None
    pairs: int


def crosstalk(friction: FloatArray, normal: FloatArray) -> BothWays | None:
    """Return c of `friction measured = friction + c * normal`, None where the record does not go both ways.

    Forward and backward the ratio of the forces is c + mu and c - mu: their mean is c. Both forces (n,) [N], tare
    taken off, NaN where they do not count.
    """
    return _mean_of_pairs(_ratios(friction, normal))


def tilt(friction: FloatArray, normal: FloatArray) -> BothWays | None:
    """Return the angle [rad] by which the surface climbs along positive friction force; arguments as `crosstalk`.

    In the axes of the machine the ratio of the forces is tan(phi + angle) forward and tan(-phi + angle) backward, with
    the angle of friction phi: the mean of their arcs is the angle, however large phi is.
    """
    return _mean_of_pairs([(sign, float(np.arctan(ratio))) for sign, ratio in _ratios(friction, normal)])


def levelled(friction: FloatArray, normal: FloatArray, angle: float) -> tuple[FloatArray, FloatArray]:
    """Return friction and normal force along and across a surface that is tilted by an angle [rad] to the machine."""
    cos, sin = np.cos(angle), np.sin(angle)
    return friction * cos - normal * sin, normal * cos + friction * sin


def _ratios(friction: FloatArray, normal: FloatArray) -> list[tuple[int, float]]:
    """Return direction and mean friction over mean normal force of the middle of every stroke."""
    found = []
    for start, stop, sign in _strokes(friction, normal):
        rows = slice(start + int(_MIDDLE[0] * (stop - start)), start + int(_MIDDLE[1] * (stop - start)))
        good = np.isfinite(friction[rows]) & np.isfinite(normal[rows])
        if np.count_nonzero(good) >= FEWEST and (load := float(np.mean(normal[rows][good]))) > 0:
            found.append((sign, float(np.mean(friction[rows][good])) / load))
    return found


def _strokes(friction: FloatArray, normal: FloatArray) -> list[tuple[int, int, int]]:
    """Return rows [start, stop) and direction of every stroke, by the side of the middle on which the ratio stays."""
    load = float(np.nanmedian(normal))
    if not load > 0:
        return []
    rows = np.arange(friction.size)
    good = np.isfinite(friction) & np.isfinite(normal) & (normal > 0.5 * load)
    if np.count_nonzero(good) < 4 * FEWEST:
        return []
    ratio = np.interp(rows, rows[good], friction[good] / normal[good])
    width = max(int(_WIDTH * friction.size), 3) | 1
    ratio = np.convolve(np.pad(ratio, width // 2, mode="edge"), np.ones(width) / width, mode="valid")
    low, high = (float(q) for q in np.quantile(ratio, [0.1, 0.9]))
    middle, clear = 0.5 * (low + high), _CLEAR * (high - low)
    if not (low < middle - clear and high > middle + clear):
        return []
    if np.mean(np.abs(ratio - middle) < clear) > _TURNING:
        return []  # it swings through the middle and dwells on neither side: stick-slip one way
    sides = ((1, ratio > middle + clear), (-1, ratio < middle - clear))
    runs = ((int(a), int(b), sign) for sign, rows in sides for a, b in true_runs(rows))
    return sorted(run for run in runs if run[1] - run[0] >= FEWEST)


def _mean_of_pairs(strokes: list[tuple[int, float]]) -> BothWays | None:
    """Return the mean over pairs of neighbours of opposite sign; every stroke stands in one pair only."""
    pairs, i = [], 0
    while i + 1 < len(strokes):
        (one, a), (other, b) = strokes[i], strokes[i + 1]
        if one == -other:
            pairs.append(0.5 * (a + b))
        i += 2 if one == -other else 1
    if not pairs:
        return None
    error = float(np.std(pairs, ddof=1) / np.sqrt(len(pairs))) if len(pairs) > 1 else None
    return BothWays(float(np.mean(pairs)), error, len(pairs))


Span = tuple[float, float]
STROKES: Final = "strokes"
"""What stands in place of a number where crosstalk or tilt are to be taken from both stroke directions."""
RAW: Final = {"friction_force": "raw friction force", "normal_force": "raw normal force"}
"""Channels of a corrected record that hold the forces as they were read [N]."""
_UNLOADED: Final = 0.1
"""Share of the load below which nothing presses."""
_RESTLESS: Final = 5.0
"""Standard deviations of the noise that a quiet interval may drift or scatter by."""


@dataclass(frozen=True)
class Corrections:
    """What to cut and correct. Times in seconds of the record.

    tare, normal_tare: a force [N] to subtract, or the (start, stop) [s] over which the signal is averaged while nothing
    rubs; what crosstalk and tilt make of a load there is no part of the zero.
    crosstalk: share of the normal force that the friction sensor shows. tilt [rad]: by how much the surface climbs
    along positive friction force. Both may be "strokes": taken from the two directions of the record.
    window: the part to use; exclude: parts to leave out.
    """

    tare: float | Span | None = None
    normal_tare: float | Span | None = None
    crosstalk: float | Literal["strokes"] | None = None
    tilt: float | Literal["strokes"] | None = None
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
class Cut:
    """A stretch [start, stop] [s] that does not count, or from which a zero was taken ("tare"), and why."""

    kind: str
    start: float
    stop: float


@dataclass(frozen=True)
class Corrected:
    """record: with corrected forces; the raw ones stand in its channels `RAW`, if a force was changed. used (n,): rows
    that count. changes, cuts: the account. What is doubtful about it stands among the findings of the record."""

    record: Record
    used: npt.NDArray[np.bool_]
    changes: tuple[Change, ...]
    cuts: tuple[Cut, ...]


def correct(record: Record, given: Corrections) -> Corrected:
    """Apply the corrections to a record; the record itself is not changed.

    Raises `LogError` for an interval that holds no sample, both angles at once from the strokes, or a record that does
    not go both ways.
    """
    if given.crosstalk == STROKES and given.tilt == STROKES:
        raise record.error(
            "crosstalk and tilt both from the strokes was asked for; at one load they look alike: "
            "give one of them as a number"
        )
    friction, normal = record.friction_force, record.normal_force
    changes: list[Change] = []
    doubts: list[Finding] = []
    if given.normal_tare is not None:
        zero, doubt = _zero(record, normal, given.normal_tare, "normal")
        normal = normal - (zero.value or 0.0)
        changes, doubts = [zero], doubt
    if given.tare is not None:
        share = _shown_of_load(record, normal, given)
        zero, doubt = _zero(record, friction - share * normal if share else friction, given.tare, "friction")
        friction = friction - (zero.value or 0.0)
        changes, doubts = [*changes, zero], [*doubts, *doubt]
    if given.crosstalk is not None:
        share, error, source = _number(record, friction, normal, given.crosstalk, crosstalk)
        friction = friction - share * normal
        text = f"{100 * share:.3g} % of the normal force taken off the friction force (crosstalk), {source}"
        changes.append(Change("crosstalk", text, share, "", error))
    if given.tilt is not None:
        angle, error, source = _number(record, friction, normal, given.tilt, tilt)
        friction, normal = levelled(friction, normal, angle)
        text = f"forces turned by {np.degrees(angle):.3g}° into the tilted surface, {source}"
        changes.append(Change("tilt", text, angle, "rad", error))
    time, end = record.time, float(record.time[-1])
    used = np.ones(time.size, dtype=bool)
    cuts = [Cut("tare", *tare) for tare in (given.normal_tare, given.tare) if isinstance(tare, tuple)]
    if given.window is not None:
        start, stop = given.window
        used &= (time >= start) & (time <= stop)
        cuts += [Cut("window", a, b) for a, b in ((0.0, min(start, end)), (max(stop, 0.0), end)) if b > a]
        changes.append(Change("window", f"only {start:g} to {stop:g} s of {end:.6g} s used, as given"))
    for start, stop in given.exclude:
        used &= (time < start) | (time > stop)
        cuts.append(Cut("exclude", start, stop))
        changes.append(Change("exclude", f"{start:g} to {stop:g} s left out, as given"))
    return Corrected(_with_forces(record, friction, normal, doubts), used, tuple(changes), tuple(cuts))


def _shown_of_load(record: Record, normal: FloatArray, given: Corrections) -> float:
    """Return the share of the normal force that the friction sensor shows at rest, as far as it is given."""
    shares = 0.0 if given.crosstalk in (None, STROKES) else float(given.crosstalk or 0.0)
    shares += 0.0 if given.tilt in (None, STROKES) else float(np.tan(float(given.tilt or 0.0)))
    if isinstance(given.tare, tuple) and STROKES in (given.crosstalk, given.tilt):
        rows = (record.time >= given.tare[0]) & (record.time <= given.tare[1]) & np.isfinite(normal)
        if rows.any() and float(np.mean(normal[rows])) > _UNLOADED * float(np.nanmedian(normal)):
            raise record.error(
                "crosstalk or tilt from the strokes needs a zero taken without load, and the tare "
                "interval is under load; choose another interval, or give the tare as a number"
            )
    return shares


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
    if max(spread, drift) <= _RESTLESS * noise:
        return change, []
    text = (
        f"the {name} moves in the tare interval {tare[0]:g} to {tare[1]:g} s (by {max(drift, spread):.3g} N; "
        f"its noise is {noise:.2g} N): choose a stretch before anything touches or moves"
    )
    return change, [Finding("tare_not_quiet", "warning", text)]


def _number(
    record: Record,
    friction: FloatArray,
    normal: FloatArray,
    given: float | str,
    estimate: Callable[[FloatArray, FloatArray], BothWays | None],
) -> tuple[float, float | None, str]:
    """Return the number, its standard error, and where it comes from in words."""
    if given != STROKES:
        return float(given), None, "as given"
    found = estimate(friction, normal)
    if found is None:
        raise record.error(
            f"the {estimate.__name__} was to come from both stroke directions, and the record goes one way only; "
            f"give a number, or a record that goes to and fro"
        )
    pairs = "one pair of strokes" if found.pairs == 1 else f"{found.pairs} pairs of strokes"
    return found.value, found.standard_error, f"from {pairs} to and fro"


def _with_forces(record: Record, friction: FloatArray, normal: FloatArray, doubts: Sequence[Finding]) -> Record:
    """Return the record with its corrected forces; the raw ones go into channels of their own."""
    new = {"friction_force": friction, "normal_force": normal}
    raw = {RAW[role]: getattr(record, role) for role, values in new.items() if values is not getattr(record, role)}
    if not raw:
        return record
    return replace(
        record,
        friction_force=friction,
        normal_force=normal,
        channels={**record.channels, **raw},
        channel_units={**record.channel_units, **dict.fromkeys(raw, "N")},
        findings=(*record.findings, *doubts),
    )
