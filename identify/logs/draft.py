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
from identify.logs.judgement import RecordPart, judge
from identify.logs.recorded_drive import RecordedDrive, drive_of, recorded_drive, velocity_in_head, velocity_text
from identify.logs.regime import LogRegime, Regime, joined
from identify.logs.regime import look as look_at
from identify.scene.toml import to_fill_in

EFFECTS = (*MAIN, "varying_normal_force")
FEWEST_CYCLES = 2
FEWEST_ROWS = 20  # of a stretch of one speed in which sticks are looked for


@dataclass(frozen=True)
class DraftLog:
    """One log, or one step of a log that has several (`step` None: all of it)."""

    path: Path
    step: int | None
    record: Record


@dataclass(frozen=True)
class Told:
    """What one piece shows, SI. seen: its regime; stiffnesses [N/m]: of every stick, its slope over the speed that
    holds in it, empty where the speed is not known; slope [N/s]: of a typical stick, None without one; slides: nearly
    throughout; rejected: why the quality gate rejects it, "" where it does not."""

    piece: DraftLog
    drive: RecordedDrive
    seen: LogRegime
    cycles: int
    slope: float | None
    stiffnesses: tuple[float, ...]
    noise: float
    slides: bool
    rejected: str

    @property
    def stiffness(self) -> float | None:
        """Series stiffness [N/m]: while the contact sticks, the force rises at stiffness times drive speed."""
        return float(np.median(self.stiffnesses)) if self.stiffnesses else None

    @property
    def left_out(self) -> str:
        """Why a draft leaves it out, "" where it does not."""
        if self.rejected:
            return f"rejected by the quality gate: {self.rejected}"
        if self.cycles >= FEWEST_CYCLES:
            return ""
        if self.drive.stands:
            return "the drive stands"
        return "" if self.slides else f"{self.cycles} stick-slip cycles, and it does not slide"


@dataclass(frozen=True)
class Draft:
    """The text of a first scene file, the dotted keys left to fill in, and a sentence for each log left out."""

    text: str
    to_fill_in: tuple[str, ...]
    left_out: tuple[str, ...]


def draft(pieces: Sequence[DraftLog], folder: Path, said: Mapping[str, object], rig: Path | None = None) -> Draft:
    """A first scene file of some logs.

    Args:
        pieces: the logs, one entry per step where a log has several.
        folder: where the scene file will stand; log paths are written relative to it.
        said: how the logs were read (step, columns, units, normal_force), repeated in each log.
        rig: the file of a measured rig, which the scene then takes.
    """
    logs = [look(piece) for piece in pieces]
    used = [log for log in logs if not log.left_out] or logs
    loads = [log.piece.record.normal_force for log in used]
    measured = any(np.ptp(load[np.isfinite(load)]) > 0.0 for load in loads)
    effects = ", ".join(json.dumps(name) for name in (EFFECTS if measured else MAIN))
    lines = [
        "# A first scene, written from the logs below by: stickslip scene",
        "# Everything marked TODO is for you to fill in. A quantity is text with a unit, or a bare SI number.",
        f"effects = [{effects}]{'   # friction follows the measured load' if measured else ''}",
        "",
        *(_rig_lines(used) if rig is None else [f"rig = {_located(rig, folder)}   # as measured: stickslip rig"]),
        "",
        "[parameters]   # all optional: start, lower, upper, fixed, prior = { mean = …, sd = … }",
        "# mu_s = { start = 0.6 }",
        '# mass = { lower = "0.05 kg", upper = "0.5 kg" }   # a rig quantity named here is estimated',
    ]
    left_out = []
    for i, log in enumerate(logs):
        rest = next((o for o in reversed(logs[:i]) if o.drive.stands and o.piece.path == log.piece.path), None)
        if log in used:
            lines += ["", *_log_lines(log, folder, said, rest)]
        else:
            name = log.piece.path.name + ("" if log.piece.step is None else f" step {log.piece.step}")
            left_out.append(f"{name}: {log.left_out}")
            lines += ["", f"# left out: {name} ({_facts(log)}): {log.left_out}"]
    text = "\n".join([*lines, ""])
    return Draft(text, tuple(to_fill_in(tomllib.loads(text))), tuple(left_out))


