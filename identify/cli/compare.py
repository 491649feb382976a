"""`stickslip compare`: tables, plots and verdicts over finished fits, by any label."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from identify.cli.common import Answer, CommandLineError, Terminal, positives

NAME = "compare"
HELP = "comparison tables and plots over finished fits (fit or batch folders), by a label"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("folders", nargs="+", metavar="DIR", help="folders of fits or batches")
    parser.add_argument("--by", required=True, metavar="LABEL", help="the label whose groups are compared")
    parser.add_argument("--out", metavar="DIR", help="folder of the answer (default: stickslip-by-<label>)")
    parser.add_argument(
        "--subject",
        metavar="LABEL",
        help='the label that says whose fit it is (default: volunteer, subject, participant or person; "none": no one)',
    )
    parser.add_argument("--without", action="append", default=[], metavar="FIT", help="leave out a fit by name")
    parser.add_argument(
        "--speeds", metavar="SPEED,…", help='common drive speeds: "0.1 mm/s,1 mm/s" (default: of the logs)'
    )
    parser.add_argument("--load", metavar="FORCE", help='common normal force: "1 N" (default: median of the logs)')


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Compare, write the folder, say what differs.

    Raises:
        CommandLineError, CompareError, OSError: one sentence each.
    """
    from identify.base.table import visible
    from identify.cli.folder import COMPARISON, check_replaceable, result_folder
    from identify.studies.compare import ComparisonQuestion, compare
    from identify.studies.comparison_page import document, write_comparison
    from identify.studies.comparison_tables import comparison_tables, together
    from identify.studies.fits import read_fits
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
    told = document(comparison, comparison_tables(comparison, answers))
    terminal.say(
        f"{told['compared']} of {told['fits']} fits compared by {visible(comparison.question.by)}: "
        + ", ".join(visible(g, 30) for g in comparison.groups[:10])
        + (f" and {len(comparison.groups) - 10} more" if len(comparison.groups) > 10 else "")
    )
    for names, _, words in together([(name, "", words) for name, words in told["in_words"].items()]):
        terminal.say(f"  {visible(names, 200)}: {visible(words, 400)}")
    for name, reason in comparison.selected.left_out[:10]:
        terminal.say(f"  left out: {visible(name, 60)} ({visible(reason, 120)})")
    for odd in comparison.odd[:10]:
        terminal.say(f"  outlier? {visible(odd.name, 60)}: {odd.quantity} is off by {odd.z:+.1f} sd")
    terminal.say(f"page: {out / 'report.html'}")
    return Answer(document={**told, "out": str(out)})
