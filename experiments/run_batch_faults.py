"""Batches that are killed and put on a full disk: what is lost?

Each batch is taken up again with --resume until it is done, and then compared, file by file, with one that was never
disturbed. Counted are groups that had ended and were gone or fitted again ("lost"), results that differ but for
times and host ("wrong"), and folders without all their files ("half"), looked for after every single kill.

The kills at random instants hit batches with a stand-in for the fit (experiments/stub_fits.py: quick, writes slowly,
numbers made from the contents of the logs): what is tried is everything around the fit.

    python experiments/run_batch_faults.py [--fast]
"""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.batch_trials import alive, children, content, differences, kill, put, started, wait_for, write_case
from experiments.machine import describe

PAGE = 6.0  # s in which tables and page are written, about
WORK = 0.05  # s that a stand-in works, and as long again that it writes
VICTIMS = ("batch", "batch", "batch", "batch", "batch, terminated", "one fit")  # who is killed; chosen evenly


@dataclass
class Tally:
    """What was counted in one series of trials: kills, batches done, and in sentences what is lost, wrong or half."""

    name: str
    kills: int = 0
    batches: int = 0
    words: list[str] = field(default_factory=list)
    victims: Counter[str] = field(default_factory=Counter)

    def look(self, out: Path, reference: Path, before: dict[str, int], failed: frozenset[str]) -> dict[str, int]:
        """Look at everything that stands there; returns the groups that have ended, with the inode of each."""
        now = put(out)
        self.words += [f"lost: {group}, or fitted again" for group, inode in before.items() if now.get(group) != inode]
        for group in sorted(set(now) - failed):
            self.words += [f"wrong or half: {words}" for words in differences(out / group, reference / group)]
        return now

    def finish(self, out: Path, reference: Path) -> None:
        """Look at a batch that is done: the tables, and what was left lying about."""
        self.batches += 1
        tables = ("index.csv", "batch.json")
        self.words += [f"wrong: {name}" for name in tables if content(out / name) != content(reference / name)]
        self.words += [f"left over: {item.name}" for item in out.glob(".*") if item.name != ".lock"]

    def __str__(self) -> str:
        victims = "".join(f", {who} {count}" for who, count in self.victims.items())
        told = f"{self.name:<40}{self.batches:>4} batches{self.kills:>5} kills{victims}: {len(self.words)} complaints"
        return "\n".join([told, *(f"    {words}" for words in self.words[:10])])


def batch(case: tuple[Path, Path], out: Path, *more: object) -> list[object]:
    """The arguments of a batch of this case."""
    return [case[0], "--scene", case[1], "--out", out, "--resume", *more]


def undisturbed(case: tuple[Path, Path], out: Path) -> None:
    """Run a batch to its end."""
    process = started(batch(case, out, "--jobs", 2, "--time-limit", "20 s"))
    _, words = process.communicate()
    if process.returncode != 0:
        raise RuntimeError(f"a batch ended with exit code {process.returncode}: {words.decode()}")


def killed_at_random(name: str, case: tuple[Path, Path], reference: Path, home: Path, kills: int) -> Tally:
    """Kill, resume, kill ..., until the batch is done; then the next batch, until there were enough kills."""
    tally, pick = Tally(name), random.Random(kills)
    span = WORK * len(put(reference))  # seconds of work, about
    while tally.kills < kills:
        out, before, failed, code = home / f"out_{tally.batches}", {}, frozenset[str](), None
        while code != 0:
            process = started(batch(case, out, "--jobs", 2), seconds=WORK)
            if tally.kills < kills:
                _one_kill(process, out, tally, pick, span)
            process.communicate()
            code = process.returncode
            if pick.random() < 0.5:  # half of the times the next batch comes while fits of this one may still die
                time.sleep(0.3)
            failed = _failed(out)
            now = tally.look(out, reference, before, failed)
            before = {group: inode for group, inode in now.items() if group not in failed}
        tally.finish(out, reference)
        shutil.rmtree(out)
    return tally


