"""`stickslip inspect`: what is in a log, and what it tells without a model."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.cli.common import (
    DONE,
    WRONG_INPUT,
    Answer,
    CommandLineError,
    Terminal,
    add_log_options,
    add_part_options,
    pairs,
    picture,
    quantity,
    read,
)

if TYPE_CHECKING:
    from data_io.thresholds import Thresholds
    from identify.cli.inspection import Inspection, StatedRig

NAME = "inspect"
HELP = "what is in a log: steps, units, sampling, quality, stick and slip, the classical table"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="one or more logs")
    parser.add_argument("--plot", metavar="FILE", help="draw force and phases over time (png, svg or pdf)")
    parser.add_argument("--stiffness", metavar="K", help='of the rig, to compare the sticks with: "1470 N/m"')
    parser.add_argument("--drive-speed", metavar="V", help='where the log does not tell it: "0.1 mm/s"')
    parser.add_argument("--mass", metavar="M", help='moving mass of the rig, for how fast it slips: "0.2 kg"')
    parser.add_argument(
        "--threshold", metavar="NAME=NUMBER,…", help="move a threshold of the verdict, such as jitter=0.1,spikes=0.01"
    )
    add_log_options(parser)
    add_part_options(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Say it for each log. Among several logs one that cannot be read is rejected and the others are still seen.

    Raises:
        CommandLineError, LogError, OSError: one sentence each.
    """
    plot = picture(arguments.plot)
    from data_io import LogError
    from identify.cli.inspection import document, inspection, overview, say

    rig, thresholds = _rig(arguments), _thresholds(arguments)
    found: list[tuple[str, Inspection | None]] = []
    logs: list[Mapping[str, Any]] = []
    unread: list[str] = []
    listed = [item for path in arguments.logs for item in _logs_in(path, arguments)]
    for path, options in listed:
        name = f"{Path(options.path).name}{path.removeprefix(options.path)}"
        try:
            seen = inspection(path, read(options.path, options, terminal), rig, thresholds)
        except LogError as error:
            if len(listed) == 1:
                raise
            unread.append(str(error))
            found.append((name, None))
            logs.append(_unreadable(path, str(error), terminal))
            continue
        found.append((name, seen))
        say(seen, terminal)
        logs.append(document(seen))
    if len(listed) > 1:
        terminal.say(overview(found))
    if plot and (drawn := [seen for _, seen in found if seen is not None]):
        from identify.cli.inspection_plot import draw

        draw(drawn, plot)
        terminal.say(f"plot: {plot}")
    if unread:
        from identify.report.stored_result import plain

        message = f"{len(unread)} of {len(listed)} logs cannot be read; {unread[0]}"
        document_of_error = {"schema": 1, "status": "error", "message": message, "logs": logs}
        return Answer(WRONG_INPUT, plain(document_of_error))
    return Answer(DONE, {"status": "done", "logs": logs})


def _logs_in(path: str, arguments: Namespace) -> list[tuple[str, Namespace]]:
    """Name and reading options of every log: an archive stands for all logs in it unless a run was chosen."""
    from data_io import LogError
    from data_io.hdf5 import read_index

    alone = [(path, Namespace(**vars(arguments), path=path))]
    if arguments.test_run is not None or Path(path).suffix.lower() not in (".h5", ".hdf5"):
        return alone
    try:
        index = read_index(path)
    except LogError:
        return alone  # reading it says why
    options = {key: value for key, value in vars(arguments).items() if key != "test_run"}
    runs = [(f"{path} run {entry.run} ({entry.source_file})", entry.run) for entry in index]
    return [(name, Namespace(**options, path=path, test_run=run)) for name, run in runs] or alone


def _unreadable(path: str, sentence: str, terminal: Terminal) -> Mapping[str, Any]:
    """A log that no reader takes is rejected like any other."""
    terminal.say(f"{path}\n  verdict: reject\n    reject: {sentence}\n")
    finding = {"code": "unreadable", "severity": "reject", "message": sentence}
    return {"path": path, "quality": {"verdict": "reject", "findings": [finding], "figures": {}}}


def _rig(arguments: Namespace) -> StatedRig:
    from identify.cli.inspection import StatedRig

    said = {"stiffness": ("N/m", arguments.stiffness), "drive_speed": ("m/s", arguments.drive_speed)}
    said |= {"mass": ("kg", arguments.mass)}
    told = {
        name: None if text is None else quantity(text, unit, f"--{name.replace('_', '-')}")
        for name, (unit, text) in said.items()
    }
    return StatedRig(**told)


def _thresholds(arguments: Namespace) -> Thresholds:
    from data_io.thresholds import Thresholds

    given = pairs(arguments.threshold, "--threshold", "jitter=0.1,spikes=0.01") or {}
    try:
        numbers = {name: float(text) for name, text in given.items()}
    except ValueError:
        raise CommandLineError(
            f"--threshold {arguments.threshold} holds no number; write --threshold jitter=0.1"
        ) from None
    return Thresholds(numbers)
