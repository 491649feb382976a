"""`stickslip convert`: any readable logs to the project's HDF5 layout, one log or an archive of many."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.cli.common import (
    DONE,
    MEASURED,
    NOT_SUCCEEDED,
    Answer,
    CommandLineError,
    Terminal,
    add_log_options,
    add_part_options,
    file_to_write,
    new_file,
    read,
)

if TYPE_CHECKING:
    from data_io import Record

NAME = "convert"
HELP = "write any readable logs in the HDF5 layout of this project: one, or many in one archive"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="a log in any readable format; several make an archive")
    parser.add_argument("--out", required=True, metavar="LOG.h5", help="the file to write; never overwritten")
    parser.add_argument(
        "--anonymise", action="store_true", help="leave out names, dates, paths and free text; they go into the key"
    )
    parser.add_argument("--key", metavar="KEY.json", help="where the key goes (default: beside --out, as OUT.key.json)")
    add_log_options(parser)
    add_part_options(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Read and write.

    Raises:
        CommandLineError, LogError, OSError: one sentence each.
    """
    out = file_to_write(arguments.out, "--out")
    if out.suffix.lower() not in (".h5", ".hdf5"):
        raise CommandLineError(f"--out {out} ends in {out.suffix!r}; expected .h5: rename it")
    key = _key_file(arguments, out)
    _check_not_a_source(arguments.logs, out, key)
    new_file(arguments.out, "--out", MEASURED)
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


def _check_not_a_source(logs: list[str], out: Path, key: Path | None) -> None:
    """Raw data are never written over."""
    for log in logs:
        for target in (out, key):
            if target is not None and target.exists() and Path(log).exists() and target.samefile(log):
                raise CommandLineError(
                    f"{target} is one of the logs; raw data are never written over: choose another name"
                )


def _write_key(path: Path, out: Path, keys: dict[str, Any]) -> None:
    """The key is readable by its owner only."""
    from data_io.atomic import atomic_path

    with atomic_path(path) as temporary:
        temporary.touch(mode=0o600)
        text = json.dumps({"key_of": out.name, "logs": keys}, ensure_ascii=False, indent=1, default=str)
        temporary.write_text(text + "\n", encoding="utf-8")
