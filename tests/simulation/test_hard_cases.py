"""The table of hard cases and random scenes, each against a truth from outside or refused by name."""

from __future__ import annotations

from dataclasses import replace

import pytest

import experiments.verdicts
from experiments.draws import draw, effects_of
from experiments.growth_rates import pairs
from experiments.hard_cases import CASES
from experiments.hard_scenes import HardCase
from experiments.verdicts import judge
from identify.base.errors import SceneError, SimulationError
from identify.effects import MAIN

GREEN = [case for case in CASES if case.truth is not None]
REFUSED = [case for case in CASES if case.truth is None]
PAPER = [seed for seed in range(2000) if effects_of(seed) == MAIN][:100]
OTHERS = range(40, 60)


@pytest.mark.parametrize("case", GREEN, ids=lambda case: case.name)
def test_the_case_is_green_and_a_spring_slightly_too_stiff_is_not(case: HardCase) -> None:
    error, spoilt = case.errors(0.0, 1e-3)
    assert error <= case.tolerance
    assert spoilt > 10.0 * case.tolerance or case.scene.drive == 0.0


@pytest.mark.parametrize("case", REFUSED, ids=lambda case: case.name)
def test_the_case_is_refused_with_its_sentence(case: HardCase) -> None:
    with pytest.raises((SimulationError, SceneError), match=case.refusal):
        case.scene.run()


def _violations(seeds: list[int]) -> list[str]:
    verdicts = [judge(draw(seed)) for seed in seeds]
    return [f"{v.seed}: {v.outcome}" for v in verdicts if v.outcome.startswith("VIOLATION")]


def test_random_scenes_with_the_effects_of_the_paper_meet_their_accuracy_or_are_refused() -> None:
    assert _violations(PAPER) == []


def test_random_scenes_with_random_effects_meet_their_accuracy_or_are_refused() -> None:
    assert _violations(list(OTHERS)) == []


def test_a_simulation_that_is_less_accurate_than_it_says_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = experiments.verdicts.plan

    def careless(*given, **more):
        steps = honest(*given, **more)
        return replace(steps, rtol=1e5 * steps.rtol) if steps.rtol in (1e-5, 1e-7, 1e-9) else steps

    monkeypatch.setattr(experiments.verdicts, "plan", careless)
    assert len(_violations(PAPER[:40])) >= 2


@pytest.mark.parametrize("pair", pairs(4), ids=lambda pair: f"{pair.effects[1]}, {pair.mass:.3g} kg")
def test_steady_sliding_loses_stability_within_three_percent_of_the_critical_stiffness(pair) -> None:
    below, above = pair.rate(0.97)[0], pair.rate(1.03)[0]
    assert below > 0.0 > above
    at, frequency = pair.rate(1.0)
    assert abs(at) < 1e-3 * min(below, -above) < 1e-3 * frequency
