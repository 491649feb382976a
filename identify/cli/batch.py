"""`stickslip batch`: one fit per group of a manifest or per file of a folder; a bad file never stops the run."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from identify.cli.common import (
    DONE,
    NOT_SUCCEEDED,
    WRONG_INPUT,
    Answer,
    CommandLineError,
    Terminal,
    positive,
)
from identify.cli.interrupt import ends_by_itself

if TYPE_CHECKING:
    from identify.studies.planning import BatchPlan
    from identify.studies.running import Summary
    from identify.studies.workers import Workers

NAME = "batch"
HELP = "one fit per group of a manifest (CSV) or per file of a folder, with a page of all"
LIMIT = "30 min"
MOST_SAID = 50  # complaints about a manifest that are shown


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("source", metavar="SOURCE", help="manifest (CSV: path, group, drive_speed, …), or a folder")
    parser.add_argument("--scene", required=True, metavar="SCENE.toml", help="rig and parameters for all groups")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder of the batch")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help='such as rig.mass="0.3 kg"')
    parser.add_argument("--jobs", type=int, metavar="N", help="fits at a time (default: one per core)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="run on the Dask cluster there, such as tcp://host:8786")
    parser.add_argument("--resume", action="store_true", help="go on in DIR: only what is missing or changed is fitted")
    parser.add_argument("--time-limit", default=LIMIT, metavar="T", help=f"for one fit (default {LIMIT})")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Check everything, fit every group, write the tables and the page; exit code 3 where a group did not converge.

    Raises:
        CommandLineError, OSError: one sentence each. What is wrong with the batch is an answer with all complaints.
    """
    from identify.studies.job import BatchError

    try:
        return _run(arguments, terminal)
    except BatchError as error:
        if len(error.complaints) == 1:
            raise
        for complaint in error.complaints[:MOST_SAID]:
            terminal.note(f"  {complaint}")
        if len(error.complaints) > MOST_SAID:
            terminal.note(f"  and {len(error.complaints) - MOST_SAID} more")
        message = f"{len(error.complaints)} things to mend before the batch can begin; nothing was fitted"
        terminal.note(f"stickslip: {message}")
        complaints = list(error.complaints)
        return Answer(WRONG_INPUT, {"schema": 1, "status": "error", "message": message, "errors": complaints})


def _run(arguments: Namespace, terminal: Terminal) -> Answer:
    limit = positive(arguments.time_limit, "s", "--time-limit")
    if arguments.jobs is not None and arguments.jobs < 1:
        raise CommandLineError(f"--jobs is {arguments.jobs}; expected at least 1: correct it")
    if arguments.jobs is not None and arguments.scheduler:
        raise CommandLineError("--jobs counts the fits on this machine; drop it, or drop --scheduler")

    from identify.cli.progress import Progress
    from identify.studies.planning import plan
    from identify.studies.running import check_place, run_batch

    out = Path(arguments.out)
    check_place(out, arguments.resume)
    with Progress(terminal.notes, terminal.progress) as progress:
        planned = plan(Path(arguments.source), Path(arguments.scene), arguments.set, progress)
    for note in planned.notes:
        terminal.note(f"note: {note}")
    workers = _workers(arguments, out)
    ends_by_itself()
    try:
        with Progress(terminal.notes, terminal.progress) as progress:
            summary = run_batch(
                planned,
                out,
                workers,
                resume=arguments.resume,
                limit=limit,
                progress=progress,
                scheduler=arguments.scheduler,
            )
    except KeyboardInterrupt:
        terminal.note(f"note: what has ended is kept in {out}; the same command with --resume goes on from there")
        raise
    _say(summary, terminal)
    if summary.status == "stopped":  # of what has ended so far a page can be had with: stickslip compare
        return Answer(WRONG_INPUT, {"schema": 1, **_document(planned, summary, out)})
    _write_page(out, terminal)
    return Answer(DONE if summary.status == "done" else NOT_SUCCEEDED, _document(planned, summary, out))


def _workers(arguments: Namespace, out: Path) -> Workers:
    """The processes of this machine, or those of a cluster."""
    if not arguments.scheduler:
        from identify.studies.workers import LocalWorkers, cores

        return LocalWorkers(arguments.jobs or cores())
    from identify.studies.workers import ClusterWorkers

    cluster = ClusterWorkers(arguments.scheduler)
    out.mkdir(parents=True, exist_ok=True)
    cluster.check(out.absolute())
    return cluster


def _say(summary: Summary, terminal: Terminal) -> None:
    """The groups that did not converge with their reasons, then how many there were."""
    from identify.base.wording import wrapped
    from identify.studies.running import in_words

    for group, end in summary.ended.items():
        if end.status != "converged":
            terminal.say(wrapped(f"{group}: {end.status.replace('_', ' ')}: {end.message}"))
    kept = f" ({summary.kept} kept from before)" if summary.kept else ""
    terminal.say(wrapped(f"{summary.message}{kept}; {in_words(summary.seconds)}"))


def _write_page(out: Path, terminal: Terminal) -> None:
    from identify.studies.comparison_page import write_batch_report

    terminal.say(f"report: {write_batch_report(out)}")


def _document(planned: BatchPlan, summary: Summary, out: Path) -> dict[str, object]:
    """What --json prints: counts, and per group its end."""
    waiting = [job.group for job in planned.jobs if job.group not in summary.ended]
    ends = {group: {"status": end.status, "message": end.message} for group, end in summary.ended.items()}
    return {
        "status": summary.status,
        "message": summary.message,
        "out": str(out),
        "kept": summary.kept,
        "seconds": summary.seconds,
        "counts": dict(Counter(end["status"] for end in ends.values())),
        "waiting": waiting,
        "groups": ends,
    }
