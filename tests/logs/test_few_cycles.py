"""Few cycles of one friction in noise: their drops scatter by chance, and are not called unlike each other."""

import numpy as np

from data_io import Record
from identify.effects import MAIN
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run

PAIR = {"mu_s": 0.698, "mu_k0": 0.547, "delta_mu_k": -0.07, "a": 108.0, "D": 52e-6, "t_cr": 0.1225}
RIG = {"mass": 0.2376, "stiffness": 1249.2, "damping": 144.4}
LOAD, SPEED, NOISE = 0.376, 0.101e-3, 1.85e-3  # N, m/s, N: a twentieth of the drop
REPEATS = 60


def test_six_cycles_of_one_friction_are_alike():
    times = np.arange(450) / 100.0
    motion = run(assemble(MAIN), PAIR | RIG, SPEED, LOAD, 4.5)
    force = motion.sample(times)["force"]
    scene = Scene.from_document({"effects": [*MAIN], "rig": RIG, "logs": [{"path": "log.csv", "drive_speed": SPEED}]})
    unlike, cycles = 0, []
    for seed in range(REPEATS):
        noise = NOISE * np.random.default_rng(seed).standard_normal(times.size)
        log = prepare(scene, scene.logs[0], Record(times, np.full(times.size, LOAD), force + noise), from_scene(scene))
        cycles.append(log.segmentation.count)
        unlike += log.unlike
    assert np.median(cycles) == 6
    assert unlike <= 0.05 * REPEATS
