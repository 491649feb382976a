"""The drive of a log from its own column, and a column that contradicts the drive of the scene."""

from dataclasses import replace

import numpy as np
import pytest

from data_io import Record
from identify import Scene, identification
from identify.base.errors import FitError
from identify.base.outcome import Status
from identify.base.result import Result
from identify.diagnosis.findings import Findings
from identify.logs.scene_records import with_drives, with_records
from identify.studies.job import BatchError
from identify.studies.planning import plan
from tests.support.batch_case import SCENE

pytestmark = pytest.mark.usefixtures("no_further_logs")

TIME = np.arange(6000) / 500.0
STEPS = ((0.0, 1e-3), (4.0, 2e-3), (8.0, 1e-3))
HOLD = ((0.0, 1e-3), (4.0, 0.0), (5.0, 1e-3))
STROKES = ((0.0, 1e-3), (4.0, -1e-3), (8.0, 1e-3))
WAITS = ((0.0, 0.0), (2.0, 1e-3))
RIG = {"mass": 0.2, "stiffness": 1800.0, "damping": 100.0}


def scene_of(drive_speed=None, **more):
    said = {} if drive_speed is None else {"drive_speed": drive_speed}
    log = {"path": "a.csv", **said, **more}
    return Scene.from_document({"effects": ["inertia", "hysteresis_damping"], "rig": RIG, "logs": [log]})


def speed_of(programme):
    starts, speeds = np.transpose(programme)
    return speeds[np.searchsorted(starts, TIME, side="right") - 1]


def record_of(programme, column="drive_speed"):
    """A record whose role, or whose channel, follows a programme."""
    force = 0.3 + 0.01 * np.random.default_rng(1).standard_normal(TIME.size)
    record = Record(TIME, np.ones(TIME.size), force)
    speed = speed_of(programme)
    if column == "drive_speed":
        return replace(record, drive_speed=speed)
    if column == "Position":
        speed = np.concatenate([[0.0], np.cumsum(speed[:-1])]) / 500.0
    return replace(record, channels={column: speed}, channel_units={column: "m" if column == "Position" else "m/s"})


@pytest.mark.parametrize("column", ["drive_speed", "Stage speed", "Position"])
@pytest.mark.parametrize("programme", [STEPS, HOLD, STROKES])
def test_a_drive_that_the_scene_leaves_out_is_taken_from_the_column(column, programme):
    scene, said = with_drives(scene_of(), [record_of(programme, column)])
    assert np.array(scene.logs[0].drive_speed) == pytest.approx(np.array(programme), abs=0.01, rel=1e-6)
    assert len(said) == 1 and said[0].startswith("a.csv: the drive speed was taken from ") and "1 mm/s" in said[0]
    assert with_drives(scene, None) == (scene, []), "what is stated is not read again"
    told, (record,) = with_records(scene, [record_of(programme, column)])
    assert told is scene and record.findings == ()


def test_one_speed_of_a_column_is_one_speed():
    scene, _ = with_drives(scene_of(), [record_of(((0.0, 1e-3),))])
    assert scene.logs[0].drive_speed == pytest.approx(1e-3)


def test_a_column_that_does_not_tell_it_is_refused_in_a_sentence():
    bare = replace(record_of(STEPS), drive_speed=None)
    with pytest.raises(FitError, match="no drive speed, and the log does not tell it; give drive_speed"):
        with_drives(scene_of(), [bare])
    with pytest.raises(FitError, match="goes gradually"):
        with_drives(scene_of(), [replace(bare, drive_speed=1e-3 * (2 + np.sin(TIME)))])
    creeping = replace(bare, channels={"Z": 1e-6 * TIME}, channel_units={"Z": "m"})
    with pytest.raises(FitError, match="column Z is not taken for the drive: nothing in the log says"):
        with_drives(scene_of(), [creeping])
    crosshead = replace(bare, channels={"Extension": 1e-3 * TIME}, channel_units={"Extension": "m"})
    with pytest.raises(FitError, match='if it is: --columns "position=Extension"'):
        with_drives(scene_of(), [crosshead])


