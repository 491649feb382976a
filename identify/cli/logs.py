"""`stickslip inspect`, `scene` and `convert`: what is in logs, a first scene of them, and one layout for all."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_io import LogError, Record, Step, read_log, write_hdf5
from data_io.anonymise import anonymous
from data_io.atomic import atomic_write
from data_io.quality import percent
from data_io.record import WINDOW_START
from identify.base.document import finite, to_dict, to_document
from identify.base.progress import to_nobody
from identify.base.result import ClassicalTable
from identify.base.table import Cell, OutputTable, Row
from identify.base.wording import DASH, columns, number, programme_text, quantity, scale_for, speed_text, wrapped
from identify.cli.arguments import MEASURED, log_options, new_file, picture, read
from identify.cli.common import Answer, CommandLineError, Exit, Terminal
from identify.logs.classical import table_of
from identify.logs.draft import DraftLog, draft
from identify.logs.drive_changes import DriveChange, drive_changes, summary
from identify.logs.judgement import Judgement, RecordPart, judge
from identify.logs.recorded_drive import NOT_STATED, RecordedDrive, drive_of, mentioned_speed, recorded_drive
from identify.logs.regime import SURE, Known, LogRegime, Regime, joined, look, only_of
from identify.logs.segment import SLIDING, SLIP, STICK, Segmentation, jumps, sensor_place
from identify.report.report_tables import stroke_table, with_sd
from identify.scene.tables import quantity as stated
from identify.scene.toml import is_rig, with_rig_file

REPLICATED = (
    "first_breakaway_coefficient", "static_peak_coefficient", "kinetic_mean_coefficient", "sliding_mean_coefficient",
    "static_over_kinetic", "stick_slip_index", "drop_N", "frequency_Hz", "jump_length_m",
)  # fmt: skip
ALIKE = 0.05  # by which the loads of replicates differ
MOST_STROKES = 2  # fit beside each other in 80 columns
MOST_CHANGES = 12  # of the drive, on a screen
LONGEST_NAME = 24  # of a log in the table of all, which is to fit in 80 columns
THUMBNAIL = 60  # stretches of the thumbnail of a log
KINDS = {"stick": STICK, "slip": SLIP, "sliding": SLIDING}


@dataclass(frozen=True)
class StepSeen:
    """One step of a log, what it says of the drive, its regime and phases; `signs` (n,): that of the sliding force in
    every row, which strokes to and fro change."""

    step: Step
    drive: RecordedDrive
    signs: NDArray[np.int64]
    seen: LogRegime
    phases: Segmentation


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
    changes: tuple[DriveChange, ...] = ()


@dataclass(frozen=True)
class StatedRig:
    """What the user says of the rig, to hold the log against; None: unknown. stiffness [N/m], drive_speed [m/s],
    mass [kg]."""

    stiffness: float | None = None
    drive_speed: float | None = None
    mass: float | None = None


def only(record: Record, step: Step) -> Record | None:
    """One step of a record, on its own clock; None where it is too short for that."""
    rows = slice(step.start, step.stop)
    if np.count_nonzero(np.isfinite(record.friction_force[rows] + record.normal_force[rows])) < 2:
        return None
    columns = {name: values[rows] for name, values in record.columns().items()}
    alone = (step.run, step.number, 0, step.stop - step.start, step.parameters)  # its head says what the drive does
    return Record.from_columns(columns, {**record.about(), "steps": (alone,), "findings": ()})


def inspection(path: str, record: Record, rig: StatedRig = StatedRig()) -> Inspection:
    """Look at a record: phases step by step, then the verdict on clock, forces and slips."""
    k, m, given = rig.stiffness or 0.0, rig.mass or 0.0, rig.drive_speed
    known = Known(k, half_period=float(np.pi * np.sqrt(m / k)) if k and m else 0.0)
    recorded = recorded_drive(record) if given is None else RecordedDrive(((0.0, given),), "given")
    regime = look(record, drive_of(record, recorded) if given is None else given, known)
    expected = rig.stiffness * abs(recorded.speed) if rig.stiffness is not None and recorded.speed else None
    several = recorded.speed is None and len(record.steps) > 1
    steps, parts = [], []
    for step in record.steps:
        rows, alone = slice(step.start, step.stop), only(record, step) if several else None
        drive = recorded if alone is None else recorded_drive(alone)
        own = [i for i, stroke in enumerate(regime.strokes) if step.start <= stroke.start < step.stop]
        signs = np.ones(step.stop - step.start, dtype=np.int64)
        for i in own:
            signs[regime.strokes[i].start - step.start :] = regime.strokes[i].direction
        seen = only_of(regime, own)
        if drive.stands:
            level = quantity(float(np.nanmedian(record.friction_force[rows])), "N", 3)
            text = f"the drive stands: {drive.trouble}; the friction force shows {level} there"
            seen = replace(seen, regime=None, confidence=SURE, evidence=(text,))
        strokes = [(regime.strokes[i].start - step.start, regime.verdicts[i].phases) for i in own]
        phases = joined(strokes, step.stop - step.start)
        steps.append(StepSeen(step, drive, signs, seen, phases))
        force, load = signs * record.friction_force[rows], record.normal_force[rows]
        parts.append(RecordPart(record.time[rows], force, phases, expected, load))
    moving = [s for s in steps if not s.drive.stands]
    if 0 < len(moving) < len(steps):
        kept = [i for i, own in enumerate(regime.strokes) if any(own in s.seen.strokes for s in moving)]
        regime = only_of(regime, kept)
    regime = replace(regime, evidence=(*regime.evidence, *_measured_at(record, steps, known)))
    table = table_of(record, regime, stiffness=rig.stiffness)
    speeds = {(own.step.run, own.step.number): own.drive.speed for own in steps}
    driven = tuple(replace(s, speed=s.speed or speeds.get((s.run, s.step))) for s in regime.strokes)
    changes = drive_changes(record, replace(regime, strokes=driven))
    return Inspection(path, record, judge(record, parts), tuple(steps), table, recorded, regime, changes)


def _measured_at(record: Record, steps: Sequence[StepSeen], known: Known) -> list[str]:
    """Where the force seems to be measured, in a sentence; none where it is as usual, or does not show."""
    each = []
    for step in steps:
        rows, phases = slice(step.step.start, step.step.stop), step.phases
        slip = known.half_period / phases.sample_interval
        each.append(jumps(record.friction_force[rows], phases, slip, step.signs))
    count, drops = np.sum(each or [(0, 0)], axis=0).tolist()
    if sensor_place(count, drops) != "counterface":
        return []
    return [
        f"{count} of {drops} drops of the force are jumps from one sample to the next, as under a counterface: where a "
        'plate there measures it, a scene needs force_sensor = "counterface" under [rig]'
    ]


def lines(seen: Inspection) -> Iterator[str]:
    """The inspection in words."""
    record, quality, several = seen.record, seen.judgement.quality, len(seen.steps) > 1
    yield seen.path
    yield (
        f"  {record.metadata.get('format', 'unknown format')}, {len(record)} rows in {len(record.steps)} step(s), "
        f"{quantity(float(record.time[-1]), 's')}, {quality.sampling.rate:.4g} Hz"
    )
    if begin := float(record.metadata.get(WINDOW_START, 0.0)):
        text = f"window: {begin:.6g} to {begin + record.time[-1]:.6g} s of the log; times below count from its begin"
        yield wrapped(f"{text}, those of a scene from the first row of the log", "  ")
    for role in ("time", "normal_force", "friction_force"):
        if source := record.metadata.get(f"{role}_source"):
            yield f"  {role.replace('_', ' ')}: {source}"
    yield wrapped(f"other columns: {', '.join(record.channels) or 'none'}", "  ")
    load, drift = (quality.figures[name][0] or 0.0 for name in ("normal_force", "normal_force_drift"))
    yield f"  normal force: {quantity(load, 'N')}, drift {percent(drift, 1, signed=True)}"
    driven = [(f"step {s.step.number}: ", s.drive) for s in seen.steps] if several and not seen.drive.speed else []
    texts = [name + text for name, drive in driven or [("", seen.drive)] if (text := _drive(drive, record))]
    hint = "" if seen.drive.trouble == NOT_STATED else f" ({seen.drive.trouble})"
    yield wrapped(f"drive speed: {'; '.join(texts) or f'not in the log{hint}'}", "  ")
    if not several:
        yield _regime_line(seen.regime)
    yield f"  verdict: {seen.judgement.verdict}"
    for finding in seen.judgement.findings:
        yield wrapped(f"{finding.severity}: {finding.message}", "    ")
    for step in seen.steps:
        yield from _step_lines(step, several)
    yield from _classical_lines(seen.classical)
    if seen.changes:
        yield wrapped(f"{summary(seen.changes)}:", "  ")
        yield change_table(seen.changes[:MOST_CHANGES]).to_text()
    if len(seen.changes) > MOST_CHANGES:
        yield f"  … and {len(seen.changes) - MOST_CHANGES} changes of the drive more: see --json"
    yield ""


def _drive(drive: RecordedDrive, record: Record) -> str:
    """The speed of a drive with where it stands; "" where it stands nowhere."""
    if drive.course is not None:
        return f"up to {quantity(drive.course.fastest, 'm/s')}, changing gradually, {drive.source}"
    if drive.programme is None:
        return ""
    text = quantity(drive.speed, "m/s") if drive.speed is not None else programme_text(drive.programme)
    return text if record.drive_speed is not None else f"{text}, {drive.source}"


def _regime_line(seen: LogRegime) -> str:
    word = "none yet" if seen.regime is None else seen.regime.value.replace("_", " ")
    return wrapped(f"regime: {word} ({100 * seen.confidence:.0f} % sure): {'; '.join(seen.evidence)}", "  ")


def _step_lines(seen: StepSeen, several: bool) -> Iterator[str]:
    phases, step = seen.phases, seen.step
    if several:
        given = ", ".join(f"{key} = {value}" for key, value in list(step.parameters.items())[:6])
        yield wrapped(f"step {step.number}: rows {step.start + 1} to {step.stop}; {given}", "  ")
        yield _regime_line(seen.seen)
    if seen.drive.stands:
        return
    stands = 0.0  # the share in which the drive of a programme stands: what no stroke holds
    if seen.seen.regime is Regime.PROGRAMME:
        stands = 1.0 - sum(s.stop - s.start for s in seen.seen.strokes) / (step.stop - step.start)
    sliding = max(phases.share(SLIDING) - stands, 0.0)
    shares = {"rising as in stick": phases.share(STICK), "falling as in slip": phases.share(SLIP), "sliding": sliding}
    if stands:
        shares["while the drive stands"] = stands
    text = ", ".join(f"{100 * share:.1f} % {word}" for word, share in shares.items())
    # The force rises on after the onset of slip, and again before the mass rests: a slip lasts longer than its fall.
    yield wrapped(f"{phases.count} stick-slip cycles; force {text}; noise {quantity(phases.noise, 'N', 3)}", "  ")
    if phases.count:
        falling, cycle = number(phases.samples_per_slip, 2), number(phases.samples_per_cycle, 4)
        yield wrapped(f"{falling} samples in each slip, peak to valley, {cycle} in each cycle", "  ")


def _classical_lines(table: ClassicalTable) -> Iterator[str]:
    """The classical table, one column per stroke, the longest ones; figures that none of them has are left out. Then
    both directions of strokes to and fro, apart."""
    longest = sorted(table.rows, key=lambda stroke: stroke["samples"], reverse=True)[:MOST_STROKES]  # type: ignore[arg-type,return-value]
    shown = [stroke for stroke in table.rows if stroke in longest]
    steps = [f"step {stroke['step']} stroke {stroke['stroke']}" for stroke in shown]
    yield stroke_table(list(zip(steps, shown, strict=True)), "classical table").to_text()
    if len(table.rows) > len(shown):
        yield f"  … and {len(table.rows) - len(shown)} strokes more: see --json"
    if table.directions:
        heads = ("all strokes", "strokes", "coefficient", "last against first tenth")
        each = [("forth" if mean.direction > 0 else "back", str(mean.strokes),
                 with_sd(mean.coefficient, mean.coefficient_sd), quantity(mean.trend_percent, "%", 3))
                for mean in table.directions]  # fmt: skip
        yield columns(list(map(list, zip(heads, *each, strict=True))))


def change_table(changes: Sequence[DriveChange]) -> OutputTable:
    """Holds and velocity steps, a row each, without the columns that none has."""
    of_length = scale_for(next((c.D_c_m for c in changes if c.D_c_m), None), "m")
    heads = "from (s)", "to", "before", "peak", "after", "direct effect", "evolution effect", f"D_c ({of_length.unit})"
    rows = list[Row]()
    for c in changes:
        levels = c.before_coefficient, c.peak_coefficient, c.after_coefficient, c.direct_effect, c.evolution_effect
        when, speed = Cell(c.start_s, number(c.start_s, 5)), speed_text(c.speed_after_m_per_s or 0.0, 3)
        length = Cell(c.D_c_m, "" if c.D_c_m is None else number(c.D_c_m / of_length.factor, 2))
        rows.append((c.name, when, speed, *(Cell(level, number(level, 3)) for level in levels), length))
    return OutputTable("Holds and velocity steps", ("", *heads), tuple(rows), "drive_changes").filled()


def overview(logs: Sequence[tuple[str, Inspection | None]]) -> str:
    """A line per log, by its name; None: it could not be read."""
    rows = [["log", "rate", "drive speed", "regime", "cycles", "verdict"]]
    for name, seen in logs:
        name = name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…"
        if seen is None:
            rows.append([name, DASH, DASH, DASH, DASH, "reject"])
            continue
        rate, speed, regime = seen.judgement.quality.sampling.rate, seen.drive.speed, seen.regime.regime
        driven = quantity(speed, "m/s") if speed is not None else "several" if seen.drive.programme else DASH
        count, verdict = sum(step.phases.count for step in seen.steps), seen.judgement.verdict
        word = DASH if regime is None else regime.value.replace("_", " ")
        rows.append([name, f"{rate:.4g} Hz", driven, word, str(count), verdict.removeprefix("accept with ")])
    return columns(rows)


def replicates(logs: Sequence[Inspection]) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation over logs of the figures that all have; none of logs that are no replicates: of
    several strokes, of other drive speeds (unknown ones by the slope of the sticks), or of loads that differ by more
    than a twentieth."""
    rows = [seen.classical.rows[0] for seen in logs if len(seen.classical.rows) == 1]
    speeds = {finite(row.get("drive_speed_m_per_s")) for row in rows}
    alike = ("normal_force_N", "stick_slope_N_per_s") if speeds == {None} else ("normal_force_N",)
    if len(rows) < max(len(logs), 2) or len(speeds) > 1:
        return {}
    for key in alike:
        values = [value for row in rows if (value := finite(row.get(key))) is not None and value > 0.0]
        if len(values) < len(rows) or max(values) > (1.0 + ALIKE) * min(values):
            return {}
    out = {}
    for key in REPLICATED:
        values = [value for row in rows if (value := finite(row.get(key))) is not None]
        if len(values) == len(rows):
            out[key] = float(np.mean(values)), float(np.std(values, ddof=1))
    return out


