"""What the track deals: levels with the correlation of an Ornstein-Uhlenbeck field, strengths that are normal draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from identify.model.model import assemble

NAMES = ("inertia", "contact_ageing", "friction_heterogeneity")
MODEL = assemble(NAMES)
STATES = [s.name for s in MODEL.states]
LENGTH = 2e-3


def _grip(track: np.ndarray, stick: np.ndarray, seeds: np.ndarray, **given: float) -> np.ndarray:
    """Grip per newton of contacts with gamma = 1 (n,): mu_k0 + (mu_s - mu_k0) strength + level."""
    n = track.size
    values = {"mu_s": 1.0, "mu_k0": 0.0, "field_sd": 0.0, "strength_sd": 0.0, "loading_sd": 0.0, "field_length": LENGTH}
    p = np.array([np.full(n, (values | given).get(q.name, q.default)) for q in MODEL.parameters])
    p[MODEL.parameter_names.index("field_seed")] = seeds
    x = np.zeros((len(STATES), n))
    x[STATES.index("gamma")], x[STATES.index("track")], x[STATES.index("stick_number")] = 1.0, track, stick
    return np.array(MODEL.grip(x, p, np.tile([[1e-3], [1.0], [1.0], [0.0]], n))).ravel()


def _levels(distance: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Levels of many tracks at one place and a distance further on."""
    random = np.random.default_rng(0)
    place, seeds = random.uniform(0, 20 * LENGTH, count), np.arange(float(count))
    both = [_grip(at, np.zeros(count), seeds, field_sd=0.1) - 1.0 for at in (place, place + distance)]
    return both[0], both[1]


def test_level_has_its_standard_deviation_and_is_normal():
    level, _ = _levels(0.0, 4000)
    assert np.std(level) == pytest.approx(0.1, rel=4 / np.sqrt(2 * 4000))
    assert abs(np.mean(level)) < 4 * 0.1 / np.sqrt(4000)
    assert stats.kstest(level / 0.1, "norm").pvalue > 1e-3


@pytest.mark.parametrize("lengths", [0.05, 0.2, 0.5, 1.0, 2.0, 4.0])
def test_level_is_correlated_as_an_ornstein_uhlenbeck_field(lengths):
    near, far = _levels(lengths * LENGTH, 4000)
    found, expected = np.corrcoef(near, far)[0, 1], np.exp(-lengths)
    assert found == pytest.approx(expected, abs=4 * (1 - expected**2) / np.sqrt(4000) + 0.01)
    assert found != pytest.approx(np.exp(-0.5 * lengths**2), abs=0.04) or lengths > 1.5  # control: no Gaussian kernel


def test_strengths_are_independent_normal_draws():
    sticks, seeds = np.meshgrid(np.arange(1000.0), np.arange(10.0))
    grip = _grip(np.zeros(sticks.size), sticks.ravel(), seeds.ravel(), strength_sd=0.2)
    draws = (np.log(grip) / 0.2).reshape(sticks.shape)
    assert stats.kstest(draws.ravel(), "norm").pvalue > 1e-3
    limit = 4 / np.sqrt(draws.size)
    for lag in (1, 2, 5):
        assert abs(np.mean(draws[:, lag:] * draws[:, :-lag])) < limit
    assert abs(np.mean(draws[1:] * draws[:-1])) < limit, "tracks are unlike each other"
