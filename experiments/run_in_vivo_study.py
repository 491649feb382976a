"""In-vivo twins: what can a fit say of a finger, at which sampling rate, and does what it says hold?

Twins of `in_vivo.py` (records of at most 45 s with 2 to 15 cycles; normal force that relaxes by 10 to 30 %, with pulse
1 to 2 % and tremor 0.5 %, measured with noise; skin in series; friction that drifts; noise with a memory; rig known to
10 %; t_cr 0.5 to 20 s), each sampled at 50, 100, 500 and 1000 Hz and fitted from the data alone with the scene that a
careful user would write.

Rules, set beforehand. An interval covers where it holds the truth; open ends hold everything. A verdict of a converged
fit is right where `identified` is off by at most 20 %, `weak` by at most a factor of three (coefficients: of their
value, delta_mu_k of mu_s - mu_k0; two thirds of it), and `not identifiable` is said of a parameter whose standard error
by the information at the answer, or whose interval, reaches beyond 20 %: nothing that is known is called unknown. False
success: converged while the joint distance (theta - truth)' C^-1 (theta - truth) of all that is searched exceeds 40 and
one of the six is off by more than 10 %.

    python experiments/run_in_vivo_study.py FIRST LAST FILE
    python experiments/run_in_vivo_study.py table FILE...
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

from experiments.in_parts import append, cases, started
from experiments.in_vivo import FRICTION, RATES, STATED, Twin, twin
from experiments.machine import describe
from identify.base.outcome import Status
from identify.identification import find

TWINS = 100
FAR, OFF = 40.0, 0.10
CLOSE, FACTOR = 0.20, 3.0
ASKED = (*FRICTION, "mass")


def trial(made: Twin, rate: float, all_known: bool = False) -> dict[str, Any]:
    """One fit, compared with the truth."""
    scene, records = made.scene(all_known=all_known), made.records(rate)
    began = time.process_time()
    _, found = find(scene, records, progress=lambda _stage, _share: None)
    line: dict[str, Any] = {
        "twin": made.number,
        "rate": rate,
        "rejected": made.rejected,
        "cycles": [int(motion.arrests.size) for motion in made.motions],
        "truth": made.truth,
        "status": found.status.value,
        "message": found.message,
        "seconds": time.process_time() - began,
        "told": {},
        "distance": None,
    }
    if found.attempt is None or found.covariance is None:
        return line
    unknowns, theta = found.unknowns, found.attempt.solved.theta
    base = unknowns.base({name: float(getattr(scene.rig, name)) for name in STATED})
    truth = unknowns.theta(np.array([made.truth[name] for name in unknowns.names]), base)
    away = (theta - truth)[unknowns.free]
    line["distance"] = float(away @ np.linalg.solve(found.covariance, away))
    errors = np.full(len(unknowns.names), np.nan)
    errors[unknowns.free] = np.sqrt(np.diag(found.covariance))
    for e in found.estimates:
        if e.name in ASKED and e.verdict != "fixed":
            index = unknowns.names.index(e.name)
            line["told"][e.name] = {
                "value": e.value,
                "low": e.lower,
                "high": e.upper,
                "verdict": e.verdict,
                "reason": e.reason,
                "error": float(errors[index]),
                "logarithmic": bool(unknowns.logarithmic[index]),
            }
    return line


def size_of(line: dict[str, Any], name: str) -> float:
    """What a coefficient's error is judged by."""
    truth = line["truth"]
    return float(abs(truth["mu_s"] - truth["mu_k0"]) if name == "delta_mu_k" else abs(truth[name]))


def covers(line: dict[str, Any], name: str) -> bool:
    """Whether the interval holds the truth."""
    told, truth = line["told"][name], line["truth"][name]
    low, high = told["low"], told["high"]
    return (low is None or low <= truth) and (high is None or high >= truth)


def right(line: dict[str, Any], name: str) -> bool:
    """Whether the verdict is one that the rules call right."""
    told, truth, size = line["told"][name], line["truth"][name], size_of(line, name)
    off = abs(told["value"] - truth) / size
    if told["verdict"] == "identified":
        return bool(off <= CLOSE)
    if told["verdict"] == "weak":
        if told["logarithmic"]:
            return bool(abs(np.log(told["value"] / truth)) <= np.log(FACTOR))
        return bool(off <= 1.0 - 1.0 / FACTOR)
    wide = 1.96 * told["error"] / (1.0 if told["logarithmic"] else size) > CLOSE
    open_end = told["low"] is None or told["high"] is None
    return bool(wide or open_end)


