"""What `stickslip inspect` finds in one log, in words and as a document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io import Record, Step
from data_io.record import WINDOW_START
from data_io.thresholds import DEFAULTS, Thresholds, percent
from identify.base.document import to_dict, to_document
from identify.base.result import ClassicalDirection, ClassicalTable
from identify.base.wording import DASH, columns, number, programme_text, quantity, speed, split_key, wrapped
from identify.cli.common import Terminal
from identify.cli.logs import only
from identify.logs.classical import table_of
from identify.logs.judgement import Judgement, judge
from identify.logs.log_regime import LogRegime, drive_of, joined, look, only_of
from identify.logs.recorded_drive import UNTOLD, RecordedDrive, recorded_drive
from identify.logs.regime import SURE, Known, Regime
from identify.logs.segment import SLIDING, SLIP, STICK, Segmentation
from identify.logs.slip_quality import RecordPart

HEADINGS = ("run", "step", "stroke", "regime")
MOST_STROKES = 2  # fit beside each other in 80 columns
LONGEST_NAME = 24  # of a log in the table of all, which is to fit in 80 columns


@dataclass(frozen=True)
class StepSeen:
    """One step of a log, what it says of the drive, its regime and phases; `signs` (n,): that of the sliding force in
    every row, which strokes to and fro change."""

    step: Step
    drive: RecordedDrive
    signs: NDArray[np.int64]
    seen: LogRegime
    phases: Segmentation

    @property
    def sign(self) -> int:
        """That of most rows."""
        return -1 if int(np.sum(self.signs)) < 0 else 1


@dataclass(frozen=True)
class Inspection:
    """One log: its record, the verdict on it, its steps."""

    path: str
    record: Record
    judgement: Judgement
    steps: tuple[StepSeen, ...]
    classical: ClassicalTable
    drive: RecordedDrive
    regime: LogRegime


@dataclass(frozen=True)
class StatedRig:
    """What the user says of the rig, to hold the log against; None: not said. stiffness [N/m], drive_speed [m/s],
    mass [kg]."""

    stiffness: float | None = None
    drive_speed: float | None = None
    mass: float | None = None

    @property
    def known(self) -> Known:
        """As the test of the regime takes it."""
        k, m = self.stiffness or 0.0, self.mass or 0.0
        return Known(k, half_period=float(np.pi * np.sqrt(m / k)) if k and m else 0.0)


def inspection(
    path: str, record: Record, rig: StatedRig = StatedRig(), thresholds: Thresholds = DEFAULTS
) -> Inspection:
    """Look at a record: phases step by step, then the verdict on clock, forces and slips."""
    given = rig.drive_speed
    told = recorded_drive(record, rig.stiffness or 0.0) if given is None else RecordedDrive(((0.0, given),), "given")
    drive = given if given is not None else drive_of(record, told)
    regime = look(record, drive, rig.known)
    alone = [only(record, step) for step in record.steps] if told.speed is None and len(record.steps) > 1 else []
    drives = [told if part is None else recorded_drive(part) for part in alone] or [told] * len(record.steps)
    steps = tuple(_seen(record, step, d, regime) for step, d in zip(record.steps, drives, strict=True))
    moving = [s for s in steps if not s.drive.stands]
    if 0 < len(moving) < len(steps):
        kept = [i for i, own in enumerate(regime.strokes) if any(own in s.seen.strokes for s in moving)]
        regime = only_of(regime, kept)
    parts = [_part(record, step, told.speed, rig.stiffness) for step in steps]
    table = table_of(record, regime, stiffness=rig.stiffness)
    return Inspection(path, record, judge(record, parts, thresholds), steps, table, told, regime)


def _part(record: Record, seen: StepSeen, speed: float | None, stiffness: float | None) -> RecordPart:
    rows = slice(seen.step.start, seen.step.stop)
    expected = stiffness * abs(speed) if stiffness is not None and speed else None
    force, load = seen.signs * record.friction_force[rows], record.normal_force[rows]
    return RecordPart(record.time[rows], force, seen.phases, expected, load)


def _seen(record: Record, step: Step, drive: RecordedDrive, whole: LogRegime) -> StepSeen:
    """A step with those strokes of the log that are in it."""
    own = [i for i, stroke in enumerate(whole.strokes) if step.start <= stroke.start < step.stop]
    signs = np.ones(step.stop - step.start, dtype=np.int64)
    for i in own:
        signs[whole.strokes[i].start - step.start :] = whole.strokes[i].direction
    parts = [(whole.strokes[i].start - step.start, whole.verdicts[i].found) for i in own]
    seen = only_of(whole, own)
    if drive.stands:
        level = quantity(float(np.nanmedian(record.friction_force[step.start : step.stop])), "N", 3)
        says = f"the drive stands: {drive.trouble}; the friction force shows {level} there"
        seen = replace(seen, regime=None, confidence=SURE, evidence=(says,))
    return StepSeen(step, drive, signs, seen, joined(parts, step.stop - step.start))


def say(seen: Inspection, terminal: Terminal) -> None:
    """The inspection in words."""
    record, quality = seen.record, seen.judgement.quality
    terminal.say(f"{seen.path}")
    kind = record.metadata.get("format", "unknown format")
    terminal.say(
        f"  {kind}, {len(record)} rows in {len(record.steps)} step(s), {quantity(float(record.time[-1]), 's')}, "
        f"{quality.sampling.rate:.4g} Hz"
    )
    if begin := float(record.metadata.get(WINDOW_START, 0.0)):
        text = f"window: {begin:.6g} to {begin + record.time[-1]:.6g} s of the log; times below count from its begin"
        terminal.say(wrapped(f"{text}, those of a scene from the first row of the log", "  "))
    for role in ("time", "normal_force", "friction_force"):
        if source := record.metadata.get(f"{role}_source"):
            terminal.say(f"  {role.replace('_', ' ')}: {source}")
    terminal.say(wrapped(f"other columns: {', '.join(record.channels) or 'none'}", "  "))
    terminal.say(
        f"  normal force: {quantity(quality.load.mean, 'N')}, drift {percent(quality.load.drift, 1, signed=True)}"
    )
    terminal.say(wrapped(f"drive speed: {_speed(seen)}", "  "))
    if len(seen.steps) == 1:
        _say_regime(seen.regime, terminal)
    terminal.say(f"  verdict: {seen.judgement.verdict}")
    for finding in seen.judgement.findings:
        terminal.say(wrapped(f"{finding.severity}: {finding.message}", "    "))
    for step in seen.steps:
        _say_step(step, len(seen.steps) > 1, terminal)
    _say_classical(seen.classical.rows, terminal)
    _say_directions(seen.classical.directions, terminal)
    terminal.say()


def overview(logs: Sequence[tuple[str, Inspection | None]]) -> str:
    """A line per log, by its name; None: it could not be read."""
    rows = [["log", "rate", "drive speed", "regime", "cycles", "verdict"]]
    for name, seen in logs:
        name = name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…"
        if seen is None:
            rows.append([name, DASH, DASH, DASH, DASH, "reject"])
            continue
        regime, drive_speed = seen.regime.regime, seen.drive.speed
        row = [
            name,
            f"{seen.judgement.quality.sampling.rate:.4g} Hz",
            speed(drive_speed) if drive_speed is not None else "several" if seen.drive.programme else DASH,
            DASH if regime is None else regime.value.replace("_", " "),
            str(sum(step.phases.count for step in seen.steps)),
            seen.judgement.verdict.removeprefix("accept with "),
        ]
        rows.append(row)
    return columns(rows)


def _speed(seen: Inspection) -> str:
    if seen.drive.speed is None and len(seen.steps) > 1:
        told = [f"step {s.step.number}: {_drive(s.drive)}, {s.drive.source}" for s in seen.steps if s.drive.programme]
        return "; ".join(told) or "not in the log"
    if seen.drive.programme is None:
        return f"not in the log ({seen.drive.trouble})" if seen.drive.trouble != UNTOLD else "not in the log"
    source = "" if seen.record.drive_speed is not None else f", {seen.drive.source}"
    return f"{_drive(seen.drive)}{source}"


def _drive(drive: RecordedDrive) -> str:
    return speed(drive.speed) if drive.speed is not None else programme_text(drive.programme or ())


def _say_regime(seen: LogRegime, terminal: Terminal) -> None:
    word = "none yet" if seen.regime is None else seen.regime.value.replace("_", " ")
    sure = f"{100 * seen.confidence:.0f} % sure"
    terminal.say(wrapped(f"regime: {word} ({sure}): {'; '.join(seen.evidence)}", "  "))


def _say_step(seen: StepSeen, several: bool, terminal: Terminal) -> None:
    phases, step = seen.phases, seen.step
    if several:
        given = ", ".join(f"{key} = {value}" for key, value in list(step.parameters.items())[:6])
        terminal.say(wrapped(f"step {step.number}: rows {step.start + 1} to {step.stop}; {given}", "  "))
        _say_regime(seen.seen, terminal)
    if seen.drive.stands:
        return
    stands = _stands(seen)
    shares = ", ".join(
        f"{100 * share:.1f} % {word}"
        for share, word in (
            (phases.share(STICK), "rising as in stick"),
            (phases.share(SLIP), "falling as in slip"),
            (max(phases.share(SLIDING) - stands, 0.0), "sliding"),
            *(((stands, "while the drive stands"),) if stands else ()),
        )
    )
    # The force rises on after the onset of slip, and again before the mass rests: a slip lasts longer than its fall.
    told = f"{phases.count} stick-slip cycles; force {shares}; noise {quantity(phases.noise, 'N', 3)}"
    terminal.say(wrapped(told, "  "))
    if not phases.count:
        return
    falling, cycle = number(phases.samples_per_slip, 2), number(phases.samples_per_cycle, 4)
    samples = f"{falling} samples in each fall, peak to valley, {cycle} in each cycle"
    terminal.say(wrapped(samples, "  "))


def _stands(seen: StepSeen) -> float:
    """The share of a step in which the drive of a programme stands: what no stroke holds."""
    if seen.seen.regime is not Regime.PROGRAMME:
        return 0.0
    return 1.0 - sum(stroke.stop - stroke.start for stroke in seen.seen.strokes) / (seen.step.stop - seen.step.start)


def _say_classical(strokes: Sequence[Mapping[str, Any]], terminal: Terminal) -> None:
    """The classical table, one column per stroke, the longest ones; figures that none of them has are left out."""
    longest = sorted(strokes, key=lambda stroke: stroke["samples"], reverse=True)[:MOST_STROKES]
    shown = [stroke for stroke in strokes if stroke in longest]
    rows = [["classical table", *(f"step {s['step']} stroke {s['stroke']}" for s in shown)]]
    spreads = {key.replace("_sd", "", 1): key for key in shown[0] if "_sd" in key}
    for key in (key for key in shown[0] if key not in HEADINGS and "_sd" not in key):
        name, unit = split_key(key)
        cells = [_cell(stroke.get(key), stroke.get(spreads.get(key, "")), unit) for stroke in shown]
        if any(cell != DASH for cell in cells):
            rows.append([name, *cells])
    terminal.say(columns(rows))
    if len(strokes) > len(shown):
        terminal.say(f"  … and {len(strokes) - len(shown)} strokes more: see --json")


def _say_directions(directions: Sequence[ClassicalDirection], terminal: Terminal) -> None:
    """Both directions of strokes to and fro, apart."""
    if not directions:
        return
    rows = [["all strokes", *("forth" if way.direction > 0 else "back" for way in directions)]]
    rows.append(["strokes", *(str(way.strokes) for way in directions)])
    rows.append(["coefficient", *(_cell(way.coefficient, way.coefficient_sd, "") for way in directions)])
    rows.append(["last against first tenth", *(_cell(way.trend_percent, None, "%") for way in directions)])
    terminal.say(columns(rows))


def _cell(value: float | None, sd: float | None, unit: str) -> str:
    if value is None:
        return DASH
    return quantity(value, unit, 3) + (f" ± {quantity(sd, unit, 2)}" if sd else "")


def document(seen: Inspection) -> dict[str, Any]:
    """The inspection as a JSON-able document, SI."""
    record, quality = seen.record, seen.judgement.quality
    programme = seen.drive.programme
    return {
        "path": seen.path,
        "format": record.metadata.get("format"),
        "sha256": record.metadata.get("sha256"),
        "rows": len(record),
        "duration_s": float(record.time[-1]),
        "window_start_s": float(record.metadata.get(WINDOW_START, 0.0)),
        "columns": dict(record.units()),
        "drive_speed_m_per_s": seen.drive.speed,
        "drive_speed_programme": None if programme is None else [list(pair) for pair in programme],
        "drive_speed_source": seen.drive.source,
        **_regime(seen.regime),
        "sampling": asdict(quality.sampling),
        "quality": {
            **to_dict(seen.judgement.result()),
            "load_N": quality.load.mean,
            "load_drift": quality.load.drift,
        },
        "steps": [_step_document(step) for step in seen.steps],
        "classical": to_document(seen.classical),
    }


def _regime(seen: LogRegime) -> Mapping[str, Any]:
    value = None if seen.regime is None else seen.regime.value
    return {"regime": value, "confidence": seen.confidence, "evidence": list(seen.evidence)}


def _step_document(seen: StepSeen) -> Mapping[str, Any]:
    phases, step = seen.phases, seen.step
    return {
        "run": step.run,
        "step": step.number,
        "rows": step.stop - step.start,
        "parameters": dict(step.parameters),
        "friction_sign": seen.sign,
        **_regime(seen.seen),
        "cycles": phases.count,
        "noise_N": phases.noise,
        "share": {"stick": phases.share(STICK), "slip": phases.share(SLIP), "sliding": phases.share(SLIDING)},
        "samples_per_slip": phases.samples_per_slip,
        "samples_per_cycle": phases.samples_per_cycle,
        "spikes": phases.spike_count,
        "begins_in_slip": phases.begins_in_slip,
        "ends_sliding": phases.ends_sliding,
        "drop_N": phases.drop_mean_and_sd,
        "period_s": phases.period_mean_and_sd,
        "stick_slope_N_per_s": phases.stick_slope,
        "onsets_s": phases.cycles.onset,
        "arrests_s": phases.cycles.arrest,
    }
