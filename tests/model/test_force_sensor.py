"""Where the force is measured: a plate under the counterface is another observation of the same motion, and a scene
that does not name it pays nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from experiments.force_plates import plate_force, plated
from experiments.study_problem import DEMO, RIG
from identify import Scene, fit
from identify.base.errors import SceneError
from identify.base.result import Status
from identify.effects import MAIN
from identify.logs.segment import drive_force
from identify.model.model import assemble
from identify.shooting.blocks import SlideBlock, block
from identify.simulation.simulate import run
from tests.support import oracle
from tests.support.finding import find

SPEEDS = ((1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0))  # [m/s], duration [s], rate [Hz]
LOAD, NOISE = 1.0, 3e-3


def _seen(speed: float, duration: float, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, force under the counterface and at the drive, by the integrator of the tests."""
    motion, times = oracle.simulate(DEMO | RIG, speed, LOAD, duration), np.arange(round(duration * rate)) / rate
    return times, plate_force(motion, times, LOAD), motion.force(times)


@pytest.mark.parametrize("speed, duration, rate", SPEEDS)
def test_a_plate_shows_the_friction_of_the_same_motion(speed, duration, rate):
    times, plate, drive = _seen(speed, duration, rate)
    motions = {
        place: run(assemble(MAIN, place), DEMO | RIG, speed, LOAD, duration) for place in ("counterface", "drive")
    }
    shown = {place: motion.sample(times)["force"] for place, motion in motions.items()}
    np.testing.assert_allclose(shown["counterface"], plate, atol=1e-7 * LOAD)
    np.testing.assert_allclose(shown["drive"], drive, atol=1e-7 * LOAD)
    assert np.max(np.abs(plate - drive)) > 0.1 * LOAD  # control: the two are not one force
    np.testing.assert_array_equal(*(motion.arrests for motion in motions.values()))


def test_a_scene_without_a_plate_pays_nothing_for_it():
    drive, plate = assemble(MAIN), assemble(MAIN, "counterface")
    assert drive is assemble(MAIN, "drive") and drive.sliding_cell is drive.load_cell
    at_drive, at_plate = (block(model, SlideBlock(2)).derivatives.instructions for model in (drive, plate))
    assert at_drive < at_plate
    scene = Scene.from_document({"effects": list(MAIN), "rig": RIG | {"drive_speed": 1e-3}})
    assert scene.model is drive and "force_sensor" not in scene.as_document()["rig"]


@pytest.mark.parametrize("speed, duration, rate", SPEEDS)
def test_the_force_at_the_drive_follows_from_that_under_the_counterface(speed, duration, rate):
    times, plate, drive = _seen(speed, duration, rate)
    frequency, zeta = float(np.sqrt(RIG["stiffness"] / RIG["mass"])), RIG["damping"] / (2.0 * RIG["stiffness"])
    fall = float(np.ptp(drive))
    assert np.quantile(np.abs(drive_force(times, plate, frequency, zeta) - drive), 0.99) < 0.05 * fall
    assert np.quantile(np.abs(drive_force(times, plate, 2.0 * frequency, zeta) - drive), 0.99) > 0.2 * fall  # control


def test_a_scene_says_where_the_force_is_measured():
    scene = Scene.from_document(
        {"effects": list(MAIN), "rig": RIG | {"drive_speed": 1e-3, "force_sensor": "counterface"}}
    )
    assert scene.model is assemble(MAIN, "counterface")
    assert Scene.from_document(scene.as_document()).model is scene.model
    assert scene.with_effects(MAIN[:3]).model.force_sensor == "counterface"
    with pytest.raises(SceneError, match=r"\[rig\] force_sensor is 'plate'; expected 'drive' or 'counterface'"):
        Scene.from_document({"effects": list(MAIN), "rig": RIG | {"drive_speed": 1e-3, "force_sensor": "plate"}})


def test_the_parameters_are_identified_from_a_plate():
    """Of the slowest log a slip holds two samples: those beside its arrest went in and out from pass to pass."""
    made = plated(19)
    scene = replace(made.scene, logs=made.scene.logs[:3])
    shorter = Record(*(column[:1600] for column in made.case.records[2].columns().values()))
    _, found = find(replace(scene, time_limit=300.0), [*made.case.records[:2], shorter])
    assert found.status is Status.CONVERGED, found.message
    estimates = {estimate.name: estimate for estimate in found.estimates}
    for name, true in made.case.truth.items():
        assert estimates[name].verdict == "identified"
        assert estimates[name].value == pytest.approx(true, abs=4.0 * estimates[name].standard_error)


@pytest.mark.parametrize("measured, stated", [("counterface", "drive"), ("drive", "counterface")])
def test_a_sensor_that_is_elsewhere_is_named(measured, stated):
    random, records = np.random.default_rng(69), []
    for speed in SPEEDS[1:]:
        times, plate, drive = _seen(*speed)
        force = plate if measured == "counterface" else drive
        records.append(Record(times, np.full(times.size, LOAD), force + NOISE * random.standard_normal(times.size)))
    logs = [{"path": f"{speed}.csv", "drive_speed": speed} for speed, _, _ in SPEEDS[1:]]
    document = {"effects": list(MAIN), "rig": RIG | {"force_sensor": stated}, "logs": logs}
    result = fit(Scene.from_document(document, Path()), records, time_limit=300).result
    assert result["status"] == "model_misfit"
    assert f'force_sensor = "{measured}" under [rig]' in result["message"]
    (cause,) = result["causes"]
    assert cause["quantity"] == "force_sensor" and cause["score"] > 1e5
