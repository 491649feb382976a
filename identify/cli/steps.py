"""`stickslip steps`: which runs and steps a log holds, before anybody chooses."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from identify.base.wording import columns, wrapped
from identify.cli.common import Answer, Terminal, add_log_options, log_options
from identify.cli.common import quantity as quantity_given

if TYPE_CHECKING:
    from data_io import StepSummary

NAME = "steps"
HELP = "the runs and steps of a log, with rows, durations, parameters and columns"
MOST_PARAMETERS = 8


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs, folders or patterns of one test's files")
    add_log_options(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
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
        _say(path, found, given.get("normal_force_N"), terminal)
        logs.append({"path": path, **given, "steps": [_document(step) for step in found]})
    return Answer(document={"status": "done", "logs": logs})


def _say(path: str, steps: Sequence[StepSummary], load: float | None, terminal: Terminal) -> None:
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


def _document(step: StepSummary) -> dict[str, Any]:
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
