"""Motions under every effect against an independent integrator, and that an effect without strength is absent."""

from __future__ import annotations

import numpy as np
import pytest

from identify.effects import ALL
from tests.support import effects_case as case

EVERY = pytest.mark.parametrize("effect", ALL, ids=lambda effect: effect.name)
TIMES, FORCES = case.TIMES, case.FORCES

RANGES = {
    "highest_speed",
    "lowest_force",
    "highest_force",
    "lowest_pressure",
    "highest_pressure",
}  # inside they are idle


@EVERY
def test_motion_is_that_of_an_independent_integrator(effect):
    names = case.company(effect)
    found = case.departure(names, case.numbers(names))
    assert found.slips >= 1, "a run without a slip tells nothing"
    assert found.times < TIMES and found.force < FORCES, found


@pytest.mark.parametrize("seed", range(6))
def test_random_compositions_move_as_an_independent_integrator_says(seed):
    random = np.random.default_rng(seed)
    names = case.subset(random)
    found = case.departure(names, case.numbers(names, random), drive=random.choice([-1.0, 1.0]) * case.DRIVE)
    assert found.times < TIMES and found.force < FORCES, (names, found)


@EVERY
def test_every_parameter_is_felt_by_the_comparison(effect):
    """Control: a parameter that is one per cent off is seen far above the tolerance."""
    names = case.company(effect)
    p = case.numbers(names)
    for q in effect.parameters:
        if q.name in RANGES:
            continue
        changed = p[q.name] * 1.01 if p[q.name] else 0.01 * q.spread
        if q.name in case.WHOLE:
            changed = p[q.name] + 1
        found = case.departure(names, p | {q.name: changed}, against=p)
        assert found.times > 100 * TIMES or found.force > 100 * FORCES, (q.name, found)
