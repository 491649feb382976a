"""Segmentation against the true events of an independent integrator, and on records that hold traps."""

import time as clock
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import find_peaks

from experiments.study_problem import DEMO, NOISE, RIG
from experiments.study_problem import SPEEDS as LOGS
from identify.logs.noise import spikes, uneven, white_noise
from identify.logs.segment import SLIDING, SLIP, STICK, _turning_points, segment
from tests.support import oracle

PAIR = DEMO | RIG
HALF_PERIOD = float(np.pi * np.sqrt(PAIR["mass"] / PAIR["stiffness"]))


def drawn_pair(rng):
    """The first row of ranges of the random study."""
    while True:
        mu_s = rng.uniform(0.4, 0.8)
        mu_k0, delta = mu_s - rng.uniform(0.1, 0.25), rng.uniform(-0.15, -0.02)
        a, length, creep = (float(np.exp(rng.uniform(*np.log(r)))) for r in ((100, 1000), (15e-6, 60e-6), (0.1, 2)))
        if mu_k0 + delta > 0.05 and mu_s <= 3 * mu_k0:
            return PAIR | {"mu_s": mu_s, "mu_k0": mu_k0, "delta_mu_k": delta, "a": a, "D": length, "t_cr": creep}


def misses_and_extras(run, found, end):
    """Slips of the run that no cycle covers, cycles that cover no slip (or one twice); a slip in whose wake the
    record ends may be either."""
    slips = list(zip(run.onsets, run.arrests, strict=False))
    hits = [[i for i, (on, off) in enumerate(slips) if on < b and off > a] for a, b in _spans(found)]
    extras = sum(not hit for hit in hits) + len(hits) - len({tuple(h) for h in hits if h}) - hits.count([])
    seen = {i for hit in hits for i in hit}
    missed = [i for i in range(len(slips)) if i not in seen]
    if missed and missed[-1] == len(slips) - 1:
        on, off = slips[-1]
        missed = missed[:-1] if end - off < 0.5 * (off - on) + 0.1 * np.median(np.diff(run.onsets)) else missed
    return len(missed), extras


def _spans(found):
    return zip(found.cycles.onset, found.cycles.arrest, strict=True)


@pytest.fixture(scope="module")
def fast():
    run = oracle.simulate(PAIR, 1e-3, 1.0, 6.0)
    return run, *oracle.noisy_log(run, 6.0, 1000, NOISE, seed=4)


@pytest.fixture(scope="module")
def drawn():
    rng = np.random.default_rng(11)
    pairs = [drawn_pair(rng) for _ in range(2)]
    return [(oracle.simulate(pair, log[0], 1.0, log[1]), *log) for pair in pairs for log in LOGS]


@pytest.mark.parametrize("half_period", [HALF_PERIOD, None])
def test_no_event_is_missed_and_none_invented_in_random_pairs(drawn, half_period):
    for run, speed, duration, rate in drawn:
        found = segment(*oracle.noisy_log(run, duration, rate, NOISE, seed=1), half_period=half_period)
        assert misses_and_extras(run, found, duration) == (0, 0), (run.law, speed)
        assert found.noise == pytest.approx(NOISE, rel=0.1)


def test_forces_and_times_of_slow_slips():
    run = oracle.simulate(PAIR, 1e-4, 1.0, 20.0)
    found = segment(*oracle.noisy_log(run, 20.0, 500, NOISE, seed=2), half_period=HALF_PERIOD).cycles
    n = found.count
    assert n == run.arrests.size
    damper = PAIR["damping"] * np.sqrt(PAIR["mass"] / PAIR["stiffness"]) * 1e-4
    onset_force = PAIR["stiffness"] * run.onset_states[:n, 0] + damper
    arrest_force = PAIR["stiffness"] * run.arrest_states[:n, 0] + damper
    np.testing.assert_allclose(found.onset_force, onset_force, atol=0.012)
    np.testing.assert_allclose(found.arrest_force, arrest_force, atol=0.012)
    assert np.all((found.fall > run.onsets[:n]) & (found.fall < run.arrests[:n]))


def test_fall_is_timed_to_a_fraction_of_a_sample(fast):
    run, t, f = fast
    found = segment(t, f, half_period=HALF_PERIOD).cycles
    fine = np.arange(0.0, 6.0, 1e-5)
    exact = run.force(fine)
    for fall, high, low in zip(found.fall, found.onset_force, found.arrest_force, strict=True):
        near = np.abs(fine - fall) < 0.02
        crossing = fine[near][np.argmax(exact[near] < 0.5 * (high + low))]
        assert abs(fall - crossing) < 0.7e-3


def test_stick_slope_is_stiffness_times_speed(fast):
    _, t, f = fast
    found = segment(t, f, half_period=HALF_PERIOD)
    assert found.stick_slope[0] == pytest.approx(1.47, rel=0.02)
    assert found.loading_slope == pytest.approx(1.47, rel=0.02)
    assert found.stick_slope[1] < 0.05