def false_success(line: dict[str, Any]) -> bool:
    """Whether the fit claims an answer that is wrong."""
    if line["status"] != Status.CONVERGED.value or not line["distance"] > FAR:
        return False
    return any(abs(line["told"][n]["value"] / line["truth"][n] - 1.0) > OFF for n in FRICTION)


def study(
    first: int,
    last: int,
    file: Path | None = None,
    rates: Sequence[float] = RATES,
    all_known: bool = False,
    share: float = 1.0,
) -> list[dict[str, Any]]:
    """The twins first to last at every rate, a share of each record, each printed, and appended to a file if one is
    given."""
    out = []
    for number in range(first, last + 1):
        made = twin(number)
        made = replace(made, durations=tuple(share * duration for duration in made.durations))
        for rate in rates:
            line = trial(made, rate, all_known)
            out.append(line)
            told = line["told"]
            missed = [n for n in told if not covers(line, n)] if line["status"] == "converged" else []
            wrong = [n for n in told if not right(line, n)] if line["status"] == "converged" else []
            print(
                f"{number:4d} {rate:5.0f} Hz {line['status']:17s} {'FALSE SUCCESS' if false_success(line) else '':13s} "
                f"cycles {line['cycles']} {line['seconds']:5.1f} s  distance {line['distance'] or np.nan:6.1f}  "
                f"not covered: {', '.join(missed) or 'none'}; verdict wrong: {', '.join(wrong) or 'none'}",
                flush=True,
            )
            if line["status"] != "converged":
                print(f"     {line['message'][:300]}", flush=True)
            append(file, line)
    return out


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Counts per sampling rate, and what each can tell."""
    print(f"\n{describe()}\n")
    print(
        "| rate | fits | status | intervals that cover | of what is identified or weak | verdicts right | false "
        "success | seconds, median |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for rate in sorted({line["rate"] for line in lines}):
        mine = [line for line in lines if line["rate"] == rate]
        done = [line for line in mine if line["status"] == Status.CONVERGED.value]
        pairs = [(line, name) for line in done for name in line["told"]]
        claims = [(line, name) for line, name in pairs if line["told"][name]["verdict"] in ("identified", "weak")]
        status = ", ".join(f"{k} {v}" for k, v in Counter(line["status"] for line in mine).most_common())
        print(
            f"| {rate:g} Hz | {len(mine)} | {status} | {_share(sum(covers(*p) for p in pairs), len(pairs))} "
            f"| {_share(sum(covers(*p) for p in claims), len(claims))} "
            f"| {_share(sum(right(*p) for p in pairs), len(pairs))} | {sum(false_success(line) for line in mine)} "
            f"| {np.median([line['seconds'] for line in mine]):.0f} |"
        )
    print("\nWhat each rate tells: identified / weak / not identifiable, of the fits that converged.\n")
    print("| rate | " + " | ".join(ASKED) + " | asked for, most often |")
    print("| --- " * (len(ASKED) + 2) + "|")
    for rate in sorted({line["rate"] for line in lines}):
        done = [line for line in lines if line["rate"] == rate and line["status"] == Status.CONVERGED.value]
        cells = []
        for name in ASKED:
            said = Counter(line["told"][name]["verdict"] for line in done if name in line["told"])
            cells.append(" / ".join(str(said[word]) for word in ("identified", "weak", "not identifiable")))
        reasons = [t["reason"] for line in done for t in line["told"].values() if t["verdict"] == "not identifiable"]
        asked = Counter(_asked(reason) for reason in reasons)
        most = asked.most_common(1)[0][0] if asked else "nothing"
        print(f"| {rate:g} Hz | {' | '.join(cells)} | {most} |")
    twins = {line["twin"]: line["rejected"] for line in lines}
    print(f"\n{len(twins)} twins, {sum(twins.values())} draws rejected")


def _asked(reason: str) -> str:
    """What a reason asks for."""
    return "sample at" + reason.split("sample at")[1].split(" or more")[0] if "sample at" in reason else "other logs"


def _share(count: int, of: int) -> str:
    return f"{count} of {of}" + (f" ({100 * count / of:.1f} %)" if of else "")


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole study; fast: two thirds of one twin at 50 Hz, of which all but coefficients is known."""
    lines = study(FAST, FAST, rates=(50.0,), all_known=True, share=0.65) if fast else study(0, TWINS - 1)
    table(lines)
    return lines


FAST = 2  # a twin that is soon done, for the fast form


if __name__ == "__main__":
    started(main, table, cases(study))
