"""Rhythms of a normal force: the error of its course is as large as is said."""

import numpy as np
import pytest

from identify.logs.log_data import smooth

NOISE = 5e-3


def _lines(random, times):
    return sum(5e-3 * np.sin(2 * np.pi * f * times + random.uniform(0, 2 * np.pi)) for f in random.uniform(8, 12, 4))


def _band(random, times):
    """A tremor that fills a band about 10 Hz."""
    spectrum = np.fft.rfft(random.standard_normal(4 * times.size))
    frequency = np.fft.rfftfreq(4 * times.size, times[1] - times[0])
    wave = np.fft.irfft(spectrum * np.exp(-0.5 * (frequency - 10.0) ** 2))[times.size : 2 * times.size]
    return 7e-3 * wave / np.std(wave)


@pytest.mark.parametrize("tremor", [_lines, _band])
@pytest.mark.parametrize(("rate", "duration"), [(100.0, 10.0), (500.0, 20.0)])
def test_the_course_of_a_trembling_load_is_as_sure_as_is_said(rate, duration, tremor):
    times, off = np.arange(int(rate * duration)) / rate, []
    for seed in range(8):
        random = np.random.default_rng(seed)
        true = tremor(random, times)
        course = smooth(times, 1.5 + true + NOISE * random.standard_normal(times.size))
        off.append((course.force.at(times) - 1.5 - true)[times.size // 8 : -times.size // 8] / course.sd)
    assert 0.6 < float(np.sqrt(np.mean(np.square(off)))) < 1.4
