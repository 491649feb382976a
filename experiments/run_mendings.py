"""What the small mendings inside a solve buy: each of `MENDINGS` taken out, over the samples of run_ablation.py.

These are no rows of the table of strategies: they act while one start is placed, solved or judged. First every case is
fitted once, and every mending is watched: did it change anything (a motion put anew, a start added, a log cut)? Only
the cases in which it did are fitted again without it. Lost: no longer right; false: false successes that appear.

    python experiments/run_mendings.py SAMPLE FIRST LAST FILE      # first pass, in parts
    python experiments/run_mendings.py without NAME FILE...        # second pass of one mending, into each FILE.NAME
    python experiments/run_mendings.py table FILE...               # reads each FILE and what stands beside it
"""

from __future__ import annotations

import inspect
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.in_parts import append, read
from experiments.run_ablation import traced
from identify import answering
from identify.base import budget
from identify.estimation import attempt, events, examined, other_optima, search, starts
from identify.shooting import passes, placing

Off = Callable[..., Any]


@dataclass(frozen=True)
class Mending:
    """Where a mending is called by which name; what stands in for it; whether it did something, from its result and
    that of what stands in for it."""

    where: ModuleType
    name: str
    off: Off
    acted: Callable[[Any, tuple[Any, ...]], bool] = lambda result, given: result is not None


def _nothing(*given: Any, **named: Any) -> None:
    return None


def _same(first: Any, *given: Any, **named: Any) -> Any:
    return first


MENDINGS: Mapping[str, Mending] = {
    "resimulated": Mending(attempt, "resimulated", _nothing),
    "resimulated_whole": Mending(attempt, "resimulated_whole", _nothing),
    "by_horizons": Mending(attempt, "_by_horizons", _nothing),
    "first_onsets": Mending(passes, "with_first_onsets", _nothing),
    "last_onsets": Mending(passes, "with_last_onsets", _nothing),
    "calm_passes": Mending(
        passes,
        "_from_calm",
        lambda logs, trajectories, unknowns, way: passes._in_passes(logs, logs, trajectories, unknowns, way),
        lambda result, given: any(passes.calmed(log) is not log for log in given[0]),
    ),
    "calm_search": Mending(
        answering,
        "_by_way_of_calm",
        lambda prepared, unknowns, searched: searched(prepared),
        lambda result, given: any(passes.calmed(log.data) is not log.data for log in given[0]),
    ),
    "interval_of_a_slip": Mending(
        passes, "_interval", lambda log, trajectory: log.interval, lambda result, given: result < given[0].interval
    ),
    "is_near_grazing": Mending(attempt, "is_near_grazing", lambda *_: False, lambda result, _: bool(result)),
    "aged_until_seen": Mending(
        placing, "aged_until_seen", lambda along, x, candidates, onsets: float(x[along.model.clamped]), lambda *_: True
    ),
    "solve_again_with_priors": Mending(
        examined,
        "solve_again_with_priors",
        lambda at, unknowns, theta, motion: attempt.solve_again(
            attempt.replace(at, solved=attempt.replace(at.solved, trajectories=motion)),
            attempt.replace(unknowns, start=theta),
        ),
        lambda *_: True,
    ),
    "placed_anew": Mending(examined, "placed_anew", _nothing),
    "continue_other_optima": Mending(
        other_optima,
        "solve_or_continue",
        lambda prepared, chosen, unknowns, cost_cutoff: attempt.solve_from(
            prepared, chosen, unknowns, cost_cutoff=cost_cutoff
        ),
        lambda *_: True,
    ),
    "suggested_starts": Mending(
        other_optima,
        "suggested_starts",
        lambda logs, unknowns: unknowns.start[None, :][:0],
        lambda result, _: len(result) > 0,
    ),
    "random_starts": Mending(
        starts, "random_starts", lambda unknowns, around, count, seed: around[None, :], lambda *_: True
    ),
    "rejected_as_incomplete": Mending(
        search, "rejected_as_incomplete", _same, lambda result, given: result.gate.status is not given[0].gate.status
    ),
    "held": Mending(search, "_held", _nothing),
    "joined_forms": Mending(events, "_joining_mended", _same, lambda result, given: result is not given[0]),
}


