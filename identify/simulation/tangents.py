"""How a slide moves with its start and its setting: exact derivatives of the steps that were taken.

The setting w (n_w,) = parameters, normal force [N], drive speed [m/s] holds during a stick and the slip after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.model.model import SPEED, Model
from identify.model.modes import ModeName
from identify.simulation.bursts import rate
from identify.simulation.phases import Slide
from identify.simulation.stepper import Situated
from identify.simulation.steppers import Method, StepProblem

Array = NDArray[np.float64]


def situated_at(w: Array, direction: float = 1.0) -> Situated:
    """What holds during a slide at a setting w (n_w,)."""
    return Situated(w[:-2], float(w[-1]), direction, float(w[-2]), 0.0)


def setting_of(slide: Slide) -> Array:
    """The setting w (n_w,) of a slide."""
    return np.append(slide.situated.p, [slide.situated.normal_force, slide.situated.drive_speed])


@lru_cache(maxsize=64)
def _functions(model: Model, method: Method, mode: ModeName) -> tuple[Mapped, Mapped]:
    """Of a step, by (x and its length, w, direction): x after it and the rate there; the derivatives of x after it by
    x and w, one column per row."""
    n_x, n_p = len(model.states), len(model.parameters)
    xh, w, direction = ca.SX.sym("xh", n_x + 1), ca.SX.sym("w", n_p + 2), ca.SX.sym("direction")
    moving, constants = rate(model, mode), ca.vertcat(w[:n_p], w[n_p + 1], direction, w[n_p], 0, 0)
    problem = StepProblem(moving, constants, lambda _after: ca.SX.ones(n_x))
    after, _ = method.step(problem, xh[:n_x], ca.SX(0), xh[n_x])
    slope = ca.jacobian(after, ca.vertcat(xh[:n_x], w)).T
    inside = [after, moving(after, constants, 0)]
    return (
        Mapped(ca.Function("inside", [xh, w, direction], [ca.densify(ca.vertcat(*inside))])),
        Mapped(ca.Function("step_slope", [xh, w, direction], [ca.densify(slope)])),
    )


def _of_steps(which: int, model: Model, slide: Slide, x: Array, lengths: Array) -> Array:
    """One of `_functions` for the steps (s,) of a slide."""
    count = len(lengths)
    settings, directions = np.repeat(setting_of(slide)[None], count, 0), np.full(count, slide.situated.direction)
    given = [np.append(x, lengths[:, None], axis=1), settings, directions]
    return _functions(model, slide.method, slide.mode)[which](given)[0]


def stepped(model: Model, slide: Slide, x: Array, lengths: Array) -> tuple[Array, Array]:
    """States (s, n_x) after steps of some lengths (s,) [s] from states x (s, n_x) of a slide, and the rates there."""
    out = _of_steps(0, model, slide, x, lengths)
    return out[:, : x.shape[1]], out[:, x.shape[1] :]


def step_slopes(model: Model, slide: Slide, x: Array, lengths: Array) -> Array:
    """The derivatives (s, n_x, n_x + n_w) of those states by x and the setting."""
    return _of_steps(1, model, slide, x, lengths).reshape(len(lengths), x.shape[1], -1)


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
    found, moved, n = list[Array](), onset, onset.shape[0]
    for number, slide in enumerate(slides):
        if number:
            moved = moved - _switch(model, slides[number - 1], slide, moved)
        slopes = step_slopes(model, slide, slide.x[:-1], np.diff(slide.t))
        nodes, by_state, by_setting = [moved], np.ascontiguousarray(slopes[:, :, :n]), slopes[:, :, n:]
        for of_state, of_setting in zip(by_state, by_setting, strict=True):
            moved = of_state.dot(moved)
            moved[:, -of_setting.shape[1] :] += of_setting
            nodes.append(moved)
        found.append(np.array(nodes))
    return found


def _switch(model: Model, before: Slide, after: Slide, moved: Array) -> Array:
    """What a switch takes from derivatives (n_x, m) at fixed times: the change of the rate, times how the time of the
    switch moves."""
    if before.situated.direction != after.situated.direction:
        which = SPEED
    elif after.mode == "saturated" and model.clamped is not None:
        which = model.clamped
    else:
        return np.zeros_like(moved)  # released: both motions agree here
    rates = [stepped(model, slide, after.x[:1], np.zeros(1))[1][0] for slide in (before, after)]
    return np.outer(rates[0] - rates[1], moved[which] / rates[0][which])
