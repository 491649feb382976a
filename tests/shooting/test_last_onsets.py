"""Slips whose onset was put at a dip of a trembling grip before the one at which they begin."""

from dataclasses import replace

import numpy as np
import pytest

import identify.estimation.attempt as room
from data_io import Record
from identify import Scene
from identify.base.outcome import Status
from identify.estimation.attempt import solve_from, solve_placed
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import SPEED, assemble
from identify.shooting.shooting_trajectory import ShootingTrajectory, turned_back
from identify.simulation.simulate import run

EFFECTS = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening", "varying_normal_force")
PAIR = {"mu_s": 0.8, "mu_k0": 0.7, "delta_mu_k": -0.03, "a": 340.0, "D": 37e-6, "t_cr": 0.67}
RIG = {"mass": 0.21, "stiffness": 1000.0, "damping": 100.0}
DRIVE_SPEED, DURATION, RATE = 8e-5, 16.0, 500.0
DIP = 0.1  # s: about a period of the tremor


@pytest.fixture(scope="module")
def trembling():
    """The answer to a log whose grip trembles faster than the drive pulls, the unknowns, and the true onsets [s]."""
    knots = np.arange(0.0, DURATION + 0.1, 1 / 200)
    grip = 1.0 + 0.005 * np.sin(2 * np.pi * 9.3 * knots) + 0.004 * np.sin(2 * np.pi * 10.7 * knots + 1.0)
    motion = run(assemble(EFFECTS), PAIR | RIG, DRIVE_SPEED, (knots, grip), DURATION)
    time, random = np.arange(int(DURATION * RATE) + 1) / RATE, np.random.default_rng(1)
    force = motion.sample(time)["force"] + 0.004 * random.standard_normal(time.size)
    load = np.interp(time, knots, grip) + 0.002 * random.standard_normal(time.size)
    known = {name: {"start" if name == "mu_s" else "fixed": value} for name, value in PAIR.items()}
    logs = [{"path": "log.csv", "drive_speed": DRIVE_SPEED}]
    scene = Scene.from_document({"effects": list(EFFECTS), "rig": RIG, "parameters": known, "logs": logs})
    unknowns = from_scene(scene)
    unknowns = replace(
        unknowns, start=unknowns.theta(np.array([(PAIR | RIG)[n] for n in unknowns.names]), unknowns.base(RIG))
    )
    prepared = prepare(scene, scene.logs[0], Record(time, load, force), unknowns)
    assert prepared.data.loose > 0.0, "what the grip is at an onset is not told"
    return solve_from([prepared], [0], unknowns), unknowns, motion.onsets


def begun_early(trajectory: ShootingTrajectory, cycle: int, early: float) -> ShootingTrajectory:
    """The motion with one onset earlier [s]: the mass stands until it moved before."""
    until, nodes, onset = trajectory.until.copy(), trajectory.nodes.copy(), int(trajectory.ending("onset")[cycle])
    begun, end, slip = until[onset], until[onset + 1], slip_nodes(trajectory, cycle)
    until[onset] -= early
    last = slip.stop - slip.start - 1
    place = (np.linspace(until[onset], end, last + 1) - begun) / (end - begun) * last
    moved = np.stack([np.interp(place, np.arange(last + 1), column) for column in trajectory.nodes[slip].T], axis=1)
    moved[place < 0.0, SPEED] = 0.0
    nodes[slip] = moved
    return replace(trajectory, until=until, nodes=nodes)


def slip_nodes(trajectory: ShootingTrajectory, cycle: int) -> slice:
    """Where the nodes of a slip stand, from its onset until it wears or rests."""
    slip = int(trajectory.ending("onset")[cycle]) + 1
    return slice(int(trajectory.first[slip]) - 1, int(trajectory.first[slip + 1]))


@pytest.mark.parametrize("cycle", [1, 2])
@pytest.mark.parametrize("early", [DIP / 2, DIP])
def test_an_onset_at_an_earlier_dip_is_put_where_the_slip_begins(trembling, cycle, early, monkeypatch):
    right, unknowns, onsets = trembling
    assert right.gate.status is Status.CONVERGED
    (log,), start = right.fitted_logs, replace(unknowns, start=right.solved.theta)
    placed = [(0, log, begun_early(right.solved.trajectories[0], cycle, early))]
    found = solve_placed([log], placed, start)
    assert found.gate.status is Status.CONVERGED
    np.testing.assert_allclose(found.solved.trajectories[0].onset, onsets, atol=4e-3)
    assert not np.any(np.concatenate(turned_back(found.solved.trajectories[0])))
    monkeypatch.setattr(room, "_simulated", lambda *_: None)  # who leaves it there
    left = solve_placed([log], placed, start)
    assert left.gate.status is Status.WRONG_EVENT_COUNT and "runs backwards" in left.gate.message
    assert left.solved.trajectories[0].onset[cycle] < onsets[cycle] - 0.02
