"""Rests in closed form: the same linear chain integrated, one rest after another, and decays of equal rates."""

from __future__ import annotations

import itertools

import casadi as ca
import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from identify.effects import ALL
from identify.model.chain import decay
from identify.model.model import TIME, Model, assemble
from tests.support import effect_oracle
from tests.support import effects_case as case

EVERY = pytest.mark.parametrize("effect", ALL, ids=lambda effect: effect.name)
TOGETHER = case.together()
# The states of the independent integrator that are states of the model too.
SHARED = effect_oracle.NAMES


def _setting(names: tuple[str, ...], seed: int):
    random = np.random.default_rng(seed)
    model = assemble(names)
    p = case.numbers(names, random)
    x = case.state(model, random)
    if "stick_number" in (states := [s.name for s in model.states]):
        x[states.index("stick_number")] = 3.0
    u = case.inputs(random)
    return model, np.array([p[n] for n in model.parameter_names]), p, x, u


def _integrated(names: tuple[str, ...], model: Model, p: dict[str, float], x: np.ndarray, u: np.ndarray, t: float):
    """States at rest after t [s] that end at the time of the inputs, by DOP853 on the equations of the effects."""
    equations = effect_oracle.Equations(names, p)
    states = [s.name for s in model.states]
    if "stick_number" in states:
        equations.stick = round(x[states.index("stick_number")])
    begin = u[TIME] - t
    start = np.array([x[states.index(n)] if n in states else 0.0 for n in SHARED] + [0.0])
    start[effect_oracle.V] = 0.0

    def rates(s: float, y: np.ndarray) -> list[float]:
        return equations.rates((start + y).tolist(), "stick", 1, u[0], u[1], begin + s)

    done = solve_ivp(rates, (0.0, t), np.zeros(8), method="DOP853", rtol=1e-12, atol=1e-16, max_step=t / 20)
    return dict(zip(SHARED, (start + done.y[:, -1]).tolist(), strict=False))


def _worst(names: tuple[str, ...], seed: int, t: float) -> float:
    model, values, p, x, u = _setting(names, seed)
    rested = dict(zip([s.name for s in model.states], case.result(model, "rest", x, values, u, t), strict=True))
    expected = _integrated(names, model, p, x, u, t)
    sizes = {s.name: case.SIZES[s.unit] for s in model.states}
    return max(abs(rested[n] - expected[n]) / sizes[n] for n in expected if n in rested)


@EVERY
@pytest.mark.parametrize("t", [1e-4, 0.3])
def test_rest_is_the_integral_of_its_chain(effect, t):
    assert _worst(case.company(effect), 1, t) < 2e-11


@pytest.mark.parametrize("seed", range(4))
def test_rest_with_all_effects_together(seed):
    assert _worst(TOGETHER, seed, 0.05 * 4**seed) < 2e-11


def test_a_rest_of_another_length_is_seen():
    """Control: the comparison tells a rest that is a hundred millionth longer."""
    model, values, p, x, u = _setting(TOGETHER, 0)
    t = 0.1
    rested = case.result(model, "rest", x, values, u, t * (1 + 1e-8))
    expected = _integrated(TOGETHER, model, p, x, u, t)
    states = [s.name for s in model.states]
    assert abs(rested[states.index("gamma")] - expected["gamma"]) > 2e-11


@EVERY
def test_one_rest_after_another_is_one_rest(effect):
    for seed, (first, second) in enumerate([(1e-5, 0.2), (0.3, 1e-3), (2.0, 40.0)]):
        model, values, _, x, u = _setting(case.company(effect), seed)
        u[TIME] = first + second + 0.7
        early = u - second * np.eye(4)[TIME]
        twice = case.result(model, "rest", case.result(model, "rest", x, values, early, first), values, u, second)
        once = case.result(model, "rest", x, values, u, first + second)
        sizes = np.array([case.SIZES[s.unit] for s in model.states])
        assert np.max(np.abs(twice - once) / (sizes + np.abs(once))) < 1e-12


# ---- decays


def _exact(rates: tuple[float, ...], t: float) -> float:
    """The divided difference of exp(-r t), rates moved apart by 1e-30 of themselves, in 200 digits."""
    with mpmath.workdps(200):
        r = [mpmath.mpf(rate) * (1 + i * mpmath.mpf(10) ** -30) for i, rate in enumerate(rates)]
        total = mpmath.mpf(0)
        for i, own in enumerate(r):
            total += mpmath.exp(-own * t) / mpmath.fprod(other - own for j, other in enumerate(r) if j != i)
        return float(total)


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-7, 1e-3, 0.05, 0.3, 2.0, 1e3])
@pytest.mark.parametrize("count", [2, 3, 4])
def test_decays_of_close_rates(count, apart):
    symbols = ca.SX.sym("r", count), ca.SX.sym("t")
    function = ca.Function("decay", list(symbols), [decay(ca.vertsplit(symbols[0]), symbols[1])])
    rates = tuple(100.0 * (1 + apart * i / 3) for i in range(count))
    for t in (1e-6, 1e-3, 0.02, 0.2):
        for order in itertools.islice(itertools.permutations(rates), 6):
            got, exact = float(function(order, t)), _exact(order, t)
            assert got == pytest.approx(exact, rel=2e-12 * 10 ** (count - 2)), (order, t)
