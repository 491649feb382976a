"""What a simulation costs is told by simulations that cost little more than it."""

from itertools import count

import pytest

from experiments.study_problem import DEMO, RIG
from identify.effects import MAIN
from identify.scene import Scene
from identify.simulation import price as room
from identify.simulation.simulate import simulate


@pytest.fixture
def scene():
    parameters = {name: {"start": value} for name, value in DEMO.items()}
    document = {
        "effects": list(MAIN),
        "rig": RIG | {"drive_speed": 5e-3, "normal_force": 1.0},
        "parameters": parameters,
    }
    return Scene.from_document(document)


@pytest.mark.parametrize(("tick", "runs"), [(1.0, 2), (1e-3, 4)])
def test_what_takes_long_is_timed_once(scene, monkeypatch, tick, runs):
    """One run that builds the functions and one that is timed; of what is over in no time, several."""
    clock, durations = count(), []
    monkeypatch.setattr(room, "process_time", lambda: tick * next(clock))
    monkeypatch.setattr(
        room, "simulate", lambda made, duration, **how: durations.append(duration) or simulate(made, duration, **how)
    )
    motion = simulate(scene, 4.0)
    told = room.price(scene, motion, 10.0)
    left_out = [name for name in MAIN if name in told.effects]
    assert set(told.seconds) == {motion.accuracy, 100 * motion.accuracy, motion.accuracy / 100}
    assert "contact_ageing" in left_out and "inertia" not in left_out, "what others need stays"
    assert len(durations) == runs * (3 + len(left_out)), "the accuracy taken, two others, and without each effect"
    assert max(durations) == motion.arrests[room.CYCLES - 1] < 4.0, "of a short part"
    assert told.seconds[motion.accuracy] == 10.0 and told.text.startswith("10 s of processor time; at accuracy")
