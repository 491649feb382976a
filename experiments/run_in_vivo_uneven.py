"""In-vivo twins whose friction differs from stick to stick: what a fit says, by sampling rate, and whether it holds.

The twins of `in_vivo.py`, on a track whose level wanders and whose strength scatters by SCATTER, fitted as a careful
user would, who knows nothing of that. A result covers where its interval holds the truth. The strength of the uneven
estimator is the onset force above the level of sliding, which falls with sliding speed here: any value from (mu_s -
mu_k0) (1 - exp(-T/t_cr)) at the median rest T to that plus -delta_mu_k is true of it. False success: an answer that
tells a parameter whose truth lies farther from the middle of its interval than FAR half widths.

    python experiments/run_in_vivo_uneven.py FIRST LAST FILE
    python experiments/run_in_vivo_uneven.py table FILE...
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.in_parts import append, cases, started
from experiments.in_vivo import FRICTION, RATES, Twin, twin
from experiments.machine import describe
from identify import fit

SCATTER = 0.15  # of the logarithm of the strength
FAR = 3.0
TWINS = 50
ASKED = (*FRICTION, "mass", "strength")


def true_values(made: Twin) -> dict[str, tuple[float, float]]:
    """Least and greatest true value of what a fit may tell of a twin."""
    rests = np.concatenate([motion.onsets[1:] - motion.arrests[: motion.onsets.size - 1] for motion in made.motions])
    fall = made.truth["mu_s"] - made.truth["mu_k0"]
    regained = fall * -float(np.expm1(-np.median(rests) / made.truth["t_cr"]))
    return {name: (value, value) for name, value in made.truth.items()} | {
        "strength": (regained, regained - made.truth["delta_mu_k"])
    }


def trial(made: Twin, rate: float) -> dict[str, Any]:
    """One fit, compared with the truth: parameters that it tells, and how far off each is, in half widths of its
    interval (0: its end is open and on the right side)."""
    began, truth = time.process_time(), true_values(made)
    document = fit(made.scene(), made.records(rate)).result
    off = {}
    for name, told in document["parameters"].items():
        if name not in ASKED or told["verdict"] == "fixed":
            continue
        low, high = told["interval"]
        least, greatest = truth[name]
        if low is not None and high is not None:
            middle = 0.5 * (low + high)
            off[name] = abs(np.clip(middle, least, greatest) - middle) / (0.5 * (high - low))
        elif low is not None or high is not None:
            holds = (low is None or low <= greatest) and (high is None or least <= high)
            off[name] = 0.0 if holds else np.inf
    return {
        "twin": made.number,
        "rate": rate,
        "cycles": [int(motion.arrests.size) for motion in made.motions],
        "status": document["status"],
        "estimator": document["estimator"],
        "message": document["message"],
        "verdicts": {name: document["parameters"][name]["verdict"] for name in off},
        "off": off,
        "seconds": time.process_time() - began,
    }


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Counts per sampling rate."""
    print(f"\n{describe()}\n")
    print("| rate | fits | status | intervals that cover | false success | told, of the answers |")
    print("| --- | --- | --- | --- | --- | --- |")
    for rate in sorted({line["rate"] for line in lines}):
        mine = [line for line in lines if line["rate"] == rate]
        done = [line for line in mine if line["status"] == "converged"]
        off = [value for line in done for value in line["off"].values()]
        wrong = sum(max(line["off"].values(), default=0.0) > FAR for line in done)
        status = Counter(f"{line['status']} ({line['estimator']})" for line in mine)
        told = Counter(name for line in done for name, verdict in line["verdicts"].items() if verdict != "bounded")
        print(
            f"| {rate:g} Hz | {len(mine)} | {', '.join(f'{k} {v}' for k, v in status.most_common())} "
            f"| {sum(value <= 1.0 for value in off)} of {len(off)} | {wrong} "
            f"| {', '.join(f'{k} {v}' for k, v in told.most_common()) or 'nothing'} |"
        )


def study(first: int, last: int, file: Path | None = None, rates: Sequence[float] = RATES) -> list[dict[str, Any]]:
    """The twins first to last at every rate, each printed, and appended to a file if one is given."""
    out = []
    for number in range(first, last + 1):
        for rate in rates:
            line = trial(twin(number, SCATTER), rate)
            out.append(line)
            missed = [f"{name} ({value:.1f})" for name, value in line["off"].items() if value > 1.0]
            print(
                f"{number:4d} {rate:5.0f} Hz {line['status']:17s} {line['estimator']:8s} cycles {line['cycles']} "
                f"{line['seconds']:5.1f} s  not covered: {', '.join(missed) or 'none'}\n     {line['message'][:300]}",
                flush=True,
            )
            append(file, line)
    return out


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole study; fast: one twin at 50 Hz."""
    lines = study(2, 2, rates=(50.0,)) if fast else study(0, TWINS - 1)
    table(lines)
    return lines


if __name__ == "__main__":
    started(main, table, cases(study))
