"""Does the log that a fit asks for tell what it is to tell? The advice of a fit, followed.

A pair of the recovery study is fitted from its four logs. Where a parameter is not identifiable, the logs that the fit
asks for are simulated with the true parameters and new noise, and all logs are fitted again; at most ROUNDS times.
Counted: parameters that a log was to tell, and of these the ones that are `identified` then; answers that are
recovered then in the sense of the recovery study; false successes.

    python experiments/run_next_log_study.py usual|wide data|user FILE NUMBER...
    python experiments/run_next_log_study.py table FILE...
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments.in_parts import append, started
from experiments.machine import describe
from experiments.run_recovery_study import CASES, FRICTION, RANGES, Outcome, Study, compared, sources_named
from experiments.study_problem import NOISE, Case, scene_of
from identify.base.result import NextLogResult
from identify.base.wording import speed_text
from identify.bench.next_log import next_logs
from identify.diagnosis.findings import Findings
from identify.effects import MAIN
from identify.estimation.starts import Sources
from identify.identification import find
from identify.model.model import assemble
from identify.simulation.simulate import run

ROUNDS = 2
SEED = 11
CODES = {"identified": "i", "weak": "w", "not identifiable": "-"}


def recorded(case: Case, log: NextLogResult, random: np.random.Generator) -> Record:
    """The log, simulated with the true parameters, from rest and with a fresh contact."""
    motion = run(assemble(MAIN), case.truth | case.rig, log.drive_speed, log.normal_force, log.duration)
    times = np.arange(round(log.duration * log.sampling_rate)) / log.sampling_rate
    force = motion.sample(times)["force"] + NOISE * random.standard_normal(times.size)
    return Record(times, np.full(times.size, log.normal_force), force)


def fitted(
    case: Case, further: Sequence[float], start: dict[str, float] | None, sources: Sources
) -> tuple[Findings, Outcome]:
    """The fit of a case, and how it compares with the truth."""
    began, scene = time.perf_counter(), scene_of(case, start, further)
    _, found = find(scene, case.records, progress=lambda _stage, _share: None, starts=sources)
    return found, compared(found, case, time.perf_counter() - began)


def trial(ranges: str, sources: Sources, number: int) -> dict[str, Any]:
    """One pair: what its fit asks for, and what becomes of it."""
    case, start, _ = Study(ranges, sources).case(number)
    random = np.random.default_rng([SEED, number])
    found, outcome = fitted(case, (), start, sources)
    line: dict[str, Any] = {"number": number, "ranges": ranges, "sources": sources}
    line |= {"before": _told(outcome), "rounds": []}
    speeds: list[float] = []
    for _ in range(ROUNDS):
        advice = next_logs(found) if "not identifiable" in outcome.verdicts.values() else None
        logs = () if advice is None else advice.logs
        if not logs:
            break
        speeds += [log.drive_speed for log in logs]
        case = replace(case, records=(*case.records, *(recorded(case, log, random) for log in logs)))
        found, outcome = fitted(case, speeds, start, sources)
        promised = [name for log in logs for name in log.expected if name in FRICTION]
        line["rounds"].append(
            {
                "logs": [
                    {
                        "speed": log.drive_speed,
                        "duration": log.duration,
                        "rate": log.sampling_rate,
                        "tells": dict(log.expected),
                    }
                    for log in logs
                ],
                "promised": promised,
                "kept": [name for name in promised if outcome.verdicts.get(name) == "identified"],
                "after": _told(outcome),
            }
        )
    _say(line)
    return line


def _told(outcome: Outcome) -> dict[str, Any]:
    return {
        "status": outcome.status.value,
        "verdicts": outcome.verdicts,
        "distance": outcome.distance,
        "recovered": outcome.recovered,
        "false_success": outcome.false_success,
        "seconds": outcome.seconds,
    }


def _verdicts(told: dict[str, Any]) -> str:
    codes = "".join(CODES.get(told["verdicts"].get(name, ""), "?") for name in FRICTION)
    return f"{codes} {told['status']} {told['distance']:.1f}{' FALSE SUCCESS' if told['false_success'] else ''}"


def _say(line: dict[str, Any]) -> None:
    print(f"{line['number']:4d} {_verdicts(line['before'])}", flush=True)
    for done in line["rounds"]:
        logs = "; ".join(
            f"{speed_text(log['speed'])}, {log['duration']:.3g} s, {log['rate']:.0f} Hz for {', '.join(log['tells'])}"
            for log in done["logs"]
        )
        print(f"     + {logs}\n     = {_verdicts(done['after'])}, {done['after']['seconds']:.1f} s", flush=True)


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Counts over all pairs that had something left to tell."""
    print(f"\n{describe()}\n")
    print("| pairs | start | not told | no log would | logs asked for | promised | kept | recovered before | after |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for ranges, sources in sorted({(line["ranges"], line["sources"]) for line in lines}):
        mine = [line for line in lines if (line["ranges"], line["sources"]) == (ranges, sources)]
        asked = [line for line in mine if "not identifiable" in line["before"]["verdicts"].values()]
        last = [line["rounds"][-1]["after"] if line["rounds"] else line["before"] for line in mine]
        rounds = [done for line in mine for done in line["rounds"]]
        before = sum(line["before"]["recovered"] for line in mine)
        count = Counter[str]()
        for done in rounds:
            count.update(logs=len(done["logs"]), promised=len(done["promised"]), kept=len(done["kept"]))
        print(
            f"| {ranges} ({len(mine)}) | {sources} | {len(asked)} | {sum(not line['rounds'] for line in asked)} "
            f"| {count['logs']} | {count['promised']} | {count['kept']} | {before} | "
            f"{sum(told['recovered'] for told in last)} |"
        )
        wrong = [line["number"] for line, told in zip(mine, last, strict=True) if told["false_success"]]
        print(f"\nfalse success after: {wrong or 'none'}")


def study(ranges: str, sources: Sources, numbers: Sequence[int], file: Path | None = None) -> list[dict[str, Any]]:
    """Pairs of the recovery study, each appended to a file if one is given."""
    out = []
    for number in numbers:
        out.append(trial(ranges, sources, number))
        append(file, out[-1])
    return out


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole study: both ranges, both starts; fast: one usual pair, of which nothing is left to tell."""
    kinds: list[tuple[str, Sources]] = [(ranges, sources) for ranges in RANGES for sources in ("data", "user")]
    lines = [line for kind in kinds[: 1 if fast else None] for line in study(*kind, range(1, 2 if fast else CASES + 1))]
    table(lines)
    return lines


def part(said: Sequence[str]) -> None:
    """The pairs that the words of a command line name."""
    ranges, word, file, *numbers = said
    study(ranges, sources_named(word), [int(number) for number in numbers], Path(file))


if __name__ == "__main__":
    started(main, table, part)
