"""What simulations are said to cost at other accuracies, against what they then take: twenty scenes, warm functions.

The functions are built before, which costs the same at every accuracy: what `stickslip simulate` prints holds them too,
and is nearer. Processor time, the least of three runs, so that a busy machine counts less.

    python experiments/run_simulation_cost.py
"""

from __future__ import annotations

import sys
from pathlib import Path
from time import process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.study_problem import DEMO, RIG
from identify.effects import MAIN
from identify.scene import Scene
from identify.simulation.cost import cost
from identify.simulation.simulate import simulate
from identify.simulation.trajectory import Trajectory

WITHIN = 0.3
COUNT = 20
ACCURACY = 1e-5
DIRECT = {"direct_strength": 0.005, "direct_speed": 1e-8}
LINEAR = {"mu_s": DEMO["mu_s"], "mu_k0": DEMO["mu_k0"], "slope": -2.0}


def scene_at(
    speed: float,
    effects: tuple[str, ...] = MAIN,
    rig: dict[str, float] = RIG,
    load: float = 1.0,
    values: dict[str, float] = DEMO,
) -> Scene:
    """A scene under a load [N] at a drive speed [m/s]."""
    return Scene.from_document(
        {
            "effects": list(effects),
            "rig": rig | {"drive_speed": speed, "normal_force": load},
            "parameters": {name: {"start": value} for name, value in values.items()},
        }
    )


def scenes(count: int) -> dict[str, tuple[Scene, float]]:
    """By name: a scene and its duration [s]; some kinds, the rest random pairs and rigs."""
    excited = DEMO | {"excitation_amplitude": 2e-6}
    made = {
        "demo, 13 slips": (scene_at(1e-3), 4.0),
        "demo, 660 slips": (scene_at(1e-3), 200.0),
        "near the end of stick-slip": (scene_at(2.1e-2), 10.0),
        "stiff": (scene_at(1e-3, (*MAIN, "direct_effect"), values=DEMO | DIRECT), 1.0),
        "linear": (scene_at(1e-3, ("inertia", "hysteresis_damping", "linear_weakening"), values=LINEAR), 20.0),
        "slides": (scene_at(0.2), 1.0),
        "lag": (scene_at(1e-3, (*MAIN, "sensor_lag")), 4.0),
        "excitation": (scene_at(1e-3, (*MAIN, "excitation"), values=excited), 4.0),
    }
    random = np.random.default_rng(1)
    for number in range(len(made), count):
        rig = {name: value * np.exp(random.normal(0.0, 0.4)) for name, value in RIG.items()}
        pair = DEMO | {name: DEMO[name] * np.exp(random.normal(0.0, 0.5)) for name in ("a", "D", "t_cr")}
        speed, load = 1e-3 * np.exp(random.normal(0.0, 1.2)), np.exp(random.normal(0.0, 0.7))
        made[f"random {number}"] = scene_at(float(speed), rig=rig, load=float(load), values=pair), 2e-3 / float(speed)
    return dict(list(made.items())[:count])


def measured(scene: Scene, duration: float, accuracy: float) -> tuple[float, Trajectory]:
    """The least processor seconds of some runs, and the motion."""
    seconds = []
    for _ in range(3):
        since = process_time()
        motion = simulate(scene, duration, accuracy=accuracy).refined()
        seconds.append(process_time() - since)
    return min(seconds), motion


def main(fast: bool = False) -> tuple[list[float], int]:
    """Print the table; returned are the ratios of what is said to what is taken, and how many scenes have their levels
    in order. fast: one scene."""
    ratios, ordered = list[float](), 0
    for name, (scene, duration) in scenes(1 if fast else COUNT).items():
        measured(scene, duration, ACCURACY)
        seconds, motion = measured(scene, duration, ACCURACY)
        stated = cost(scene, motion, seconds).seconds
        ordered += list(stated.values()) == sorted(stated.values())
        mine = [stated[a] / measured(scene, duration, a)[0] for a in stated if a != motion.accuracy]
        ratios += mine
        print(f"{name:28s} {motion.onsets.size:5d} slips {1e3 * seconds:8.1f} ms  {' '.join(f'{q:.2f}' for q in mine)}")
    good = sum(abs(ratio - 1.0) <= WITHIN for ratio in ratios)
    print(f"{good} of {len(ratios)} within {100 * WITHIN:g} %, levels in order in {ordered}")
    return ratios, ordered


if __name__ == "__main__":
    main(fast="--fast" in sys.argv)
