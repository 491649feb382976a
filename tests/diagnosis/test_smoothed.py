"""A log that was averaged before it came is refused by name, even where a wrong rig hides it; noise with memory not."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from identify.diagnosis.quantities import smoothed
from tests.logs.test_segment import PAIR
from tests.support import oracle

NOISE, RATE = 2e-3, 1000.0


def attempt_of(made):
    """An attempt whose curve is the true force and whose noise was `made` of white noise, at its own level."""
    run = oracle.simulate(PAIR, 1e-3, 1.0, 5.0)
    time, force = oracle.noisy_log(run, 5.0, RATE, 0.0, seed=0)
    noise = made(np.random.default_rng(3).standard_normal(time.size))
    noise *= NOISE / np.std(noise)
    data = SimpleNamespace(force=force + noise, weight=np.full(time.size, NOISE**-2))
    log = SimpleNamespace(name="a.csv", data=data)
    return SimpleNamespace(fitted_logs=(log,), solved=SimpleNamespace(fitted=[force]))


@pytest.mark.parametrize("width", [3, 4, 5, 8, 11])
def test_the_width_of_an_average_is_in_its_noise(width):
    told = smoothed(attempt_of(lambda white: np.convolve(white, np.ones(width) / width, "same")))
    assert told is not None and f"over {width} samples" in told


@pytest.mark.parametrize("memory", [0.0, 0.3, 0.6, 0.8, 0.95])
def test_noise_with_a_memory_is_no_average(memory):
    assert smoothed(attempt_of(lambda white: lfilter([1.0], [1.0, -memory], white))) is None


def test_an_average_that_the_curve_does_not_show_is_no_matter():
    found = attempt_of(lambda white: np.convolve(white, np.ones(5) / 5, "same"))
    data = found.fitted_logs[0].data
    level = SimpleNamespace(force=data.force - found.solved.fitted[0], weight=data.weight)
    flat = SimpleNamespace(
        fitted_logs=(SimpleNamespace(name="a.csv", data=level),),
        solved=SimpleNamespace(fitted=[np.zeros(level.force.size)]),
    )
    assert smoothed(flat) is None
