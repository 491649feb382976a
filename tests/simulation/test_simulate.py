"""The hybrid simulation against an independent event-driven integrator (tests/support/oracle.py, DOP853 at 1e-12)."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.study_problem import DEMO, RIG
from identify.base.errors import SimulationError
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.plan import Stepping
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory
from tests.support import oracle

PAIR = DEMO | RIG
MODEL = assemble(MAIN)
STEPS = ((0.0, 1e-3), (0.9, 3e-3), (1.4, 0.0), (2.0, 5e-4))
STROKES = ((0.0, 1e-3), (0.9, -2e-3), (2.0, 1e-3))
RELAXING = ((0.0, 1.0), (1.0, 0.9), (3.0, 0.85))
SCENES = {
    "0.1 mm/min": (1e-4 / 60, 1.0, 500.0),
    "0.1 mm/s": (1e-4, 1.0, 13.0),
    "1 mm/s": (1e-3, 1.0, 2.0),
    "5 mm/s": (5e-3, 1.0, 1.0),
    "speed steps and a hold": (STEPS, 1.0, 3.5),
    "reversed drive": (STROKES, 1.0, 3.0),
    "relaxing normal force": (1e-3, RELAXING, 3.5),
}


def _ours(drive: object, force: object, duration: float, **options: object) -> Trajectory:
    load = (tuple(np.transpose(force).tolist())) if isinstance(force, tuple) else force
    return run(MODEL, PAIR, drive, load, duration, **options)  # type: ignore[arg-type]


def _errors(trajectory: Trajectory, truth: oracle.Oracle, duration: float) -> tuple[float, float]:
    """Largest event error over the mean period, largest force error over the normal force (1 N)."""
    assert trajectory.onsets.size == truth.onsets.size
    assert trajectory.arrests.size == truth.arrests.size
    period = duration / max(truth.onsets.size, 1)
    events = max(
        float(np.max(np.abs(trajectory.onsets - truth.onsets))),
        float(np.max(np.abs(trajectory.arrests - truth.arrests))),
        float(np.max(np.abs(trajectory.wear_times - truth.wear_times))),
    )
    times = np.linspace(0.0, duration, 2001)
    # At an event the force has a corner, not a jump; right at a step of the drive it jumps: leave those out.
    times = times[np.min(np.abs(times[:, None] - np.array([0.9, 1.4, 2.0])[None, :]), axis=1) > 1e-9]
    force = float(np.max(np.abs(trajectory.sample(times)["force"] - truth.force(times))))
    return events / period, force


@pytest.mark.parametrize("name", SCENES)
def test_events_and_forces_agree_with_an_independent_integrator(name: str) -> None:
    drive, force, duration = SCENES[name]
    truth = oracle.simulate(PAIR, drive, force, duration)
    assert truth.onsets.size >= 2
    events, forces = _errors(_ours(drive, force, duration), truth, duration)
    assert events < 1e-8
    assert forces < 1e-8


def test_accuracy_is_lost_when_switches_are_not_located() -> None:
    drive, force, duration = SCENES["1 mm/s"]
    truth = oracle.simulate(PAIR, drive, force, duration)
    events, forces = _errors(_ours(drive, force, duration, accuracy=Stepping(1e-11, locate=False)), truth, duration)
    assert events > 1e-6
    assert forces > 1e-6


def test_stick_is_the_closed_form() -> None:
    states = _ours(1e-3, 1.0, 0.3).sample([0.1, 0.2])
    assert states["force"] == pytest.approx(
        1470.0 * 1e-3 * np.array([0.1, 0.2]) + 147.0 * np.sqrt(0.2 / 1470.0) * 1e-3, rel=1e-14
    )
    assert states["gamma"] == pytest.approx(-np.expm1(-np.array([0.1, 0.2]) / 0.5), rel=1e-14)


def test_a_drive_at_rest_never_moves_the_mass() -> None:
    trajectory = run(MODEL, PAIR, 0.0, 1.0, 100.0)
    assert trajectory.onsets.size == 0
    assert np.all(trajectory.sample([1.0, 50.0])["force"] == 0.0)


def test_without_inertia_nothing_is_simulated() -> None:
    with pytest.raises(SimulationError, match="add inertia to effects"):
        run(assemble(("contact_ageing",)), PAIR, 1e-3, 1.0, 2.0)
