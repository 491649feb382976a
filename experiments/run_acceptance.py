"""The frozen truth: every sample that the fit is judged by, in one command and one table.

One line of JSON a case: status, answered, right, false success, true values inside and outside their 95 % intervals,
worst deviation in half-widths, verdict errors, processor and wall seconds, message. The rules stand in `judgement.py`,
the samples in `acceptance_samples.py`. A run goes on where its file ends. Limits of issue "The fit at half its size"
stand beside the figures.

With `--cpu-clock` time limits of fits count processor time, so that a busy machine changes no verdict. `--subset third`
is the fixed part that is run after each step. `--set second` draws the same recipes from other seeds: it is held out,
run only at the end of a change of the fit, and nothing is ever mended on its cases.

`results/acceptance_before.jsonl` holds the cases of the third that were run at b89a542, before the fit was halved,
`results/acceptance_after.jsonl` most samples whole, at 4f78dd2a to c7ed8047, `results/acceptance_second_after.jsonl`
the third of the second set for which time sufficed, at 31a765c1 to c7ed8047.

    python experiments/run_acceptance.py run SAMPLE|all [FIRST LAST] --out FILE.jsonl [--subset third] [--cpu-clock]
    python experiments/run_acceptance.py table BEFORE.jsonl [AFTER.jsonl]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.acceptance_samples import COMMANDS, SAMPLES, SECOND, Sample
from experiments.machine import by_processor_time, describe

HEAD = (
    "sample", "cases", "right", "false", "answered", "intervals that hold", "verdict errors", "invented",
    "processor s, median / worst", "asked for",
)  # fmt: skip
FAST = (("usual", 5), ("regimes", 3), ("hard", 0))


def case(sample: str, number: int) -> dict[str, Any]:
    """One case, with what it took."""
    wall, cpu = time.perf_counter(), os.times()
    line = SAMPLES[sample].one(number)
    used = sum(os.times()[:4]) - sum(cpu[:4])
    spent = {"cpu": round(line.get("cpu", used), 2), "wall": round(time.perf_counter() - wall, 2)}
    return {"sample": sample, "case": number} | line | spent


def read(path: str | Path) -> list[dict[str, Any]]:
    """The cases of a file."""
    return [json.loads(line) for line in Path(path).read_text(encoding="utf-8").splitlines()]


def run(sample: str, numbers: Sequence[int], file: Path | None) -> list[dict[str, Any]]:
    """The cases of a sample that the file does not hold yet."""
    done = {(line["sample"], line["case"]) for line in read(file)} if file is not None and file.exists() else set()
    lines = []
    for number in numbers:
        if (sample, number) in done:
            continue
        line = case(sample, number)
        lines.append(line)
        if file is not None:
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(line) + "\n")
        word = "right" if line["right"] else "FALSE" if line["false"] else line["status"]
        print(f"{sample} {number} {word} {line['cpu']:.1f} s  {'' if line['right'] else line['message']}", flush=True)
    return lines


def row(sample: Sample, lines: Sequence[Mapping[str, Any]]) -> list[str]:
    """The figures of a sample, in the order of HEAD without name and limit."""
    inside, outside = (sum(line[key] for line in lines) for key in ("inside", "outside"))
    held = f"{inside} of {inside + outside} ({100 * inside / (inside + outside):.1f} %)" if inside + outside else "–"
    seconds = [line["cpu"] for line in lines]
    return [
        str(len(lines)),
        str(sum(line["right"] for line in lines)),
        str(sum(line["false"] for line in lines)),
        str(sum(line["answered"] for line in lines)),
        held,
        str(sum(len(line["verdict_errors"]) for line in lines)),
        str(sum(line.get("invented", False) for line in lines)),
        f"{np.median(seconds):.1f} / {max(seconds):.0f}",
    ]


def limits(sample: Sample, count: int) -> str:
    """What is asked of a sample of so many cases."""
    asked = []
    if sample.limit is not None:
        asked.append(f"right ≥ {sample.limit * count:.3g}")
    if sample.answered is not None:
        asked.append(f"answered ≥ {sample.answered * count:.3g}")
    if sample.coverage is not None:
        low, high = sample.coverage
        asked.append(f"hold ≥ {100 * low:.0f} %" if high >= 1.0 else f"hold {100 * low:.0f} to {100 * high:.0f} %")
    return ", ".join([*asked, "false 0"]) if asked else "as before, false 0"


def table(before: Sequence[Mapping[str, Any]], after: Sequence[Mapping[str, Any]] | None = None) -> None:
    """A row a sample; with two runs, of the cases that both hold, and the cases that went and came."""
    runs = [{(line["sample"], line["case"]): line for line in lines} for lines in (before, after or ())]
    common = [key for key in runs[0] if after is None or key in runs[1]]
    print("| " + " | ".join(HEAD) + " |\n" + "| --- " * len(HEAD) + "|")
    for name, sample in SAMPLES.items():
        keys = [key for key in common if key[0] == name]
        if not keys:
            continue
        rows = [row(sample, [each[key] for key in keys]) for each in runs[: 1 if after is None else 2]]
        cells = [" → ".join(dict.fromkeys(cell)) for cell in zip(*rows, strict=True)]
        print("| " + " | ".join([name, *cells, limits(sample, len(keys))]) + " |")
    if after is None:
        _list("false", [key for key in common if runs[0][key]["false"]])
        return
    pairs = [(key, runs[0][key], runs[1][key]) for key in common]
    _list("right before, not after", [key for key, old, new in pairs if old["right"] and not new["right"]])
    _list("right after, not before", [key for key, old, new in pairs if new["right"] and not old["right"]])
    _list("false after", [key for key, _, new in pairs if new["false"]])


def _list(title: str, keys: Sequence[tuple[str, int]]) -> None:
    if keys:
        print(f"\n{title}: " + ", ".join(f"{name} {number}" for name, number in keys))


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole table; fast: a case of a few samples."""
    if fast:
        lines = [line for sample, number in FAST for line in run(sample, [number], None)]
    else:
        lines = [line for name, sample in SAMPLES.items() for line in run(name, sample.numbers("whole"), None)]
    print(f"\n{describe()}\n")
    table(lines)
    return lines


def _command() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    running = commands.add_parser("run")
    running.add_argument("sample", choices=[*SAMPLES, "all"])
    running.add_argument("numbers", type=int, nargs="*", metavar="FIRST LAST")
    running.add_argument("--out", type=Path, required=True)
    running.add_argument("--subset", choices=("whole", "third"), default="whole")
    running.add_argument("--set", choices=("first", "second"), default="first")
    running.add_argument("--cpu-clock", action="store_true")
    shown = commands.add_parser("table")
    shown.add_argument("before", type=Path)
    shown.add_argument("after", type=Path, nargs="?")
    said = parser.parse_args()
    if said.command == "table":
        table(read(said.before), None if said.after is None else read(said.after))
        return
    if said.cpu_clock:
        by_processor_time()
        COMMANDS.cpu_clock = True
    shift = SECOND if said.set == "second" else 0
    for name in SAMPLES if said.sample == "all" else (said.sample,):
        numbers = SAMPLES[name].numbers(said.subset)
        if said.numbers:
            numbers = [number for number in numbers if said.numbers[0] <= number <= said.numbers[-1]]
        if shift and name in ("measured", "hard"):
            continue  # these are not drawn
        run(name, [number + shift for number in numbers], said.out)


if __name__ == "__main__":
    _command() if len(sys.argv) > 1 else main()
