"""Does a published interval hold what specimens scatter? Pairs whose friction differs from log to log.

Each design has two to four speeds, each in one log of its own specimen: all friction, and its static part by itself,
scatter by 2 to 5 % from log to log. Prints how many of the six mean values lie in the published intervals, and in those
of a rig taken as exact (the negative control).

    python -m experiments.run_specimen_scatter [FIRST LAST]
"""

from __future__ import annotations

import sys

import numpy as np

from data_io import Record
from experiments.machine import describe
from identify import Scene, fit
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
SPEEDS = (1e-4, 3e-4, 1e-3, 3e-3)  # m/s
NAMES = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
NOISE = 3e-3  # N, at a load of 1 N


def design(seed: int) -> tuple[Scene, list[Record], dict[str, float], float]:
    """A scene, its records, the mean values of the pair, and the scatter from log to log."""
    random = np.random.default_rng(seed)
    mu_s = random.uniform(0.45, 0.8)
    truth = {
        "mu_s": mu_s,
        "mu_k0": mu_s - random.uniform(0.12, 0.25),
        "delta_mu_k": -random.uniform(0.04, 0.12),
        "a": float(np.exp(random.uniform(np.log(150.0), np.log(600.0)))),
        "D": random.uniform(20e-6, 60e-6),
        "t_cr": float(np.exp(random.uniform(np.log(0.15), np.log(1.5)))),
    }
    scatter, logs, records = random.uniform(0.02, 0.05), [], []
    for speed in sorted(random.choice(SPEEDS, random.integers(2, 5), replace=False)):
        gain, static = np.exp(scatter * random.standard_normal(2))
        own = {name: truth[name] * (gain if name in NAMES[:3] else 1.0) for name in NAMES}
        own["mu_s"] = own["mu_k0"] + (own["mu_s"] - own["mu_k0"]) * static
        duration = float(np.clip(8.0 * 0.2 / (RIG["stiffness"] * speed), 2.0, 40.0))
        rate = 1000.0 if speed > 5e-4 else 500.0  # Hz
        time = np.arange(round(duration * rate) + 1) / rate
        force = run(assemble(MAIN), own | RIG, float(speed), 1.0, duration).sample(time)["force"]
        records.append(Record(time, np.ones(time.size), force + NOISE * random.standard_normal(time.size)))
        logs.append({"path": f"{1e3 * speed:g}_mm_per_s.csv", "drive_speed": float(speed)})
    document = {"effects": list(MAIN), "rig": RIG, "logs": logs, "tolerances": {"specimen": scatter}}
    return Scene.from_document(document), records, truth, scatter


def main(fast: bool = False, first: int = 0, last: int = 39) -> None:
    """Print the coverage of designs from the first seed to the last."""
    print(describe())
    held, exact, of, refused = 0, 0, 0, 0
    for seed in range(first, first + 1 if fast else last + 1):
        scene, records, truth, scatter = design(seed)
        result = fit(scene, records).typed
        if not result.converged:
            refused += 1
            print(f"{seed:4d}  {100 * scatter:.1f} %  {len(records)} logs  {result.status}: {result.message:.90}")
            continue
        inside = [[], []]
        for name in NAMES:
            entry = result.parameters[name]
            for found, ends in zip(inside, (entry.ends, entry.interval_rig_exact or entry.ends), strict=True):
                low, high = (-np.inf if ends[0] is None else ends[0]), (np.inf if ends[1] is None else ends[1])
                found.append(low <= truth[name] <= high)
        held, exact, of = held + sum(inside[0]), exact + sum(inside[1]), of + len(NAMES)
        print(f"{seed:4d}  {100 * scatter:.1f} %  {len(records)} logs  {sum(inside[0])} of 6, exact {sum(inside[1])}")
    print(f"published {held} of {of}, rig exact {exact} of {of}; {refused} refused")


if __name__ == "__main__":
    main(False, *(int(argument) for argument in sys.argv[1:3]))
