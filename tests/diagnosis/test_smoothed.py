"""A log that was averaged before it came is refused by name, even where a wrong rig hides it; noise with memory not."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, filtfilt, lfilter, savgol_filter

from identify.diagnosis.quantities import smoothed
from tests.logs.test_segment import PAIR
from tests.support import oracle

NOISE, RATE = 2e-3, 1000.0


def logged(made):
    """A log and its curve: the true force; its noise was `made` of white noise, at its own level."""
    run = oracle.simulate(PAIR, 1e-3, 1.0, 5.0)
    time, force = oracle.noisy_log(run, 5.0, RATE, 0.0, seed=0)
    noise = made(np.random.default_rng(3).standard_normal(time.size))
    noise *= NOISE / np.std(noise)
    data = SimpleNamespace(force=force + noise, weight=np.full(time.size, NOISE**-2))
    log = SimpleNamespace(name="a.csv", data=data)
    return [log], [force]


TREATMENTS = {
    **{f"average of {n}": lambda f, n=n: np.convolve(f, np.ones(n) / n, "same") for n in (3, 4, 5, 8, 11)},
    "Butterworth": lambda f: filtfilt(*butter(4, 0.1), f),
    "Savitzky-Golay": lambda f: savgol_filter(f, 15, 2),
    "resampled finer": lambda f: np.interp(np.arange(f.size) / 1.7, np.arange(f.size), f),
}


@pytest.mark.parametrize("kind", TREATMENTS)
def test_a_smoothed_force_is_recognised_by_its_noise(kind):
    told = smoothed(*logged(TREATMENTS[kind]))
    assert "smoothed or resampled" in told
    if kind.startswith("average"):
        width = int(kind.split()[-1])
        assert abs(int(re.search(r"over (\d+) samples", told)[1]) / width - 1.0) < 0.35


@pytest.mark.parametrize("memory", [0.0, 0.3, 0.6, 0.8, 0.95])
def test_noise_with_a_memory_is_no_average(memory):
    assert smoothed(*logged(lambda white: lfilter([1.0], [1.0, -memory], white))) == ""


def test_an_average_that_the_curve_does_not_show_is_no_matter():
    (log,), (curve,) = logged(lambda white: np.convolve(white, np.ones(5) / 5, "same"))
    level = SimpleNamespace(force=log.data.force - curve, weight=log.data.weight)
    assert smoothed([SimpleNamespace(name="a.csv", data=level)], [np.zeros(curve.size)]) == ""
