"""What a simulation and a map say of the price of other accuracies and points, against what these then cost.

Every figure is of a process of its own, as `stickslip simulate` and `stickslip stability --map` are used, in processor
seconds, so that a busy machine counts less; of the cost the least of two.

    python experiments/run_answer_price.py
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from experiments.study_problem import DEMO, RIG
from identify.app.jobs import same_code
from identify.effects import MAIN

WITHIN = 0.3
REPEATS = 2
LINEAR = ("inertia", "hysteresis_damping", "linear_weakening")
SLOPE = {key: DEMO[key] for key in ("mu_s", "mu_k0")} | {"slope": -2.0}
DIRECT = DEMO | {"direct_strength": 0.005, "direct_speed": 1e-8}
ACCURACIES = (1e-3, 1e-5, 1e-7)
# name: effects, parameters, drive speed [m/s], duration [s]
SIMULATIONS = {
    "demo, 13 slips": (MAIN, DEMO, 1e-3, 4.0),
    "demo, 660 slips": (MAIN, DEMO, 1e-3, 200.0),
    "near the end of stick-slip": (MAIN, DEMO, 2.1e-2, 10.0),
    "stiff: direct effect from 10 nm/s": ((*MAIN, "direct_effect"), DIRECT, 1e-3, 4.0),
    "friction linear in speed": (LINEAR, SLOPE, 1e-3, 20.0),
}
POINTS = (10, 20, 40)
# name: effects, parameters, quantities
MAPS = {
    "demo": (MAIN, DEMO, ("drive_speed", "stiffness")),
    "weak weakening": (MAIN, DEMO | {"delta_mu_k": -0.02}, ("drive_speed", "damping")),
    "direct effect": ((*MAIN, "direct_effect"), DIRECT | {"direct_speed": 1e-4}, ("drive_speed", "normal_force")),
    "friction linear in speed": (LINEAR, SLOPE, ("mass", "stiffness")),
    "ageing alone": (MAIN, DEMO, ("t_cr", "D")),
}


def scene_file(path: Path, effects: tuple[str, ...], parameters: Mapping[str, float], speed: float) -> Path:
    """A scene of the demo's rig under 1 N."""
    rig = "".join(f"{key} = {value!r}\n" for key, value in (RIG | {"drive_speed": speed, "normal_force": 1.0}).items())
    held = "".join(f"{key} = {{ fixed = {value!r} }}\n" for key, value in parameters.items())
    path.write_text(f"effects = {json.dumps(effects)}\n[rig]\n{rig}[parameters]\n{held}", encoding="utf-8")
    return path


def levels(words: list[str], key: str) -> dict[float, float]:
    """Seconds by level, as a command says them."""
    ran = subprocess.run(
        [sys.executable, "-P", "-m", "identify", *words, "--json", "--quiet"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # the same in words
        check=True,
        text=True,
        env=same_code(),
    )
    return {float(f"{level[key]:.3g}"): level["seconds"] for level in json.loads(ran.stdout)["price"]["levels"]}


def compare(name: str, words: dict[float, list[str]], key: str, repeats: int) -> list[float]:
    """Said over cost of each pair of neighbouring levels; words: the command of each level."""
    told = {level: [levels(command, key) for _ in range(repeats)] for level, command in words.items()}
    cost = {level: min(run[level] for run in runs) for level, runs in told.items()}
    ratios = []
    for level, runs in told.items():
        first = min(runs, key=lambda run: run[level])
        for other in (found for found in cost if found != level and found in first):
            ratios.append(first[other] / cost[other])
            numbers = f"{first[other]:8.2f} {cost[other]:8.2f} {ratios[-1]:6.2f}"
            print(f"{name:34s} {level:8g} {other:8g} {numbers}", flush=True)
    return ratios


def main(fast: bool = False) -> list[float]:
    """Print the table; the ratios are returned. fast: one simulation and one small map, once."""
    print(describe())
    print(f"{'':34s} {'from':>8s} {'of':>8s} {'said s':>8s} {'cost s':>8s} {'ratio':>6s}")
    repeats, ratios = 1 if fast else REPEATS, list[float]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pair.toml"
        out = str(Path(folder) / "out.csv")
        for name, (effects, parameters, speed, duration) in list(SIMULATIONS.items())[: 1 if fast else None]:
            scene = scene_file(path, effects, parameters, speed)
            simulate = ["simulate", "--scene", str(scene), "--duration", f"{duration} s", "--rate", "1 kHz"]
            accuracies = {a: [*simulate, "--out", out, "--accuracy", f"{a:g}"] for a in ACCURACIES[: 2 if fast else 3]}
            ratios += compare(name, accuracies, "accuracy", repeats)
        for name, (effects, parameters, names) in list(MAPS.items())[: 1 if fast else None]:
            scene = scene_file(path, effects, parameters, 5e-3)
            stability = ["stability", "--scene", str(scene), "--map", *names]
            points = {float(n): [*stability, "--points", str(n)] for n in ((8, 16) if fast else POINTS)}
            ratios += compare(f"map, {name}", points, "points", repeats)
    good = sum(abs(ratio - 1.0) <= WITHIN for ratio in ratios)
    print(f"{good} of {len(ratios)} within {100 * WITHIN:g} %")
    return ratios


if __name__ == "__main__":
    main(fast="--fast" in sys.argv)
