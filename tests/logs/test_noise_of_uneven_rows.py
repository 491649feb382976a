"""The noise of a force whose rows follow each other unevenly is that of even rows: lines run over true distances."""

from pathlib import Path

import numpy as np
import pytest

from data_io import read_log
from identify.logs.noise import uneven, white_noise
from identify.logs.segment import segment

CASES = Path(__file__).parents[1] / "cases"
NOISE = 2e-3


def thinned(time, draw):
    return np.sort(draw.choice(time, time.size // 2, replace=False))


def jittering(time, draw):
    return time + draw.uniform(-0.4, 0.4, time.size) * time[1]


def two_rates(time, _draw):
    return np.concatenate([time[: time.size // 2 : 3], time[time.size // 2 :]])


def saw(time):
    """Sticks of 0.36 s that load by 1 N/s, slips of 20 ms [N]."""
    phase = (time % 0.36) / 0.36
    return 0.3 + 0.36 * np.minimum(phase, (1.0 - phase) * 17.0)


@pytest.mark.parametrize("rows", [thinned, jittering, two_rates])
@pytest.mark.parametrize("rate", [300.0, 1000.0])
def test_the_noise_of_uneven_rows(rows, rate):
    draw = np.random.default_rng(3)
    time = rows(np.arange(int(12 * rate)) / rate, draw)
    force = saw(time) + NOISE * draw.standard_normal(time.size)
    assert segment(time, force).noise == pytest.approx(NOISE, rel=0.06)


def test_by_number_of_rows_a_ramp_is_noise():
    """The negative control: told nothing of the distances, the noise of thinned rows is too large."""
    draw = np.random.default_rng(3)
    time = thinned(np.arange(12_000) / 1000.0, draw)
    force = saw(time) + 1e-4 * draw.standard_normal(time.size)
    assert white_noise(force) > 3e-4 and white_noise(force, time) == pytest.approx(1e-4, rel=0.1)
    assert uneven(time) and not uneven(np.arange(500) / 7.0)
    few_lost = np.delete(np.arange(500.0), [100, 200, 300])
    assert not uneven(few_lost), "a few rows lost are gaps, for which blocks are left out"


@pytest.mark.parametrize("name", ["v1_thin.csv.gz", "v03_thin.csv.gz"])
def test_the_thinned_pair(name):
    record = read_log(CASES / name)
    assert segment(record.time, record.friction_force).noise == pytest.approx(NOISE, rel=0.03)
