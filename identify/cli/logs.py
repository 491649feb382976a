"""`stickslip steps`, `scene` and `convert`: what logs hold, a first scene of them, and one layout for all."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.base.wording import columns, wrapped
from identify.cli.common import (
    DONE,
    MEASURED,
    NOT_SUCCEEDED,
    Answer,
    Command,
    CommandLineError,
    Terminal,
    add_log_options,
    add_part_options,
    file_to_write,
    log_options,
    new_file,
    read,
)
from identify.cli.common import quantity as quantity_given

if TYPE_CHECKING:
    from data_io import Record, Step, StepSummary
    from identify.logs.draft import DraftLog

MOST_PARAMETERS = 8


# ----------------------------------------------------------------------------------------------------------------------
# The runs and steps of a log.
# ----------------------------------------------------------------------------------------------------------------------


def _steps_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs, folders or patterns of one test's files")
    add_log_options(parser)


def _steps(arguments: Namespace, terminal: Terminal) -> Answer:
    """List them.

    Raises:
        CommandLineError, LogError, OSError: one sentence each.
    """
    from data_io import list_steps

    options = log_options(arguments)
    given: dict[str, Any] = {}
    if options["normal_force"] is not None:
        given = {"normal_force_N": quantity_given(options["normal_force"], "N", "--normal-force")}
    logs: list[dict[str, Any]] = []
    for path in arguments.logs:
        found = list_steps(path, **options)
        _say_steps(path, found, given.get("normal_force_N"), terminal)
        logs.append({"path": path, **given, "steps": [_step_document(step) for step in found]})
    return Answer(document={"status": "done", "logs": logs})


def _say_steps(path: str, steps: Sequence[StepSummary], load: float | None, terminal: Terminal) -> None:
    from identify.base.wording import DASH, quantity

    terminal.say(path if load is None else f"{path}, under {quantity(load, 'N')} as given")
    rows = [["run", "step", "rows", "duration", "started"]]
    for step in steps:
        length = DASH if step.duration is None else quantity(step.duration, "s")
        started = DASH if step.started is None else step.started.time().isoformat(timespec="milliseconds")
        rows.append([str(step.run), str(step.number), str(step.rows), length, started])
    terminal.say(columns(rows))
    for step in steps:
        given = ", ".join(f"{key} = {value}" for key, value in list(step.parameters.items())[:MOST_PARAMETERS])
        names = ", ".join(f"{name} [{unit}]" if unit else name for name, unit in step.columns.items())
        terminal.say(wrapped(f"run {step.run} step {step.number}: {given or 'no parameters'}; columns {names}", "  "))
        if step.restarts:
            text = f"run {step.run} step {step.number}: the clock restarts {step.restarts} times and tells no duration"
            terminal.say(wrapped(text + '; if the rows follow each other evenly, give --rate, such as "100 Hz"', "  "))
    terminal.say()


def _step_document(step: StepSummary) -> dict[str, Any]:
    return {
        "run": step.run,
        "step": step.number,
        "rows": step.rows,
        "duration_s": step.duration,
        "clock_restarts": step.restarts,
        "started": None if step.started is None else step.started.isoformat(),
        "columns": dict(step.columns),
        "parameters": dict(step.parameters),
    }


# ----------------------------------------------------------------------------------------------------------------------
# A first scene file.
# ----------------------------------------------------------------------------------------------------------------------


def _scene_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="the logs of one pair")
    parser.add_argument("--out", required=True, metavar="SCENE.toml", help="the file to write; never overwritten")
    parser.add_argument("--rig", metavar="RIG.toml", help="a file that stickslip rig wrote, which the scene takes")
    add_log_options(parser)


def _scene(arguments: Namespace, terminal: Terminal) -> Answer:
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


# ----------------------------------------------------------------------------------------------------------------------
# Any readable logs in the HDF5 layout of this project.
# ----------------------------------------------------------------------------------------------------------------------


def _convert_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="a log in any readable format; several make an archive")
    parser.add_argument("--out", required=True, metavar="LOG.h5", help="the file to write; never overwritten")
    parser.add_argument(
        "--anonymise", action="store_true", help="leave out names, dates, paths and free text; they go into the key"
    )
    parser.add_argument("--key", metavar="KEY.json", help="where the key goes (default: beside --out, as OUT.key.json)")
    add_log_options(parser)
    add_part_options(parser)


def _convert(arguments: Namespace, terminal: Terminal) -> Answer:
    """Read and write.

    Raises:
        CommandLineError, LogError, OSError: one sentence each.
    """
    out = new_file(arguments.out, "--out", MEASURED)
    if out.suffix.lower() not in (".h5", ".hdf5"):
        raise CommandLineError(f"--out {out} ends in {out.suffix!r}; expected .h5: rename it")
    key = _key_file(arguments, out)
    from data_io import write_archive, write_hdf5
    from identify.cli.progress import Progress

    work = _Work(arguments, terminal)
    if len(arguments.logs) == 1:
        with Progress(terminal.notes, terminal.progress) as progress:
            told = (lambda share: progress(f"writing {out.name}", share)) if terminal.notes.isatty() else _silent
            record = work.read(arguments.logs[0])
            write_hdf5(record, out, told, dated=not arguments.anonymise)
        rows, steps = len(record), len(record.steps)
        words = f"{out}: {rows} rows in {steps} step(s)"
    else:
        entries = write_archive(work.records(), out, dated=not arguments.anonymise)
        rows, steps = sum(entry.rows for entry in entries), sum(entry.steps for entry in entries)
        words = f"{out}: {len(entries)} logs, {rows} rows; read one with --run N"
    if key is not None:
        try:
            _write_key(key, out, work.keys)
        except OSError:
            out.unlink()  # without its key it is of no use
            raise
    terminal.say(words)
    if key is not None:
        terminal.say(f"{key}: the key; keep it apart from {out.name}")
    document: dict[str, Any] = {"out": str(out), "rows": rows, "steps": steps}
    if key is not None:
        document["key"] = str(key)
    if len(arguments.logs) > 1:
        document |= {"logs": work.done, "failed": work.failed}
    failed = bool(work.failed)
    return Answer(NOT_SUCCEEDED if failed else DONE, {"status": "incomplete" if failed else "done", **document})


@dataclass
class _Work:
    """Reading log after log; what could not be read is said and left out of an archive."""

    arguments: Namespace
    terminal: Terminal
    keys: dict[str, Any] = field(default_factory=dict)
    done: list[str] = field(default_factory=list)
    failed: list[dict[str, str]] = field(default_factory=list)

    def read(self, path: str) -> Record:
        """One log, anonymous if that was asked for."""
        record = read(path, self.arguments, self.terminal)
        if not self.arguments.anonymise:
            return record
        from data_io.anonymise import anonymous

        safe = anonymous(record)
        self.keys[safe.name] = safe.key
        return safe.record

    def records(self) -> Iterator[Record]:
        """Log after log, so that only one is in memory; a bad one never stops the others."""
        from data_io import LogError

        for path in self.arguments.logs:
            try:
                record = self.read(path)
            except LogError as error:
                self.failed.append({"path": path, "message": str(error)})
                self.terminal.say(f"left out: {error}")
                continue
            self.done.append(path)
            self.terminal.note(f"{len(self.done) + len(self.failed)} of {len(self.arguments.logs)}: {path}")
            yield record


def _silent(_share: float) -> None:
    """Progress that nobody watches."""


def _key_file(arguments: Namespace, out: Path) -> Path | None:
    if not arguments.anonymise:
        if arguments.key is not None:
            raise CommandLineError("--key was given without --anonymise; there is no key then: add --anonymise")
        return None
    key = file_to_write(arguments.key or str(out.with_suffix(".key.json")), "--key")
    if key.exists():
        raise CommandLineError(f"{key} exists, and may be the key of other logs; move it, or name another with --key")
    return key


def _write_key(path: Path, out: Path, keys: dict[str, Any]) -> None:
    """The key is readable by its owner only."""
    from data_io.atomic import atomic_path

    with atomic_path(path) as temporary:
        temporary.touch(mode=0o600)
        text = json.dumps({"key_of": out.name, "logs": keys}, ensure_ascii=False, indent=1, default=str)
        temporary.write_text(text + "\n", encoding="utf-8")


STEPS = "the runs and steps of a log, with rows, durations, parameters and columns"
SCENE = "write a first, commented scene file from your logs"
CONVERT = "write any readable logs in the HDF5 layout of this project: one, or many in one archive"
COMMANDS = (
    Command("steps", STEPS, _steps_arguments, _steps),
    Command("scene", SCENE, _scene_arguments, _scene),
    Command("convert", CONVERT, _convert_arguments, _convert),
)
