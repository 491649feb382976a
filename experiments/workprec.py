"""Work against precision: timing loops, and runs of one scene with every method over a ladder of tolerances."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.model.model import Model, assemble
from identify.simulation.drive import Drive, NormalForce
from identify.simulation.phases import Machine, Phase, phases
from identify.simulation.plan import ACCURACY, Plan, Stepping, scales
from identify.simulation.simulate import run
from identify.simulation.steppers import Method
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scene:
    """A named simulation: effects, all parameters, drive speed [m/s] and duration [s] under 1 N; what makes it so."""

    name: str
    says: str
    effects: tuple[str, ...]
    values: dict[str, float]
    drive_speed: float
    duration: float

    @property
    def model(self) -> Model:
        """The composed model."""
        return assemble(self.effects)

    def run(self, *, accuracy: float = ACCURACY, rtol: float | None = None, method: Method | None = None) -> Trajectory:
        """Simulate it to an accuracy, or with a relative tolerance of steps of one method."""
        how = accuracy if rtol is None else Stepping(rtol, method)
        return run(self.model, self.values, self.drive_speed, 1.0, self.duration, accuracy=how)


@dataclass(frozen=True)
class Point:
    """One run of one program: error (of event times over the mean cycle), seconds (median), their spread."""

    program: str
    setting: str
    error: float
    seconds: float
    lowest: float
    highest: float


@contextmanager
def one_core() -> Iterator[None]:
    """Run on one core where the system allows to say so."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def timed(function: Callable[[], Any], repeats: int) -> tuple[Any, list[float]]:
    """The result of the first, untimed call, and processor times [s] of `repeats` more."""
    result, seconds = function(), []
    for _ in range(repeats):
        since = time.process_time()
        function()
        seconds.append(time.process_time() - since)
    return result, seconds


def point(
    program: str, setting: str, function: Callable[[], Array], truth: Array, period: float, repeats: int
) -> Point:
    """Time a program that returns event times (n,) [s]; another number of events is an infinite error."""
    found, seconds = timed(function, repeats)
    error = float(np.max(np.abs(found - truth))) / period if found.size == truth.size else float("inf")
    return Point(program, setting, error, float(np.median(seconds)), min(seconds), max(seconds))


def ladder(scene: Scene, method: Method, rtols: Sequence[float], truth: Array, repeats: int) -> list[Point]:
    """One method of ours over tolerances; what it refuses is left out."""
    period, out = scene.duration / truth.size, []
    for rtol in rtols:
        try:
            out.append(
                point(
                    method.name,
                    f"{rtol:.0e}",
                    lambda rtol=rtol: scene.run(rtol=rtol, method=method).onsets,  # type: ignore[misc]
                    truth,
                    period,
                    repeats,
                )
            )
        except SimulationError:
            continue
    return out


def fixed_steps(scene: Scene, method: Method, h: float, *, locate: bool = True) -> tuple[Phase, ...]:
    """The scene with steps of length h [s] and no error control; switches located or not."""
    model = scene.model
    p = np.array([scene.values[name] for name in model.parameter_names])
    scale = replace(scales(model, p, 1.0), longest=h)
    machine = Machine(model, p, scale, Plan(1e6, (method,)), locate=locate)
    machine.first = dict.fromkeys(machine.first, h)
    x = np.array([state.start for state in model.states], float)
    return tuple(phases(machine, Drive.of(scene.drive_speed), NormalForce.of(1.0), scene.duration, x))


def measured_order(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Slope of log(error) over log(step length)."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