@pytest.mark.parametrize("programme", [STEPS, HOLD, STROKES])
def test_one_stated_speed_against_a_column_that_changes_is_doubted_and_taken(programme):
    for column, place in (("drive_speed", "the drive speed of the log"), ("Stage speed", "column Stage speed")):
        scene, (record,) = with_records(scene_of(1e-3), [record_of(programme, column)])
        assert scene.logs[0].drive_speed == 1e-3
        (finding,) = record.findings
        assert finding.severity == "warning" and f"{place} changes" in finding.message


@pytest.mark.parametrize("programme", [STEPS, HOLD, STROKES])
def test_a_carriage_that_nothing_shows_to_be_the_drive_neither_tells_nor_doubts_it(programme):
    record = record_of(programme, "V2")
    with pytest.raises(FitError, match="column V2 is not taken for the drive"):
        with_drives(scene_of(), [record])
    assert with_records(scene_of(1e-3), [record])[1][0].findings == ()


def test_one_speed_goes_with_a_window_a_late_start_and_strokes_of_a_position():
    window = {"window": ["0.5 s", "3.5 s"]}
    for scene, record in (
        (scene_of(1e-3, **window), record_of(STEPS)),
        (scene_of(1e-3), record_of(WAITS)),
        (scene_of(1e-3), record_of(STROKES, "Position")),
        (scene_of(1.015e-3), record_of(((0.0, 1e-3),))),
    ):
        assert with_records(scene, [record])[1][0].findings == ()


@pytest.mark.parametrize(("stated", "words"), [
    (1.03e-3, "1.03 mm/s at 0 s, but the drive speed of the log says 1 mm/s there"),
    ([[0, 1e-3], [4.0, 2.1e-3], [8.0, 1e-3]], "2.1 mm/s at 4 s"),
    ([[0, 1e-3], [4.6, 2e-3], [8.0, 1e-3]], "1 mm/s at 4 s, but the drive speed of the log says 2 mm/s"),
    ([[0, 1e-3], [4.0, 2e-3]], "2 mm/s at 8 s"),
])  # fmt: skip
def test_a_contradiction_is_a_warning_in_one_sentence(stated, words):
    column = ((0.0, 1e-3),) if isinstance(stated, float) else STEPS
    scene, (record,) = with_records(scene_of(stated), [record_of(column)])
    (finding,) = record.findings
    assert (finding.code, finding.severity) == ("drive_speed_disagrees", "warning")
    assert words in finding.message and "correct drive_speed" in finding.message
    assert with_records(scene, [record])[1][0].findings == (finding,), "it is said once"


def test_steps_as_a_user_reads_them_agree():
    said = [[0, 1.005e-3], [4.1, 2e-3], [7.95, 1e-3]]
    assert with_records(scene_of(said), [record_of(STEPS)])[1][0].findings == ()


def test_a_fit_says_what_it_took_and_the_scene_of_its_result_holds_it(monkeypatch):
    found = Findings(Status.NO_CYCLES, "", None)
    monkeypatch.setattr(identification, "plain_or_uneven", lambda *_arguments: ([], found))
    monkeypatch.setattr(identification, "_curves", lambda *_arguments: ())
    monkeypatch.setattr(identification, "result_of", lambda *_: Result(notes=("another",)))
    result = identification.fit(scene_of(), [record_of(STEPS)]).result
    took = "a.csv: the drive speed was taken from the drive speed of the log: 1 mm/s, from 4 s 2 mm/s, from 8 s 1 mm/s."
    assert result["notes"] == [took, "another"]
    (entry,) = Scene.from_document(result["provenance"]["scene"]).logs
    assert entry.drive_speed == STEPS, "verify and the calculators take the same"


def test_a_batch_asks_for_the_speed_or_the_name_of_its_column(tmp_path):
    (tmp_path / "a.csv").write_text("T,Fz,Fx,v\ns,N,N,mm/s\n0,1,0.3,1\n1,1,0.3,1\n")
    (tmp_path / "m.csv").write_text("path,group\na.csv,G\n")
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    with pytest.raises(BatchError, match="no drive speed; give drive_speed in the manifest"):
        plan(tmp_path / "m.csv", scene, ())
    scene.write_text(SCENE + '[[logs]]\npath = "a.csv"\ncolumns = { drive_speed = "v" }\n')
    assert len(plan(tmp_path / "m.csv", scene, ()).jobs) == 1
