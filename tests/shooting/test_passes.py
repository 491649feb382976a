"""How one pass is solved."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from identify.shooting import passes


@pytest.mark.parametrize(
    ("slips", "row", "patience"),
    [
        (passes.MANY - 1, 0.0, [passes.PATIENCE]),
        (passes.MANY, 0.5 * passes.FOLLOWS, [passes.ENOUGH]),  # a good start
        (passes.MANY, 2.0 * passes.FOLLOWS, [passes.ENOUGH, passes.BRIEF]),  # one from which more of it is needed
    ],
)
def test_among_hundreds_of_slips_the_exact_hessian_comes_sooner(monkeypatch, slips, row, patience):
    asked: list[tuple[int, bool]] = []

    def creeping(_problem, *, iterations, exact=False, **_):
        asked.append((iterations, exact))
        return SimpleNamespace(success=exact, iterations=iterations, constraint_violation=row, cost=0.5, z=None)

    monkeypatch.setattr(passes, "solve", creeping)
    unknowns = SimpleNamespace(model=SimpleNamespace(vibrates=False))
    layout = SimpleNamespace(unknowns=unknowns)
    tried = passes._tried(SimpleNamespace(layout=layout, samples=1), 1e-8, 1e-4, False, slips)
    assert asked[:-1] == [(most, False) for most in patience] and asked[-1][1] and tried.exact
    assert tried.iterations == sum(iterations for iterations, _ in asked)


@pytest.mark.parametrize(("row", "goes_on"), [(0.1 * passes.HANGS, True), (10 * passes.HANGS, False)])
def test_a_motion_that_hangs_together_is_followed_to_the_end_of_its_valley(monkeypatch, row, goes_on):
    asked: list[tuple[bool, object]] = []

    def in_a_valley(_problem, *, iterations, exact=False, start=None, **_):
        asked.append((exact, start))
        arrived = exact and start == "exact"
        where = "exact" if exact else "plain"
        return SimpleNamespace(success=arrived, iterations=iterations, constraint_violation=row, cost=0.5, z=where)

    monkeypatch.setattr(passes, "solve", in_a_valley)
    unknowns = SimpleNamespace(model=SimpleNamespace(vibrates=False))
    problem = SimpleNamespace(layout=SimpleNamespace(places=[], unknowns=unknowns), samples=1)
    tried = passes._tried(problem, 1e-8, 1e-4, False, 0)
    assert tried.solution.success == goes_on
    assert asked == [(False, None), (True, "plain"), *([(True, "exact")] if goes_on else [])]


@pytest.mark.parametrize(("shift", "settles"), [(0.5 * passes.VANISHING, True), (2.0 * passes.VANISHING, False)])
def test_a_rest_that_vanishes_halves_for_ever_and_counts_as_settled(shift, settles):
    """An event that goes as far as it can in a pass has farther to go, unless that is next to nothing."""
    interval = 0.05
    place = SimpleNamespace(events=np.array([0, 1]))
    reach = np.array([1.0, shift * interval])
    layout = SimpleNamespace(places=[place], upper=reach, lower=-reach)
    solution = SimpleNamespace(x=np.array([0.0, -shift * interval]))
    log, trajectory = SimpleNamespace(interval=interval), SimpleNamespace(slips=np.empty(0))
    moved = passes._shift_in_samples(SimpleNamespace(layout=layout), solution, [log], [trajectory])
    assert (moved < passes.SETTLED) == settles