@pytest.mark.parametrize("seconds_after_onset", [0.004, 0.025])
def test_record_that_begins_in_a_slip(fast, seconds_after_onset):
    run, t, f = fast
    start = int((run.onsets[2] + seconds_after_onset) * 1000)
    found = segment(t[start:] - t[start], f[start:], half_period=HALF_PERIOD)
    assert found.begins_in_slip
    assert found.count == run.arrests.size - 3
    assert found.phase[0] == SLIP


def test_last_fall_without_a_rise_does_not_count(fast):
    run, t, f = fast
    stop = int(1000 * (run.onsets[8] + 0.03))
    assert segment(t[:stop], f[:stop], half_period=HALF_PERIOD).count == 8
    stop = int(1000 * (run.arrests[8] + 0.1))
    assert segment(t[:stop], f[:stop], half_period=HALF_PERIOD).count == 9


@pytest.mark.parametrize("weakening", [0.0, 0.05])
def test_loading_then_steady_sliding_has_no_cycle(weakening):
    run = oracle.simulate(PAIR | {"delta_mu_k": weakening}, 2e-2, 1.0, 1.0)
    found = segment(*oracle.noisy_log(run, 1.0, 2000, NOISE, seed=3), half_period=HALF_PERIOD)
    assert run.arrests.size == 0
    assert found.count == 0
    assert found.ends_sliding
    assert found.phase[0] == STICK
    assert found.share(SLIDING) > 0.9
    assert found.drop_mean_and_sd is None
    assert found.period_mean_and_sd is None


def test_noise_alone_a_ramp_and_a_constant():
    t = np.arange(200_000) / 1000
    noise = NOISE * np.random.default_rng(0).standard_normal(t.size)
    for half_period in (None, HALF_PERIOD):
        steady = segment(t, 0.5 + noise, half_period=half_period)
        assert (steady.count, steady.share(SLIDING)) == (0, 1.0)
        ramp = segment(t, 1e-3 * t + noise, half_period=half_period)
        assert (ramp.count, ramp.share(STICK)) == (0, 1.0)
        assert ramp.loading_slope == pytest.approx(1e-3, rel=0.01)
    assert segment(t, np.full(t.size, 0.5)).count == 0


def test_rest_before_the_drive_hold_after_it_drift_and_programme(fast):
    run, _, f = fast
    rng = np.random.default_rng(5)
    still = np.concatenate([NOISE * rng.standard_normal(1500), f])
    found = segment(np.arange(still.size) / 1000, still, half_period=HALF_PERIOD)
    assert found.count == run.arrests.size
    stop = int(1000 * run.arrests[6]) + 60
    held = np.concatenate([f[:stop], f[stop] + NOISE * rng.standard_normal(3000)])
    found = segment(np.arange(held.size) / 1000, held, half_period=HALF_PERIOD)
    assert found.count == 7
    assert found.phase[-1] == SLIDING
    t = np.arange(f.size) / 1000
    found = segment(t, f * (0.8 + 0.2 * np.exp(-t / 2)) + 0.05 * t, half_period=HALF_PERIOD)
    assert found.count == run.arrests.size
    stepwise = oracle.simulate(PAIR, ((0, 1e-3), (2, 1e-4), (10, 1e-3)), 1.0, 12.0)
    found = segment(*oracle.noisy_log(stepwise, 12.0, 1000, NOISE, seed=6), half_period=HALF_PERIOD)
    assert misses_and_extras(stepwise, found, 12.0) == (0, 0)


def test_isolated_spikes_are_masked_and_make_no_events(fast):
    run, t, f = fast
    rng = np.random.default_rng(7)
    spiky, hit = f.copy(), np.zeros(f.size, bool)
    for start in range(40, f.size - 40, 90):
        length = int(rng.integers(1, 4))
        hit[start : start + length] = True
        spiky[start : start + length] += rng.choice([-1, 1]) * rng.uniform(12, 60) * NOISE
    found = segment(t, spiky, half_period=HALF_PERIOD)
    assert found.count == run.arrests.size
    assert np.mean(found.spikes[hit]) > 0.9
    assert np.mean(found.spikes[~hit]) < 0.002
    assert found.noise == pytest.approx(NOISE, rel=0.1)


@pytest.mark.parametrize(("speed", "duration", "rate"), [LOGS[0], (5e-3, 1.5, 200.0), (5e-3, 1.5, 500.0)])
def test_sharp_corners_and_coarse_crests_are_no_spikes(speed, duration, rate):
    run = oracle.simulate(PAIR, speed, 1.0, duration)
    _, f = oracle.noisy_log(run, duration, rate, 1e-4, seed=8)
    assert not spikes(f, 1e-4).any()


