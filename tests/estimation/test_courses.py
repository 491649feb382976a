"""Fits of a drive on a course: through its turns, with the course inside of every stick and slip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from experiments.record_kinds import slide_hold_slide
from experiments.study_problem import DEMO, RIG
from identify import Scene, fit
from identify.base.errors import SceneError
from identify.effects import MAIN
from identify.logs.recorded_drive import recorded_drive
from identify.logs.scene_records import prepare_scene, with_drives
from identify.logs.segment import jumps, segment, sensor_place
from identify.model.composition import FORCE_SENSORS, ForceSensorPlace
from identify.model.model import assemble
from identify.scene.tables import Course
from identify.shooting.layout import COARSE_GRID
from identify.shooting.placing import follow
from identify.shooting.shooting import shooting_problem
from identify.shooting.starts import level_starts
from identify.simulation.drive import Drive
from identify.simulation.simulate import run
from identify.simulation.sliding import growth_rates

SINE = Course((2e-3, 0.25, 0.0))
RAMPS, DURATION, NOISE = Course(ramps=((0.0, 0.5e-3), (2.5, 3e-3), (5.0, 0.5e-3))), 5.0, 3e-3


def _record(course: Course, duration: float, *, position: bool = False, sensor: ForceSensorPlace = "drive") -> Record:
    """The demo pair on a course, with noise; position: as a column of 10 um; sensor: where the force is measured."""
    motion = run(assemble(MAIN, sensor), DEMO | RIG, course, 1.0, duration, accuracy=1e-8)
    time = np.arange(round(2000 * duration)) / 2000
    force = motion.sample(time)["force"] + NOISE * np.random.default_rng(1).standard_normal(time.size)
    record = Record(time, np.ones(time.size), force)
    if not position:
        return record
    steps = 1e-5 * np.round(1e5 * Drive.of(course, duration).motion(time)[0])
    return replace(record, channels={"position": steps}, channel_units={"position": "m"})


def _scene(sensor: ForceSensorPlace = "drive", **log: object) -> Scene:
    rig = {**RIG, "force_sensor": sensor}
    return Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": [{"path": "log.csv", **log}]}, Path())


def _misfit(scene: Scene, record: Record) -> float:
    """Squares per sample, of twice the noise variance, of the motion that follows from the true parameters."""
    ready = prepare_scene(scene, [record])
    log, unknowns = ready.logs[0], ready.unknowns
    p = np.array([(DEMO | RIG)[name] for name in unknowns.names])
    followed = follow(unknowns.model, log.data, p, begins_sliding=False)
    assert followed is not None
    assert followed[1] == log.data.end
    unknowns = replace(unknowns, start=unknowns.theta(p, log.data.base))
    problem = shooting_problem([log.data], [followed[0]], unknowns, COARSE_GRID)
    return problem.evaluate(problem.start, derivatives=False).cost / problem.samples


def test_true_parameters_follow_a_drive_on_ramps_and_not_a_faster_one() -> None:
    record = _record(RAMPS, DURATION)
    assert _misfit(_scene(drive=RAMPS.table), record) < 2.0
    faster = Course(ramps=tuple((time, 1.2 * speed) for time, speed in RAMPS.ramps))
    assert _misfit(_scene(drive=faster.table), record) > 20.0


@pytest.mark.usefixtures("no_predictions")
@pytest.mark.parametrize(
    ("course", "position", "sensor"),
    [
        pytest.param(RAMPS, False, "drive", marks=pytest.mark.slow),
        (RAMPS, True, "drive"),
        (RAMPS, False, "counterface"),
        pytest.param(SINE, False, "counterface", marks=pytest.mark.slow),
    ],
)
def test_a_pair_is_recovered_from_one_log_on_a_course(course: Course, position: bool, sensor: ForceSensorPlace) -> None:
    scene = _scene(sensor) if position else _scene(sensor, drive=course.table)
    record = _record(course, DURATION if course == RAMPS else 8.0, position=position, sensor=sensor)
    found = fit(scene, [record], time_limit=300.0).result
    assert found["status"] == "converged"
    for name, truth in DEMO.items():
        entry = found["parameters"][name]
        assert entry["interval"][0] <= truth <= entry["interval"][1], name
        assert entry["value"] == pytest.approx(truth, rel=0.05), name


def test_sticks_of_strokes_are_found_behind_a_plate_as_at_the_drive() -> None:
    cycles = []
    for sensor in FORCE_SENSORS:
        (log,) = prepare_scene(_scene(sensor, drive=SINE.table), [_record(SINE, 8.0, sensor=sensor)]).logs
        cycles.append(log.segmentation.cycles)
        assert sensor_place(*log.jumps) == sensor
        assert log.data.noise == pytest.approx(NOISE, rel=0.05), sensor
    assert cycles[0].count == cycles[1].count == 41
    assert cycles[0].arrest == pytest.approx(cycles[1].arrest, abs=5e-3)


@pytest.mark.parametrize(("amplitude", "frequency", "turns_in_slips"), [(2e-3, 0.25, False), (3e-3, 3.0, True)])
def test_true_parameters_follow_a_sine_through_its_turns(
    amplitude: float, frequency: float, turns_in_slips: bool
) -> None:
    sine = Course((amplitude, frequency, 0.0))
    record = _record(sine, 7.0 if frequency < 1.0 else 2.0)
    (log,) = prepare_scene(_scene(drive=sine.table), [record]).logs
    assert [np.sign(stroke.data.programme.speeds).sum() > 0 for stroke in log.pieces[:3]] == [True, True, True]
    assert _misfit(_scene(drive=sine.table), record) < 2.0
    wider = Course((1.2 * amplitude, frequency, 0.0))
    assert _misfit(_scene(drive=wider.table), record) > 20.0
    motion = run(assemble(MAIN), DEMO | RIG, sine, 1.0, 2.0)
    inside = [phase.mode != "stick" for t in (np.arange(4) + 0.5) / 2 / frequency for phase in motion.phases
              if phase.start < t <= phase.start + phase.duration]  # fmt: skip
    assert any(inside) == turns_in_slips


@pytest.mark.parametrize("noise", [0.0, 3e-6])
def test_the_course_behind_a_coarse_position_column_is_finer_than_its_resolution(noise: float) -> None:
    record, duration = _record(RAMPS, DURATION, position=True), DURATION
    position = Drive.of(RAMPS, duration).motion(record.time)[0]
    wavy = 1e-5 * np.round(1e5 * (position + noise * np.random.default_rng(2).standard_normal(position.size)))
    course = recorded_drive(replace(record, channels={"position": wavy})).course
    assert course is not None
    off = Drive.of(course, duration).motion(record.time)[0] - position
    assert np.std(off) < 0.5e-6 < np.std(wavy - position)


def test_a_fast_sine_in_a_position_column_is_no_programme_of_many_steps() -> None:
    sine, time = Course((1.8e-3, 3.0, 0.3)), np.arange(3000) / 1000
    position = Drive.of(sine, 3.0).motion(time)[0]
    columns = {"position": 1e-5 * np.round(1e5 * position)}, {"position": "m"}
    found = recorded_drive(Record(time, np.ones(3000), np.ones(3000), channels=columns[0], channel_units=columns[1]))
    assert found.course is not None
    off = Drive.of(found.course, 3.0).motion(time)[0] - position
    assert np.std(off) < 2e-6 < np.std(columns[0]["position"] - position)


def test_starts_slide_steadily_where_a_log_does_and_creep_as_peaks_after_holds_do() -> None:
    scene, record, truth = slide_hold_slide(0)
    ready = prepare_scene(with_drives(scene, [record])[0], [record])
    base, unknowns = ready.logs[0].data.base, ready.unknowns
    starts = unknowns.values(level_starts(ready.logs, unknowns), base)
    settings = np.column_stack([starts, np.ones(len(starts)), np.full(len(starts), 1e-3)])
    assert np.all(growth_rates(unknowns.model, settings) < 0.0)
    stated = np.append(unknowns.values(unknowns.start, base), [1.0, 1e-3])
    assert growth_rates(unknowns.model, stated[None])[0] > 0.0
    assert starts[:, unknowns.names.index("t_cr")] == pytest.approx(truth["t_cr"], rel=0.5)
    assert starts[:, unknowns.names.index("mu_s")] == pytest.approx(truth["mu_s"], rel=0.1)


def test_nothing_jumps_where_a_drive_turns() -> None:
    row = np.arange(4000)
    signs = np.where(row // 400 % 2, -1.0, 1.0)
    force = signs * (1.0 + 0.3 * np.sin(2.0 * np.pi * row / 100.0)) + 1e-3 * np.random.default_rng(5).standard_normal(
        4000
    )
    phases = segment(row / 1000.0, force)
    assert jumps(force, phases, 50.0, signs)[0] == 0 < jumps(force, phases, 50.0, signs)[1]
    assert jumps(force, phases, 50.0)[0] > 2, "as one force it does"


def test_a_course_that_is_misspelt_is_refused_by_name() -> None:
    for drive, expected in (
        ({"sine": {"amplitude": "2 mm"}}, "has no frequency"),
        ({"sine": {"amplitude": "2 mm", "frequency": "1 Hz"}, "ramps": []}, "keep exactly one"),
        ({"ramps": [[0, "1 mm/s"]]}, "two pairs at least"),
        ({"sinus": {}}, "did you mean 'sine'"),
    ):
        with pytest.raises(SceneError, match=expected):
            _scene(drive=drive)
    with pytest.raises(SceneError, match="keep one of them"):
        _scene(drive=RAMPS.table, drive_speed=1e-3)


def test_a_course_survives_the_document_of_its_scene() -> None:
    scene = _scene(drive=RAMPS.table)
    assert Scene.from_document(scene.as_document()).logs[0].drive_speed == RAMPS
