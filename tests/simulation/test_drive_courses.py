"""A drive on a course (sine, ramps) against scipy's DOP853 on equations (1), (2), (5), (6), written out here."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from experiments.study_problem import DEMO, RIG
from identify.effects import MAIN
from identify.model.model import assemble, on_course
from identify.scene.tables import Course
from identify.simulation.drive import Drive
from identify.simulation.phases import _rest_functions
from identify.simulation.simulate import run
from identify.simulation.stepper import symbols

Array = NDArray[np.float64]
PAIR, MODEL, LOAD = DEMO | RIG, assemble(MAIN), 1.0


class Sine:
    """Position A sin(2 pi f t + phase) and its speed, exactly."""

    def __init__(self, amplitude: float, frequency: float, phase: float) -> None:
        self.given, self.omega = (amplitude, frequency, phase), 2.0 * np.pi * frequency

    def __call__(self, t: float) -> tuple[float, float]:
        angle = self.omega * t + self.given[2]
        return self.given[0] * (np.sin(angle) - np.sin(self.given[2])), self.given[0] * self.omega * np.cos(angle)


def ramped(knots: tuple[tuple[float, float], ...]) -> Callable[[float], tuple[float, float]]:
    """Position and speed of ramps, by the trapezoidal rule."""
    times, speeds = np.array(knots).T
    moved = np.concatenate([[0.0], np.cumsum(np.diff(times) * 0.5 * (speeds[1:] + speeds[:-1]))])

    def drive(t: float) -> tuple[float, float]:
        i, speed = int(np.searchsorted(times, t, side="right")) - 1, float(np.interp(t, times, speeds))
        return float(moved[i] + 0.5 * (speeds[i] + speed) * (t - times[i])), speed

    return drive


def truth(
    drive: Callable[[float], tuple[float, float]], duration: float
) -> tuple[Array, Array, Callable[[Array], Array]]:
    """Onsets and arrests [s], and the force of the load cell [N] at times: the position of the mass is integrated."""
    k, m, c = PAIR["stiffness"], PAIR["mass"], PAIR["damping"] * np.sqrt(PAIR["mass"] / PAIR["stiffness"])
    static, kinetic, fall, a = (PAIR[name] for name in ("mu_s", "mu_k0", "delta_mu_k", "a"))

    def pull(t: float, x: float, v: float) -> float:
        position, speed = drive(t)
        return k * (position - x) + c * (speed - v)

    def rates(t: float, y: Array, way: int) -> list[float]:
        low = kinetic + fall * (1.0 - np.exp(-a * abs(y[1])))
        friction = way * LOAD * (low + (static - low) * max(y[2], 0.0))
        ageing = (1.0 - y[2]) / PAIR["t_cr"] - abs(y[1]) / PAIR["D"]
        return [y[1], (pull(t, *y[:2]) - friction) / m, ageing if y[2] > 0.0 or ageing > 0.0 else 0.0]

    t, x, v, aged, onsets, arrests, parts = 0.0, 0.0, 0.0, 0.0, list[float](), list[float](), list[tuple]()
    while t < duration:
        begun, gamma = t, aged

        def spare(at: float, since: float = begun, g: float = gamma, place: float = x) -> float:
            rested = 1.0 - (1.0 - g) * np.exp(-(at - since) / PAIR["t_cr"])
            return float(LOAD * (kinetic + (static - kinetic) * rested) - abs(pull(at, place, 0.0)))

        grid = np.append(np.arange(t, duration, 1e-3), duration)
        held = np.array([spare(at) for at in grid])
        if held.min() > 0.0:
            parts.append((t, duration, lambda at, place=x: np.array([np.full(at.size, place), 0.0 * at])))
            break
        i = int(np.argmax(held <= 0.0))
        t = float(brentq(spare, grid[i - 1], grid[i], xtol=1e-15)) if i else t
        parts.append((begun, t, lambda at, place=x: np.array([np.full(at.size, place), 0.0 * at])))
        onsets.append(t)
        aged = 1.0 - (1.0 - gamma) * np.exp(-(t - begun) / PAIR["t_cr"])
        way = int(np.sign(pull(t, x, 0.0)))
        rest, first = lambda _t, y, way: way * y[1], True
        while True:  # gamma is clamped where it falls to zero
            worn = lambda _t, y, way: y[2]  # noqa: E731
            freed = lambda _t, y, way: 1.0 / PAIR["t_cr"] - abs(y[1]) / PAIR["D"]  # noqa: E731
            other = worn if aged > 0.0 else freed
            rest.terminal = other.terminal = True  # type: ignore[attr-defined]
            rest.direction, other.direction = -1, -1 if aged > 0.0 else 1  # type: ignore[attr-defined]
            begin = [x, v, max(aged, 0.0)]
            if first:  # the speed grows from nothing
                begin[1] = way * 1e-16
            solved = solve_ivp(
                rates, (t, duration), begin, "DOP853", None, True, [rest, other], args=(way,), rtol=1e-12, atol=1e-18
            )
            parts.append((t, solved.t[-1], lambda at, of=solved.sol: of(at)[:2]))
            t, (x, v, aged), first = float(solved.t[-1]), solved.y[:, -1], False
            if solved.t_events[0].size or t >= duration:
                break
            aged = 0.0 if other is worn else 1e-15
        if t < duration:
            arrests.append(t)
        v = 0.0
    edges = np.array([begin for begin, *_ in parts])

    def force(times: Array) -> Array:
        which = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, None)
        inside = [parts[j][2](np.array([at]))[:, 0] for j, at in zip(which, times, strict=True)]
        return np.array([pull(at, *y) for at, y in zip(times, inside, strict=True)])

    return np.array(onsets), np.array(arrests), force


RAMPS = ((0.0, 0.0), (1.0, 2e-3), (2.0, 2e-3), (3.0, 0.5e-3))
COURSES = {
    "slow sine": (Course((2e-3, 0.05, 0.3)), Sine(2e-3, 0.05, 0.3), 14.0),
    "sine": (Course((2e-3, 1.0, 0.0)), Sine(2e-3, 1.0, 0.0), 2.2),
    "fast sine": (Course((0.8e-3, 5.0, 1.0)), Sine(0.8e-3, 5.0, 1.0), 0.7),
    "ramps": (Course(ramps=RAMPS), ramped(RAMPS), 3.0),
}


@pytest.mark.parametrize("name", COURSES)
def test_a_drive_on_a_course_moves_the_mass_as_an_independent_integrator_says(name: str) -> None:
    course, drive, duration = COURSES[name]
    onsets, arrests, force = truth(drive, duration)
    motion = run(MODEL, PAIR, course, LOAD, duration)
    assert onsets.size >= 3
    assert motion.onsets == pytest.approx(onsets, abs=1e-6)
    assert motion.arrests == pytest.approx(arrests, abs=1e-6)
    times = np.linspace(0.0, duration, 1001)
    assert motion.sample(times)["force"] == pytest.approx(force(times), abs=1e-6 * LOAD)


def test_steps_in_place_of_the_slopes_of_a_course_are_no_such_motion() -> None:
    course, drive, duration = COURSES["sine"]
    fine = Drive.of(course, duration)
    _, _, force = truth(drive, duration)
    motion = run(MODEL, PAIR, Drive(fine.starts, fine.speeds), LOAD, duration)
    times = np.linspace(0.0, duration, 1001)
    assert np.max(np.abs(motion.sample(times)["force"] - force(times))) > 1e-3 * LOAD


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