def look(piece: DraftLog) -> Told:
    """Drive, regime, stick slopes and noise of one piece."""
    record, drive = piece.record, recorded_drive(piece.record)
    seen = look_at(record, drive_of(record, drive))
    pairs = list(zip(seen.strokes, seen.verdicts, strict=True))
    moving = [(v, s.speed) for s, v in pairs if s.stop - s.start >= FEWEST_ROWS]
    cycles = sum(verdict.found.count for verdict, _ in moving if verdict.regime is not None and verdict.regime.slips)
    slides = cycles < FEWEST_CYCLES and any(verdict.regime is Regime.SLIDING for verdict, _ in moving)
    slopes = [(slope, speed) for verdict, speed in moving for slope in verdict.found.stick_slopes.tolist()]
    # first rises where there is no stick; but one into sliding bends
    slopes = slopes or [(v.found.loading_slope, speed) for v, speed in moving if v.found.loading_slope is not None]
    slopes = [] if slides else slopes
    whole = joined([(stroke.start, verdict.found) for stroke, verdict in pairs], len(record))
    signs = np.ones(len(record))
    for stroke in seen.strokes:
        signs[stroke.start :] = stroke.direction
    return Told(
        piece=piece,
        drive=drive,
        seen=seen,
        cycles=cycles,
        slope=float(np.median([slope for slope, _ in slopes])) if slopes else None,
        stiffnesses=tuple(slope / speed for slope, speed in slopes if speed),
        noise=whole.noise,
        slides=slides,
        rejected=judge(record, [RecordPart(record.time, signs * record.friction_force, whole)]).reason,
    )


def _rig_lines(logs: Sequence[Told]) -> list[str]:
    known = [log.stiffness for log in logs if log.stiffness is not None]
    stiffness = 'stiffness = "TODO N/m"   # k of rig, holder and specimen along the drive'
    if known:
        stiffness = (
            f'stiffness = {{ value = "{np.median(known):.4g} N/m", tolerance = "1 %" }}   '
            f"# k, from the stick slopes over the speeds: {', '.join(f'{k:.4g}' for k in known)} N/m"
        )
    return [
        '[rig]   # a tolerance can be stated: mass = { value = "0.2 kg", tolerance = "2 %" }',
        'mass = "TODO kg"   # moving mass of the specimen and its holder',
        stiffness,
        'zeta = "TODO"   # damping ratio: tap the holder, drive at rest; if n swings later 1/e is left, 1/(2 pi n)',
        "# instead of zeta: log_decrement, loss_factor (= 2 zeta), or damping, which is a dashpot in N s/m or the h of",
        '# eq. 1 in N/m (h = 2 zeta k = dashpot times sqrt(k/m)): damping = "147 N/m"',
    ]


def _log_lines(log: Told, folder: Path, said: Mapping[str, object], rest: Told | None) -> list[str]:
    """The entry of a piece; rest: the step before it in which the drive stands."""
    piece = log.piece
    lines = [f"# {_facts(log)}", "[[logs]]", f"path = {_located(piece.path, folder)}"]
    if log.slides:
        lines.insert(1, "# it slides: it tells the friction at its speed, and with slower logs a and delta_mu_k")
    options = dict(said) if piece.step is None else {**said, "step": piece.step}
    lines += [_drive_line(log), *(f"{key} = {_toml(value)}" for key, value in options.items())]
    lines.append(f'# noise = "{1e3 * log.noise:.3g} mN"   # estimated from the log; taken anew at every fit')
    if rest is not None:
        zero = float(np.nanmedian(rest.piece.record.friction_force))
        lines.append(
            f'# tare = "{1e3 * zero:.3g} mN"   # what the force shows in step {rest.piece.step}, where the drive '
            "stands: its zero, if nothing pulls there"
        )
    if "normal_force" not in said and not np.isfinite(piece.record.normal_force).all():
        lines.append("# normal_force has gaps")
    return [*lines, '# labels = { material = "…", volunteer = "…" }']


def _located(path: Path, folder: Path) -> str:
    """A path as a scene file in that folder gives it."""
    return json.dumps(os.path.relpath(path.absolute(), folder.absolute()).replace(os.sep, "/"), ensure_ascii=False)


def _drive_line(log: Told) -> str:
    programme = log.drive.programme
    if programme is None:
        slope = "" if log.slope is None else f"; the force rises at {log.slope:.4g} N/s in stick, that is k times it"
        head = velocity_in_head(log.piece.record)
        states = "" if head is None else f"the head of the log says {velocity_text(head)}; "
        return f'drive_speed = "TODO mm/s"   # {states}{log.drive.trouble}{slope}'
    if log.drive.speed is not None:
        return f'drive_speed = "{speed_text(log.drive.speed)}"   # {log.drive.source}: check it'
    pairs = ", ".join(f'[{start:.6g}, "{speed_text(speed)}"]' for start, speed in programme)
    return f"drive_speed = [{pairs}]   # [start in s, speed], {log.drive.source}: check it"


def _facts(log: Told) -> str:
    record = log.piece.record
    regime = "nothing moves" if log.seen.regime is None else log.seen.regime.value.replace("_", " ")
    return (
        f"{len(record)} samples at {describe_sampling(record)[0].rate:.4g} Hz, {record.time[-1]:.4g} s; normal force "
        f"{float(np.nanmedian(record.normal_force)):.4g} N; {log.cycles} stick-slip cycles; {regime}"
    )


def _toml(value: object) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key)} = {_toml(item)}" for key, item in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)
