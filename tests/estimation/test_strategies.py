"""The table of strategies, its trace, and the time limit of a fit."""

from __future__ import annotations

import time

import pytest

from identify import Scene, fit
from identify.base import budget
from identify.base.budget import no_time_limit, seconds_left, time_is_up, time_limit
from identify.base.result import Status
from identify.estimation.estimator import in_time, tracing, tried
from identify.examples import FOLDER

pytestmark = pytest.mark.usefixtures("no_predictions")


def test_limits_nest_and_are_lifted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "time", time)
    assert seconds_left() == float("inf") and not time_is_up()
    with time_limit(100.0):
        with time_limit(1000.0):
            assert 99.0 < seconds_left() <= 100.0
        with time_limit(0.0):
            assert time_is_up() and seconds_left() == 0.0
            with no_time_limit():
                assert not time_is_up()
        assert not time_is_up()


def test_what_is_due_when_the_time_is_up_is_noted_and_not_tried() -> None:
    with tracing() as trace, time_limit(0.0):
        assert tried("joined", lambda: pytest.fail("it was tried")) is None
        assert not in_time("joined")
    assert trace.not_tried == ["joined"] and trace.trials == []


@pytest.mark.parametrize("limit", [0.02, 0.3])
def test_a_fit_whose_time_is_up_ends_with_what_it_has(limit: float) -> None:
    scene = Scene.from_toml(FOLDER / "pair.toml", [f"fit.time_limit={limit}"])
    found = fit(scene)
    result = found.result
    spent = sum(trial["seconds"] for trial in result["search"])
    assert spent < 1.1 * limit + 1.0, "one pass may be under way"
    if found.status is not Status.CONVERGED:
        assert (
            f"the time limit of {limit:g} s left no time for" in result["message"]
            and "--time-limit" in result["message"]
        )
        assert result["not_tried"] and all(p["value"] is None for p in result["parameters"].values())
