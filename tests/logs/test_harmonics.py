"""Rhythms as harmonics: what samples say of them against a dense solution, and near the ends of a record."""

import numpy as np
import pytest

from identify.logs.log_data import harmonics, smooth

NOISE = 5e-3


def test_amplitudes_and_variances_are_those_of_a_dense_solution():
    n, step, noise = 61, 0.02, NOISE**2
    random = np.random.default_rng(1)
    values = 0.02 * np.sin(np.arange(n) * 1.1) + NOISE * random.standard_normal(n)
    share = np.zeros(n)
    share[[3, 20, 21, 22, 41]] = 0.5, 0.9, 0.99, 0.8, 0.3
    made = harmonics(values, step, share, noise)
    line = np.flatnonzero(share)
    phase = np.pi * np.outer(np.arange(n) + 0.5, line) / n
    waves = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
    prior = np.tile(noise * share[line] / (1.0 - share[line]) / n, 2)
    covariance = np.linalg.inv(waves.T @ waves / noise + np.diag(1.0 / prior))
    amplitudes = covariance @ waves.T @ values / noise
    np.testing.assert_allclose(np.append(made.cosine, made.sine), amplitudes, rtol=1e-9, atol=1e-15)
    times = np.array([0.0, 0.013, 0.5, 1.2])
    at = np.pi * np.outer(times / step + 0.5, line) / n
    seen = np.concatenate([np.cos(at), np.sin(at)], axis=1)
    np.testing.assert_allclose(made.variance(times), np.sum(seen @ covariance * seen, axis=1), rtol=1e-9)
    fast = seen * np.tile(line >= 21, 2)
    np.testing.assert_allclose(made.variance(times, 21), np.sum(fast @ covariance * fast, axis=1), rtol=1e-9)
    places, wave = made.course(3)
    finer = np.pi * np.outer(places / step + 0.5, line) / n
    np.testing.assert_allclose(
        wave, np.concatenate([np.cos(finer), np.sin(finer)], axis=1) @ amplitudes, rtol=1e-9, atol=1e-14
    )


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
def test_the_course_of_a_trembling_load_is_as_sure_at_its_ends_as_is_said(rate, duration, tremor):
    times = np.arange(int(rate * duration)) / rate
    places = np.unique(
        np.round(rate * np.array([0.0, 0.05, 0.2, 0.5, duration - 0.3, duration - 0.1, duration - 0.03]))
    )
    places = places.astype(int)
    ends, middle = [], []
    for seed in range(16):
        random = np.random.default_rng(seed)
        true = tremor(random, times)
        seen = 1.5 + true + NOISE * random.standard_normal(times.size)
        course = smooth(times, seen)
        off = course.force.at(times) - 1.5 - true
        assert course.sd_over_time is not None
        ends.append(off[places] / course.sd_over_time.at(times[places]))
        inner = slice(times.size // 3, 2 * times.size // 3, 17)
        middle.append(off[inner] / course.sd_over_time.at(times[inner]))
    root = [float(np.sqrt(np.mean(np.square(z)))) for z in (ends, middle)]
    assert 0.6 < root[0] < 1.4 and 0.6 < root[1] < 1.4
