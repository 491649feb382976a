"""What each strategy of the search buys: every row of `STRATEGIES` switched off, over the studies.

First every sample is fitted once, and the trace tells which strategies led to each answer. A strategy can only have
decided the cases whose answer it led to (or, for the hypotheses, whose cause it named); these alone are fitted again
with the row switched off. Decided: such cases. Lost: of these, what is no longer right without it (a truth that was
recovered, a wrong rig that was named). False: false successes that appear without it. Bought per 200: lost cases of the
usual, in-vivo, record-kind and wrong-rig samples, per 200 cases of these. Seconds: of processor time, spent on the row
in all cases, and how many of the cases tried it. Lines: of code that only this row needs.

Time limits count processor time here, so that a busy machine changes no verdict. Every case follows from its sample and
its number, so the study can be run in parts; a part goes on where its file ends.

    python experiments/run_ablation.py SAMPLE FIRST LAST FILE          # first pass
    python experiments/run_ablation.py without FILE...                 # second pass, into each FILE.without
    python experiments/run_ablation.py table FILE...                   # reads FILE and FILE.without
"""

from __future__ import annotations

import inspect
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments import run_in_vivo_study, run_record_kinds, run_wrong_rig
from experiments.in_parts import append, by_processor_time, read
from experiments.in_vivo import RATES, twin
from experiments.machine import describe
from experiments.record_kinds import KINDS
from experiments.run_recovery_study import FIVE, Study
from experiments.two_materials import fit_both
from identify.diagnosis import diagnosis, disagreement
from identify.estimation import events, grouped, other_optima, search
from identify.estimation.strategies import STRATEGIES, Strategy, tracing

Outcome = tuple[bool, bool, str]  # right, false success, status

RECOVERY = {
    "usual, data": Study("usual"),
    "usual, user": Study("usual", "user"),
    "noise x4": Study("usual", noise=4.0),
    "rate / 4": Study("usual", rate=0.25),
    "wide, five logs": Study(FIVE),
}
TOLD = (
    "usual, data",
    "usual, user",
    "in vivo",
    "record kinds",
    "wrong rig",
    "two materials",
)  # by which a row is judged
FAST = (("usual, data", 1, 2),)

CODE: Mapping[Strategy, Sequence[object]] = {
    Strategy.PIECES_FIRST: (search._pieces_first,),
    Strategy.PRIOR_CONTINUATION: (search._prior_continuation, search._held, search.solve_by_continuation),
    Strategy.STEADY_PARTS: (search._levels_only,),
    Strategy.GROUP_BY_GROUP: (grouped,),
    Strategy.EVENTS_CORRECTED: (search._events_corrected, search._mended, events.with_events_mended),
    Strategy.JOINED: (events.join,),
    Strategy.VIBRATION_STARTS: (other_optima.multistart_around,),
    Strategy.OTHER_OPTIMA: (other_optima.lowest_optimum, other_optima.optima_about, other_optima._thrown),
    Strategy.HYPOTHESES: (diagnosis,),
    Strategy.ONE_LOG_OUT: (disagreement,),
}
"""Functions and modules that only this row needs."""


