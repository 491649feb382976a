"""`stickslip scene` and `convert`: a first scene of logs, and one layout for all."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from identify.base.progress import to_nobody
from identify.cli.common import (
    MEASURED,
    Answer,
    Command,
    CommandLineError,
    Terminal,
    add_log_options,
    add_options,
    add_part_options,
    log_options,
    new_file,
    read,
)

if TYPE_CHECKING:
    from data_io import Record, Step
    from identify.logs.draft import DraftLog


def _scene_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("logs", nargs="+", metavar="LOG", help="the logs of one pair")
    options = {
        "--out SCENE.toml": "the file to write; never overwritten",
        "--rig RIG.toml": "a file that stickslip rig wrote, which the scene takes",
    }
    add_options(parser, options, required=["--out"])
    add_log_options(parser)


def _scene(arguments: Namespace, terminal: Terminal) -> Answer:
    """Read the logs and write the draft."""
    out = new_file(arguments.out, "--out", "your edits")

    from data_io.atomic import atomic_write
    from identify.logs.draft import draft
    from identify.scene.toml import is_rig, with_rig_file

    rig = None if arguments.rig is None else Path(arguments.rig)
    if rig is not None and not is_rig(with_rig_file({"rig": str(rig)}, Path())["rig"]):
        raise CommandLineError(f"--rig: {rig} is no file of a rig; give one that stickslip rig wrote, such as rig.toml")
    options = log_options(arguments)
    made = draft([piece for log in arguments.logs for piece in _pieces(log, options)], out.parent, options, rig)
    missing = list(made.to_fill_in)
    with atomic_write(out) as handle:
        handle.write(made.text)
    terminal.say(f"{out}: written from {len(arguments.logs)} log(s)")
    for sentence in made.left_out:
        terminal.say(f"left out: {sentence}")
    if missing:
        terminal.say(f"still to fill in (marked TODO): {', '.join(missing)}")
    terminal.say(f"then: stickslip fit --scene {out}")
    return Answer(document={"status": "done", "out": str(out), "to_fill_in": missing, "left_out": made.left_out})


def _pieces(log: str, options: Mapping[str, object]) -> list[DraftLog]:
    """The log, or its steps one by one where it has several and none was chosen."""
    from data_io import read_log
    from identify.logs.draft import DraftLog

    record = read_log(log, **options)  # type: ignore[arg-type]
    steps = record.steps if len(record.steps) > 1 else ()
    alone = [DraftLog(Path(log), step.number, part) for step in steps if (part := only(record, step)) is not None]
    return alone or [DraftLog(Path(log), None, record)]


def only(record: Record, step: Step) -> Record | None:
    """One step of a record, on its own clock; None where it is too short for that."""
    import numpy as np

    from data_io import Record

    rows = slice(step.start, step.stop)
    if np.count_nonzero(np.isfinite(record.friction_force[rows] + record.normal_force[rows])) < 2:
        return None
    columns = {name: values[rows] for name, values in record.columns().items()}
    alone = (step.run, step.number, 0, step.stop - step.start, step.parameters)  # its head says what the drive does
    return Record.from_columns(columns, {**record.about(), "steps": (alone,), "findings": ()})


def _convert_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("log", metavar="LOG", help="a log in any readable format")
    options = {
        "--out LOG.h5": "the file to write; never overwritten",
        "--anonymise": "leave out names, dates, paths and free text; they go into a key beside it, OUT.key.json",
    }
    add_options(parser, options, required=["--out"])
    add_log_options(parser)
    add_part_options(parser)


def _convert(arguments: Namespace, terminal: Terminal) -> Answer:
    """Read and write; the key of an anonymous log is readable by its owner only."""
    out = new_file(arguments.out, "--out", MEASURED, (".h5", ".hdf5"))
    from data_io import write_hdf5
    from data_io.anonymise import anonymous
    from data_io.atomic import atomic_path

    key = new_file(str(out.with_suffix(".key.json")), "--out", "the key of other logs") if arguments.anonymise else None
    record = read(arguments.log, arguments, terminal)
    safe = anonymous(record) if key else None
    record = safe.record if safe else record
    with terminal.bar() if terminal.notes.isatty() else nullcontext(to_nobody) as progress:
        write_hdf5(record, out, lambda share: progress(f"writing {out.name}", share), dated=not key)
    rows, steps = len(record), len(record.steps)
    document = {"status": "done", "out": str(out), "rows": rows, "steps": steps}
    if key and safe:
        try:
            with atomic_path(key) as temporary:
                temporary.touch(mode=0o600)
                text = {"key_of": out.name, "logs": {safe.name: safe.key}}
                temporary.write_text(json.dumps(text, ensure_ascii=False, indent=1, default=str) + "\n", "utf-8")
        except OSError:
            out.unlink()  # without its key it is of no use
            raise
        document["key"] = str(key)
    terminal.say(f"{out}: {rows} rows in {steps} step(s)")
    if key:
        terminal.say(f"{key}: the key; keep it apart from {out.name}")
    return Answer(document=document)


COMMANDS = (
    Command("scene", "write a first, commented scene file from your logs", _scene_arguments, _scene),
    Command("convert", "write any readable log in the HDF5 layout of this project", _convert_arguments, _convert),
)
