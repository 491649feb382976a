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


def random_pairs(count: int, seed: int) -> list[dict[str, float]]:
    """Pairs of the study ranges; draws that lose kinetic friction or slip backwards are drawn again."""
    rng = np.random.default_rng(seed)
    pairs: list[dict[str, float]] = []
    while len(pairs) < count:
        mu_s, step = rng.uniform(0.4, 0.8), rng.uniform(0.1, 0.25)
        pair = {"mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": rng.uniform(-0.15, -0.02)}
        for name, low, high in (("a", 100, 1000), ("D", 15e-6, 60e-6), ("t_cr", 0.1, 2.0)):
            pair[name] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        if pair["mu_k0"] + pair["delta_mu_k"] > 0.05 and mu_s <= 3 * pair["mu_k0"]:
            pairs.append({**pair, **RIG})
    return pairs


@dataclass
class Tally:
    """Relative errors by quantity, whether outcomes are those of the simulation, closed forms called valid (whether
    they are), complaints."""

    errors: dict[str, list[float]] = field(default_factory=dict)
    outcomes: list[bool] = field(default_factory=list)
    claims: list[bool] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def add(self, name: str, error: float, where: str) -> None:
        """One relative error; beyond the target it is also told."""
        self.errors.setdefault(name, []).append(error)
        if not error <= TARGET:
            self.complaints.append(f"{where}: {name} off by {100 * error:.3g} %")


def check(values: Mapping[str, float], speeds: Sequence[float], tally: Tally, name: str) -> None:
    """Hold the answers for one pair against the simulation."""
    points = [OperatingPoint(values, v, 1.0) for v in speeds]
    documents = [to_dict(answer) for answer in predictions(assemble(EFFECTS), points, ())]
    pair = brute_force.Pair.of(values)
    from_rest = [brute_force.settled(pair, v) for v in speeds]
    sticking = [v for v, found in zip(speeds, from_rest, strict=True) if found is not None]
    end = brute_force.bracket(pair, max(sticking), fastest=30.0) if sticking else None
    for v, document, found in zip(speeds, documents, from_rest, strict=True):
        where, answer = f"{name} at {1e3 * v:.4g} mm/s", document["stability"]["outcome"]
        sticks = found is not None or (end is not None and v < end[0])
        truth = OUTCOMES[sticks, brute_force.slides_on(pair, v)]
        tally.outcomes.append(answer == truth)
        if answer != truth:
            tally.complaints.append(f"{where}: {answer}; simulation: {truth}")
        for key, attribute in COMPARED.items() if found is not None else ():
            true, part, form = getattr(found, attribute), document["amplitude"], document["closed_forms"][key]
            if part["drop"]["value"] is not None:
                tally.add(key, abs(part[key]["value"] / true - 1), where)
            if form["validity"].startswith("valid here") and form["value"] is not None:
                tally.claims.append(abs(form["value"] / true - 1) <= AGREES + TARGET)
                if not tally.claims[-1]:
                    tally.complaints.append(f"{where}: closed form of {key} called valid, is not")
    for value in dict.fromkeys(document["stability"]["critical_speed"]["value"] for document in documents):
        if end is None or value is None:
            outside = 0.0 if (end is None or np.isinf(end[1])) and value is None else np.inf
        else:
            outside = max(end[0] / value - 1, value / end[1] - 1, 0.0)
        tally.add("end of stick-slip", outside, f"{name}, {value} m/s, simulation {end}")


def main(fast: bool = False) -> float:
    """Print the comparison; the largest relative error is returned."""
    pairs = random_pairs(1 if fast else 200, seed=7)
    rng, begun = np.random.default_rng(8), time.perf_counter()
    print(machine.describe())
    print(f"demo pair and {len(pairs)} random pairs, F_n = 1 N, m, k, h nominal")
    tally = Tally()
    for i, pair in enumerate([DEMO, *pairs]):
        extra = np.exp(rng.uniform(np.log(EXTRA[0]), np.log(EXTRA[1]), 1 if fast else 2)).tolist()
        check(pair, [*(SPEEDS[1:3] if fast else SPEEDS), *extra], tally, f"pair {i}")
    print(f"\n{'quantity':20s} {'compared':>8s} {'median':>10s} {'largest':>10s}  within 1 %")
    for name, errors in tally.errors.items():
        e = np.array(errors)
        print(f"{name:20s} {e.size:8d} {100 * np.median(e):8.4f} % {100 * np.max(e):8.4f} %  {np.sum(e <= TARGET)}")
    print(f"right outcome: {sum(tally.outcomes)} of {len(tally.outcomes)}")
    print(
        f"closed forms called valid: {len(tally.claims)}, of which simulation contradicts {tally.claims.count(False)}"
    )
    print(*(f"  {line}" for line in tally.complaints), f"{time.perf_counter() - begun:.0f} s", sep="\n")
    return float(max(max(errors) for errors in tally.errors.values()))


if __name__ == "__main__":
    main(fast="--fast" in sys.argv)