def test_quantised_force(fast):
    run, t, f = fast
    step = 0.004
    coarse = np.round((f - f.min()) / step) * step
    found = segment(t, coarse, half_period=HALF_PERIOD)
    assert found.count == run.arrests.size
    assert found.noise == pytest.approx(np.hypot(NOISE, step / np.sqrt(12)), rel=0.1)
    assert not found.spikes.any()
    clean = np.round(run.force(t) / 0.01) * 0.01  # repeats itself: a median of single differences is zero here
    assert 0.3 * 0.01 / np.sqrt(12) < segment(t, clean).noise < 3 * 0.01 / np.sqrt(12)


def test_white_noise_of_known_sd():
    noise = np.random.default_rng(9).standard_normal(20_000)
    t = np.arange(noise.size)
    assert white_noise(noise) == pytest.approx(1.0, rel=0.03)
    assert white_noise(noise + 50.0 * t) == pytest.approx(1.0, rel=0.03)
    assert white_noise(noise + 40.0 * np.sin(t / 12.0)) == pytest.approx(1.0, rel=0.05)
    assert np.std(np.diff(noise + 40.0 * np.sin(t / 12.0))) / np.sqrt(2) > 1.5  # what plain differences would say


@pytest.mark.parametrize("n", [0, 1, 2, 3, 7, 8, 15, 16, 40])
def test_tiny_records(n):
    rng = np.random.default_rng(n)
    found = segment(np.arange(n) / 10.0, rng.standard_normal(n))
    assert found.phase.shape == found.spikes.shape == (n,)
    assert np.isfinite(found.noise)
    assert found.count == 0


def test_a_million_samples_take_little_time(fast):
    run, _, _ = fast
    t = np.arange(1_000_000) * 6e-6
    f = run.force(t) + NOISE * np.random.default_rng(1).standard_normal(t.size)
    start = clock.process_time()
    found = segment(t, f, half_period=HALF_PERIOD)
    assert clock.process_time() - start < 1.5
    assert found.count == run.arrests.size


def saw(time):
    """Sticks of 0.36 s that load by 1 N/s, slips of 20 ms [N]."""
    phase = (time % 0.36) / 0.36
    return 0.3 + 0.36 * np.minimum(phase, (1.0 - phase) * 17.0)


@pytest.mark.parametrize("rate", [300.0, 1000.0])
def test_the_noise_of_uneven_rows_is_that_of_even_ones(rate):
    draw, even = np.random.default_rng(3), np.arange(int(12 * rate)) / rate
    thinned = np.sort(draw.choice(even, even.size // 2, replace=False))
    jittering = even + draw.uniform(-0.4, 0.4, even.size) * even[1]
    two_rates = np.concatenate([even[: even.size // 2 : 3], even[even.size // 2 :]])
    for time in (thinned, jittering, two_rates):
        assert uneven(time)
        force = saw(time) + 2e-3 * draw.standard_normal(time.size)
        assert segment(time, force).noise == pytest.approx(2e-3, rel=0.06)
    assert not uneven(np.delete(np.arange(500.0), [100, 200, 300])), "a few rows lost are gaps"


def test_a_swing_of_a_few_samples_that_dies_out_is_no_spike_but_a_spike_after_it_is():
    """A finger that is dragged at 30 mm/s, at 100 Hz: seven samples in each period of the rig."""
    t = np.arange(500) / 100.0
    f = 0.4 - 0.8 * np.exp(-3.0 * t) * np.cos(2.0 * np.pi * 13.8 * t)
    f += 4e-3 * np.random.default_rng(3).standard_normal(t.size)
    assert not spikes(f, 4e-3).any()
    f[300] += 0.05
    assert np.flatnonzero(spikes(f, 4e-3)).tolist() == [300]


def test_more_noise_and_fewer_samples():
    rng = np.random.default_rng(21)
    pair = drawn_pair(rng)
    for (speed, duration, rate), noise, every in ((LOGS[2], 0.02, 1), (LOGS[3], 0.02, 1), (LOGS[3], NOISE, 4)):
        run = oracle.simulate(pair, speed, 1.0, duration)
        t, f = oracle.noisy_log(run, duration, rate, noise, seed=1)
        found = segment(t[::every], f[::every], half_period=HALF_PERIOD)
        missed, extra = misses_and_extras(run, found, duration)
        assert extra == 0 and missed <= (0.2 * run.onsets.size if found.low_snr else 0)


@pytest.mark.parametrize("seed", range(20))
def test_turning_points_are_the_peaks_of_that_prominence(seed):
    """The reference is scipy's; a plateau, of which it names the middle, has no chance in random walks."""
    random = np.random.default_rng(seed)
    walk = np.cumsum(random.standard_normal(300))
    height = random.uniform(0.5, 5.0)
    peaks, valleys = _turning_points(walk, height)
    assert np.array_equal(peaks, find_peaks(walk, prominence=height)[0])
    edges = [*peaks.tolist(), walk.size]
    assert valleys.tolist() == [a + int(np.argmin(walk[a:b])) for a, b in pairwise(edges)]
    assert np.all(walk[peaks] - walk[valleys] > height) and not _turning_points(np.sort(walk), height)[0].size
