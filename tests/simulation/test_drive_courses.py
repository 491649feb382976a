"""A drive on a course (sine, ramps) against the independent integrator of the tests."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from experiments.study_problem import DEMO, RIG
from identify.effects import MAIN
from identify.model.model import assemble, on_course
from identify.scene.tables import Course
from identify.simulation.drive import Drive
from identify.simulation.phases import _rest_functions
from identify.simulation.simulate import run
from identify.simulation.stepper import symbols
from tests.support import effect_oracle

Array = NDArray[np.float64]
PAIR, MODEL, LOAD = DEMO | RIG, assemble(MAIN), 1.0


RAMPS = ((0.0, 0.0), (1.0, 2e-3), (2.0, 2e-3), (3.0, 0.5e-3))
COURSES = {
    "slow sine": (Course((2e-3, 0.05, 0.3)), 14.0),
    "sine": (Course((2e-3, 1.0, 0.0)), 2.2),
    "fast sine": (Course((0.8e-3, 5.0, 1.0)), 0.7),
    "ramps": (Course(ramps=RAMPS), 3.0),
}


@cache
def truth(name: str) -> effect_oracle.Run:
    """The speed is the derivative of A sin(2 pi f t + phase), or linear between the ramps' knots."""
    course, duration = COURSES[name]
    if course.sine is None:
        return effect_oracle.simulate(MAIN, PAIR, lambda t: float(np.interp(t, *np.array(RAMPS).T)), LOAD, duration)
    amplitude, frequency, phase = course.sine
    omega = 2.0 * np.pi * frequency
    return effect_oracle.simulate(
        MAIN, PAIR, lambda t: amplitude * omega * float(np.cos(omega * t + phase)), LOAD, duration
    )


@pytest.mark.parametrize("name", COURSES)
def test_a_drive_on_a_course_moves_the_mass_as_an_independent_integrator_says(name: str) -> None:
    (course, duration), other = COURSES[name], truth(name)
    motion = run(MODEL, PAIR, course, LOAD, duration)
    assert len(other.onsets) >= 3
    assert motion.onsets == pytest.approx(np.array(other.onsets), abs=1e-6)
    assert motion.arrests == pytest.approx(np.array(other.arrests), abs=1e-6)
    times = np.linspace(0.0, duration, 1001)
    assert motion.sample(times)["force"] == pytest.approx(other.force(times), abs=1e-6 * LOAD)


def test_steps_in_place_of_the_slopes_of_a_course_are_no_such_motion() -> None:
    course, duration = COURSES["sine"]
    fine = Drive.of(course, duration)
    motion = run(MODEL, PAIR, Drive(fine.starts, fine.speeds), LOAD, duration)
    times = np.linspace(0.0, duration, 1001)
    assert np.max(np.abs(motion.sample(times)["force"] - truth("sine").force(times))) > 1e-3 * LOAD


def test_the_mass_sticks_at_a_turn_and_then_slides_backwards() -> None:
    motion = run(MODEL, PAIR, Course((2e-3, 0.2, 0.0)), LOAD, 5.0)
    speeds = np.array([phase.x[len(phase.x) // 2, 1] for phase in motion.phases if phase.mode != "stick"])
    assert speeds.min() < 0.0 < speeds.max()


@pytest.mark.parametrize("more", [(), ("skin_compliance",), ("sensor_lag",), ("finger_motion",)])
def test_a_rest_of_one_piece_and_the_same_in_parts_end_alike(more: tuple[str, ...]) -> None:
    model = on_course(assemble((*MAIN, *more)))
    p = np.array([{**PAIR}.get(q.name, q.default) for q in model.parameters])
    x0, v0, pace = np.array([s.start for s in model.states]), 1e-3, 4e-3

    def after(x: Array, begin: float, end: float) -> Array:
        return np.array(model.rest(x, p, [v0 + pace * end, 1.0, 1.0, end], end - begin, pace)).ravel()

    middle = after(x0, 0.0, 0.07)
    assert after(middle, 0.07, 0.2) == pytest.approx(after(x0, 0.0, 0.2), rel=1e-9, abs=1e-15)


def test_a_constant_speed_costs_nothing() -> None:
    """The model of a constant speed is the very object it was, and its rests have the instructions they had."""
    assert assemble(MAIN) is MODEL and not MODEL.on_course
    assert symbols(MODEL)[1].numel() == len(MODEL.parameters) + 5
    plain, along = (_rest_functions(each)[0].n_instructions() for each in (MODEL, on_course(MODEL)))
    assert MODEL.rest.n_instructions() == 18 and plain < along
    assert run(MODEL, PAIR, 1e-3, 1.0, 1.0).model is MODEL
    assert MODEL.slip.n_instructions() == on_course(MODEL).slip.n_instructions()
