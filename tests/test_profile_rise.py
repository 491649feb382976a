"""A made-up ridge with a rise across it: what lies behind belongs to the interval where the data object no more."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.estimation import profile as profile_side
from identify.estimation.profile import CRITICAL, _walks
from identify.estimation.profile_line import FREE

NEAR, FAR = 0.19, 0.75  # of a logarithm: the data begin to object, and no longer do
SIDE = 0.1  # standard error near the answer


class Line:
    """A logarithm that all others follow; `loss` is what the data lose at a distance from the answer."""

    def __init__(self, loss: Callable[[float], float]) -> None:
        open_ = np.full(1, np.inf)
        self.unknowns = SimpleNamespace(
            names=["t_cr"], logarithmic=[True], lower=-open_, upper=open_, walls=np.zeros((2, 1), bool)
        )
        self.best = self._made(0.0, FREE)
        self.seen: list[Any] = []
        self._loss = loss

    @staticmethod
    def _made(value: float, held: int) -> Any:
        return SimpleNamespace(theta=np.array([value]), held=held)

    def point(self, _near: Any, index: int, value: float) -> Any:
        self.seen.append(self._made(value, index))
        return self.seen[-1]

    def loss_root(self, point: Any) -> float:
        return float(np.sqrt(self._loss(float(point.theta[0]))))


def rise(off: float) -> float:
    """A parabola below the answer and up to a height of 5, which falls again."""
    parabola = (off / SIDE) ** 2
    return parabola if off < NEAR else max(2.0, 5.0 - 3.0 * (off - NEAR) / (FAR - NEAR))


def ends(line: Line) -> tuple[float | None, float | None]:
    walks = _walks(line, {0: SIDE}, {0: 1.0}, 1, lambda _stage, _share: None)  # type: ignore[arg-type]
    return walks[0, -1.0].side.end, walks[0, 1.0].side.end


def test_behind_a_rise_the_walk_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    low, high = ends(Line(rise))
    assert low == pytest.approx(-SIDE * np.sqrt(CRITICAL), rel=0.02)
    assert high is None  # as far as a profile asks
    monkeypatch.setattr(profile_side, "LONG", np.inf)  # nobody looks
    assert ends(Line(rise))[1] == pytest.approx(NEAR, abs=0.02)


def test_a_rise_that_goes_on_is_an_end_and_costs_few_looks() -> None:
    line = Line(lambda off: (off / SIDE) ** 2)
    low, high = ends(line)
    assert low == pytest.approx(-SIDE * np.sqrt(CRITICAL), rel=0.02)
    assert high == pytest.approx(SIDE * np.sqrt(CRITICAL), rel=0.02)
    assert sum(abs(point.theta[0]) > 2.5 * SIDE for point in line.seen) <= 4  # two on each side


def test_behind_a_high_rise_nothing_counts() -> None:
    def cliff(off: float) -> float:
        return 0.0 if off > 0.9 else 100.0 if off > 2.5 * SIDE else (off / SIDE) ** 2

    assert ends(Line(cliff))[1] == pytest.approx(SIDE * np.sqrt(CRITICAL), rel=0.02)


def ridge_without_end(off: float) -> float:
    """Nothing is objected to as far as a profile asks and farther; then a rise, and a lower place behind it."""
    return float(np.interp(off, [0.0, 1.5, 2.0, 3.0], [0.0, 0.5, 20.0, 0.0]))


def farthest(line: Line) -> float:
    _walks(line, {0: SIDE}, {0: 1.0}, 1, lambda _stage, _share: None)  # type: ignore[arg-type]
    return max(float(point.theta[0]) for point in line.seen if line.loss_root(point) ** 2 < 0.1)


class Stubborn(Line):
    """A line on which the solver fails from one point to another that is far away."""

    def point(self, near: Any, index: int, value: float) -> Any:
        return super().point(near, index, value) if abs(value - float(near.theta[index])) < 0.6 else None


@pytest.mark.parametrize("kind", [Line, Stubborn])
def test_past_an_open_end_the_walk_looks_behind_a_rise(kind: type[Line], monkeypatch: pytest.MonkeyPatch) -> None:
    assert farthest(kind(ridge_without_end)) > 3.0
    monkeypatch.setattr(profile_side, "RISEN", 1.0)  # the first objection ends it
    assert farthest(kind(ridge_without_end)) < 1.5


def test_where_the_solver_fails_past_an_open_end_the_walk_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Stubborn(ridge_without_end)
    monkeypatch.setattr(profile_side, "FAILURES", 1)
    assert farthest(line) < 1.5
