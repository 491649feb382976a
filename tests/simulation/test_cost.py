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


def test_a_long_motion_is_timed_on_its_first_cycles_and_effects_have_their_share():
    scene = scene_at(5e-3)
    motion = simulate(scene, 4.0)
    told = cost(scene, motion, 100.0)
    assert motion.onsets.size > 2 * CYCLES
    assert told.seconds[motion.accuracy] == 100.0 and told.text.startswith("1e+02 s of processor time; at accuracy")
    assert set(told.effects) == {"hysteresis_damping", "contact_ageing", "velocity_weakening"}, "what others need stays"
    assert all(0.0 <= seconds < 100.0 for seconds in told.effects.values())
