"""Fewer of many values: as many as a median needs, and none of what alternates is lost."""

import numpy as np
import pytest

from data_io.arrays import ENOUGH, kept, shown, thinned, thinned_steps


@pytest.mark.parametrize("size", [0, 1, ENOUGH, 2 * ENOUGH - 1])
def test_few_values_stay_as_they_are(size):
    values = np.arange(size, dtype=float)
    assert thinned(values) is values


@pytest.mark.parametrize("factor", [2.0, 2.9, 4.0, 30.0, 31.3])
def test_many_become_enough(factor):
    size = int(factor * ENOUGH)
    left = thinned(np.arange(size, dtype=float))
    assert ENOUGH <= left.size <= 3 * ENOUGH
    assert left.size < 2 * ENOUGH or factor < 3.0
    assert np.ptp(np.diff(left)) == 0.0 and np.diff(left)[0] % 2 == 1


def test_a_median_of_enough_is_that_of_all_within_its_error():
    values = np.random.default_rng(1).standard_normal(1_000_000)
    error = np.sqrt(np.pi / 2 / ENOUGH)
    assert abs(np.median(thinned(values)) - np.median(values)) < 3 * error


def test_what_alternates_is_seen_both_ways():
    values = np.tile([0.0, 1.0], 20 * ENOUGH)
    assert np.mean(thinned(values)) == pytest.approx(0.5, abs=1e-4)
    assert np.mean(values[::40]) == 0.0, "an even stride would see one kind only"


@pytest.mark.parametrize("size", [2, 1000, 30 * ENOUGH + 7])
def test_steps_are_those_that_would_be_chosen_from_all(size):
    values = np.random.default_rng(2).standard_normal(size)
    np.testing.assert_array_equal(thinned_steps(values), thinned(np.diff(values)))


def test_what_is_whole_is_not_copied():
    values = np.arange(5.0)
    assert kept(values, values >= 0) is values
    np.testing.assert_array_equal(kept(values, values > 2), [3.0, 4.0])
    assert shown(values, values >= 0) is values
    np.testing.assert_array_equal(shown(values, values > 2), [np.nan, np.nan, np.nan, 3.0, 4.0])
