"""What a batch is made of: manifests, folders, groups, overrides, and every complaint at once."""

import csv
import io
from pathlib import Path

import pytest

from identify.base.table import LINE, harmless, visible
from identify.scene import Scene
from identify.studies.batch_store import Ended, index_csv
from identify.studies.job import LONGEST, BatchError, Job, content_key, folder_names, numerics
from identify.studies.planning import BatchPlan, plan
from identify.studies.running import in_words
from tests.support.batch_case import SCENE, write_case


@pytest.fixture
def case(tmp_path):
    """Writes a manifest beside some logs; gives its plan."""
    for name in ("a.csv", "b.csv", "c.csv"):
        (tmp_path / name).write_text(f"T,Fz,Fx\ns,N,N\n0,1,0.3\n1,1,0.{ord(name[0])}\n")
    (tmp_path / "scene.toml").write_text(SCENE)

    def made(text, overrides=(), scene=""):
        (tmp_path / "m.csv").write_text(text)
        (tmp_path / "scene.toml").write_text(SCENE + scene)
        return plan(tmp_path / "m.csv", tmp_path / "scene.toml", overrides)

    return made


def complaints(made, *arguments, **more):
    with pytest.raises(BatchError) as error:
        made(*arguments, **more)
    return list(error.value.complaints)


def scene_of(job):
    return Scene.from_document(job.scene)


def test_rows_of_a_group_are_one_job_with_its_labels(case):
    made = case(
        "path,group,drive_speed,material,run\nb.csv,G,2 mm/s,skin,2\na.csv,G,1 mm/s,skin,1\nc.csv,H,3 mm/s,,7\n"
    )
    first, second = made.jobs
    assert (first.group, second.group) == ("G", "H") and made.labels == ("material", "run")
    assert [log.path.name for log in scene_of(first).logs] == ["a.csv", "b.csv"], "in the order of their names"
    assert [log.drive_speed for log in scene_of(first).logs] == [1e-3, 2e-3]
    assert first.labels == {"material": "skin", "run": "1; 2"} and second.labels == {"run": "7"}
    assert first.logs[1].labels == {"material": "skin", "run": "2"}
    assert Job.from_document(first.as_document()) == first
    assert any("'run' is taken as a label" in note for note in made.notes)


@pytest.mark.parametrize("spelt", ["drivespeed", "Drive speed", "DRIVE-SPEED"])
def test_a_column_spelt_otherwise_is_no_label(case, spelt):
    said = complaints(case, f"path,group,{spelt}\na.csv,G,1 mm/s\n")
    assert said == [next(c for c in said if f"{spelt!r} would be a label; did you mean drive_speed?" in c)]
    made = case(f"path,group,drive_speed,{spelt}\na.csv,G,1 mm/s,slow\n")  # beside the right one it can be nothing else
    assert made.labels == (spelt,)


def test_overrides_reach_the_group_or_the_log(case):
    same = "path,group,drive_speed,rig.mass,parameters.mu_s.start,logs.window\n"
    same += 'a.csv,G,1 mm/s,0.3 kg,0.7,"[""1 s"", ""2 s""]"\nb.csv,G,1 mm/s,300 g,0.7,\n'
    said = complaints(case, same.replace("300 g,0.7", "300 g,0.8"))
    assert len(said) == 1 and "0.7 and 0.8 for parameters.mu_s.start" in said[0] and "'G'" in said[0]
    scene = scene_of(case(same).jobs[0])
    assert [log.mass for log in scene.logs] == [0.3, 0.3] and scene.rig.mass == 0.2, "told differently, so per log"
    assert scene.parameters["mu_s"].start == 0.7 and [log.window for log in scene.logs] == [(1.0, 2.0), None]
    scene = scene_of(case(same.replace("300 g", "0.3 kg")).jobs[0])
    assert scene.rig.mass == 0.3 and [log.mass for log in scene.logs] == [None, None]


