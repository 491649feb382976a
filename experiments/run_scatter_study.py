"""Strength that scatters from stick to stick: what a fit says of it, and whether its intervals hold.

Random pairs of the usual kind, simulated by scattered_records.py, which shares nothing with the estimator. A false
cause is one of FALSE in the sentence of a fit. Covered: of the six parameters told with an interval, how many hold the
truth. Time limits count processor time.

    python experiments/run_scatter_study.py [pairs per scatter, as 10 or 30-39 [scatter...]]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.in_parts import by_processor_time
from experiments.scattered_records import with_scatter
from experiments.study_problem import SPEEDS, USUAL, coefficients_only, random_case, scene_of
from identify import fit

SCATTERS = (0.0, 0.003, 0.01, 0.03, 0.05, 0.15)
FALSE = (
    "missed or invented",
    "cut off",
    "normal force is off",
    "wrong rig",
    "moves otherwise",
    "wrong noise",
    "occlusion",
    "contradicts",
    "the data ask for",
    "start values",
    "without it",
)
SEED = 53


def main(
    fast: bool = False, pairs: Sequence[int] = range(10), scatters: Sequence[float] = SCATTERS
) -> list[dict[str, object]]:
    """One line per scatter; fast: one pair that scatters by 1 %, of which only the coefficients are searched."""
    print(
        f"{'scatter':>8} {'plain':>6} {'uneven':>7} {'none':>5} {'false causes':>13} {'covered':>9} {'found':>15}"
        f" {'s':>6}"
    )
    out = []
    for scatter in (0.01,) if fast else scatters:
        rows = [one(scatter, pair, fast) for pair in (pairs[:1] if fast else pairs)]
        plain, uneven = (sum(r["estimator"] == name for r in rows) for name in ("plain", "uneven"))
        covered, told = (sum(int(r[name]) for r in rows) for name in ("covered", "told"))  # type: ignore[call-overload]
        found = [float(r["scatter"]) for r in rows if r["scatter"] is not None]  # type: ignore[arg-type]
        line = {"scatter": scatter, "plain": plain, "uneven": uneven, "covered": covered, "told": told, "rows": rows}
        spread = f"{100 * min(found):.2g} to {100 * max(found):.2g} %" if found else ""
        print(
            f"{100 * scatter:7.1f}% {plain:6d} {uneven:7d} {len(rows) - plain - uneven:5d} "
            f"{sum(bool(r['false']) for r in rows):13d} {f'{covered} of {told}':>9} {spread:>15} "
            f"{np.median([r['seconds'] for r in rows]):6.1f}",  # type: ignore[arg-type]
            flush=True,
        )
        for row in rows:
            if row["false"] or row["estimator"] == "none":
                print(f"         pair {row['pair']}: {row['message']}")
        out.append(line)
    return out


def one(scatter: float, pair: int, known: bool = False) -> dict[str, object]:
    """What a fit of one pair gave; known: all but the coefficients is told."""
    case, _ = random_case(np.random.default_rng([SEED, pair]), USUAL)
    records = with_scatter(case, SPEEDS, scatter, pair)
    scene = coefficients_only(scene_of(case), case.truth) if known else scene_of(case)
    began = time.process_time()
    result = fit(scene, records).result
    seconds = time.process_time() - began
    message, converged = str(result["message"]), result["status"] == "converged"
    estimator = ("uneven" if result.get("estimator") == "uneven" else "plain") if converged else "none"
    told = [
        (name, e)
        for name, e in result["parameters"].items()
        if estimator == "plain" and name in case.truth and None not in e["interval"]
    ]
    found: float | None = None
    if estimator == "uneven":
        found = result["parameters"]["strength_scatter"]["value"]
    elif estimator == "plain":
        found = result["gate"]["strength_scatter"]
    return {
        "pair": pair,
        "estimator": estimator,
        "told": len(told),
        "covered": sum(e["interval"][0] <= case.truth[name] <= e["interval"][1] for name, e in told),
        "scatter": found,
        "false": [words for words in FALSE if words in message],
        "message": message,
        "seconds": seconds,
    }


if __name__ == "__main__":
    by_processor_time()
    first, _, last = (sys.argv[1:] or ["0-9"])[0].rpartition("-")
    pairs = range(int(first), int(last) + 1) if first else range(int(last))
    main(pairs=pairs, scatters=tuple(float(word) for word in sys.argv[2:]) or SCATTERS)
