"""What the levels of the data suggest is tried as it is where an answer leaves parameters open."""

from __future__ import annotations

import numpy as np
import pytest
from taken_logs import taken

from experiments.study_problem import DEMO, RIG, SPEEDS, simulated_case
from identify.examination import valleys
from identify.search.attempt import Clock, solve_from
from identify.search.starts import suggested_starts


def test_the_suggestions_are_tried_in_the_first_look_only(monkeypatch: pytest.MonkeyPatch) -> None:
    case = simulated_case(DEMO, 17)
    prepared, unknowns = taken(case.records[2:3], SPEEDS[2:3], DEMO, RIG)
    suggested = suggested_starts(prepared, unknowns)
    assert len(suggested) == 8 and np.all(suggested[:, ~unknowns.free] == unknowns.start[~unknowns.free])
    found = solve_from(prepared, [0], unknowns, Clock())
    assert found is not None
    monkeypatch.setattr(valleys, "THROWN", 1)

    def tried(own: bool) -> int:
        starts = list(valleys._thrown(found, unknowns, 0, own))
        return sum(any(np.array_equal(start, one) for one in suggested) for start in starts)

    assert (tried(own=True), tried(own=False)) == (valleys.SOLVED, 0)
