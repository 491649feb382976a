"""`stickslip scene`: a first scene file from what the logs tell."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from identify.cli.common import Answer, CommandLineError, Terminal, add_log_options, log_options, read

NAME = "scene"
HELP = "write a first, commented scene file from your logs"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="the logs of one pair")
    parser.add_argument("--out", required=True, metavar="SCENE.toml", help="the file to write; never overwritten")
    add_log_options(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Read the logs and write the draft.

    Raises:
        CommandLineError, LogError, OSError: one sentence each.
    """
    out = Path(arguments.out)
    if out.exists():
        raise CommandLineError(f"--out {out} exists and may hold your edits; choose another name")

    from data_io.atomic import atomic_write
    from identify.draft import draft

    said = {key: value for key, value in log_options(arguments).items() if value is not None}
    records = [(Path(log), read(log, arguments)) for log in arguments.logs]
    text, missing = draft(records, out.parent, said)
    with atomic_write(out) as handle:
        handle.write(text)
    terminal.say(f"{out}: written from {len(records)} log(s)")
    if missing:
        terminal.say(f"still to fill in (marked TODO): {', '.join(missing)}")
    terminal.say(f"then: stickslip fit --scene {out}")
    return Answer(document={"status": "done", "out": str(out), "to_fill_in": missing})
