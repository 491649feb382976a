"""Implicit steps between their ends: the error inside a step counts as that at its end."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from identify.simulation.steppers import STIFF, StepProblem

LAMBDA, STEP, RTOL = 1e6, 0.5, 1e-6


def _follower(kind: type[ca.SX] = ca.SX) -> tuple[ca.Function, ca.Function]:
    """A step, and the state inside it, of y' = -lambda (y - cos t) - sin t, whose solution is cos t."""
    x, c, t, h, part = (ca.SX.sym(name) for name in ("x", "c", "t", "h", "part"))
    rate = ca.Function("rate", [x, c, t], [-LAMBDA * (x - ca.cos(t)) - ca.sin(t)])
    after, norm = STIFF.step(StepProblem(rate, c, lambda after: RTOL), x, t, h)
    inside = STIFF.within(StepProblem(rate, c, lambda after: RTOL), x, t, h, part, after)
    return ca.Function("step", [x, t, h], [after, norm]), ca.Function("inside", [x, t, h, part], [inside])


def test_a_step_that_is_good_at_its_end_only_is_refused() -> None:
    step, inside = _follower()
    shares = np.linspace(0.0, 1.0, 41)

    def errors(h: float) -> tuple[float, float, float]:
        after, norm = step(1.0, 0.0, h)
        within = max(abs(float(inside(1.0, 0.0, h, share * h)) - np.cos(share * h)) for share in shares)
        return abs(float(after) - np.cos(h)), within, float(norm)

    end, within, norm = errors(STEP)
    assert end < 0.1 * RTOL and within > 10.0 * RTOL  # what the end alone would let pass
    assert norm > 1.0
    good = next(h for h in STEP * 0.9 ** np.arange(60) if errors(h)[2] <= 1.0)
    assert good > 0.02
    assert errors(good)[1] < 3.0 * RTOL


def test_a_part_of_an_implicit_step_is_the_motion_there() -> None:
    """Without a fast decay: the polynomial is as good as the step."""
    x, c, t, h, part = (ca.SX.sym(name) for name in ("x", "c", "t", "h", "part"))
    rate = ca.Function("rate", [x, c, t], [-x])
    problem = StepProblem(rate, c, lambda after: 1e-12)
    after = STIFF.step(problem, x, t, h)[0]
    inside = ca.Function("inside", [x, h, part], [STIFF.within(problem, x, t, h, part, after)])
    at = np.linspace(0.0, 1.0, 11)

    def error(h: float) -> float:
        return max(abs(float(inside(1.0, h, share * h)) - np.exp(-share * h)) for share in at)

    assert np.log2(error(0.2) / error(0.1)) == pytest.approx(4.0, abs=0.2)
