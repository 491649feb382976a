"""Designs that cannot tell a parameter, and their repairs.

Random pairs x designs: one drive speed only; holds too short; slips that hold a few samples; slow speeds only; and the
repair of each. Cycles are always resolved (12 samples or more), slips not. `results/design_truths.json` holds, by
number, the verdicts that a profile likelihood by brute force from the true motion allows for each parameter
at a state of the project that had one.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_io import Record
from experiments.study_problem import NORMAL_FORCE, RIG, USUAL, recorded
from identify.effects import MAIN
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run

Log = tuple[float, float, float]  # drive speed [m/s], duration [s], sampling rate [Hz]

SEED = 21
FEWEST = 3  # cycles of each log of a design
SEEN = 12.0  # samples of a cycle, at least: slips may go unresolved, cycles not
SLOWEST: Log = (1e-4 / 60, 800.0, 50.0)
SLOWER: Log = (1e-5, 150.0, 200.0)
SLOW: Log = (1e-4, 20.0, 500.0)
FAST: Log = (1e-3, 4.0, 1000.0)
FASTER: Log = (5e-3, 1.5, 2000.0)
FEW = (2.0, 5.0)  # samples of a slip that is not resolved
LONG_AGEING = (1.5, 6.0)  # t_cr [s] of the pairs whose holds are to be too short
KINDS = ("one speed", "short holds", "unresolved slips", "slow only")
TRUTHS = Path(__file__).parent / "results" / "design_truths.json"


@dataclass(frozen=True)
class Design:
    """Logs of a pair: kind of flaw, whether repaired; truth and rig by name."""

    kind: str
    repaired: bool
    truth: dict[str, float]
    rig: dict[str, float]
    logs: tuple[Log, ...]
    records: tuple[Record, ...]


def design(number: int) -> Design:
    """The design of a number (from 0): pair, kind of flaw and whether it is repaired follow from it."""
    pair, rest = divmod(number, 2 * len(KINDS))
    kind, repaired = KINDS[rest // 2], bool(rest % 2)
    random = np.random.default_rng([SEED, pair, rest // 2])
    while True:
        truth, rig = _pair(random, kind)
        flawed, mended = _logs(random, kind, rig)
        chosen = mended if repaired else flawed
        if truth["mu_k0"] > 0.0 and truth["mu_k0"] + truth["delta_mu_k"] > 0.05:
            # The repair keeps the pair of its flaw: a pair is taken where all logs of both show cycles.
            motions = {
                log[:2]: run(assemble(MAIN), truth | rig, log[0], NORMAL_FORCE, log[1]) for log in (*flawed, *mended)
            }
            sound = all(
                m.arrests.size >= FEWEST and all(phase.situated.direction >= 0.0 for phase in m.phases)
                for m in motions.values()
            )
            if sound and all(log[2] * log[1] / motions[log[:2]].arrests.size >= SEEN for log in flawed):
                break
    noise = np.random.default_rng([SEED, pair, rest])
    records = tuple(recorded(motions[log[:2]], log[2], noise) for log in chosen)
    return Design(kind, repaired, truth, rig, chosen, records)


def _pair(random: np.random.Generator, kind: str) -> tuple[dict[str, float], dict[str, float]]:
    mu_s, step = random.uniform(*USUAL.mu_s), random.uniform(*USUAL.step)
    truth = {"mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": random.uniform(*USUAL.delta_mu_k)}
    ageing = LONG_AGEING if kind == "short holds" else USUAL.t_cr
    for name, (low, high) in (("a", USUAL.a), ("D", USUAL.D), ("t_cr", ageing)):
        truth[name] = float(np.exp(random.uniform(np.log(low), np.log(high))))
    return truth, {name: value * USUAL.rig ** random.uniform(-1.0, 1.0) for name, value in RIG.items()}


def _logs(random: np.random.Generator, kind: str, rig: dict[str, float]) -> tuple[tuple[Log, ...], tuple[Log, ...]]:
    """The logs of a flawed design and of its repair."""
    if kind == "one speed":
        only = (SLOW, FAST)[int(random.integers(2))]
        return (only,), (SLOWER, SLOW, FAST, FASTER)
    if kind == "short holds":
        return (FAST, FASTER), (SLOWER, SLOW, FAST, FASTER)
    if kind == "unresolved slips":
        slip = float(np.pi * np.sqrt(rig["mass"] / rig["stiffness"]))
        rate = float(np.round(random.uniform(*FEW) / slip))
        return tuple((v, t, rate) for v, t, _ in (SLOWER, SLOW, FAST)), (SLOWER, SLOW, FAST, FASTER)
    return (SLOWEST, SLOWER), (SLOWEST, SLOWER, SLOW, FAST, FASTER)


def scene_of(made: Design) -> Scene:
    """The scene a user would write."""
    logs = [{"path": f"log_{i}.csv", "drive_speed": log[0]} for i, log in enumerate(made.logs, 1)]
    return Scene.from_document(
        {"effects": [*MAIN, "varying_normal_force"], "rig": dict(made.rig), "logs": logs}, Path()
    )


def allowed(number: int) -> dict[str, list[str]]:
    """Verdicts that may be given of a design, by parameter; empty where they are not known."""
    return dict(json.loads(TRUTHS.read_text(encoding="utf-8")).get(str(number), {}))
