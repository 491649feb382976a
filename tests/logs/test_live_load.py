"""What a live finger does to a record: a normal force that jitters, noise with a memory, few samples per stick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from identify.effects import MAIN
from identify.logs.log_data import LogData, smooth
from identify.logs.segment import noise_on_lines, segment
from identify.model.model import assemble
from identify.shooting.layout import COARSE_GRID
from identify.shooting.passes import solve_in_passes
from identify.shooting.placing import place
from identify.simulation.drive import NormalForce
from identify.simulation.simulate import run
from tests.support import shooting_case as case

PAIR = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.1, "a": 480.0, "D": 40e-6, "t_cr": 5.0}
RIG = {"mass": 0.206, "stiffness": 1433.0, "damping": 140.0}
NOISE, MEMORY = 5e-3, 4e-3  # [N], [s]


def _remembering(count, rate, seed, memory=MEMORY):
    kept = np.exp(-1.0 / (rate * memory))
    new = np.random.default_rng(seed).standard_normal(count + 500) * np.sqrt(1.0 - kept**2)
    return lfilter([1.0], [1.0, -kept], new)[500:]


def _load(times, tremor=0.005):
    slow = 1.5 * (1.0 - 0.2 * (1.0 - np.exp(-times / 10.0)))
    return slow * (1.0 + 0.015 * np.sin(2 * np.pi * 1.1 * times) + tremor * np.sin(2 * np.pi * 9.7 * times + 1.0))


@pytest.mark.parametrize(("rate", "duration"), [(50.0, 30), (100.0, 30), (1000.0, 30), (50.0, 5), (100.0, 5)])
def test_pulse_and_tremor_of_a_load_are_kept_and_their_error_is_known(rate, duration):
    # Of five seconds at 50 Hz no spectrum was taken: an error of 6 mN was called 2 mN.
    times, at = np.arange(int(duration * rate)) / rate, np.linspace(0.1, duration - 0.1, 20_001)
    off, stated = [], []
    for seed in range(4):
        made = smooth(times, _load(times) + NOISE * np.random.default_rng(seed).standard_normal(times.size), cycles=7)
        off.append(np.mean((made.force.at(at) - _load(at)) ** 2))
        stated.append(made.sd**2)
    assert np.mean(off) < 0.25 * NOISE**2
    assert 0.6**2 * np.mean(off) < np.mean(stated) < 1.6**2 * np.mean(off)


@pytest.mark.parametrize("drift", [0.0, 0.1])
def test_a_swing_of_a_load_is_a_sinusoid_however_its_periods_fit_the_record(drift):
    """Three numbers are known to a thousandth of the swing, the many lines of its spectrum to a hundredth."""
    times = np.arange(3001) / 2000.0
    swing = 1.0 + 0.1 * np.sin(2 * np.pi * 3.2 * times + 0.7) + drift * times
    seen = swing + 2e-3 * np.random.default_rng(4).standard_normal(times.size)
    made = smooth(times, seen)
    off = float(np.std(made.force.at(times) - swing))
    assert off < 1.3e-4 and 0.6 * off < made.sd < 1.6 * off


def test_noise_alone_makes_no_rhythm_of_a_load():
    times = np.arange(20_000) / 1000.0
    for seed in range(5):
        made = smooth(times, 1.0 + NOISE * np.random.default_rng(seed).standard_normal(times.size))
        assert len(made.force.times) < 40 and made.jitter_sd == 0.0


@pytest.mark.parametrize("rate", [50.0, 500.0, 1000.0])
def test_noise_with_a_memory_is_seen_whole(rate):
    sticks = [(i, i + int(2 * rate)) for i in range(0, int(20 * rate), int(2 * rate))]
    found = [noise_on_lines(_remembering(int(20 * rate), rate, seed), sticks) for seed in range(6)]
    assert np.mean(found) == pytest.approx(1.0, abs=0.04)


def test_noise_with_a_memory_makes_no_slips():
    # Second differences see a third of such noise; taken for white, it made hundreds of slips of three.
    model, speed, rate = assemble(MAIN), 2e-5, 500.0
    times = np.arange(int(40 * rate)) / rate
    motion = run(model, PAIR | RIG, speed, 1.2, times[-1])
    force = motion.sample(times)["force"] + NOISE * _remembering(times.size, rate, 2)
    found = segment(times, force, half_period=0.037)
    assert found.count == motion.arrests.size
    assert found.noise == pytest.approx(NOISE, rel=0.05)


def _swinging(swing, which=2, end=8.0):
    """Forces of a log whose load is 1 N but in one slip, where it goes over to 1 N + swing; its falls and its end."""
    model, speed, times = assemble(MAIN), 3e-4, np.arange(int(500 * end)) / 500.0
    calm = run(model, PAIR | case.RIG, speed, 1.0, end)
    onset, arrest = float(calm.onsets[which]), float(calm.arrests[which])
    middle = float(calm.wear_times[which])
    ramp = np.linspace(0.0, 1.0, 40)
    after = arrest + 0.4 * (float(calm.onsets[which + 1]) - arrest) * np.array([0.5, 1.0])
    knots = np.concatenate([[0.0], onset + (middle - onset) * ramp, after, [end]])
    course = np.concatenate([[1.0], 1.0 + swing * ramp**2, [1.0 + swing, 1.0, 1.0]])
    motion = run(model, PAIR | case.RIG, speed, (knots, course), end)
    count = motion.arrests.size
    falls = 0.5 * (motion.onsets[:count] + motion.arrests)
    last = float(motion.arrests[-1]) + 0.3 * float(motion.onsets[2] - motion.arrests[1])
    return times, motion.sample(times)["force"], falls, last


@pytest.mark.parametrize("swing", [-8e-3, pytest.param(8e-3, marks=pytest.mark.slow)])
def test_a_load_that_swings_in_a_slip_is_found_there(swing):
    times, force, falls, end = _swinging(swing)
    unknowns = case.search_space(PAIR, ())
    weight, load = np.full(times.size, NOISE**-2), NormalForce.of(1.0)
    log = LogData(times, force, weight, unknowns.base(case.RIG), 3e-4, load, 5e-3, 0.0, end)
    costs = {}
    for tremor in (0.0, 5e-3):
        data = [replace(log, jitter_sd=tremor)]
        values = [unknowns.values(unknowns.start, log.base)]
        trajectories = [g for g in place(unknowns.model, data, values, [falls], COARSE_GRID) if g is not None]
        solved = solve_in_passes(data, trajectories, unknowns)
        costs[tremor], (trajectory,) = solved.solution.cost, solved.trajectories
    found = trajectory.slip_deviation
    assert found[2] == pytest.approx(swing, abs=1e-3)
    assert np.max(np.abs(np.delete(found, 2))) < 1e-3
    assert np.max(np.abs(trajectory.deviation)) < 1e-3
    prior = 0.5 * (swing / 5e-3) ** 2
    assert costs[5e-3] < prior + 0.5
    assert costs[0.0] > costs[5e-3] + 20.0, "a load that is one number per cycle cannot say it"


def _broad(count, step, random):
    """A tremor about 9 Hz, of half its power half a hertz to either side, of one in the mean square."""
    turn, left = np.exp((-2 * np.pi * 0.5 + 2j * np.pi * 9.0) * step), random.standard_normal((2, count))
    tremor = lfilter([1.0], [1.0, -turn], left[0] + 1j * left[1]).real
    return tremor / np.std(tremor)


def test_a_jitter_in_a_broad_band_is_not_known_better_than_it_is():
    """Its skirts lie below the noise in every line, and hold a sixth of it together."""
    ratios = []
    for seed in range(3):
        knots, random = np.arange(20001) * 1e-3, np.random.default_rng(seed)
        grip = 3.0 * (1.0 + 0.005 * _broad(knots.size, 1e-3, random))
        made = smooth(knots, grip + 4.6e-3 * random.standard_normal(knots.size))
        inside = slice(500, -500)
        ratios.append(float(np.sqrt(np.mean((made.force.at(knots) - grip)[inside] ** 2)) / made.sd))
    assert 0.85 < np.mean(ratios) < 1.15