def one(sample: str, number: int) -> Outcome:
    """Fit one case of a sample and judge it by the rules of its study."""
    if sample in RECOVERY:
        from experiments.run_recovery_study import fit_case

        study = RECOVERY[sample]
        case, start, _ = study.case(number)
        told = fit_case(case, start, study.sources)
        return told.recovered, told.false_success, told.status.value
    if sample == "in vivo":
        line = run_in_vivo_study.trial(twin(number // len(RATES)), RATES[number % len(RATES)])
        false = run_in_vivo_study.false_success(line)
        right = line["status"] == "converged" and all(run_in_vivo_study.right(line, name) for name in line["told"])
        return right and not false, false, line["status"]
    if sample == "record kinds":
        found = run_record_kinds.line(KINDS[number % len(KINDS)], number // len(KINDS))
        return found.found, found.false, found.status
    if sample == "wrong rig":
        kinds = tuple(run_wrong_rig.KINDS)
        line = run_wrong_rig.trial(kinds[number % len(kinds)], 1 + number // len(kinds), also_freed=False)
        return bool(line["noticed"] and line["named"]), not line["noticed"], line["status"]
    if sample == "two materials":
        return fit_both(number)
    others = ("in vivo", "record kinds", "wrong rig", "two materials")
    raise SystemExit(f"no sample {sample!r}; there are {', '.join([*RECOVERY, *others])}")


def traced(sample: str, number: int, off: Iterable[Strategy] = ()) -> dict[str, Any]:
    """One case with its trace."""
    began = time.process_time()
    with tracing(off) as trace:
        right, false, status = one(sample, number)
    spent: dict[str, list[float]] = {}
    for trial in trace.trials:
        spent.setdefault(trial.strategy.split(":")[0], []).append(trial.seconds)
    return {
        "sample": sample,
        "number": number,
        "right": right,
        "false": false,
        "status": status,
        "found_by": sorted(set(trace.found_by)),
        "spent": {name: [len(times), sum(times)] for name, times in spent.items()},
        "not_tried": trace.not_tried,
        "seconds": time.process_time() - began,
    }


def first_pass(sample: str, first: int, last: int, file: Path | None) -> list[dict[str, Any]]:
    """Cases first to last with everything on."""
    done = {line["number"] for line in read([file])} if file is not None and file.exists() else set()
    lines = []
    for number in range(first, last + 1):
        if number in done:
            continue
        line = traced(sample, number)
        lines.append(line)
        append(file, line)
        word = "right" if line["right"] else "FALSE SUCCESS" if line["false"] else line["status"]
        print(f"{sample} {number:4d} {word:16s} {line['seconds']:6.1f} s  {', '.join(line['found_by'])}", flush=True)
    return lines


def decided(strategy: Strategy, line: Mapping[str, Any]) -> bool:
    """Whether a strategy may have decided a case: it led to the answer, or named the cause."""
    if strategy in (Strategy.HYPOTHESES, Strategy.ONE_LOG_OUT):
        return strategy.title in line["spent"] and (line["right"] or line["status"] != "converged")
    return strategy.title in line["found_by"]


def second_pass(lines: Sequence[Mapping[str, Any]], file: Path | None) -> list[dict[str, Any]]:
    """Every decided case again without the strategy."""
    done = {(e["without"], e["number"]) for e in read([file])} if file is not None and file.exists() else set()
    again = []
    for strategy in STRATEGIES:
        if strategy is Strategy.FEATURE_START:
            continue
        for line in lines:
            if not decided(strategy, line) or (strategy.title, line["number"]) in done:
                continue
            other = traced(line["sample"], line["number"], [strategy]) | {"without": strategy.title}
            again.append(other)
            append(file, other)
            print(f"without {strategy.title}: {line['sample']} {line['number']} {other['status']}", flush=True)
    return again


def lines_of_code(strategy: Strategy) -> int:
    """Lines of code that only this row needs."""
    return sum(len(inspect.getsource(piece).splitlines()) for piece in CODE.get(strategy, ()))  # type: ignore[arg-type]


def table(lines: Sequence[Mapping[str, Any]], again: Sequence[Mapping[str, Any]]) -> None:
    """A row per strategy."""
    print(f"\n{describe()}\n")
    print("| sample | cases | right | false | over the time limit | seconds, median / worst |")
    print("| --- | --- | --- | --- | --- | --- |")
    for sample in dict.fromkeys(line["sample"] for line in lines):
        mine = [line for line in lines if line["sample"] == sample]
        times = sorted(line["seconds"] for line in mine)
        late = sum(bool(line["not_tried"]) for line in mine)
        right, false = sum(line["right"] for line in mine), sum(line["false"] for line in mine)
        print(
            f"| {sample} | {len(mine)} | {right} | {false} | {late} | {times[len(times) // 2]:.1f} / {times[-1]:.0f} |"
        )
    told = sum(line["sample"] in TOLD for line in lines)
    by_case = {(line["sample"], line["number"]): line for line in lines}
    print(f"\nBought per 200 cases of {', '.join(TOLD)} ({told} cases).\n")
    print("| strategy | tried in | led to | lost without | false without | bought per 200 | seconds in all | lines |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for strategy in STRATEGIES:
        tried = [line["spent"][strategy.title] for line in lines if strategy.title in line["spent"]]
        led = [line for line in lines if decided(strategy, line)]
        without = [other for other in again if other["without"] == strategy.title]
        pairs = [(by_case[other["sample"], other["number"]], other) for other in without]
        lost = [other for line, other in pairs if line["right"] and not other["right"]]
        false = sum(other["false"] and not line["false"] for line, other in pairs)
        bought = 200 * sum(other["sample"] in TOLD for other in lost) / max(told, 1)
        samples = ", ".join(dict.fromkeys(other["sample"] for other in lost))
        cells = (
            ("all", "–", "–", "–")
            if strategy is Strategy.FEATURE_START
            else (f"{len(led)}", f"{len(lost)}{f' ({samples})' if samples else ''}", f"{false}", f"{bought:.1f}")
        )
        print(
            f"| {strategy.title} | {len(tried)} | {' | '.join(cells)} | {sum(t[1] for t in tried):.0f} "
            f"| {lines_of_code(strategy) or '–'} |"
        )


def main(fast: bool = False) -> None:
    """Both passes over small samples; fast: two usual pairs."""
    samples = FAST if fast else tuple((sample, 1, 20) for sample in RECOVERY)
    lines = [line for sample, first, last in samples for line in first_pass(sample, first, last, None)]
    table(lines, second_pass(lines, None))


def _command(words: Sequence[str]) -> None:
    by_processor_time()
    if words[0] == "without":
        for file in words[1:]:
            second_pass(read([file]), Path(f"{file}.without"))
    elif words[0] == "table":
        beside = [f"{file}.without" for file in words[1:]]
        table(read(words[1:]), read([file for file in beside if Path(file).exists()]))
    else:
        first_pass(words[0], int(words[1]), int(words[2]), Path(words[3]))


if __name__ == "__main__":
    main() if len(sys.argv) == 1 else _command(sys.argv[1:])