def _one_kill(process: subprocess.Popen[bytes], out: Path, tally: Tally, pick: random.Random, span: float) -> None:
    """Kill the batch or one of its fits at a random instant: of its start in some trials, of its work in most."""
    victim = pick.choice(VICTIMS)
    before = set(out.glob("*/"))
    if pick.random() < 0.8:  # from the first thing that a fit of this run has written
        wait_for(lambda: process.poll() is not None or bool(set(out.glob("*/")) - before), 300.0)
    time.sleep(pick.uniform(0.0, span))
    below = children(process.pid)
    if process.poll() is not None:
        return
    if victim == "one fit" and below:
        kill(pick.choice(below))
    else:
        kill(process.pid, signal.SIGTERM if "terminated" in victim else signal.SIGKILL)
    tally.kills += 1
    tally.victims[victim] += 1
    if victim != "one fit" and pick.random() < 0.5:
        process.wait()
        wait_for(lambda: not any(alive(pid) for pid in below))


def killed_at_its_page(case: tuple[Path, Path], reference: Path, home: Path, kills: int) -> Tally:
    """Kill a batch from its last group on, while tables and page are written: no file is half, no group is lost."""
    tally, pick, out = Tally("killed while its page is written"), random.Random(kills), home / "page"
    while tally.kills < kills:
        before = put(out)
        process = started(batch(case, out, "--jobs", 2), before="")
        while process.poll() is None and len(put(out)) < len(put(reference)):
            time.sleep(0.05)
        time.sleep(pick.uniform(0.0, PAGE))
        kill(process.pid)
        process.communicate()
        tally.kills += process.returncode != 0
        tally.look(out, reference, before, frozenset())
        for page in out.glob("report.html"):
            tally.words += [] if page.read_text().rstrip().endswith("</html>") else ["half: report.html"]
        if pick.random() < 0.2:
            shutil.rmtree(out)
    process = started(batch(case, out, "--jobs", 2), before="")
    process.communicate()
    tally.finish(out, reference)
    tally.words += [] if (out / "report.html").is_file() and process.returncode == 0 else ["no page in the end"]
    return tally


def _failed(out: Path) -> frozenset[str]:
    """The groups whose fit was killed: they hold a record of it alone, and are done again."""
    return frozenset(group for group in put(out) if {p.name for p in (out / group).iterdir()} == {"job.json"})


def full_disk(case: tuple[Path, Path], reference: Path, home: Path) -> Tally:
    """A disk that takes ever larger files: no group is half, and with room again the batch is done."""
    tally, out, before = Tally("full disk"), home / "full", dict[str, int]()
    for size in (5_000, 15_000, 50_000, None):  # bytes that a file may have
        process = started(batch(case, out, "--jobs", 2), largest=size)
        _, words = process.communicate()
        if b"Traceback" in words or process.returncode != (2 if size in (5_000, 15_000) else 0):
            tally.words.append(f"exit code {process.returncode}: {words.decode()[-300:]}")
        tally.kills += process.returncode != 0
        before = tally.look(out, reference, before, frozenset())
    tally.finish(out, reference)
    return tally


def main(fast: bool = False) -> list[Tally]:
    """All trials. fast: a few kills.

    Raises:
        RuntimeError: something was lost, wrong, half or left over.
    """
    print(describe())
    kills, size = (2, 5) if fast else (110, 20)
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        case, reference = write_case(home / "in", [f"G{i:02d}" for i in range(size)]), home / "reference"
        undisturbed(case, reference)
        tallies = [
            killed_at_random("killed at random", case, reference, home, kills),
            killed_at_its_page(case, reference, home, kills // 3),
            full_disk(case, reference, home),
        ]
    print(*tallies, sep="\n")
    if any(tally.words for tally in tallies):
        raise RuntimeError("not everything survived; see the table")
    return tallies


if __name__ == "__main__":
    main("--fast" in sys.argv[1:])
