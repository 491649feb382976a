"""What a simulation is said to cost at other accuracies, against what it then costs."""

from experiments.study_problem import DEMO, RIG
from identify.effects import MAIN
from identify.scene import Scene
from identify.simulation.simulate import CYCLES, cost, simulate


def scene_at(speed, effects=MAIN, **more):
    parameters = {name: {"start": value} for name, value in (DEMO | more).items()}
    document = {
        "effects": list(effects),
        "rig": RIG | {"drive_speed": speed, "normal_force": 1.0},
        "parameters": parameters,
    }
    return Scene.from_document(document)


def test_a_long_motion_is_timed_on_its_first_cycles():
    scene = scene_at(5e-3)
    motion = simulate(scene, 4.0)
    seconds = cost(scene, motion, 100.0)
    assert motion.onsets.size > 2 * CYCLES
    assert list(seconds) == sorted(seconds, reverse=True) and seconds[motion.accuracy] == 100.0
    assert list(seconds.values()) == sorted(seconds.values()), "what is finer costs more"
