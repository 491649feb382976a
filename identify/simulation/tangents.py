"""How a slide moves with its start and its setting: exact derivatives of the steps that were taken.

The setting w (n_w,) = parameters, normal force [N], drive speed [m/s] holds during a stick and the slip after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.model.model import SPEED, Model
from identify.model.modes import ModeName
from identify.simulation.phases import Slide
from identify.simulation.stepper import Situated, rate
from identify.simulation.steppers import Method, StepProblem

Array = NDArray[np.float64]


def situated_at(w: Array, direction: float = 1.0, time: float = 0.0) -> Situated:
    """What holds during a slide at a setting w (n_w,) from a time [s] on."""
    return Situated(w[:-2], float(w[-1]), direction, float(w[-2]), 0.0, time)


@dataclass(frozen=True)
class StepExpressions:
    """What a step is a function of: x and its length, w, direction; x after it and the rate there."""

    given: tuple[ca.SX, ca.SX, ca.SX]
    after: ca.SX
    rate: ca.SX

    @staticmethod
    def of(model: Model, method: Method, mode: ModeName) -> StepExpressions:
        """Of a sliding mode."""
        n_x, n_p = len(model.states), len(model.parameters)
        xh, w, direction = ca.SX.sym("xh", n_x + 1), ca.SX.sym("w", n_p + 2), ca.SX.sym("direction")
        moving, constants = rate(model, mode), ca.vertcat(w[:n_p], w[n_p + 1], direction, w[n_p], 0, 0)
        problem = StepProblem(moving, constants, lambda _after: ca.SX.ones(n_x))
        after, _ = method.step(problem, xh[:n_x], ca.SX(0), xh[n_x])
        return StepExpressions((xh, w, direction), after, moving(after, constants, 0))

    def function(self, *results: ca.SX) -> Mapped:
        """These results of a step, each as one row of numbers."""
        return Mapped(ca.Function("step", self.given, [ca.densify(result) for result in results]))


@lru_cache(maxsize=64)
def _functions(model: Model, method: Method, mode: ModeName) -> tuple[Mapped, Mapped]:
    """Of a step: x after it and the rate there; the derivatives of x after it by x and w, one column per row."""
    step = StepExpressions.of(model, method, mode)
    xh, w, _ = step.given
    slope = ca.jacobian(step.after, ca.vertcat(xh[:-1], w)).T
    return step.function(step.after, step.rate), step.function(slope)


def of_steps(function: Mapped, slide: Slide, x: Array, lengths: Array) -> list[Array]:
    """The results (s, ...) of a function of steps of some lengths (s,) [s] from states x (s, n_x) of a slide."""
    count, situated = len(lengths), slide.situated
    settings = np.repeat(situated.setting[None], count, axis=0)
    given = [np.concatenate([x, lengths[:, None]], axis=1), settings, np.full(count, situated.direction)]
    return function(given)


def stepped(model: Model, slide: Slide, x: Array, lengths: Array) -> tuple[Array, Array]:
    """States (s, n_x) after steps of some lengths (s,) [s] from states x (s, n_x) of a slide, and the rates there."""
    after, rates = of_steps(_functions(model, slide.method, slide.mode)[0], slide, x, lengths)
    return after, rates


def step_slopes(model: Model, slide: Slide, x: Array, lengths: Array) -> Array:
    """The derivatives (s, n_x, n_x + n_w) of those states by x and the setting."""
    (slopes,) = of_steps(_functions(model, slide.method, slide.mode)[1], slide, x, lengths)
    return slopes.reshape(len(lengths), x.shape[1], -1)


def onward(slope: Array, moved: Array) -> Array:
    """Derivatives (n_x, m) after a step with `slope` (n_x, n_x + n_w), of those before it; the last of the m directions
    are the setting."""
    n = moved.shape[0]
    after = slope[:, :n] @ moved
    after[:, n - slope.shape[1] :] += slope[:, n:]
    return np.asarray(after)


def node_slopes(model: Model, slides: Sequence[Slide], onset: Array) -> list[Array]:
    """Derivatives, at fixed times, of the states at the nodes of slides that follow each other: (nodes, n_x, m) each.

    Args:
        onset: derivatives (n_x, m) of the first state; the last of the m directions are the setting.
    """
    found, moved = list[Array](), onset
    for number, slide in enumerate(slides):
        if number:
            moved = moved - _switch(model, slides[number - 1], slide, moved)
        nodes = [moved]
        for slope in step_slopes(model, slide, slide.x[:-1], np.diff(slide.t)):
            moved = onward(slope, moved)
            nodes.append(moved)
        found.append(np.array(nodes))
    return found


def _switch(model: Model, before: Slide, after: Slide, moved: Array) -> Array:
    """What a switch takes from derivatives (n_x, m) at fixed times: the change of the rate, times how the time of the
    switch moves."""
    if before.situated.direction != after.situated.direction:
        which = SPEED
    elif after.mode == "worn" and model.clamped is not None:
        which = model.clamped
    else:
        return np.zeros_like(moved)  # released: both motions agree here
    rates = [stepped(model, slide, after.x[:1], np.zeros(1))[1][0] for slide in (before, after)]
    return np.outer(rates[0] - rates[1], moved[which] / rates[0][which])
