"""A first scene file from what the logs tell; what they do not tell is marked TODO."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.detection.segment import segment
from identify.effects import MAIN
from identify.scene.toml import to_fill_in
from identify.speeds import speed_scale

Array = NDArray[np.float64]

EFFECTS = (*MAIN, "varying_normal_force")
FEWEST_CYCLES = 2
STEADY = 0.02  # relative scatter up to which a recorded speed counts as one speed
ROUNDED = 1e-9  # of its values: a position that varies by less stands still


@dataclass(frozen=True)
class Piece:
    """One log, or one step of a log that has several (`step` None: all of it)."""

    path: Path
    step: int | None
    record: Record


@dataclass(frozen=True)
class Told:
    """What one piece tells, SI. `speed` and `slope` are None where it does not tell."""

    piece: Piece
    speed: float | None
    speed_source: str
    cycles: int
    slope: float | None
    noise: float

    @property
    def stiffness(self) -> float | None:
        """Series stiffness [N/m]: while the contact sticks, the force rises at stiffness times drive speed."""
        return None if self.slope is None or self.speed is None else self.slope / self.speed


def draft(pieces: Sequence[Piece], folder: Path, said: Mapping[str, Any]) -> tuple[str, list[str]]:
    """The text of a first scene file, and the dotted keys that are left to fill in.

    Args:
        pieces: the logs, one entry per step where a log has several.
        folder: where the scene file will stand; log paths are written relative to it.
        said: how the logs were read (step, columns, units, normal_force), repeated in each log.
    """
    told = [look(piece) for piece in pieces]
    used = [t for t in told if t.cycles >= FEWEST_CYCLES] or told
    lines = [
        "# A first scene, written from the logs below by: stickslip scene",
        "# Everything marked TODO is for you to fill in. A quantity is text with a unit, or a bare SI number.",
        f"effects = [{', '.join(json.dumps(name) for name in EFFECTS)}]   # friction follows the measured load",
        "",
        *_rig_lines(used),
        "",
        "[parameters]   # all optional: start, lower, upper, fixed, prior = { mean = …, sd = … }",
        "# mu_s = { start = 0.6 }",
        '# mass = { lower = "0.05 kg", upper = "0.5 kg" }   # a rig quantity named here is estimated',
    ]
    for t in told:
        lines += ["", *_log_lines(t, folder, said)] if t in used else ["", _left_out(t)]
    text = "\n".join([*lines, ""])
    return text, list(to_fill_in(tomllib.loads(text)))


def look(piece: Piece) -> Told:
    """Speed, cycles, stick slope and noise of one piece."""
    record = piece.record
    force = record.friction_force * (np.sign(np.nanmedian(record.friction_force)) or 1.0)
    found = segment(record.time, force)
    slope = found.stick_slope
    speed, source = told_speed(record)
    return Told(piece, speed, source, found.count, slope and slope[0], found.noise)


def told_speed(record: Record) -> tuple[float | None, str]:
    """The drive speed [m/s] that the record tells, and where it says so."""
    if record.drive_speed is not None:
        return abs(float(np.median(record.drive_speed))) or None, "as the log says"
    for name, unit in record.channel_units.items():
        values = record.channels[name]
        if unit == "m/s" and _is_steady(values):
            return abs(float(np.median(values))), f"from column {name}"
    rates = {}
    for name, unit in record.channel_units.items():
        values = record.channels[name]
        if unit == "m" and np.all(np.isfinite(values)) and np.ptp(values) > ROUNDED * np.max(np.abs(values)):
            rate, start = np.polyfit(record.time, values, 1)
            if np.std(values - (start + rate * record.time)) < STEADY * np.std(values):
                rates[name] = abs(float(rate))
    if not rates:
        return None, ""
    fastest = max(rates, key=lambda name: rates[name])  # others creep or wear while the drive moves
    return rates[fastest], f"from the slope of column {fastest}"


def _is_steady(values: Array) -> bool:
    middle = abs(float(np.median(values)))
    return bool(middle > 0 and np.all(np.isfinite(values)) and np.std(values) < STEADY * middle)


def _rig_lines(told: Sequence[Told]) -> list[str]:
    known = [t.stiffness for t in told if t.stiffness is not None]
    if known:
        listed = ", ".join(f"{k:.4g}" for k in known)
        stiffness = (
            f'stiffness = {{ value = "{np.median(known):.4g} N/m", tolerance = "1 %" }}   '
            f"# k, from the stick slopes over the speeds: {listed} N/m"
        )
    else:
        stiffness = 'stiffness = "TODO N/m"   # k of rig, holder and specimen along the drive'
    return [
        '[rig]   # a tolerance can be stated: mass = { value = "0.2 kg", tolerance = "2 %" }',
        'mass = "TODO kg"   # moving mass of the specimen and its holder',
        stiffness,
        'damping = "TODO N/m"   # h of eq. 1; or one of zeta, loss_factor, log_decrement (of the ringing after a tap)',
    ]


def _log_lines(told: Told, folder: Path, said: Mapping[str, Any]) -> list[str]:
    piece, record = told.piece, told.piece.record
    path = os.path.relpath(piece.path.absolute(), folder.absolute()).replace(os.sep, "/")
    lines = [f"# {_facts(told)}", "[[logs]]", f"path = {json.dumps(path, ensure_ascii=False)}"]
    if told.speed is not None:
        lines.append(f'drive_speed = "{speed_text(told.speed)}"   # {told.speed_source}: check it')
    else:
        slope = "" if told.slope is None else f"; the force rises at {told.slope:.4g} N/s in stick, that is k times it"
        lines.append(f'drive_speed = "TODO mm/s"   # the log does not tell it{slope}')
    options = dict(said) if piece.step is None else {**said, "step": piece.step}
    lines += [f"{key} = {_toml(value)}" for key, value in options.items()]
    lines.append(f'# noise = "{1e3 * told.noise:.3g} mN"   # estimated from the log; taken anew at every fit')
    if "normal_force" not in said and not np.isfinite(record.normal_force).all():
        lines.append("# normal_force has gaps")
    return [*lines, '# labels = { material = "…", volunteer = "…" }']


def _facts(told: Told) -> str:
    record = told.piece.record
    rate = 1.0 / float(np.median(np.diff(record.time)))
    load = float(np.nanmedian(record.normal_force))
    return (
        f"{len(record)} samples at {rate:.4g} Hz, {record.time[-1]:.4g} s; normal force {load:.4g} N; "
        f"{told.cycles} stick-slip cycles"
    )


def _left_out(told: Told) -> str:
    step = "" if told.piece.step is None else f" step {told.piece.step}"
    return f"# left out: {told.piece.path.name}{step} ({_facts(told)})"


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key)} = {_toml(item)}" for key, item in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)


def speed_text(speed: float) -> str:
    """A speed [m/s] as it stands on the dial: "0.1 mm/min", "5 mm/s"."""
    unit, size = speed_scale(speed)
    return f"{speed / size:.4g} {unit}"