@contextmanager
def watching() -> Iterator[set[str]]:
    """The names of the mendings that did something meanwhile."""
    acted = set[str]()

    def watched(title: str, mending: Mending, original: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            result = original(*given, **named)
            if mending.acted(result, given):
                acted.add(title)
            return result

        return call

    with ExitStack() as stack:
        for title, mending in MENDINGS.items():
            original = getattr(mending.where, mending.name)
            stack.enter_context(patch.object(mending.where, mending.name, watched(title, mending, original)))
        yield acted


def first_pass(sample: str, first: int, last: int, file: Path | None) -> list[dict[str, Any]]:
    """Cases first to last, each mending watched."""
    done = {line["number"] for line in read([file])} if file is not None and file.exists() else set()
    lines = []
    for number in (n for n in range(first, last + 1) if n not in done):
        with watching() as acted:
            line = traced(sample, number)
        line["acted"] = sorted(acted)
        lines.append(line)
        append(file, line)
        print(sample, number, line["status"], round(line["seconds"], 1), *line["acted"], flush=True)
    return lines


def without(title: str, lines: Sequence[Mapping[str, Any]], file: Path | None) -> list[dict[str, Any]]:
    """The cases in which a mending did something, fitted again without it."""
    done = {line["number"] for line in read([file])} if file is not None and file.exists() else set()
    mending, again = MENDINGS[title], []
    for line in (line for line in lines if title in line["acted"] and line["number"] not in done):
        with patch.object(mending.where, mending.name, mending.off):
            other = traced(line["sample"], line["number"])
        again.append(other)
        append(file, other)
        word = "as before" if other["right"] == line["right"] else "LOST" if line["right"] else "won"
        print(f"without {title}:", line["sample"], line["number"], other["status"], word, flush=True)
    return again


def table(files: Sequence[str]) -> None:
    """A row per mending: where it did something, and what is lost without it."""
    print("| mending | cases | fitted again | lost | won | false without | seconds, with / without | lines |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    lines = {(line["sample"], line["number"]): line for line in read(files)}
    for title, mending in MENDINGS.items():
        again = read([f"{file}.{title}" for file in files if Path(f"{file}.{title}").exists()])
        pairs = [(lines[other["sample"], other["number"]], other) for other in again]
        lost = [f"{line['sample']} {line['number']}" for line, other in pairs if line["right"] and not other["right"]]
        won = sum(other["right"] and not line["right"] for line, other in pairs)
        false = sum(other["false"] and not line["false"] for line, other in pairs)
        seconds = [sum(one["seconds"] for one in side) for side in zip(*pairs, strict=True)] or [0.0, 0.0]
        code = len(inspect.getsource(getattr(mending.where, mending.name)).splitlines())
        acted = sum(title in line["acted"] for line in lines.values())
        print(
            f"| {title} | {acted} | {len(pairs)} | {len(lost)}{' (' + ', '.join(lost) + ')' if lost else ''} | {won} "
            f"| {false} | {seconds[0]:.0f} / {seconds[1]:.0f} | {code} |"
        )


def main(fast: bool = False) -> None:
    """Small samples; fast: one usual pair."""
    lines = first_pass("usual, data", 1, 1 if fast else 20, None)
    for title in MENDINGS:
        without(title, lines, None)


def _command(words: Sequence[str]) -> None:
    budget.time = SimpleNamespace(perf_counter=time.process_time)  # type: ignore[assignment]
    if words[0] == "without":
        for file in words[2:]:
            without(words[1], read([file]), Path(f"{file}.{words[1]}"))
    elif words[0] == "table":
        table(words[1:])
    else:
        first_pass(words[0], int(words[1]), int(words[2]), Path(words[3]))


if __name__ == "__main__":
    main() if len(sys.argv) == 1 else _command(sys.argv[1:])
