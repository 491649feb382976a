"""`stickslip inspect`, `scene` and `convert`: what is in logs, a first scene of them, and one layout for all."""

from __future__ import annotations

from argparse import Namespace
from contextlib import nullcontext
from pathlib import Path

from data_io import LogError, read_log, write_hdf5
from data_io.anonymise import anonymous
from data_io.atomic import atomic_write
from identify.base.progress import to_nobody
from identify.cli.arguments import MEASURED, log_options, new_file, picture, read
from identify.cli.common import Answer, CommandLineError, Exit, Terminal
from identify.cli.inspection import (
    Inspection,
    StatedRig,
    document,
    draw,
    inspection,
    lines,
    only,
    overview,
    replicate_lines,
    replicates,
)
from identify.logs.draft import DraftLog, draft
from identify.report.stored_result import plain
from identify.scene.tables import quantity
from identify.scene.toml import is_rig, with_rig_file


def inspect(arguments: Namespace, terminal: Terminal) -> Answer:
    """Say it for each log. Among several logs one that cannot be read is rejected and the others are still seen."""
    plot = picture(arguments.plot)
    given = (
        ("stiffness", "N/m", arguments.stiffness),
        ("drive-speed", "m/s", arguments.drive_speed),
        ("mass", "kg", arguments.mass),
    )
    rig = StatedRig(*(None if text is None else quantity(text, unit, f"--{name}") for name, unit, text in given))
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
        return Answer(Exit.WRONG_INPUT, plain({"schema": 1, "status": "error", "message": message, "logs": logs}))
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
