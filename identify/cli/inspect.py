"""`stickslip inspect`: what is in a log, and what it tells without a model; in words, a document and a picture."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from identify.cli.common import (
    DONE,
    WRONG_INPUT,
    Answer,
    Command,
    Terminal,
    add_log_options,
    add_options,
    add_part_options,
    picture,
    quantity,
    read,
)


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("logs", nargs="+", metavar="LOG", help="one or more logs")
    options = {
        "--plot FILE": "draw force and phases over time (png, svg or pdf)",
        "--stiffness K": 'of the rig, to compare the sticks with: "1470 N/m"',
        "--drive-speed V": 'where the log does not tell it: "0.1 mm/s"',
        "--mass M": 'moving mass of the rig, for how fast it slips: "0.2 kg"',
    }
    add_options(parser, options)
    add_log_options(parser)
    add_part_options(parser)


def _run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Say it for each log. Among several logs one that cannot be read is rejected and the others are still seen."""
    plot = picture(arguments.plot)
    from data_io import LogError
    from identify.cli.inspection import Inspection, StatedRig, document, draw, inspection, lines, overview

    stated = {
        name: quantity(text, unit, f"--{name.replace('_', '-')}")
        for name, unit in (("stiffness", "N/m"), ("drive_speed", "m/s"), ("mass", "kg"))
        if (text := getattr(arguments, name)) is not None
    }
    rig = StatedRig(**stated)

    found: list[tuple[str, Inspection | None]] = []
    logs: list[object] = []
    unread: list[str] = []
    for path in arguments.logs:
        try:
            seen = inspection(path, read(path, arguments, terminal), rig)
        except LogError as error:
            if len(arguments.logs) == 1:
                raise
            unread.append(str(error))
            found.append((Path(path).name, None))
            terminal.say(f"{path}\n  verdict: reject\n    reject: {error}\n")
            finding = {"code": "unreadable", "severity": "reject", "message": str(error)}
            logs.append({"path": path, "quality": {"verdict": "reject", "findings": [finding], "figures": {}}})
            continue
        found.append((Path(path).name, seen))
        for line in lines(seen):
            terminal.say(line)
        logs.append(document(seen))
    if len(found) > 1:
        terminal.say(overview(found))
    if plot and (drawn := [seen for _, seen in found if seen is not None]):
        draw(drawn, plot)
        terminal.say(f"plot: {plot}")
    if unread:
        from identify.report.stored_result import plain

        message = f"{len(unread)} of {len(found)} logs cannot be read; {unread[0]}"
        return Answer(WRONG_INPUT, plain({"schema": 1, "status": "error", "message": message, "logs": logs}))
    return Answer(DONE, {"status": "done", "logs": logs})


HELP = "what is in a log: steps, units, sampling, quality, stick and slip, the classical table"
COMMANDS = (Command("inspect", HELP, _arguments, _run),)