def test_what_the_scene_says_of_a_log_is_kept_where_the_row_says_nothing(case):
    listed = '[[logs]]\npath = "a.csv"\ndrive_speed = "9 mm/s"\nnoise = "1 mN"\nlabels = { site = "arm" }\n'
    listed += '[[logs]]\npath = "gone.csv"\n'
    made = case("path,group,drive_speed,material\na.csv,G,,skin\nb.csv,H,1 mm/s,skin\n", scene=listed)
    (log,) = scene_of(made.jobs[0]).logs
    assert log.drive_speed == 9e-3 and log.noise == 1e-3 and log.labels == {"site": "arm", "material": "skin"}
    assert any("1 of the scene's own [[logs]]" in note for note in made.notes)
    (log,) = scene_of(case("path,group,drive_speed\na.csv,G,2 mm/s\n", scene=listed).jobs[0]).logs
    assert log.drive_speed == 2e-3, "the manifest has the last word"


def test_what_the_scene_says_of_a_log_without_a_path_holds_of_every_log(case):
    """So that the logs of a folder can take their drive from a column."""
    rows = "path,group,drive_speed\na.csv,G,\nb.csv,H,\nc.csv,K,2 mm/s\n"
    listed = '[[logs]]\ncolumns = { position = "Fz" }\nnoise = "2 mN"\n[[logs]]\npath = "b.csv"\nnoise = "1 mN"\n'
    made = case(rows, scene=listed)
    logs = [scene_of(job).logs[0] for job in made.jobs]
    assert [log.columns for log in logs] == [{"position": "Fz"}] * 3
    assert [log.noise for log in logs] == [2e-3, 1e-3, 2e-3] and logs[2].drive_speed == 2e-3
    assert not any("take no part" in note for note in made.notes)
    (said,) = complaints(case, rows)
    assert said.startswith("m.csv line 2, m.csv line 3: has no drive speed") and 'position = "…"' in said


def test_everything_wrong_is_told_at_once(case):
    rows = "a.csv,G,1 mm/s,-1 kg\nb.csv,G,1 mm/s,3 lightyears\nc.csv,H,,\nnone.csv,H,1 mm/s,\n"
    said = complaints(case, "path,group,drive_speed,rig.mass\n" + rows)
    text = "\n".join(said)
    assert len(said) == 4 and all(len(line.splitlines()) == 1 for line in said)
    assert "m.csv line 2: " in text and "-1" in text and "m.csv line 3: " in text and "lightyears" in text
    assert (
        "m.csv line 4: " in text and "has no drive speed" in text and "there is no log" in text and "none.csv" in text
    )


def test_one_complaint_stands_for_all_whom_it_concerns(case):
    rows = "".join(f"{name}.csv,{name},\n" for name in "abc")
    (sentence,) = complaints(case, "path,group,drive_speed\n" + rows, overrides=["rig.mas=1"])
    assert "m.csv line 2, m.csv line 3, m.csv line 4: " in sentence and "'mass'" in sentence


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["the manifest is empty"]),
        ("path,group\n", ["lists no log"]),
        ("file,group\na.csv,G\n", ["has no column path"]),
        ("path,group,group\na.csv,G,H\n", ["'group' twice"]),
        ("path,rigg.mass\na.csv,1\n", ["did you mean rig.mass?"]),
        ("path,logs.windw\na.csv,1\n", ["did you mean logs.window?"]),
        (
            "path,group,drive_speed\na.csv,,1 mm/s\n,G,1 mm/s\n",
            ["line 2: the row has no group", "line 3: the row has no"],
        ),
        ("path,drive_speed\na.csv,0.1\nb.csv,0.2\n", ["'0.1', without a unit", "'0.2', without a unit"]),
        ("path,drive_speed\na.csv,1 mm/s,what\n", ["under no heading"]),
        ('path,drive_speed\n"a.csv,1 mm/s\n', ["this is no CSV"]),
        ("path,group,drive_speed\na.csv,G,1 mm/s\na.csv,G,1 mm/s\n", ["already (m.csv line 2)"]),
        ("path,drive_speed\nnone.csv,1 mm/s\n", ["there is no log"]),
    ],
)
def test_manifests_that_cannot_be_meant(case, text, words):
    said = complaints(case, text)
    assert len(said) == len(words)
    assert all(word in sentence for word, sentence in zip(words, said, strict=True))


def test_semicolons_and_a_mark_of_byte_order_are_fine(case, tmp_path):
    (tmp_path / "m.csv").write_bytes("\ufeffpath;group;drive_speed;place\na.csv;G;1 mm/s;Füße, links\n".encode())
    assert plan(tmp_path / "m.csv", tmp_path / "scene.toml").jobs[0].labels == {"place": "Füße, links"}
    (tmp_path / "m.csv").write_bytes("path;group\nMüller.csv;G\n".encode("latin-1"))
    with pytest.raises(BatchError, match="UTF-8"):
        plan(tmp_path / "m.csv", tmp_path / "scene.toml")


