"""`stickslip batch` and `compare`: many fits at once, and comparisons over finished fits."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from identify.cli.common import (
    DONE,
    NOT_SUCCEEDED,
    SET,
    WRONG_INPUT,
    Answer,
    Command,
    CommandLineError,
    Options,
    Terminal,
    positive,
    positives,
)
from identify.cli.interrupt import ends_by_itself

if TYPE_CHECKING:
    from identify.studies.workers import Workers

LIMIT = "30 min"
MOST_SAID = 50  # complaints about a manifest that are shown


BATCH_OPTIONS: Options = {
    "source SOURCE": "manifest (CSV: path, group, drive_speed, …), or a folder",
    "--scene SCENE.toml!": "rig and parameters for all groups",
    "--out DIR!": "folder of the batch",
    **SET,
    "--jobs N": "fits at a time (default: one per core)",
    "--scheduler ADDRESS": "run on the Dask cluster there, such as tcp://host:8786",
    "--resume": "go on in DIR: only what is missing or changed is fitted",
    "--time-limit T": f"for one fit (default {LIMIT})",
}


def batch(arguments: Namespace, terminal: Terminal) -> Answer:
    """Check everything, fit every group, write the tables and the page; exit code 3 where a group did not converge."""
    limit = positive(arguments.time_limit or LIMIT, "s", "--time-limit")
    if arguments.jobs is not None and arguments.jobs < 1:
        raise CommandLineError(f"--jobs is {arguments.jobs}; expected at least 1: correct it")
    if arguments.jobs is not None and arguments.scheduler:
        raise CommandLineError("--jobs counts the fits on this machine; drop it, or drop --scheduler")

    from identify.base.wording import wrapped
    from identify.studies.batch_store import BatchError
    from identify.studies.planning import plan
    from identify.studies.running import check_place, in_words, run_batch
    from identify.studies.workers import ClusterWorkers, LocalWorkers, cores

    out = Path(arguments.out)
    check_place(out, arguments.resume)
    try:
        with terminal.bar() as progress:
            planned = plan(Path(arguments.source), Path(arguments.scene), arguments.set, progress)
    except BatchError as error:  # what is wrong with the batch is an answer with all complaints
        complaints = list(error.complaints)
        if len(complaints) == 1:
            raise
        more = [f"and {len(complaints) - MOST_SAID} more"] if len(complaints) > MOST_SAID else []
        for complaint in [*complaints[:MOST_SAID], *more]:
            terminal.note(f"  {complaint}")
        message = f"{len(complaints)} things to correct before the batch can begin; nothing was fitted"
        terminal.note(f"stickslip: {message}")
        return Answer(WRONG_INPUT, {"schema": 1, "status": "error", "message": message, "errors": complaints})
    for note in planned.notes:
        terminal.note(f"note: {note}")
    workers: Workers = LocalWorkers(arguments.jobs or cores())
    if arguments.scheduler:
        workers = ClusterWorkers(arguments.scheduler)
        out.mkdir(parents=True, exist_ok=True)
        workers.check(out.absolute())
    ends_by_itself()
    try:
        with terminal.bar() as progress:
            how = {"resume": arguments.resume, "limit": limit, "scheduler": arguments.scheduler}
            summary = run_batch(planned, out, workers, progress=progress, **how)
    except KeyboardInterrupt:
        terminal.note(f"note: what has ended is kept in {out}; the same command with --resume goes on from there")
        raise
    for group, end in summary.ended.items():
        if end.status != "converged":
            terminal.say(wrapped(f"{group}: {end.status.replace('_', ' ')}: {end.message}"))
    kept = f" ({summary.kept} kept from before)" if summary.kept else ""
    terminal.say(wrapped(f"{summary.message}{kept}; {in_words(summary.seconds)}"))
    ends = {group: {"status": end.status, "message": end.message} for group, end in summary.ended.items()}
    document = {
        "status": summary.status,
        "message": summary.message,
        "out": str(out),
        "kept": summary.kept,
        "seconds": summary.seconds,
        "counts": dict(Counter(end["status"] for end in ends.values())),
        "waiting": [job.group for job in planned.jobs if job.group not in summary.ended],
        "groups": ends,
    }
    if summary.status == "stopped":  # of what has ended so far a page can be had with: stickslip compare
        return Answer(WRONG_INPUT, {"schema": 1, **document})
    write_page(out, terminal)
    return Answer(DONE if summary.status == "done" else NOT_SUCCEEDED, document)


def write_page(out: Path, terminal: Terminal) -> None:
    """Write the page of a batch and name it."""
    from identify.studies.comparison_page import write_batch_report

    terminal.say(f"report: {write_batch_report(out)}")


COMPARE_OPTIONS: Options = {
    "folders DIR+": "folders of fits or batches",
    "--by LABEL!": "the label whose groups are compared",
    "--out DIR": "folder of the answer (default: stickslip-by-<label>)",
    "--subject LABEL": "the label that says whose fit it is (default: volunteer, subject, participant or person; "
    '"none": no one)',
    "--without FIT+": "leave out a fit by name",
    "--speeds SPEED,…": 'common drive speeds: "0.1 mm/s,1 mm/s" (default: of the logs)',
    "--load FORCE": 'common normal force: "1 N" (default: median of the logs)',
}


def compare_fits(arguments: Namespace, terminal: Terminal) -> Answer:
    """Compare, write the folder, say what differs."""
    from identify.base.table import visible
    from identify.cli.folder import COMPARISON, check_replaceable, result_folder
    from identify.studies.compare import ComparisonQuestion, compare, read_fits
    from identify.studies.comparison_page import document, write_comparison
    from identify.studies.comparison_tables import comparison_tables, together
    from identify.studies.operating_points import answered

    speeds = positives(arguments.speeds, "m/s", "--speeds")
    load = next(iter(positives(arguments.load, "N", "--load")), None)
    by = "".join(c if c.isalnum() or c in "-_" else "_" for c in arguments.by)[:40] or "label"
    out = Path(arguments.out or f"stickslip-by-{by}")
    for folder in map(Path, arguments.folders):
        if not folder.is_dir():
            what = "is no folder" if folder.exists() else "does not exist"
            raise CommandLineError(f"{folder}: this {what}; give the folder of a fit or of a batch")
    check_replaceable(out, COMPARISON)
    question = ComparisonQuestion(arguments.by, arguments.subject, tuple(arguments.without))
    terminal.note("reading the fits")
    comparison = compare(read_fits(arguments.folders), question)
    terminal.note("stability and amplitude at common operating points")
    answers = answered(comparison, speeds, load)
    terminal.note("writing the tables and the page")
    with result_folder(out, COMPARISON) as folder:
        write_comparison(comparison, answers, folder, home=out)
    outcome = document(comparison, comparison_tables(comparison, answers))
    terminal.say(
        f"{outcome['compared']} of {outcome['fits']} fits compared by {visible(comparison.question.by)}: "
        + ", ".join(visible(g, 30) for g in comparison.groups[:10])
        + (f" and {len(comparison.groups) - 10} more" if len(comparison.groups) > 10 else "")
    )
    for names, _, words in together([(name, "", words) for name, words in outcome["in_words"].items()]):
        terminal.say(f"  {visible(names, 200)}: {visible(words, 400)}")
    for name, reason in comparison.selected.left_out[:10]:
        terminal.say(f"  left out: {visible(name, 60)} ({visible(reason, 120)})")
    terminal.say(f"page: {out / 'report.html'}")
    return Answer(document={**outcome, "out": str(out)})


BATCH = "one fit per group of a manifest (CSV) or per file of a folder, with a page of all"
COMPARE = "comparison tables and plots over finished fits (fit or batch folders), by a label"
COMMANDS = (
    Command("batch", BATCH, BATCH_OPTIONS, batch),
    Command("compare", COMPARE, COMPARE_OPTIONS, compare_fits),
)
