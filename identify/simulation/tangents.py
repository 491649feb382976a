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
from identify.simulation.phases import Slide
from identify.simulation.stepper import Situated, rate
from identify.simulation.steppers import Method, StepProblem

Array = NDArray[np.float64]


def situated_at(w: Array, direction: float = 1.0, time: float = 0.0) -> Situated:
    """What holds during a slide at a setting w (n_w,) from a time [s] on."""
    return Situated(w[:-2], float(w[-1]), direction, float(w[-2]), 0.0, time)


@lru_cache(maxsize=64)
def _functions(model: Model, method: Method, mode: ModeName) -> tuple[Mapped, Mapped]:
    """Of (x and step length, w, direction): x after a step and the rate there; the derivatives of x by x and w."""
    n_x, n_p = len(model.states), len(model.parameters)
    given = xh, w, direction = ca.SX.sym("xh", n_x + 1), ca.SX.sym("w", n_p + 2), ca.SX.sym("direction")
    moving, constants = rate(model, mode), ca.vertcat(w[:n_p], w[n_p + 1], direction, w[n_p], 0, 0)
    problem = StepProblem(moving, constants, lambda _after: ca.SX.ones(n_x))
    after, _ = method.step(problem, xh[:n_x], ca.SX(0), xh[n_x])
    slope = ca.jacobian(after, ca.vertcat(xh[:-1], w)).T
    results = [after, moving(after, constants, 0)], [slope]
    values, slopes = (Mapped(ca.Function("step", given, [ca.densify(q) for q in some])) for some in results)
    return values, slopes


def _arguments(slide: Slide, x: Array, lengths: Array) -> list[Array]:
    count, situated = len(lengths), slide.situated
    settings = np.repeat(np.append(situated.p, [situated.normal_force, situated.drive_speed])[None], count, axis=0)
    return [np.concatenate([x, lengths[:, None]], axis=1), settings, np.full(count, situated.direction)]


def stepped(model: Model, slide: Slide, x: Array, lengths: Array) -> tuple[Array, Array]:
    """States (s, n_x) after steps of some lengths (s,) [s] from states x (s, n_x) of a slide, and the rates there."""
    after, rates = _functions(model, slide.method, slide.mode)[0](_arguments(slide, x, lengths))
    return after, rates


def node_slopes(model: Model, slides: Sequence[Slide], onset: Array) -> list[Array]:
    """Derivatives, at fixed times, of the states at the nodes of slides that follow each other: (nodes, n_x, m) each.

    Args:
        onset: derivatives (n_x, m) of the first state; the last of the m directions are the setting.
    """
    out, moved, n = list[Array](), onset, onset.shape[0]
    for number, slide in enumerate(slides):
        if number:
            moved = moved - _switch(model, slides[number - 1], slide, moved)
        nodes = [moved]
        (slopes,) = _functions(model, slide.method, slide.mode)[1](_arguments(slide, slide.x[:-1], np.diff(slide.t)))
        for slope in slopes.reshape(len(slide.t) - 1, n, -1):
            after = slope[:, :n] @ moved
            after[:, n - slope.shape[1] :] += slope[:, n:]
            moved = after
            nodes.append(moved)
        out.append(np.array(nodes))
    return out


def _switch(model: Model, before: Slide, after: Slide, moved: Array) -> Array:
    """What a switch takes from derivatives (n_x, m) at fixed times: the jump of the rate times how its time moves."""
    if before.situated.direction != after.situated.direction:
        which = SPEED
    elif after.mode == "worn" and model.clamped is not None:
        which = model.clamped
    else:
        return np.zeros_like(moved)  # released: both motions agree here
    rates = [stepped(model, slide, after.x[:1], np.zeros(1))[1][0] for slide in (before, after)]
    return np.outer(rates[0] - rates[1], moved[which] / rates[0][which])
