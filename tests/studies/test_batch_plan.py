"""What a batch is made of: manifests, folders, groups, overrides, and every complaint at once."""

from pathlib import Path

import pytest

from experiments.batch_trials import SCENE, write_case
from identify.scene import Scene
from identify.studies.batch_store import LONGEST, BatchError, Job, content_key, folder_names, numerics
from identify.studies.planning import plan

GOOD = "path,group,drive_speed\na.csv,G,1 mm/s\n"
WITH_X = "path,drive_speed,x\na.csv,1 mm/s,"
MASS = GOOD.replace("group", "rig.mass").replace("G", "1")
START = "path,group,drive_speed,parameters.mu_s.start\na.csv,G,1 mm/s,0.7\nb.csv,G,1 mm/s,"
HOSTILE = [
    "..", ".", "a/b", "a\\b", "CON", "index.csv", "<script>alert(1)</script>", "=cmd|' /C calc'!A0", "x" * 10_000,
    "\u202egnp.exe", "two\nlines", " ", "ü" * 200, "Case", "case", ".lock", "-rf", "a:b", "~", "😀" * 50,
]  # fmt: skip


@pytest.fixture
def case(tmp_path):
    """Writes a manifest beside some logs; gives its plan."""
    for name in ("a.csv", "b.csv", "c.csv"):
        (tmp_path / name).write_text(f"T,Fz,Fx\ns,N,N\n0,1,0.3\n1,1,0.{ord(name[0])}\n")

    def planned(text, overrides=(), scene=""):
        (tmp_path / "m.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
        (tmp_path / "scene.toml").write_text(SCENE + scene)
        return plan(tmp_path / "m.csv", tmp_path / "scene.toml", overrides)

    return planned


def complaints(planned, *arguments, **more):
    with pytest.raises(BatchError) as error:
        planned(*arguments, **more)
    return list(error.value.complaints)


def scene_of(job):
    return Scene.from_document(job.scene)


def test_rows_of_a_group_are_one_job_with_its_labels(case):
    planned = case(
        "path,group,drive_speed,material,run\nb.csv,G,2 mm/s,skin,2\na.csv,G,1 mm/s,skin,1\nc.csv,H,3 mm/s,,7\n"
    )
    first, second = planned.jobs
    assert (first.group, second.group) == ("G", "H") and planned.labels == ("material", "run")
    assert [log.path.name for log in scene_of(first).logs] == ["a.csv", "b.csv"], "in the order of their names"
    assert [log.drive_speed for log in scene_of(first).logs] == [1e-3, 2e-3]
    assert first.labels == {"material": "skin", "run": "1; 2"} and second.labels == {"run": "7"}
    assert first.logs[1].labels == {"material": "skin", "run": "2"}
    assert Job.from_document(first.as_document()) == first
    text = "\ufeffpath;group;drive_speed;place\na.csv;G;1 mm/s;Füße, links\n"  # of a German spreadsheet
    assert case(text.encode()).jobs[0].labels == {"place": "Füße, links"}


def test_overrides_reach_the_group_or_the_log(case):
    same = "path,group,drive_speed,rig.mass,parameters.mu_s.start,logs.window\n"
    same += 'a.csv,G,1 mm/s,0.3 kg,0.7,"[""1 s"", ""2 s""]"\nb.csv,G,1 mm/s,300 g,0.7,\n'
    scene = scene_of(case(same).jobs[0])
    assert [log.mass for log in scene.logs] == [0.3, 0.3] and scene.rig.mass == 0.2, "the rows differ, so per log"
    assert scene.parameters["mu_s"].start == 0.7 and [log.window for log in scene.logs] == [(1.0, 2.0), None]
    scene = scene_of(case(same.replace("300 g", "0.3 kg")).jobs[0])
    assert scene.rig.mass == 0.3 and [log.mass for log in scene.logs] == [None, None]


def test_what_the_scene_states_of_logs_is_kept_where_the_row_states_nothing(case):
    """Of the log at a path, and without a path of every log, so that a folder can take its drive from a column."""
    listed = '[[logs]]\npath = "a.csv"\ndrive_speed = "9 mm/s"\nnoise = "1 mN"\nlabels = { site = "arm" }\n'
    rows = "path,group,drive_speed,material\na.csv,G,,skin\nb.csv,H,1 mm/s,skin\n"
    (log,) = scene_of(case(rows, scene=listed).jobs[0]).logs
    assert log.drive_speed == 9e-3 and log.noise == 1e-3 and log.labels == {"site": "arm", "material": "skin"}
    (log,) = scene_of(case("path,group,drive_speed\na.csv,G,2 mm/s\n", scene=listed).jobs[0]).logs
    assert log.drive_speed == 2e-3, "the manifest has the last word"
    rows = "path,group,drive_speed\na.csv,G,\nb.csv,H,\nc.csv,K,2 mm/s\n"
    listed = '[[logs]]\ncolumns = { position = "Fz" }\nnoise = "2 mN"\n[[logs]]\npath = "b.csv"\nnoise = "1 mN"\n'
    logs = [scene_of(job).logs[0] for job in case(rows, scene=listed).jobs]
    assert [log.columns for log in logs] == [{"position": "Fz"}] * 3
    assert [log.noise for log in logs] == [2e-3, 1e-3, 2e-3] and logs[2].drive_speed == 2e-3
    (sentence,) = complaints(case, rows)
    assert sentence.startswith("m.csv line 2, m.csv line 3: has no drive speed") and 'position = "…"' in sentence


def test_everything_wrong_is_listed_at_once(case):
    rows = "a.csv,G,1 mm/s,-1 kg\nb.csv,G,1 mm/s,3 lightyears\nc.csv,H,,\nnone.csv,H,1 mm/s,\n"
    found = complaints(case, "path,group,drive_speed,rig.mass\n" + rows)
    assert len(found) == 4 and all(len(line.splitlines()) == 1 for line in found)
    for place, word in (("4: ", "no drive speed"), ("2: ", "-1"), ("3: ", "lightyears"), ("5: ", "none.csv")):
        assert any(f"line {place}" in sentence and word in sentence for sentence in found)
    rows = "".join(f"{name}.csv,{name},\n" for name in "abc")
    (sentence,) = complaints(case, "path,group,drive_speed\n" + rows, overrides=["rig.mas=1"])
    assert "m.csv line 2, m.csv line 3, m.csv line 4: " in sentence and "'mass'" in sentence


@pytest.mark.parametrize(
    ("wrong", "remedies", "right"),
    [
        ("", ["expected a heading such as path,group,drive_speed"], GOOD),
        (GOOD.encode("utf-16"), ["save the manifest as CSV in UTF-8"], GOOD),
        ('path,group,drive_speed\n"a.csv"x,G,1 mm/s\n', ["correct that line"], GOOD),
        ("log,group,drive_speed\na.csv,G,1 mm/s\n", ["expected path,group,drive_speed"], GOOD),
        (GOOD.replace("group", "path"), ["rename one column"], GOOD),
        (MASS.replace("rig", "rgi"), ["'rig'"], MASS),
        (GOOD.replace("drive_speed", "Drive speed"), ["did you mean drive_speed? Rename it"], GOOD),
        (WITH_X + "1,2\n", ["quote texts with a comma"], WITH_X + '"1,2"\n'),
        ("path,group,drive_speed\na.csv,,1 mm/s\n,G,1 mm/s\n", ["no group; give one", "give the log's path"], GOOD),
        (GOOD.replace("a.csv", "a\0.csv"), ["zero byte; correct it"], GOOD),
        (GOOD.replace("1 mm/s", "1"), ['write for instance "1 mm/s"'], GOOD),
        (GOOD + "a.csv,G,1 mm/s\n", ["already (m.csv line 2); drop one"], GOOD),
        ("path,group,drive_speed\n", ["expected one row per log"], GOOD),
        (GOOD.replace("a.csv", "z.csv"), ["check its path"], GOOD),
        (START + "0.8\n", ["split the group"], START.replace("b.csv,G", "b.csv,H") + "0.8\n"),
    ],
)  # fmt: skip
def test_a_refused_manifest_is_taken_with_the_remedy_that_is_named(case, wrong, remedies, right):
    found = complaints(case, wrong)
    assert len(found) == len(remedies)
    assert all(remedy in sentence for remedy, sentence in zip(remedies, found, strict=True))
    assert case(right).jobs


def test_a_folder_is_one_group_per_log(tmp_path):
    folder = tmp_path / "logs"
    _, scene = write_case(tmp_path, [])
    folder.mkdir()
    for name in ("slow.csv", "slow.txt.gz", "0.1_mm.txt", "notes.md", ".hidden.csv"):
        (folder / name).write_text("T,Fz,Fx\ns,N,N\n0,1,0.3\n")
    jobs = plan(folder, scene, ['rig.drive_speed="1 mm/s"']).jobs
    assert [job.group for job in jobs] == ["0.1_mm", "slow.csv", "slow.txt.gz"]
    (tmp_path / "empty" / "V01").mkdir(parents=True)
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "a\udcff.csv").touch()
    for place, words in (("empty", "holds no log"), ("none.csv", "no such manifest"), ("odd", "not UTF-8; rename it")):
        with pytest.raises(BatchError, match=words):
            plan(tmp_path / place, scene)


