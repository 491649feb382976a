"""`stickslip convert`: any readable log to the project's HDF5 layout."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from typing import TYPE_CHECKING

from identify.cli.common import Answer, CommandLineError, Terminal, add_log_options, file_to_write, read

if TYPE_CHECKING:
    from data_io import Record

NAME = "convert"
HELP = "write any readable log in the HDF5 layout of this project"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("log", metavar="LOG", help="a log in any readable format")
    parser.add_argument("--out", required=True, metavar="LOG.h5", help="the file to write")
    parser.add_argument("--anonymise", action="store_true", help="leave out names, dates, paths and free text")
    add_log_options(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Read and write.

    Raises:
        CommandLineError, LogError, OSError: one sentence each.
    """
    out = file_to_write(arguments.out, "--out")
    if out.suffix.lower() not in (".h5", ".hdf5"):
        raise CommandLineError(f"--out {out} ends in {out.suffix!r}; expected .h5: rename it")
    from data_io import write_hdf5

    record = read(arguments.log, arguments)
    write_hdf5(anonymous(record) if arguments.anonymise else record, out)
    terminal.say(f"{out}: {len(record)} rows in {len(record.steps)} step(s)")
    return Answer(document={"status": "done", "out": str(out), "rows": len(record), "steps": len(record.steps)})


def anonymous(record: Record) -> Record:
    """The record without what could name a person, a day, a machine or a file: columns and findings stay."""
    steps = tuple(replace(step, parameters={}) for step in record.steps)
    kept = {key: record.metadata[key] for key in ("format",) if key in record.metadata}
    findings = tuple(replace(f, message=f.code.replace("_", " ")) for f in record.findings)
    return replace(record, steps=steps, metadata=kept, findings=findings)
