"""Random scenes over the whole admissible box: each meets its accuracy, or is refused by name; energy balances.

    python experiments/run_property_draws.py                        all draws, one table
    python experiments/run_property_draws.py --from 0 --to 500 --append draws.csv    one part, kept
    python experiments/run_property_draws.py --table draws.csv      the table of all parts
    python experiments/run_property_draws.py --table draws.csv --page docs/hard_cases.md    the same, into the page

For every draw: a run at an accuracy of 1e-4, 1e-6 or 1e-8, a run a hundred times tighter to compare with, the energy
balance of the first by quadrature, and for a share of those with the paper's effects an independent integrator.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections import Counter
from dataclasses import asdict, fields
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1])]

from experiments.draws import draw  # noqa: E402
from experiments.machine import describe  # noqa: E402
from experiments.verdicts import SECONDS, SHARE, Verdict, judge  # noqa: E402

DRAWS = 10_000
FEW = 30
HEADING = "## Random scenes"
HEAD = f"""{HEADING}

Printed by `experiments/run_property_draws.py`: any composition of effects, half of the scenes with quantities from the
whole admissible box, the others from where skin on polymer lies; accuracies of 1e-4, 1e-6 and 1e-8, each run held
against one a hundred times tighter, the energy added up by quadrature, a share against an independent integrator. What
they have found wrong is in `tests/simulation/test_found_by_draws.py`. "As far as the scene allows": the error is no
larger than {SHARE:g} times what disturbances as large as the accuracy make."""


def judged(first: int, last: int, stop_at: float = float("inf"), kept: Path | None = None) -> list[Verdict]:
    """The verdicts of these seeds, each kept in a file as it comes; none is begun once the clock is at `stop_at`."""
    verdicts: list[Verdict] = []
    for seed in range(first, last):
        if time.monotonic() > stop_at:
            break
        verdicts.append(judge(draw(seed)))
        if kept is not None:
            append(kept, verdicts[-1:])
    return verdicts


def append(path: Path, verdicts: list[Verdict]) -> None:
    """Keep more verdicts."""
    new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Verdict)])
        if new:
            writer.writeheader()
        writer.writerows(asdict(v) for v in verdicts)


def load(path: Path) -> list[Verdict]:
    """The verdicts of all parts."""
    kinds = {"outcome": str, "error": float, "energy": float, "seconds": float, "outside": float}
    with path.open(encoding="utf-8") as file:
        return [Verdict(**{k: kinds.get(k, int)(v) for k, v in row.items()}) for row in csv.DictReader(file)]


def table(verdicts: list[Verdict]) -> str:
    """Counts by outcome, and what was measured over all draws."""
    counts = Counter(v.outcome if not v.outcome.startswith("VIOLATION") else "VIOLATION" for v in verdicts)
    lines = ["| outcome | draws |", "| --- | ---: |"]
    lines += [f"| {outcome} | {n} |" for outcome, n in counts.most_common()]
    lines += [f"| together | {len(verdicts)} |", ""]
    ran = [v for v in verdicts if v.phases]
    balanced = [v.energy for v in ran if v.energy == v.energy]
    met = [v.error for v in ran if v.outcome == "met"]
    checked = [v.outside for v in ran if v.outside == v.outside]
    lines.append(f"- seeds {min(v.seed for v in verdicts)} to {max(v.seed for v in verdicts)}")
    lines.append(
        f"- draws with at least one onset: {sum(v.onsets > 0 for v in ran)}; phases: {sum(v.phases for v in ran)}"
    )
    if met:
        lines.append(f"- largest error among those met: {max(met):.2g} times the accuracy asked for")
    if balanced:
        lines.append(f"- energy balanced in {len(balanced)}; largest error {max(balanced):.2g} times the accuracy")
    if checked:
        lines.append(f"- against the independent integrator: {len(checked)}; largest error {max(checked):.2g} times")
    lines.append(f"- longest run: {max(v.seconds for v in verdicts):.1f} s of processor time (bound {SECONDS:g} s)")
    lines += [f"- VIOLATION at seed {v.seed}: {v.outcome}" for v in verdicts if v.outcome.startswith("VIOLATION")]
    return "\n".join(lines)


def put(page: Path, verdicts: list[Verdict]) -> None:
    """Write the table as the last section of a page."""
    before = page.read_text(encoding="utf-8").split(HEADING)[0].rstrip()
    page.write_text("\n\n".join([before, HEAD, describe(), table(verdicts)]) + "\n", encoding="utf-8")


def main(
    fast: bool = False, first: int = 0, last: int = DRAWS, seconds: float = float("inf"), kept: Path | None = None
) -> list[Verdict]:
    """Judge the draws and print the table.

    Args:
        seconds: no draw is begun after that time. kept: file that takes each verdict as it comes.
    """
    print(describe())
    verdicts = judged(first, FEW if fast else last, time.monotonic() + seconds, kept)
    print(table(verdicts) if verdicts else "no draws")
    return verdicts


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--from", dest="first", type=int, default=0)
    parser.add_argument("--to", dest="last", type=int, default=DRAWS)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="begin no draw after that time")
    parser.add_argument("--append", type=Path, help="keep the verdicts in this file; go on behind its last seed")
    parser.add_argument("--table", type=Path, help="only print the table of this file")
    parser.add_argument("--page", type=Path, help="with --table: write it into this page, as its last section")
    given = parser.parse_args()
    if given.table and given.page:
        put(given.page, load(given.table))
    elif given.table:
        print(describe(), table(load(given.table)), sep="\n")
    else:
        done = load(given.append) if given.append and given.append.exists() else []
        main(False, max([given.first, *(v.seed + 1 for v in done)]), given.last, given.seconds, given.append)
