"""Hostile inputs by the hundred: each must end soon, in little memory, in one sentence and exit code 2.

An input (experiments/hostile_inputs.py) is given to its command in a process of its own, a copy of one that has the
package loaded: what is measured is the work on the input. What is sound and merely long may as well be read (exit 0).

    python experiments/run_hostile_inputs.py [every n-th [words that its name holds]]
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.hostile_inputs import GOOD, SCENE, Hostile, all_inputs
from experiments.machine import describe

LONGEST, WORKS = 2.0, 6.0  # [s] of processor time beside reading, and of a command that computes on what it took
BYTES_PER_SECOND = 20e6  # of the file: reading time
MOST_MEMORY = 500e6  # bytes, over those of a process that has done nothing
GIVEN_UP = 30  # [s] of processor time
LONGEST_SENTENCE = 2000  # characters


@dataclass(frozen=True)
class Ending:
    """How a command ended: exit code (negative: by that signal), processor time [s], peak memory [bytes], words."""

    code: int
    seconds: float
    memory: float
    words: str


def ended(command: list[str], folder: Path) -> Ending:
    """Run a command of ours in a copy of this process; returns how it ended."""
    import identify.cli.main as cli

    words = folder / "words"
    child = os.fork()
    if child == 0:
        code = 1
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (GIVEN_UP, GIVEN_UP))
            resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
            for number, target in ((0, os.devnull), (1, os.devnull), (2, str(words))):
                os.dup2(os.open(target, os.O_RDWR | os.O_CREAT | os.O_TRUNC), number)
            sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
            os.chdir(folder)
            code = cli.main(command)
            sys.stderr.flush()
        finally:
            os._exit(code)
    until = time.monotonic() + 20 * GIVEN_UP  # a busy machine; what waits without working is seen still
    done, status, used = os.wait4(child, os.WNOHANG)
    while not done and time.monotonic() < until:
        time.sleep(0.005)
        done, status, used = os.wait4(child, os.WNOHANG)
    if not done:
        os.kill(child, 9)
        _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    said = words.read_text(encoding="utf-8", errors="replace")
    return Ending(code, used.ru_utime + used.ru_stime, 1024.0 * used.ru_maxrss, said)


def complaint(hostile: Hostile, ending: Ending, size: int, idle: float) -> str:
    """What is wrong with how an input ended, "" where nothing is."""
    found = []
    works = WORKS if hostile.command[0] not in ("inspect", "scene", "convert") and ending.code != 2 else 0.0
    if ending.seconds > LONGEST + works + size / BYTES_PER_SECOND:
        found.append(f"{ending.seconds:.1f} s")
    if ending.memory - idle > MOST_MEMORY:
        found.append(f"{(ending.memory - idle) / 1e6:.0f} MB")
    if ending.code != 2 and not (hostile.sound and ending.code in (0, 3)):
        found.append(f"exit {ending.code}: {ending.words[-200:]!r}")
    last = [line for line in ending.words.splitlines() if line.startswith("stickslip: ")]
    if ending.code == 2 and (len(last) != 1 or not ending.words.rstrip().endswith(last[0])):
        found.append(f"no sentence: {ending.words[-200:]!r}")
    if ending.code == 2 and last and len(last[0]) > LONGEST_SENTENCE:
        found.append(f"a sentence of {len(last[0])} characters")
    return "; ".join(found)


def tried(hostile: Hostile, folder: Path, idle: float) -> tuple[Ending, str]:
    """Give an input to its command; returns how it ended and what is wrong with that."""
    place, data = folder / hostile.file, hostile.data()
    for name, content in {hostile.file: data, "pair.toml": SCENE.encode(), **hostile.beside}.items():
        (folder / name).write_bytes(content)
    names = {"{file}": str(place), "{scene}": str(folder / "pair.toml")}
    command = [names.get(word, word.replace("{out}", str(folder / "out"))) for word in hostile.command]
    ending = ended(command, folder)
    return ending, complaint(hostile, ending, len(data), idle)


def main(fast: bool = False, every: int = 1, words: str = "") -> Counter[str]:
    """Try the inputs; returns how often each kind of end was seen."""
    from identify.cli import bench, fit, logs, operating, simulation, studies  # noqa: F401 - loaded before any is timed

    chosen = [hostile for hostile in all_inputs() if words in f"{hostile.name}, {hostile.file}"][
        :: 60 if fast else every
    ]
    counts, slowest, largest = Counter[str](), 0.0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "good.csv").write_bytes(GOOD)
        idle = ended(["inspect", "good.csv"], Path(folder)).memory
    for hostile in chosen:
        with tempfile.TemporaryDirectory() as folder:
            ending, wrong = tried(hostile, Path(folder), idle)
        counts["WRONG" if wrong else "refused" if ending.code == 2 else "read"] += 1
        slowest, largest = max(slowest, ending.seconds), max(largest, ending.memory - idle)
        if wrong:
            print(f"WRONG {hostile.name}, {hostile.file}: {wrong}", flush=True)
    print(f"{len(chosen)} hostile inputs: {dict(counts)}; longest {slowest:.1f} s, most memory {largest / 1e6:.0f} MB")
    print(describe())
    return counts


if __name__ == "__main__":
    arguments = sys.argv[1:]
    counted = main(every=int(arguments[0]) if arguments else 1, words=arguments[1] if len(arguments) > 1 else "")
    sys.exit(1 if counted["WRONG"] else 0)