def test_hostile_groups_get_harmless_folders(tmp_path):
    names = folder_names(HOSTILE)
    assert len({name.casefold() for name in names.values()}) == len(HOSTILE)
    for name in names.values():
        (tmp_path / name).mkdir()
        assert (tmp_path / name).parent == tmp_path and not name.startswith((".", "~")) and len(name) <= LONGEST + 10
        assert len(name.encode()) < 200 and name.isprintable() and Path(name).name == name
    assert len(list(tmp_path.iterdir())) == len(HOSTILE)
    assert folder_names(["Pad 3 (left)", "G1"]) == {"Pad 3 (left)": "Pad 3 (left)", "G1": "G1"}


def test_the_key_depends_on_what_the_numbers_depend_on(case):
    text = "path,group,drive_speed,material\na.csv,G,1 mm/s,skin\n"
    job = case(text).jobs[0]
    digests = [log.sha256 for log in job.logs]
    assert job.key == content_key({**job.scene, "name": "other"}, digests, numerics()) and len(job.key) == 64
    assert job.key != content_key(job.scene, ["0" * 64], numerics())
    assert job.key != content_key(job.scene, digests, "other")
    assert job.key != case(text.replace("1 mm/s", "1.1 mm/s")).jobs[0].key
    assert job.key != case(text, ["effects=['inertia']"]).jobs[0].key
