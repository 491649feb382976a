"""How one pass is solved."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from identify import passes


@pytest.mark.parametrize(("slips", "patience"), [(passes.MANY - 1, passes.PATIENCE), (passes.MANY, passes.BRIEF)])
def test_among_hundreds_of_slips_the_exact_hessian_comes_sooner(monkeypatch, slips, patience):
    asked: list[tuple[int, bool]] = []

    def creeping(_problem, *, iterations, exact=False, **_):
        asked.append((iterations, exact))
        return SimpleNamespace(success=exact, iterations=iterations, infeasibility=0.0, cost=1.0, z=None)

    monkeypatch.setattr(passes, "solve", creeping)
    unknowns = SimpleNamespace(model=SimpleNamespace(vibrates=False))
    layout = SimpleNamespace(places=[SimpleNamespace(onset=np.zeros(slips))], unknowns=unknowns)
    tried = passes._tried(SimpleNamespace(layout=layout, samples=1), 1e-8, 1e-4, False, False)
    assert asked[0] == (patience, False) and asked[1][1] and tried.bent
    assert tried.iterations == sum(iterations for iterations, _ in asked)
