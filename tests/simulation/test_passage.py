"""Where a tremor stands when a line that rises first reaches it, against lines that are followed one by one."""

import numpy as np
import pytest

from identify.logs.loads import first_passage

STEP, LATER = 5e-4, 0.06


def _tremor(seed, duration=120.0):
    random, times = np.random.default_rng(seed), np.arange(round(duration / STEP)) * STEP
    waves = [
        np.sin(2 * np.pi * f * times + p)
        for f, p in zip(random.uniform(8, 12, 4), random.uniform(0, 2 * np.pi, 4), strict=True)
    ]
    return sum(waves) / np.sqrt(2.0)


def _followed(tremor, rise, survived, seed):
    """Lines that start far below at random heights, each followed until it reaches the tremor."""
    random, starts = np.random.default_rng(seed), []
    line = rise * STEP * np.arange(tremor.size)
    lowest, highest = float(np.min(tremor - line)), float(tremor[0])
    soon, after = round(survived / STEP), round(LATER / STEP)
    for height in random.uniform(lowest, highest, 3000):
        reached = np.flatnonzero(tremor - line <= height)
        if soon:  # of those dips that last
            ahead = np.minimum(reached + soon, tremor.size - 1)
            lasting = (tremor - line)[ahead] < (tremor - line)[reached]
            reached = reached[lasting]
        if reached.size and reached[0] + after < tremor.size:
            starts.append(reached[0])
    return float(np.mean(tremor[starts])), float(np.mean(tremor[np.array(starts) + after]))


@pytest.mark.parametrize("rise", [10.0, 25.0, 60.0])
def test_the_means_are_those_of_lines_that_are_followed(rise):
    tremor = _tremor(2)
    onset, end = first_passage(tremor, STEP, rise, LATER)
    told = _followed(tremor, rise, 0.0, 5)
    assert (onset, end) == pytest.approx(told, abs=0.06)


def test_a_slow_line_meets_a_tremor_in_its_dips_and_a_fast_one_anywhere():
    tremor = _tremor(3)
    slow, fast = (first_passage(tremor, STEP, rise, LATER) for rise in (5.0, 3000.0))
    assert slow[0] < -0.6 and slow[1] > 0.5
    assert abs(fast[0]) < 0.1
