"""`stickslip scene`: a first scene file from what the logs tell."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.cli.common import Answer, CommandLineError, Terminal, add_log_options, log_options, new_file

if TYPE_CHECKING:
    from data_io import Record, Step
    from identify.logs.draft import DraftLog

NAME = "scene"
HELP = "write a first, commented scene file from your logs"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="the logs of one pair")
    parser.add_argument("--out", required=True, metavar="SCENE.toml", help="the file to write; never overwritten")
    parser.add_argument("--rig", metavar="RIG.toml", help="a file that stickslip rig wrote, which the scene takes")
    add_log_options(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Read the logs and write the draft.

    Raises:
        CommandLineError, SceneError, LogError, OSError: one sentence each.
    """
    out = new_file(arguments.out, "--out", "your edits")

    from data_io.atomic import atomic_write
    from identify.logs.draft import draft
    from identify.scene.toml import is_rig, with_rig_file

    rig = None if arguments.rig is None else Path(arguments.rig)
    if rig is not None and not is_rig(with_rig_file({"rig": str(rig)}, Path())["rig"]):
        raise CommandLineError(f"--rig: {rig} is no file of a rig; give one that stickslip rig wrote, such as rig.toml")
    said = {key: value for key, value in log_options(arguments).items() if value is not None}
    made = draft([piece for log in arguments.logs for piece in pieces(log, said)], out.parent, said, rig)
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


def pieces(log: str, said: Mapping[str, Any]) -> list[DraftLog]:
    """The log, or its steps one by one where it has several and none was chosen.

    Raises:
        LogError: one sentence.
    """
    from data_io import read_log
    from identify.logs.draft import DraftLog

    record = read_log(log, **said)
    if len(record.steps) < 2:
        return [DraftLog(Path(log), None, record)]
    alone = [
        DraftLog(Path(log), step.number, part) for step in record.steps if (part := only(record, step)) is not None
    ]
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
