"""Residuals of neighbouring samples that lean to one side."""

import numpy as np
import pytest

from identify.estimation.goodness_of_fit import most_leaning
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
    lean = most_leaning([_log(residual)], [np.full(residual.size, 2.0)])
    return lean.share


def _chi2_deviations(residual):
    return (np.sum((residual / NOISE) ** 2) - residual.size) / np.sqrt(2.0 * residual.size)


def test_white_noise_does_not_lean():
    shares = [_share(NOISE * np.random.default_rng(i).standard_normal(SAMPLES)) for i in range(20)]
    assert max(shares) < 0.9


def test_a_slip_missed_by_two_standard_deviations_of_thirty_samples_shows_where_chi2_says_nothing():
    residual = NOISE * np.random.default_rng(1).standard_normal(SAMPLES)
    residual[7000:7030] -= 2.0 * NOISE
    assert abs(_chi2_deviations(residual)) < 2.0
    lean = most_leaning([_log(residual)], [np.full(SAMPLES, 2.0)])
    assert lean.share > 1.2
    assert lean.time == pytest.approx(7.0145, abs=0.01)
    assert lean.residual == pytest.approx(-2.0 * NOISE, rel=0.3)


def test_noise_with_a_memory_does_not_lean_but_would_if_it_passed_for_white(monkeypatch):
    random = np.random.default_rng(2).standard_normal(SAMPLES)
    residual = np.empty(SAMPLES)
    residual[0] = random[0]
    for i in range(1, SAMPLES):
        residual[i] = 0.9 * residual[i - 1] + np.sqrt(1 - 0.81) * random[i]
    assert _share(NOISE * residual) < 1.0
    monkeypatch.setattr("identify.estimation.goodness_of_fit.QUARTILE", np.inf)
    assert _share(NOISE * residual) > 1.5


def test_what_is_not_fitted_does_not_count():
    residual = NOISE * np.random.default_rng(3).standard_normal(SAMPLES)
    residual[100:200] += 5.0
    curve = np.full(SAMPLES, 2.0)
    curve[100:200] = np.nan
    assert most_leaning([_log(residual)], [curve]).share < 0.9
    assert most_leaning([], []) is None


def test_the_window_is_that_of_running_totals_over_every_start(monkeypatch):
    """Widths up to OVERLAP are looked at from every sample: the lean that stands out most is found exactly."""
    residual = NOISE * np.random.default_rng(5).standard_normal(3001)
    monkeypatch.setattr("identify.estimation.goodness_of_fit.LONGEST", 8)
    monkeypatch.setattr("identify.estimation.goodness_of_fit.QUARTILE", np.inf)  # the noise is white, and known
    lean = most_leaning([_log(residual)], [np.full(residual.size, 2.0)])
    total = np.concatenate([[0.0], np.cumsum(residual / NOISE)])
    widths = {w: int(np.argmax(np.abs(total[w:] - total[:-w]))) for w in (2, 4, 8)}
    highest = {w: abs(float(total[i + w] - total[i])) / np.sqrt(w) for w, i in widths.items()}
    width = max(highest, key=lambda w: highest[w])
    assert lean.deviations == pytest.approx(highest[width], rel=1e-9)
    assert lean.time == pytest.approx((widths[width] + 0.5 * (width - 1)) / 1000.0, rel=1e-9)


def test_weights_may_differ_from_sample_to_sample():
    residual = NOISE * np.random.default_rng(1).standard_normal(SAMPLES)
    residual[7000:7030] -= 2.0 * NOISE
    logs = [_log(residual), _log(residual)]
    logs[1].weight[0] *= 1.0 + 1e-9
    even, uneven = (most_leaning([log], [np.full(SAMPLES, 2.0)]).deviations for log in logs)
    assert uneven == pytest.approx(even, rel=1e-8)
    logs[1].weight[7000:7030] /= 100.0
    assert most_leaning([logs[1]], [np.full(SAMPLES, 2.0)]).deviations < 0.7 * even
