"""A misfit whose residuals hum with the mains says so; other lines, and noise, are not called hum."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.diagnosis.second_look import hum


def left(frequency: float, height: float, rate: float = 1000.0) -> Any:
    """An attempt that leaves a swing [Hz, N] in noise of 2 mN of a log."""
    time = np.arange(4000) / rate
    curve = 0.4 + 0.1 * ((3.0 * time) % 1.0)
    swing = height * np.sin(2.0 * np.pi * frequency * time)
    force = curve + swing + 2e-3 * np.random.default_rng(1).standard_normal(time.size)
    fitted = np.where(time < 3.5, curve, np.nan)
    log = SimpleNamespace(time=time, force=force, weight=np.ones(time.size))
    solved = SimpleNamespace(problem=SimpleNamespace(logs=[log]), fitted=[fitted])
    return SimpleNamespace(solved=solved, fitted_logs=[SimpleNamespace(name="log.csv")])


@pytest.mark.parametrize(
    ("frequency", "height", "said"), [(50.0, 8e-3, "50"), (60.1, 2e-3, "60"), (100.0, 2e-3, "100")]
)
def test_hum_of_the_mains_is_named_with_its_size(frequency: float, height: float, said: str) -> None:
    words = hum(left(frequency, height))
    assert f"what is left of log.csv swings {said} times a second by" in words
    told = float(words.split(" mN")[0].split()[-1])
    assert told == pytest.approx(1e3 * height, rel=0.15)


@pytest.mark.parametrize(("frequency", "height"), [(50.0, 0.0), (43.0, 8e-3), (7.0, 8e-3), (55.0, 3e-3)])
def test_other_lines_and_noise_are_no_hum(frequency: float, height: float) -> None:
    assert hum(left(frequency, height)) == ""
    assert hum(None) == ""
