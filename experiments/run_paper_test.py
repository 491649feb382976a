"""The paper's own test on its own: what does such a log hold of the six parameters, and what has to be added?

Normal force 1 N, drive speed 0.1 mm/min, stiffness 1470 N/m, relaxation length 37.4 um, relaxation time 0.5 s (text of
the paper); mass, damping and friction coefficients, which it does not state, as in the test problem of the studies.
Sampled at 20 Hz, as a CETR log is, and at 1 kHz; then with what the answer asks for.

    python experiments/run_paper_test.py
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments.machine import describe
from experiments.study_problem import DEMO, NOISE, NORMAL_FORCE, RIG
from identify import Scene, fit
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run

SPEED = 1e-4 / 60.0  # 0.1 mm/min
# Name, (drive speed [m/s], duration [s], sampling rate [Hz]) of each log.
DESIGNS: tuple[tuple[str, tuple[tuple[float, float, float], ...]], ...] = (
    ("the paper's test at 20 Hz", ((SPEED, 800.0, 20.0),)),
    ("the paper's test at 1 kHz", ((SPEED, 800.0, 1000.0),)),
    ("with a log at 1 mm/s, 1 kHz", ((SPEED, 800.0, 20.0), (1e-3, 4.0, 1000.0))),
    ("with logs at 1 and 5 mm/s", ((SPEED, 800.0, 20.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0))),
)
FRICTION = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")


def identify(logs: tuple[tuple[float, float, float], ...], duration_share: float = 1.0) -> dict[str, Any]:
    """The document of a fit of simulated logs of these speeds, durations and rates."""
    model, random, records = assemble(MAIN), np.random.default_rng(12), []
    for speed, duration, rate in logs:
        times = np.arange(round(duration * duration_share * rate) + 1) / rate
        force = run(model, DEMO | RIG, speed, NORMAL_FORCE, times[-1]).sample(times)["force"]
        noisy = force + NOISE * random.standard_normal(times.size)
        records.append(Record(times, np.full(times.size, NORMAL_FORCE), noisy))
    scene = Scene.from_document(
        {
            "effects": list(MAIN),
            "rig": dict(RIG),
            "logs": [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, _, _) in enumerate(logs, 1)],
        }
    )
    return dict(fit(scene, records).result)


def table(name: str, result: dict[str, Any]) -> None:
    """What a fit says of each parameter."""
    print(f"\n### {name}\n\n{result['status']}: {result['message']}\n")
    print("| parameter | truth | answer | 95 % interval | verdict | what would tell |")
    print("| --- | --- | --- | --- | --- | --- |")
    for parameter in FRICTION:
        found = result["parameters"][parameter]
        value = "—" if found["value"] is None else f"{found['value']:.4g}"
        ends = found["interval"] or [None, None]
        interval = " to ".join("open" if end is None else f"{end:.4g}" for end in ends)
        advice = "" if found["verdict"] == "identified" else found["reason"]
        print(f"| {parameter} | {DEMO[parameter]:.4g} | {value} | {interval} | {found['verdict']} | {advice} |")


def main(fast: bool = False) -> list[dict[str, Any]]:
    """All designs; fast: the first one, a third as long."""
    print(f"{describe()}")
    chosen = DESIGNS[:1] if fast else DESIGNS
    results = [identify(logs, 0.35 if fast else 1.0) for _, logs in chosen]
    for (name, _), result in zip(chosen, results, strict=True):
        table(name, result)
    return results


if __name__ == "__main__":
    main()
