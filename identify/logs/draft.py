"""A first scene file from what the logs show; what they do not show is marked TODO."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_io import Record
from data_io.quality import describe_sampling
from identify.base.wording import speed_text
from identify.effects import MAIN
from identify.logs.drive_changes import drive_changes, summary
from identify.logs.judgement import RecordPart, judge
from identify.logs.noise import FEWEST_ROWS
from identify.logs.recorded_drive import (
    RecordedDrive,
    drive_of,
    mentioned_speed,
    recorded_drive,
    velocity_in_head,
    velocity_text,
)
from identify.logs.regime import Regime, joined, look
from identify.logs.segment import jumps, sensor_place
from identify.scene.toml import to_fill_in

FEWEST_CYCLES = 2
HEAD = """# A first scene, written from the logs below by: stickslip scene
# Everything marked TODO is for you to fill in. A quantity is text with a unit, or a bare SI number.
"""
PARAMETERS = """
[parameters]   # all optional: start, lower, upper, fixed, prior = { mean = …, sd = … }
# mu_s = { start = 0.6 }
# mass = { lower = "0.05 kg", upper = "0.5 kg" }   # a rig quantity named here is estimated
"""
RIG = """[rig]   # a tolerance can be stated: mass = { value = "0.2 kg", tolerance = "2 %" }
mass = "TODO kg"   # moving mass of the specimen and its holder
STIFFNESS
zeta = "TODO"   # damping ratio: tap the holder, drive at rest; if n swings later 1/e is left, 1/(2 pi n)
# instead of zeta: log_decrement, loss_factor (= 2 zeta), or the h of eq. 1 (h = 2 zeta k, of a dashpot c
# h = c sqrt(k/m)): damping = "147 N/m"
SENSOR
"""
SENSORS = {
    True: 'force_sensor = "counterface"   # the force jumps at many drops, as a plate there shows it; else "drive"',
    False: '# force_sensor = "counterface"   # where a plate there measures the force, and no load cell at the drive',
}


@dataclass(frozen=True)
class DraftLog:
    """One log, or one step of a log that has several (`step` None: all of it)."""

    path: Path
    step: int | None
    record: Record


@dataclass(frozen=True)
class Draft:
    """The text of a first scene file, the dotted keys left to fill in, and a sentence for each log left out."""

    text: str
    to_fill_in: tuple[str, ...]
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class _Seen:
    """What one piece shows, SI. stiffness [N/m]: while the contact sticks, the force rises at stiffness times drive
    speed; slope [N/s]: of a typical stick; None without one, or an unknown speed; jumps: how many drops of the force
    are jumps, and how many drops there are; left_out: why it is, "" where not; changes: its holds and speed steps."""

    piece: DraftLog
    drive: RecordedDrive
    facts: str
    slope: float | None
    stiffness: float | None
    noise: float
    slides: bool
    jumps: tuple[int, int]
    left_out: str
    changes: str


def draft(pieces: Sequence[DraftLog], folder: Path, options: Mapping[str, object], rig: Path | None = None) -> Draft:
    """A first scene file of some logs.

    Args:
        pieces: the logs, one entry per step where a log has several.
        folder: where the scene file will stand; log paths are written relative to it.
        options: how the logs were read (step, columns, units, normal_force), repeated in each log.
        rig: the file of a measured rig, which the scene then takes.
    """
    logs = [_seen(piece) for piece in pieces]
    used = [log for log in logs if not log.left_out] or logs
    loads = [log.piece.record.normal_force for log in used]
    measured = any(np.ptp(load[np.isfinite(load)]) > 0.0 for load in loads)
    effects = ", ".join(json.dumps(name) for name in (*MAIN, *(["varying_normal_force"] if measured else [])))
    known = [log.stiffness for log in used if log.stiffness is not None]
    stiffness = 'stiffness = "TODO N/m"   # k of rig, holder and specimen along the drive'
    if known:
        stiffness = (
            f'stiffness = {{ value = "{np.median(known):.4g} N/m", tolerance = "1 %" }}   '
            f"# k, from the stick slopes over the speeds: {', '.join(f'{k:.4g}' for k in known)} N/m"
        )
    measured_rig = "" if rig is None else f"rig = {_located(rig, folder)}   # as measured: stickslip rig\n"
    text = HEAD + f"effects = [{effects}]{'   # friction follows the measured load' if measured else ''}\n\n"
    plate = sensor_place(*np.sum([log.jumps for log in used], axis=0).tolist()) == "counterface"
    text += (measured_rig or RIG.replace("STIFFNESS", stiffness).replace("SENSOR", SENSORS[plate])) + PARAMETERS
    left_out = []
    for i, log in enumerate(logs):
        rest = next((o for o in reversed(logs[:i]) if o.drive.stands and o.piece.path == log.piece.path), None)
        if log in used:
            text += "\n" + "\n".join(_log_lines(log, folder, options, rest)) + "\n"
        else:
            name = log.piece.path.name + ("" if log.piece.step is None else f" step {log.piece.step}")
            left_out.append(f"{name}: {log.left_out}")
            text += f"\n# left out: {name} ({log.facts}): {log.left_out}\n"
    return Draft(text, tuple(to_fill_in(tomllib.loads(text))), tuple(left_out))


def _seen(piece: DraftLog) -> _Seen:
    """Drive, regime, stick slopes and noise of one piece."""
    record, drive = piece.record, recorded_drive(piece.record)
    seen = look(record, drive_of(record, drive))
    pairs = list(zip(seen.strokes, seen.verdicts, strict=True))
    moving = [(v, s.speed) for s, v in pairs if s.stop - s.start >= FEWEST_ROWS]
    cycles = sum(verdict.phases.count for verdict, _ in moving if verdict.regime is not None and verdict.regime.slips)
    slides = cycles < FEWEST_CYCLES and any(verdict.regime is Regime.SLIDING for verdict, _ in moving)
    slopes = [(slope, speed) for verdict, speed in moving for slope in verdict.phases.stick_slopes.tolist()]
    # first rises where there is no stick; but one into sliding bends
    slopes = slopes or [(v.phases.loading_slope, speed) for v, speed in moving if v.phases.loading_slope is not None]
    slopes = [] if slides else slopes
    stiffnesses = [slope / speed for slope, speed in slopes if speed]
    whole = joined([(stroke.start, verdict.phases) for stroke, verdict in pairs], len(record))
    signs = np.ones(len(record))
    for stroke in seen.strokes:
        signs[stroke.start :] = stroke.direction
    rejected = judge(record, [RecordPart(record.time, signs * record.friction_force, whole)]).reason
    left_out = f"rejected by the quality gate: {rejected}" if rejected else ""
    if not rejected and cycles < FEWEST_CYCLES and (drive.stands or not slides):
        left_out = "the drive stands" if drive.stands else f"{cycles} stick-slip cycles, and it does not slide"
    regime = "nothing moves" if seen.regime is None else seen.regime.value.replace("_", " ")
    facts = (
        f"{len(record)} samples at {describe_sampling(record)[0].rate:.4g} Hz, {record.time[-1]:.4g} s; normal force "
        f"{float(np.nanmedian(record.normal_force)):.4g} N; {cycles} stick-slip cycles; {regime}"
    )
    slope = float(np.median([slope for slope, _ in slopes])) if slopes else None
    stiffness = float(np.median(stiffnesses)) if stiffnesses else None
    drops = jumps(record.friction_force, whole, 0.0, signs)
    changes = summary(drive_changes(record, seen))
    return _Seen(piece, drive, facts, slope, stiffness, whole.noise, slides, drops, left_out, changes)


def _log_lines(log: _Seen, folder: Path, options: Mapping[str, object], rest: _Seen | None) -> list[str]:
    """The entry of a piece; rest: the step before it in which the drive stands."""
    piece, drive = log.piece, log.drive
    lines = [f"# {log.facts}", "[[logs]]", f"path = {_located(piece.path, folder)}"]
    if log.slides:
        lines.insert(1, "# it slides: it determines the friction at its speed, and with slower logs a and delta_mu_k")
    if log.changes:
        lines.insert(1, f"# {log.changes} (holds determine t_cr and mu_s)")
    if drive.course is not None:
        lines.append(f"# its speed changes gradually, up to {speed_text(drive.course.fastest)}: taken {drive.source}")
    elif drive.programme is None:
        slope = "" if log.slope is None else f"; the force rises at {log.slope:.4g} N/s in stick, that is k times it"
        head = velocity_in_head(piece.record)
        states = "" if head is None else f"the header of the log states {velocity_text(head)}; "
        speed, place = mentioned_speed(piece.record, piece.path.name)
        states += f"its {place} says {speed}; " if speed and head is None else ""
        lines.append(f'drive_speed = "TODO mm/s"   # {states}{drive.trouble}{slope}')
    elif drive.speed is not None:
        lines.append(f'drive_speed = "{speed_text(drive.speed)}"   # {drive.source}: check it')
    else:
        pairs = ", ".join(f'[{start:.6g}, "{speed_text(speed)}"]' for start, speed in drive.programme)
        lines.append(f"drive_speed = [{pairs}]   # [start in s, speed], {drive.source}: check it")
    stated = options if piece.step is None else {**options, "step": piece.step}
    lines += [f"{key} = {_toml(value)}" for key, value in stated.items()]
    lines.append(f'# noise = "{1e3 * log.noise:.3g} mN"   # estimated from the log, again at every fit')
    if rest is not None:
        zero = float(np.nanmedian(rest.piece.record.friction_force))
        lines.append(
            f'# tare = "{1e3 * zero:.3g} mN"   # what the force shows in step {rest.piece.step}, where the drive '
            "stands: its zero, if nothing pulls there"
        )
    if "normal_force" not in options and not np.isfinite(piece.record.normal_force).all():
        lines.append("# normal_force has gaps")
    return [*lines, '# labels = { material = "…", volunteer = "…" }']


def _located(path: Path, folder: Path) -> str:
    """A path as a scene file in that folder gives it."""
    return json.dumps(os.path.relpath(path.absolute(), folder.absolute()).replace(os.sep, "/"), ensure_ascii=False)


def _toml(value: object) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key)} = {_toml(item)}" for key, item in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)
