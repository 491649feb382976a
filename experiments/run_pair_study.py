"""What the calculators say of the demo pair and 200 random pairs, against plain simulation.

Per pair: drop, period and peak speed at four drive speeds, the outcome there and at two random ones, and the drive
speed at which stick-slip ends. Plain simulation: `brute_force` (scipy's DOP853, no line of the package in it); its
outcome is "sticks" where the motion from a rested contact, or one brought from slower drives, goes on sticking, and
"slides" where a disturbance of steady sliding by 2 % dies down. Every closed form that an answer calls valid is held
against the simulation too.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments import brute_force, machine
from experiments.study_problem import DEMO as FRICTION
from experiments.study_problem import RIG
from identify.base.document import to_dict
from identify.effects import MAIN as EFFECTS
from identify.model.model import assemble
from identify.prediction.closed_forms import AGREES
from identify.prediction.draws import OperatingPoint
from identify.prediction.predict import predictions

DEMO = FRICTION | RIG
SPEEDS = (0.1e-3 / 60, 0.1e-3, 1e-3, 5e-3)
TARGET = 0.01
COMPARED = {"drop": "drop", "period": "period", "peak_speed": "peak"}  # in answers, in `brute_force.Jump`
OUTCOMES = {
    (True, False): "always sticks",
    (True, True): "bistable",
    (False, True): "never sticks",
    (False, False): "undecided",
}
EXTRA = (1e-4, 0.1)  # m/s, range of the random drive speeds


def random_pairs(count: int, seed: int) -> tuple[list[dict[str, float]], int]:
    """Pairs of the study ranges, and how many draws were rejected (kinetic friction lost, or reverse slip)."""
    rng = np.random.default_rng(seed)
    pairs: list[dict[str, float]] = []
    rejected = 0
    while len(pairs) < count:
        mu_s, step = rng.uniform(0.4, 0.8), rng.uniform(0.1, 0.25)
        pair = {"mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": rng.uniform(-0.15, -0.02)}
        for name, low, high in (("a", 100, 1000), ("D", 15e-6, 60e-6), ("t_cr", 0.1, 2.0)):
            pair[name] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        if pair["mu_k0"] + pair["delta_mu_k"] > 0.05 and mu_s <= 3 * pair["mu_k0"]:
            pairs.append({**pair, **RIG})
        else:
            rejected += 1
    return pairs, rejected


@dataclass
class Tally:
    """Relative errors by quantity, outcomes (answer, simulation), claims of validity (all, wrong), complaints."""

    errors: dict[str, list[float]] = field(default_factory=dict)
    outcomes: list[tuple[str, str]] = field(default_factory=list)
    claims: int = 0
    wrong_claims: int = 0
    complaints: list[str] = field(default_factory=list)

    def add(self, name: str, error: float, where: str) -> None:
        """One relative error; beyond the target it is also told."""
        self.errors.setdefault(name, []).append(error)
        if not error <= TARGET:
            self.complaints.append(f"{where}: {name} off by {100 * error:.3g} %")


def simulated(
    pair: brute_force.Pair, speeds: Sequence[float]
) -> tuple[list[tuple[str, brute_force.Jump | None]], tuple[float, float] | None]:
    """Outcome and settled cycle at every speed, and the bracket of the end of stick-slip."""
    from_rest = [brute_force.settled(pair, v) for v in speeds]
    sticking = [v for v, found in zip(speeds, from_rest, strict=True) if found is not None]
    end = brute_force.bracket(pair, max(sticking), fastest=30.0) if sticking else None
    rows = []
    for v, found in zip(speeds, from_rest, strict=True):
        sticks = found is not None or (end is not None and v < end[0])
        outcome = OUTCOMES[sticks, brute_force.slides_on(pair, v)]
        rows.append((outcome, found))
    return rows, end


def check(pair: Mapping[str, float], speeds: Sequence[float], tally: Tally, name: str) -> None:
    """Hold the answers for one pair against the simulation."""
    documents = [
        to_dict(answer) for answer in predictions(assemble(EFFECTS), [OperatingPoint(pair, v, 1.0) for v in speeds], ())
    ]
    rows, end = simulated(brute_force.Pair.of(pair), speeds)
    for v, document, (outcome, found) in zip(speeds, documents, rows, strict=True):
        where = f"{name} at {1e3 * v:.4g} mm/s"
        said = document["stability"]["outcome"]
        tally.outcomes.append((said, outcome))
        if said != outcome:
            tally.complaints.append(f"{where}: {said}; simulation: {outcome}")
        part = document["amplitude"]
        if found is not None and part["drop"]["value"] is not None:
            for key, attribute in COMPARED.items():
                tally.add(key, abs(part[key]["value"] / getattr(found, attribute) - 1), where)
        if found is not None:
            _claims(document["closed_forms"], found, tally, where)
    ours = [d["stability"]["critical_speed"]["value"] for d in documents]
    for value in dict.fromkeys(ours):
        if end is None or value is None:
            same = (end is None or np.isinf(end[1])) and value is None
            tally.add("end of stick-slip", 0.0 if same else np.inf, f"{name}, {value} m/s, simulation {end}")
        else:
            outside = max(end[0] / value - 1, value / end[1] - 1, 0.0)
            tally.add("end of stick-slip", outside, f"{name}, {value:.6g} m/s, simulation {end[0]:.6g} to {end[1]:.6g}")


def _claims(forms: Mapping[str, Any], found: brute_force.Jump, tally: Tally, where: str) -> None:
    """Count the closed forms called valid, and those of them that the simulation contradicts."""
    for key, truth in (("drop", found.drop), ("period", found.period), ("peak_speed", found.peak)):
        entry = forms[key]
        if entry["validity"].startswith("valid here") and entry["value"] is not None:
            tally.claims += 1
            if abs(entry["value"] / truth - 1) > AGREES + TARGET:
                tally.wrong_claims += 1
                tally.complaints.append(f"{where}: closed form of {key} called valid, is not")


def _report(tally: Tally) -> float:
    print(f"\n{'quantity':20s} {'compared':>8s} {'median':>10s} {'99 %':>10s} {'largest':>10s}  within 1 %")
    worst = 0.0
    for name, errors in tally.errors.items():
        e = np.array(errors)
        worst = max(worst, float(np.max(e)))
        shown = "".join(f" {100 * q:8.4f} %" for q in (np.median(e), np.quantile(e, 0.99), np.max(e)))
        print(f"{name:20s} {e.size:8d} {shown}  {int(np.sum(e <= TARGET))} of {e.size}")
    print("\noutcome of the answer (rows) and of the simulation (columns)")
    words = list(dict.fromkeys([*OUTCOMES.values(), *(said for said, _ in tally.outcomes)]))
    print(f"{'':20s}" + "".join(f"{word:>20s}" for word in words))
    for said in words:
        print(f"{said:20s}" + "".join(f"{tally.outcomes.count((said, truth)):20d}" for truth in words))
    right = sum(said == truth for said, truth in tally.outcomes)
    print(f"right outcome: {right} of {len(tally.outcomes)}")
    print(f"closed forms called valid: {tally.claims}, of which the simulation contradicts {tally.wrong_claims}")
    for line in tally.complaints:
        print(f"  {line}")
    return worst


def main(fast: bool = False) -> float:
    """Print the comparison; the largest relative error is returned."""
    pairs, rejected = random_pairs(1 if fast else 200, seed=7)
    rng, begun = np.random.default_rng(8), time.perf_counter()
    print(machine.describe())
    print(f"demo pair and {len(pairs)} random pairs ({rejected} draws rejected), F_n = 1 N, m, k, h nominal")
    tally = Tally()
    for i, pair in enumerate([DEMO, *pairs]):
        extra = np.exp(rng.uniform(np.log(EXTRA[0]), np.log(EXTRA[1]), 1 if fast else 2)).tolist()
        check(pair, [*(SPEEDS[1:3] if fast else SPEEDS), *extra], tally, f"pair {i}")
        if not fast and i % 20 == 0:
            print(f"  {i} of {len(pairs)} pairs after {time.perf_counter() - begun:.0f} s", flush=True)
    worst = _report(tally)
    print(f"{time.perf_counter() - begun:.0f} s")
    return worst


if __name__ == "__main__":
    main(fast="--fast" in sys.argv)