def test_a_folder_is_one_group_per_log(tmp_path):
    folder = tmp_path / "logs"
    _, scene = write_case(tmp_path, [])
    folder.mkdir()
    for name in ("slow.csv", "slow.txt.gz", "0.1_mm.txt", "notes.md", ".hidden.csv"):
        (folder / name).write_text("T,Fz,Fx\ns,N,N\n0,1,0.3\n")
    jobs = plan(folder, scene, ['rig.drive_speed="1 mm/s"']).jobs
    assert [job.group for job in jobs] == ["0.1_mm", "slow.csv", "slow.txt.gz"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(BatchError, match="holds no log"):
        plan(tmp_path / "empty", scene)
    (tmp_path / "empty" / "V01").mkdir()
    with pytest.raises(BatchError, match=r"\(V01 in it are not looked into\).*manifest"):
        plan(tmp_path / "empty", scene)
    with pytest.raises(BatchError, match="no such manifest"):
        plan(tmp_path / "none.csv", scene)


HOSTILE = [
    "..", ".", "a/b", "a\\b", "CON", "index.csv", "<script>alert(1)</script>", "=cmd|' /C calc'!A0", "x" * 10_000,
    "\u202egnp.exe", "two\nlines", " ", "ü" * 200, "Case", "case", ".lock", "-rf", "a:b", "~", "😀" * 50,
]  # fmt: skip


def test_hostile_groups_get_harmless_folders(tmp_path):
    names = folder_names(HOSTILE)
    assert len({name.casefold() for name in names.values()}) == len(HOSTILE)
    for name in names.values():
        (tmp_path / name).mkdir()
        assert (tmp_path / name).parent == tmp_path and not name.startswith((".", "~")) and len(name) <= LONGEST + 10
        assert len(name.encode()) < 200 and name.isprintable() and Path(name).name == name
    assert len(list(tmp_path.iterdir())) == len(HOSTILE)
    assert folder_names(["Pad 3 (left)", "G1"]) == {"Pad 3 (left)": "Pad 3 (left)", "G1": "G1"}


def test_hostile_texts_are_harmless_in_the_index():
    jobs = tuple(
        Job(group, f"f{i}", "k", "n", {}, (), {"note": group, "group": "=1+1"}, 0) for i, group in enumerate(HOSTILE)
    )
    made = BatchPlan(Path("m.csv"), Path("s.toml"), (), "n", jobs, ("note",), ())
    text = index_csv(made, {HOSTILE[0]: Ended("failed", "=1+1\nmore", False, None)})
    rows = list(csv.reader(io.StringIO(text)))
    assert rows[0] == ["group", "status", "message", "result", "folder", "logs", "note", "label: group", "seconds"]
    assert len(rows) == len(HOSTILE) + 1 == len(text.splitlines()) and rows[1][2] == "'=1+1 more"
    for row, group in zip(rows[1:], HOSTILE, strict=True):
        assert not any(cell.startswith(("=", "+", "-", "@")) for cell in row)
        assert row[0].lstrip("'").rstrip() == visible(group, LINE)
    assert harmless("-0.1 °C") == "'-0.1 °C" and harmless("plain") == "plain" and harmless(" =1") == "'=1"


def test_the_key_knows_what_the_numbers_depend_on(case):
    job = case("path,group,drive_speed,material\na.csv,G,1 mm/s,skin\n").jobs[0]
    digests = [log.sha256 for log in job.logs]
    assert job.key == content_key(job.scene, digests, numerics()) and len(job.key) == 64
    assert job.key == content_key({**job.scene, "name": "other"}, digests, numerics())
    assert job.key != content_key(job.scene, ["0" * 64], numerics())
    assert job.key != content_key(job.scene, digests, "other")
    assert job.key != case("path,group,drive_speed,material\na.csv,G,1.1 mm/s,skin\n").jobs[0].key
    assert (
        job.key != case("path,group,drive_speed,material\na.csv,G,1 mm/s,skin\n", ["effects=['inertia']"]).jobs[0].key
    )


def test_a_time_in_words():
    assert [in_words(s) for s in (4.4, 300.0, 12_000.0)] == ["4 s", "5 min", "3 h 20 min"]
