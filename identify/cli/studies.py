"""`stickslip batch` and `compare`: many fits at once, and comparisons over finished fits."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from pathlib import Path

from identify.base.table import visible
from identify.base.wording import wrapped
from identify.cli.arguments import COMPARISON, check_replaceable, positive, result_folder
from identify.cli.common import Answer, CommandLineError, Exit, Terminal
from identify.cli.interrupt import ends_by_itself
from identify.scene.tables import POSITIVE, Key, check
from identify.studies.batch_store import BatchError
from identify.studies.planning import plan
from identify.studies.running import check_place, in_words, run_batch
from identify.studies.workers import ClusterWorkers, LocalWorkers, Workers, cores

LIMIT = 1800.0  # seconds of one fit


def batch(arguments: Namespace, terminal: Terminal) -> Answer:
    """Check everything, fit every group, write the tables and the page; exit code 3 where a group did not converge."""
    limit = positive(arguments.time_limit, "s", "--time-limit") or LIMIT
    check("--jobs", Key(sign=POSITIVE), arguments.jobs)
    if arguments.jobs is not None and arguments.scheduler:
        raise CommandLineError("--jobs counts the fits on this machine; drop it, or drop --scheduler")
    out = Path(arguments.out)
    check_place(out, arguments.resume)
    try:
        with terminal.bar() as progress:
            planned = plan(Path(arguments.source), Path(arguments.scene), arguments.set, progress)
    except BatchError as error:
        if len(error.complaints) == 1:
            raise
        message = f"{len(error.complaints)} things to correct before the batch can begin; nothing was fitted"
        raise CommandLineError(message, error.complaints) from None
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
    outcome = {
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
        return Answer(Exit.WRONG_INPUT, {"schema": 1, **outcome})
    from identify.studies.comparison_page import write_batch_report  # takes longer to load than a batch to begin

    terminal.say(f"report: {write_batch_report(out)}")
    return Answer.of(summary.status == "done", outcome)


def compare_fits(arguments: Namespace, terminal: Terminal) -> Answer:
    """Compare, write the folder, say what differs."""
    from identify.studies.compare import ComparisonQuestion, compare, read_fits
    from identify.studies.comparison_page import comparison_tables, document, together, write_comparison

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
    terminal.note("writing the tables and the page")
    with result_folder(out, COMPARISON) as folder:
        write_comparison(comparison, folder, home=out)
    outcome = document(comparison, comparison_tables(comparison))
    groups = [visible(group, 30) for group in comparison.groups[:10]]
    more = f" and {len(comparison.groups) - 10} more" if len(comparison.groups) > 10 else ""
    by = visible(comparison.question.by)
    terminal.say(f"{outcome['compared']} of {outcome['fits']} fits compared by {by}: {', '.join(groups)}{more}")
    for names, _, words in together([(name, "", words) for name, words in outcome["in_words"].items()]):
        terminal.say(f"  {visible(names, 200)}: {visible(words, 400)}")
    for name, reason in comparison.selected.left_out[:10]:
        terminal.say(f"  left out: {visible(name, 60)} ({visible(reason, 120)})")
    terminal.say(f"page: {out / 'report.html'}")
    return Answer(document={**outcome, "out": str(out)})
