"""Slips that were missed or invented are mended before a solve: against the slips of the simulated motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data_io import Record
from identify import Scene
from identify.effects import MAIN
from identify.estimation.events import TOO_BAD, misfit_of_start, with_events_mended
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.simulation.simulate import run

# Near the end of stick-slip: jumps of four standard deviations of the noise, after a start with larger ones.
TRUTH = {"mu_s": 0.5348, "mu_k0": 0.3311, "delta_mu_k": -0.02818, "a": 197.7, "D": 21.24e-6, "t_cr": 3.3}
RIG = {"mass": 0.1757, "stiffness": 1863.0, "damping": 119.9}
NOISE, NORMAL_FORCE = 5e-3, 1.0
LOGS = ((1e-5, 80.0, 200.0), (1e-4, 8.0, 500.0), (5e-3, 0.8, 2000.0))  # drive speed [m/s], duration [s], rate [Hz]


@pytest.fixture(scope="module")
def logs():
    """Prepared logs, the search space with its start at the truth, and the middles of the true slips of each log."""
    model, random, records, middles = assemble(MAIN), np.random.default_rng(4), [], []
    for speed, duration, rate in LOGS:
        motion = run(model, TRUTH | RIG, speed, NORMAL_FORCE, duration)
        time = np.arange(round(duration * rate) + 1) / rate
        force = motion.sample(time)["force"] + NOISE * random.standard_normal(time.size)
        records.append(Record(time, np.full(time.size, NORMAL_FORCE), force))
        # The slip that re-ages the contact lasts microseconds: the one before the mass slides without ageing counts.
        slips = [p for p in motion.phases if p.mode == "slip" and p.times[-1] > 5e-4]
        middles.append(np.array([p.situated.time + 0.5 * p.times[-1] for p in slips]))
    entries = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, _, _) in enumerate(LOGS)]
    scene = Scene.from_document({"effects": list(MAIN), "rig": RIG, "logs": entries})
    unknowns = from_scene(scene)
    base = unknowns.base(RIG)
    unknowns = replace(unknowns, start=unknowns.theta(np.array([(TRUTH | RIG)[n] for n in unknowns.names]), base))
    prepared = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    return prepared, unknowns, middles


def _missed(falls, middles):
    return [t for t in middles if np.min(np.abs(falls - t)) > 0.04]


def test_missed_slips_are_put_in(logs):
    prepared, unknowns, middles = logs
    log, whole = prepared[1], [t for t in middles[1] if t < 7.9]  # the last one is cut by the end
    assert len(_missed(log.falls, whole)) >= 4, "the detection itself misses none: the test shows nothing"
    assert misfit_of_start(log, unknowns) > TOO_BAD
    mended = with_events_mended(log, unknowns)
    assert len(_missed(mended.falls, whole)) <= 1
    assert misfit_of_start(mended, unknowns) < TOO_BAD


def test_invented_slips_are_taken_out_and_a_log_that_fits_is_left_alone(logs):
    prepared, unknowns, _ = logs
    log = prepared[0]
    assert with_events_mended(log, unknowns) is log
    between = 0.5 * (log.falls[1] + log.falls[2])
    wrong = replace(log, falls=np.sort(np.append(log.falls, between)))
    assert misfit_of_start(wrong, unknowns) > TOO_BAD
    np.testing.assert_allclose(with_events_mended(wrong, unknowns).falls, log.falls)
    lacking = replace(log, falls=np.delete(log.falls, 1))
    np.testing.assert_allclose(with_events_mended(lacking, unknowns).falls, log.falls, atol=0.02)
