"""What noise with a memory makes of a likelihood ratio, against noise that is drawn."""

import numpy as np
import pytest
from scipy.signal import lfilter

from identify.estimation.residual_autocorrelation import Colour, CurveChange, NoiseAutocorrelation

SD, CORRELATION, SAMPLES = 0.02, 0.8, 4000
WHITE = Colour(np.empty(0), 1.0)
SLOW = Colour(np.array([CORRELATION]), 1.0 - CORRELATION**2)


def remembering(*colours: Colour, levels: tuple[float, ...] | None = None) -> NoiseAutocorrelation:
    weights = tuple(np.full(SAMPLES, SD**-2) for _ in colours)
    return NoiseAutocorrelation(weights, colours, levels or (1.0,) * len(colours))


def bump(width: float, size: float = 0.01) -> np.ndarray:
    """A change of the curve that lasts so many samples [N]."""
    return size * np.exp(-0.5 * ((np.arange(SAMPLES) - SAMPLES / 2) / width) ** 2)


def drawn(random: np.random.Generator, count: int) -> np.ndarray:
    new = SD * np.sqrt(1.0 - CORRELATION**2) * random.standard_normal((count, SAMPLES + 200))
    return lfilter([1.0], [1.0, -CORRELATION], new)[:, 200:]


def test_white_noise_has_no_memory():
    noise = remembering(WHITE, WHITE)
    change = noise.change([np.zeros(SAMPLES)] * 2, [bump(5.0)] * 2)
    assert noise.white and change.memory(7.0) == 1.0 and change.objection(7.0) == 7.0


@pytest.mark.parametrize("width", [0.4, 3.0, 60.0])
def test_the_memory_along_a_change_is_the_variance_of_drawn_noise_along_it(width):
    there = bump(width)
    change = remembering(SLOW).change([np.zeros(SAMPLES)], [there])
    along = drawn(np.random.default_rng(1), 4000) @ there / np.linalg.norm(there) / SD
    assert change.memory(0.0) == pytest.approx(np.var(along), rel=0.1)
    assert change.moved == pytest.approx(np.sum((there / SD) ** 2))


def test_slow_changes_see_the_whole_memory_and_quick_ones_none():
    quick = 0.01 * np.cos(np.pi * np.arange(SAMPLES))
    noise = remembering(SLOW)
    slow = noise.change([np.zeros(SAMPLES)], [bump(200.0)])
    assert slow.memory(0.0) == pytest.approx((1 + CORRELATION) / (1 - CORRELATION), rel=0.02)
    fast = noise.change([np.zeros(SAMPLES)], [quick])
    assert fast.memory(0.0) == pytest.approx((1 - CORRELATION) / (1 + CORRELATION), rel=0.02)


def test_the_truth_is_objected_to_as_often_as_the_level_says():
    # a model with one parameter, times which a bump is added; least squares loses chi-square of it at the truth
    there, losses, objections = bump(20.0), [], []
    noise = remembering(SLOW)
    for residual in drawn(np.random.default_rng(2), 2000):
        best = (residual @ there) / (there @ there)
        loss = np.sum(residual**2 - (residual - best * there) ** 2) / SD**2
        losses.append(loss)
        objections.append(noise.change([best * there], [np.zeros(SAMPLES)]).objection(loss))
    assert np.mean(np.array(objections) < 3.841) == pytest.approx(0.95, abs=0.015)
    assert np.mean(np.array(losses) < 3.841) < 0.6, "as white noise it is taken for wrong"


def test_logs_count_by_their_own_noise_level_and_weight():
    there, nothing = bump(200.0), np.zeros(SAMPLES)
    noise = remembering(WHITE, SLOW, levels=(2.0, 1.0))
    of_white = noise.change([nothing, nothing], [there, nothing])
    of_slow = noise.change([nothing, nothing], [nothing, there])
    both = noise.change([nothing, nothing], [there, there])
    assert of_white.memory(0.0) == pytest.approx(2.0)
    assert both.remembered == pytest.approx(of_white.remembered + of_slow.remembered)
    masked = NoiseAutocorrelation((np.zeros(SAMPLES),), (SLOW,), (1.0,)).change([nothing], [there])
    assert masked.moved == 0.0 and masked.objection(3.0) == 3.0
    assert noise.change([nothing * np.nan] * 2, [there] * 2).moved == 0.0


def test_what_priors_lose_remembers_nothing():
    change = CurveChange(moved=4.0, remembered=36.0)
    assert change.memory(4.0) == 9.0
    assert change.memory(40.0) == pytest.approx(1.8), "a tenth is of the data"
