"""What one record measures of a rig: a ring-down, or the stiffness of its sticks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.base.errors import IdentifyError
from identify.base.quantiles import NORMAL, student
from identify.base.wording import speed_text, three_figures
from identify.bench.ringdown import FEWEST_SAMPLES, FEWEST_SWINGS, RingDown, ring_downs
from identify.logs.draft import DraftLog, look
from identify.logs.noise import line_slope
from identify.logs.recorded_drive import UNTOLD, recorded_drive

Array = NDArray[np.float64]

RISE = 0.2, 0.8  # of the way from rest to the level that a ramp reaches: its straight part
FEWEST_ROWS = 8  # of a ramp
BENT = 0.1  # by how much the two halves of a ramp may differ in slope


@dataclass(frozen=True)
class Measured:
    """One figure of a rig from one record.

    kind: "frequency" (natural, undamped [rad/s]), "zeta", "stiffness" [N/m], "series" (stiffness with the skin in
    series [N/m]) or "mass" [kg]; value, and error: standard error, relative; added: mass [kg] that was fixed to the
    rig; by_speed: whether an error of the drive speed is one of the figure; source: where it is from, in words.
    """

    kind: str
    value: float
    error: float
    source: str
    added: float = 0.0
    by_speed: bool = False


def rings(record: Record, name: str, added: float = 0.0) -> list[Measured]:
    """Natural frequency and damping ratio of every tap of a record; none where nothing rings down.

    Raises:
        IdentifyError: too few samples per swing.
    """
    try:
        taps = ring_downs(record.time, record.friction_force)
    except IdentifyError as reason:
        raise IdentifyError(f"{name}: {reason}") from None
    return [m for number, tap in enumerate(taps, 1) for m in _of_tap(tap, _tap_name(name, number, len(taps)), added)]


def _tap_name(name: str, number: int, count: int) -> str:
    return f"{name}, tap {number}" if count > 1 else name


def _of_tap(tap: RingDown, name: str, added: float) -> list[Measured]:
    shown = f"{name}: rings at {three_figures(tap.frequency / (2 * np.pi))} Hz for {tap.swings:.0f} swings"
    if tap.dry:
        shown += f", which die along a straight line: a guide rubs with {three_figures(tap.dry)} N"
    measured = [Measured("frequency", tap.frequency, tap.frequency_error, shown, added)]
    if tap.zeta_error < 1.0:
        measured.append(Measured("zeta", tap.zeta, tap.zeta_error, shown, added))
    return measured


def sticks(record: Record, path: Path, speed: float | None, on_skin: bool = False) -> list[Measured]:
    """The stiffness that the sticks of a record, or one slow pull, show.

    Args:
        speed: of the drive [m/s]; None: as the record has it.

    Raises:
        IdentifyError: no drive speed, or no straight rise.
    """
    seen = look(DraftLog(path, None, record)).seen
    recorded = recorded_drive(record)
    drive = recorded.speed if speed is None else speed
    if not drive:
        why = "" if recorded.trouble == UNTOLD else f" ({recorded.trouble})"
        raise IdentifyError(
            f"{path.name}: no tap rings down in it, and it does not hold its drive speed{why}, which turns the slope "
            f'of a stick into a stiffness; for a pull give --drive-speed "{path.name}=0.1 mm/s"; a tap needs '
            f"{FEWEST_SWINGS:.0f} swings above the noise with {FEWEST_SAMPLES:.0f} samples each: sample faster"
        )
    slopes = np.abs(np.concatenate([verdict.found.stick_slopes for verdict in seen.verdicts] or [np.empty(0)]))
    if slopes.size >= 2:
        slope, error = float(np.median(slopes)), _error_of_median(slopes)
        shown = f"{slopes.size} sticks rise at {three_figures(slope)} N/s"
    else:
        slope, error = _ramp(record.time, record.friction_force, path.name)
        shown = f"a ramp rises at {three_figures(slope)} N/s"
    source = f"{path.name}: {shown} at {speed_text(drive)}{', on skin' if on_skin else ''}"
    return [Measured("series" if on_skin else "stiffness", slope / drive, error, source, by_speed=True)]


def _error_of_median(values: Array) -> float:
    """Relative standard error of the median of some values, from their scatter; pi/2 is the price of a median."""
    spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
    count = values.size
    widened = float(student(0.975, count - 1)) / NORMAL
    return widened * spread * float(np.sqrt(0.5 * np.pi / count)) / float(np.median(values))


def _ramp(time: Array, force: Array, name: str) -> tuple[float, float]:
    """Slope [N/s] of a rise from rest to a level, and its relative standard error.

    Raises:
        IdentifyError: no rise, or one that is not straight.
    """
    good = np.isfinite(force)
    time, force = time[good], force[good]
    force = force * (1.0 if np.sum(force - force[0]) >= 0.0 else -1.0)
    low, high = np.quantile(force, (0.02, 0.98))
    levels = [low + share * (high - low) for share in RISE]
    top = int(np.argmax(force >= levels[1]))
    below = np.flatnonzero(force[: top + 1] <= levels[0])
    first = int(below[-1]) + 1 if below.size else 0
    refused = (
        f"{name} holds neither a tap that rings down, nor two sticks, nor a straight rise of the force; record one of "
        "these: a tap with the drive at rest, or a slow pull on a rigid block"
    )
    if top - first < FEWEST_ROWS:
        raise IdentifyError(refused)
    t, f = time[first : top + 1], force[first : top + 1]
    line = np.polyfit(t - t[0], f, 1)
    noise = float(np.std(f - np.polyval(line, t - t[0]), ddof=2))
    half = t.size // 2
    halves = [line_slope(t[part], f[part], noise) for part in (slice(half), slice(half, None))]
    error = noise / (np.sqrt(t.size) * float(np.std(t)))
    # A line through half the rows is known to sqrt(8) times the error of the whole.
    if not line[0] > 0.0 or abs(halves[1] - halves[0]) > BENT * line[0] + 4.0 * np.sqrt(16.0) * error:
        raise IdentifyError(refused)
    lean = float(np.hypot(abs(halves[1] - halves[0]) / 4.0, error))  # a bend is part of what is not known of it
    return float(line[0]), lean / float(line[0])
