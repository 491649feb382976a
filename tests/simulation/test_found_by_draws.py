"""What random scenes have found wrong, each held to a truth from outside."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from experiments.draws import draw
from experiments.energy import balance
from experiments.verdicts import judge, motion
from identify.simulation.steppers import STIFF, StepProblem

# Seed of the scene: what was wrong there.
FOUND = {
    2475: "samples inside implicit steps showed disturbances that the steps had damped away",
    2503: "the energy of a series element that relaxes in a rest of millennia was not seen",
    2545: "the integrator of the tests stepped over a touch of rest",
    3354: "inside implicit steps a speed that follows the drive was interpolated too coarsely",
    4461: "a mass of eight milligrams lost energy between its samples",
    3732: "a slip with a fresh contact began as one whose contact is not fresh",
}
# Of thirty onsets in three hours one switches to the other side by rounding, on some processors; the scene's own
# disturbances do the same. What was wrong there was the energy.
ALSO = {4461: ("met as far as the scene allows",)}


@pytest.mark.parametrize("seed", FOUND)
def test_the_scene_meets_its_accuracy(seed: int) -> None:
    verdict = judge(draw(seed))
    assert verdict.energy <= 1.0
    assert verdict.outcome in ("met", *ALSO.get(seed, ()))


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


VALUES = {"mu_s": 0.6, "mu_k0": 0.45, "stiffness": 1470.0, "mass": 0.2, "damping": 8.0 * 1470.0}


def test_an_implicit_step_that_newton_does_not_find_again_is_drawn_through_its_ends() -> None:
    """Seed 7645: one step of 1,200 was found by Newton's method and, a last digit apart, not found again: samples in it
    were of 1e16 m/s."""
    scene = draw(7645)
    ours = motion(scene, scene.accuracy)
    found = balance(ours, scene.values)
    assert found is not None and found.error < 10.0 * scene.accuracy
    fastest = max(float(np.max(np.abs(np.asarray(phase.states)[:, 1]))) for phase in ours.phases)
    times = np.linspace(0.0, ours.duration, 20_001)
    assert float(np.max(np.abs(ours.sample(times)["sliding_speed"]))) <= 1.01 * fastest


@pytest.mark.parametrize("seed", [3002, 4065])
def test_a_switch_is_not_reached_along_too_long_a_straight_line(seed: int) -> None:
    """Slips that hardly begin under a vibrating drive: a line of a tenth of the root of the tolerance lost them."""
    assert judge(draw(seed)).outcome.startswith("met")
