"""Off equals absent: at its null values an effect moves nothing; where its null is a limit, it gets there in order."""

from __future__ import annotations

import numpy as np
import pytest

from identify.effects import ALL
from identify.model.model import assemble
from identify.simulation.plan import Stepping
from identify.simulation.simulate import initial_states, run
from tests.support import effects_case as case

TIMES, FORCES = case.TIMES, case.FORCES
# A slip that starts under a rising pull takes sqrt(m D / fall) ln(...) until it has slid by D; with D falling as the
# square of the creep time, so that no speed of sliding ages, that is the first order less the logarithm.
ORDER = {"contact_ageing": 0.85}
PATH = {"D": 2}  # power of the strength along which a parameter goes to its limit


def _at(effect, strength: float) -> dict[str, float]:
    """Numbers of the company with the effect at its null, or by a factor `strength` from a limit."""
    p = case.numbers(case.company(effect))
    for name, null in effect.null.items():
        q = next(q for q in effect.parameters if q.name == name)
        limit = q.scale == "log" and not q.lower <= null <= q.upper
        share = strength ** PATH.get(name, 1)
        p[name] = p[name] * share if limit and null == 0.0 else p[name] / share if limit else null
    return p


def _limit(effect) -> bool:
    return any(
        q.scale == "log" and not q.lower <= effect.null[q.name] <= q.upper
        for q in effect.parameters
        if q.name in effect.null
    )


def _run(names: tuple[str, ...], p: dict[str, float]):
    """From a settled start, so that a lag shows nothing of the start."""
    model = assemble(names)
    values, load = {n: p[n] for n in model.parameter_names}, case.load_of(names)
    u = np.array([case.DRIVE, case.LOAD, 1.0, 0.0])
    start = initial_states(model, np.array(list(values.values())), u, {})
    return run(model, values, case.DRIVE, load, case.DURATION, start=start, accuracy=Stepping(case.RTOL))


def _compared(effect, strength: float) -> tuple[float, float]:
    """Difference in event times [s] and force [N] between the effect at its null and its absence."""
    with_it, less = case.company(effect), case.without(effect)
    runs = [_run(names, p) for names, p in ((with_it, _at(effect, strength)), (less, case.numbers(less)))]
    times = np.linspace(0.0, case.DURATION, 241)
    forces = [motion.sample(times)["force"] for motion in runs]
    a, b = (np.concatenate([motion.onsets, motion.arrests]) for motion in runs)
    assert a.size == b.size
    return float(np.max(np.abs(a - b), initial=0.0)), float(np.max(np.abs(forces[0] - forces[1])))


STRENGTHLESS = [e for e in ALL if e.null and not _limit(e)]
LIMITS = [e for e in ALL if _limit(e) and e.name != "inertia"]  # of the vanishing mass: see the tests without inertia


@pytest.mark.parametrize("effect", STRENGTHLESS, ids=lambda effect: effect.name)
def test_an_effect_at_its_null_is_absent(effect):
    times, forces = _compared(effect, 0.0)
    assert times < TIMES and forces < FORCES, (times, forces)


@pytest.mark.parametrize("effect", STRENGTHLESS, ids=lambda effect: effect.name)
def test_an_effect_beside_its_null_is_not_absent(effect):
    """Control: every null value counts, also alone."""
    for name, null in effect.null.items():
        spread = next(q.spread for q in effect.parameters if q.name == name)
        beside = replace_null(effect, name, null + 0.01 * spread)
        times, forces = _compared(beside, 0.0)
        assert times > 100 * TIMES or forces > 100 * FORCES, (name, times, forces)


def replace_null(effect, name: str, value: float):
    """The same effect with another value in its null."""
    other = type(effect)()
    other.null = dict(effect.null) | {name: value}
    return other


@pytest.mark.parametrize("effect", LIMITS, ids=lambda effect: effect.name)
def test_an_effect_near_its_limit_is_nearly_absent(effect):
    strengths = np.array([1e-2, 1e-3])
    errors = np.array([_compared(effect, s)[1] for s in strengths])
    order = np.diff(np.log(errors)) / np.diff(np.log(strengths))
    assert order == pytest.approx(ORDER.get(effect.name, 1.0), abs=0.15), (errors, order)
    assert errors[-1] < 1e-2 * case.LOAD
