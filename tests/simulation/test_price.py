"""What a simulation costs is told by simulations that cost little more than it."""

from itertools import count

import pytest

from experiments.study_problem import DEMO, RIG
from identify.effects import MAIN
from identify.scene import Scene
from identify.simulation import price as room
from identify.simulation.phases import Slide
from identify.simulation.simulate import simulate


def scene_at(speed, effects=MAIN, **more):
    parameters = {name: {"start": value} for name, value in (DEMO | more).items()}
    document = {
        "effects": list(effects),
        "rig": RIG | {"drive_speed": speed, "normal_force": 1.0},
        "parameters": parameters,
    }
    return Scene.from_document(document)


@pytest.fixture
def scene():
    return scene_at(5e-3)


def test_what_is_over_within_a_tick_of_the_clock_has_no_share(scene, monkeypatch):
    monkeypatch.setattr(room, "process_time", lambda: 0.0)
    told = room.price(scene, simulate(scene, 1.0), 0.5)
    assert told.effects and set(told.effects.values()) == {0.0}


@pytest.mark.parametrize(("tick", "turns"), [(1.0, 1), (1e-3, 3)])
def test_what_takes_long_is_timed_once(scene, monkeypatch, tick, turns):
    """One run builds the functions, one of each tolerance is timed; of what is over in no time, several."""
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
    assert len(durations) == (1 + 4 * turns) + len(left_out) * (1 + turns), "four tolerances, and without each effect"
    cut = max(durations)
    assert motion.arrests[room.CYCLES - 1] < cut < min(motion.onsets[motion.onsets > motion.arrests[room.CYCLES - 1]])
    assert told.seconds[motion.accuracy] == 10.0 and told.text.startswith("10 s of processor time; at accuracy")


SCENES = {
    "slow": (scene_at(1e-3), 40.0),
    "near the end of stick-slip": (scene_at(2.1e-2), 4.0),
    "stiff": (scene_at(1e-3, (*MAIN, "direct_effect"), direct_strength=0.005, direct_speed=1e-8), 4.0),
    "without slips": (scene_at(0.2), 1.0),
}


@pytest.mark.parametrize("name", SCENES)
def test_other_accuracies_cost_what_is_said(name, monkeypatch):
    """The clock shows the steps that were taken; also where a run had to be made again for its accuracy."""
    made, duration = SCENES[name]
    steps = []

    def counting(*given, **how):
        motion = simulate(*given, **how)
        steps.append(sum(len(phase.times) for phase in motion.phases if isinstance(phase, Slide)))
        return motion

    def all_steps(accuracy):
        """A refined motion, and the steps of all runs that were made for it."""
        runs = [simulate(made, duration, accuracy=accuracy)]
        refined = runs[0].refined()
        for _ in range(refined.coarser + 1):
            runs.append(runs[-1]._other)
        return refined, sum(len(p.times) for run in runs for p in run.phases if isinstance(p, Slide))

    monkeypatch.setattr(room, "process_time", lambda: float(sum(steps)))
    monkeypatch.setattr(room, "simulate", counting)
    motion, taken = all_steps(1e-5)
    told = room.price(made, motion, taken).seconds
    for accuracy in (1e-3, 1e-7):
        said = next(seconds for level, seconds in told.items() if level == pytest.approx(accuracy))
        assert said == pytest.approx(all_steps(accuracy)[1], rel=0.3), accuracy
