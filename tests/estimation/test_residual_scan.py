"""Windows of residuals that stand out of noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from identify.estimation.goodness_of_fit import residual_scan
from identify.logs.log_data import LogData
from identify.simulation.drive import NormalForce

NOISE, SAMPLES = 0.01, 20_000


def _log(residual):
    time = np.arange(residual.size) / 1000.0
    return LogData(
        time=time,
        force=2.0 + residual,
        weight=np.full(residual.size, NOISE**-2.0),
        normal_force=NormalForce.of(1.0),
        normal_force_sd=0.0,
        drive_speed=1e-3,
        begin=0.0,
        end=float(time[-1]),
        base=np.zeros(1),
    )


def _share(residual):
    return residual_scan([_log(residual)], [np.full(residual.size, 2.0)]).ratio


def test_white_noise_stands_out_nowhere():
    shares = [_share(NOISE * np.random.default_rng(i).standard_normal(SAMPLES)) for i in range(20)]
    assert max(shares) < 0.9


def test_a_slip_missed_by_two_standard_deviations_of_thirty_samples_shows_where_chi2_says_nothing():
    residual = NOISE * np.random.default_rng(1).standard_normal(SAMPLES)
    residual[7000:7030] -= 2.0 * NOISE
    assert abs(np.sum((residual / NOISE) ** 2) - SAMPLES) < 2.0 * np.sqrt(2.0 * SAMPLES)
    lean = residual_scan([_log(residual)], [np.full(SAMPLES, 2.0)])
    assert lean.ratio > 1.2
    assert lean.time == pytest.approx(7.0145, abs=0.01)
    assert lean.residual == pytest.approx(-2.0 * NOISE, rel=0.3)


def test_autocorrelated_noise_stands_out_nowhere():
    random = np.random.default_rng(2).standard_normal(SAMPLES)
    assert _share(NOISE * lfilter([np.sqrt(1 - 0.81)], [1.0, -0.9], random)) < 1.0


def test_what_is_not_fitted_does_not_count():
    residual = NOISE * np.random.default_rng(3).standard_normal(SAMPLES)
    residual[100:200] += 5.0
    curve = np.full(SAMPLES, 2.0)
    curve[100:200] = np.nan
    assert residual_scan([_log(residual)], [curve]).ratio < 0.9
    assert residual_scan([], []) is None