def replicate_lines(figures: Mapping[str, tuple[float, float]], count: int) -> str:
    """The same as a table."""
    row = dict[str, float]()
    for key, (mean, sd) in figures.items():
        head, _, unit = key.rpartition("_") if key.endswith(("_N", "_Hz", "_m")) else (key, "", "")
        row |= {key: mean, f"{head}_sd{'_' if unit else ''}{unit}": sd}
    return stroke_table([(f"mean ± sd of {count} logs", row)], "replicates").to_text()


def document(seen: Inspection) -> dict[str, object]:
    """The inspection as a JSON-able document, SI."""
    record, quality, programme = seen.record, seen.judgement.quality, seen.drive.programme
    finite = record.friction_force[np.isfinite(record.friction_force)]
    parts = np.array_split(finite, THUMBNAIL)
    return {
        "path": seen.path,
        "format": record.metadata.get("format"),
        "sha256": record.metadata.get("sha256"),
        "rows": len(record),
        "duration_s": float(record.time[-1]),
        "force_overview_N": [[float(np.min(part)), float(np.max(part))] for part in parts if part.size],
        "window_start_s": float(record.metadata.get(WINDOW_START, 0.0)),
        "columns": dict(record.units()),
        "drive_speed_m_per_s": seen.drive.speed,
        "drive_speed_programme": None if programme is None else [list(pair) for pair in programme],
        "drive_speed_source": seen.drive.source,
        "speed_mentioned": mentioned_speed(record, Path(seen.path).name),
        **_regime(seen.regime),
        "sampling": asdict(quality.sampling),
        "quality": {
            **to_dict(seen.judgement.result()),
            "load_N": quality.figures["normal_force"][0],
            "load_drift": quality.figures["normal_force_drift"][0],
        },
        "steps": [
            {
                "run": step.run,
                "step": step.number,
                "rows": step.stop - step.start,
                "parameters": dict(step.parameters),
                "friction_sign": -1 if int(np.sum(signs)) < 0 else 1,
                **_regime(regime),
                "cycles": phases.count,
                "noise_N": phases.noise,
                "share": {name: phases.share(kind) for name, kind in KINDS.items()},
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
            for step, signs, regime, phases in ((s.step, s.signs, s.seen, s.phases) for s in seen.steps)
        ],
        "classical": to_document(seen.classical),
        "drive_changes": [to_document(change) for change in seen.changes],
    }


def _regime(seen: LogRegime) -> Mapping[str, object]:
    value = None if seen.regime is None else seen.regime.value
    return {"regime": value, "confidence": seen.confidence, "evidence": list(seen.evidence)}


def draw(logs: Sequence[Inspection], path: Path) -> list[Path]:
    """Force with its slips and load over time, whole and a few cycles closer; of several logs each in a file of its own
    with its number behind the name."""
    from data_io.atomic import atomic_path
    from identify.base.result import LogCurves
    from identify.report.figures import draw_force
    from identify.report.style import drawing_style

    files = [path if len(logs) == 1 else path.with_stem(f"{path.stem}_{i}") for i in range(1, len(logs) + 1)]
    for place, (item, file) in enumerate(zip(logs, files, strict=True), 1):
        record, names = item.record, ("onset", "arrest", "onset_force", "arrest_force")
        cycles = [np.concatenate([getattr(step.phases.cycles, name) for step in item.steps]) for name in names]
        marks, force, n = np.column_stack(cycles), record.friction_force.copy(), len(record)
        for step in item.steps:
            force[step.step.start : step.step.stop] *= step.signs
        curves = LogCurves(item.path, record.time, record.normal_force, force, np.full(n, np.nan), np.ones(n, bool),
                           np.nan, np.nan, marks)  # fmt: skip
        with drawing_style(), atomic_path(file) as temporary:
            figure = draw_force(curves, place, True).figure
            assert figure is not None
            figure.savefig(temporary, format=file.suffix[1:], dpi=130)
    return files


def inspect(arguments: Namespace, terminal: Terminal) -> Answer:
    """Say it for each log. Among several logs one that cannot be read is rejected and the others are still seen."""
    plot = picture(arguments.plot)
    given = (
        ("stiffness", "N/m", arguments.stiffness),
        ("drive-speed", "m/s", arguments.drive_speed),
        ("mass", "kg", arguments.mass),
    )
    rig = StatedRig(*(None if text is None else stated(text, unit, f"--{name}") for name, unit, text in given))
    inspections: list[tuple[str, Inspection | None]] = []
    logs: list[object] = []
    unread: list[str] = []
    for path in arguments.logs:
        try:
            seen = inspection(path, read(path, arguments, terminal), rig)
        except LogError as error:
            if len(arguments.logs) == 1:
                raise
            unread.append(str(error))
            inspections.append((Path(path).name, None))
            terminal.say(f"{path}\n  verdict: reject\n    reject: {error}\n")
            finding = {"code": "unreadable", "severity": "reject", "message": str(error)}
            logs.append({"path": path, "quality": {"verdict": "reject", "findings": [finding], "figures": {}}})
            continue
        inspections.append((Path(path).name, seen))
        for line in lines(seen):
            terminal.say(line)
        logs.append(document(seen))
    if len(inspections) > 1:
        terminal.say(overview(inspections))
    repeated = replicates([seen for _, seen in inspections if seen is not None])
    if repeated:
        terminal.say(f"\n{replicate_lines(repeated, len(inspections) - len(unread))}")
    if plot and (drawn := [seen for _, seen in inspections if seen is not None]):
        terminal.say(f"plot: {', '.join(map(str, draw(drawn, plot)))}")
    if unread:
        message = f"{len(unread)} of {len(inspections)} logs cannot be read; {unread[0]}"
        return Answer(Exit.WRONG_INPUT, to_dict({"schema": 1, "status": "error", "message": message, "logs": logs}))
    figures = {key: {"mean": mean, "sd": sd} for key, (mean, sd) in repeated.items()}
    return Answer(document={"status": "done", "logs": logs, **({"replicates": figures} if figures else {})})


def scene(arguments: Namespace, terminal: Terminal) -> Answer:
    """Read the logs and write the draft."""
    out = new_file(arguments.out, "your edits")
    rig = None if arguments.rig is None else Path(arguments.rig)
    if rig is not None and not is_rig(with_rig_file({"rig": str(rig)}, Path())["rig"]):
        raise CommandLineError(f"--rig: {rig} is no file of a rig; give one that stickslip rig wrote, such as rig.toml")
    options = log_options(arguments)
    pieces: list[DraftLog] = []
    for log in arguments.logs:  # step by step where it has several and none was chosen
        record = read_log(log, **options)
        steps = record.steps if len(record.steps) > 1 else ()
        alone = [DraftLog(Path(log), step.number, part) for step in steps if (part := only(record, step)) is not None]
        pieces += alone or [DraftLog(Path(log), None, record)]
    draft_scene = draft(pieces, out.parent, options, rig)
    missing = list(draft_scene.to_fill_in)
    with atomic_write(out) as handle:
        handle.write(draft_scene.text)
    terminal.say(f"{out}: written from {len(arguments.logs)} log(s)")
    for sentence in draft_scene.left_out:
        terminal.say(f"left out: {sentence}")
    if missing:
        terminal.say(f"still to fill in (marked TODO): {', '.join(missing)}")
    terminal.say(f"then: stickslip fit --scene {out}")
    return Answer(document={"status": "done", "out": str(out), "to_fill_in": missing, "left_out": draft_scene.left_out})


def convert(arguments: Namespace, terminal: Terminal) -> Answer:
    """Read and write; an anonymous log does not say when it was written."""
    out, record = new_file(arguments.out, MEASURED, (".h5", ".hdf5")), read(arguments.log, arguments, terminal)
    record = anonymous(record) if arguments.anonymise else record
    with terminal.bar() if terminal.notes.isatty() else nullcontext(to_nobody) as progress:
        write_hdf5(record, out, lambda s: progress(f"writing {out.name}", s), dated=not arguments.anonymise)
    rows, steps = len(record), len(record.steps)
    terminal.say(f"{out}: {rows} rows in {steps} step(s)")
    return Answer(document={"status": "done", "out": str(out), "rows": rows, "steps": steps})
