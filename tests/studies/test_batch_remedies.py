"""Every sentence in which a batch is refused: met by an input, and its remedy, done to that very input, is taken."""

import inspect
import re

import pytest

from identify.studies import planning, running
from identify.studies.batch_store import BATCH, Store
from identify.studies.job import BatchError
from identify.studies.planning import MOST_COLUMNS, plan
from identify.studies.running import _check_foreign, check_place
from tests.support.batch_case import SCENE
from tests.support.sentences import advising

GOOD = "path,group,drive_speed\na.csv,G,1 mm/s\n"
# A manifest, the remedy that the sentence names, and the manifest after it.
MANIFESTS = [
    ("", "expected a heading such as path,group,drive_speed", "path,group,drive_speed\na.csv,G,1 mm/s\n"),
    (GOOD.encode("utf-16"), "save the manifest as CSV in UTF-8", GOOD),
    ('path,group,drive_speed\n"a.csv"x,G,1 mm/s\n', "mend that line", GOOD),
    ("path,group,drive_speed" + ",x" * MOST_COLUMNS + "\n", "or split it", GOOD),
    ("log,group,drive_speed\na.csv,G,1 mm/s\n", "expected path,group,drive_speed", GOOD),
    ("path,path,drive_speed\na.csv,G,1 mm/s\n", "rename one column", "path,run,drive_speed\na.csv,G,1 mm/s\n"),
    ("path,drive_speed,rgi.mass\na.csv,1 mm/s,1\n", "did you mean rig.mass",
     "path,drive_speed,rig.mass\na.csv,1 mm/s,1\n"),
    ("path,drive_speed,rgi.mass\na.csv,1 mm/s,1\n", "A label has no dot",
     "path,drive_speed,rgi_mass\na.csv,1 mm/s,1\n"),
    ("path,drive_speed,logs.stp\na.csv,1 mm/s,1\n", "did you mean logs.step",
     "path,drive_speed,logs.step\na.csv,1 mm/s,1\n"),
    ("path,Drive speed\na.csv,1 mm/s\n", "did you mean drive_speed. Rename it", "path,drive_speed\na.csv,1 mm/s\n"),
    ("path,drive_speed,x\na.csv,1 mm/s,1,2\n", "quote texts with a comma", 'path,drive_speed,x\na.csv,1 mm/s,"1,2"\n'),
    ("path,drive_speed\n,1 mm/s\n", "give the log's path", "path,drive_speed\na.csv,1 mm/s\n"),
    ("path,group,drive_speed\na.csv,,1 mm/s\n", "the row has no group; give one", GOOD),
    ("path,drive_speed\na\0.csv,1 mm/s\n", "zero byte; correct it", "path,drive_speed\na.csv,1 mm/s\n"),
    ("path,drive_speed\na.csv,1\n", 'write for instance "1 mm/s"', "path,drive_speed\na.csv,1 mm/s\n"),
    (GOOD + "a.csv,G,1 mm/s\n", "stands in group 'G' already .*; drop one", GOOD),
    ("path,group,drive_speed\n", "expected one row per log under its heading", GOOD),
    ("path,drive_speed\nz.csv,1 mm/s\n", "check its path", "path,drive_speed\na.csv,1 mm/s\n"),
    ("path,group\na.csv,G\n", "give drive_speed in the manifest", GOOD),
    ("path,group,drive_speed,parameters.mu_s.start\na.csv,G,1 mm/s,0.7\nb.csv,G,1 mm/s,0.8\n", "make them equal",
     "path,group,drive_speed,parameters.mu_s.start\na.csv,G,1 mm/s,0.7\nb.csv,G,1 mm/s,0.7\n"),
    ("path,group,drive_speed,parameters.mu_s.start\na.csv,G,1 mm/s,0.7\nb.csv,G,1 mm/s,0.8\n", "or split the group",
     "path,group,drive_speed,parameters.mu_s.start\na.csv,G,1 mm/s,0.7\nb.csv,H,1 mm/s,0.8\n"),
]  # fmt: skip
GOES_ON = (r"make\ room", "interrupted", r"\ about.*left")  # and then --resume, as the trials of the batch do


@pytest.fixture
def folder(tmp_path):
    """Two logs and a scene."""
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(f"T,Fz,Fx\ns,N,N\n0,1,0.3\n1,1,0.{ord(name[0])}\n")
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def _planned(folder, manifest):
    content = manifest if isinstance(manifest, bytes) else manifest.encode()
    (folder / "m.csv").write_bytes(content)
    return plan(folder / "m.csv", folder / "scene.toml")


def _places(folder):
    """What else a batch refuses: source and output folders."""
    scene, logs, out = folder / "scene.toml", folder / "logs", folder / "out"
    speed = ['rig.drive_speed="1 mm/s"']
    logs.mkdir(exist_ok=True)

    def named(name):
        def act():
            for path in logs.iterdir():
                path.unlink()
            (logs / name).write_bytes((folder / "a.csv").read_bytes())
            return plan(logs, scene, speed)

        return act

    def placed(resume=False, **items):
        def act():
            if out.is_dir():
                for path in out.iterdir():
                    path.unlink()
            out.mkdir(exist_ok=True)
            for name in items.values():
                (out / name).touch()
            check_place(out, resume)

        return act

    yield lambda: plan(folder / "none.csv", scene), "check its path", lambda: plan(folder, scene, speed)
    yield named("notes.pdf"), "choose another folder", named("a.csv")
    yield named("a\udcff.csv"), "not UTF-8; rename it", named("b.csv")
    yield lambda: check_place(scene, False), "choose another name", placed()
    yield placed(other="mine.txt"), "choose another folder or empty it", placed()
    yield placed(batch=BATCH), "add --resume to go on with it", placed(resume=True, batch=BATCH)


def _beside(folder):
    """A foreign file where a result is to stand."""
    jobs, store = _planned(folder, GOOD).jobs, Store(folder / "kept")
    (store.folder / jobs[0].folder).mkdir(parents=True, exist_ok=True)
    foreign = store.folder / jobs[0].folder / "mine.txt"
    foreign.touch()
    said = _sentence(lambda: _check_foreign(store, jobs))
    foreign.unlink()
    _check_foreign(store, jobs)
    return said


def _note(folder):
    """A column that is a label by name, and what sets the scene instead."""
    (note,) = _planned(folder, "path,drive_speed,step\na.csv,1 mm/s,1\n").notes
    assert "logs.step" in note
    assert _planned(folder, "path,drive_speed,logs.step\na.csv,1 mm/s,1\n").notes == ()
    return note


def _locked(folder, monkeypatch):
    """A log that may not be read."""

    def refusing(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(planning, "file_sha256", refusing)
    return lambda: _planned(folder, GOOD)


def _sentence(act):
    with pytest.raises(BatchError) as caught:
        act()
    return "\n".join(caught.value.complaints)


def test_a_refused_batch_is_taken_with_the_remedy_that_is_named(folder, monkeypatch):
    for refused, remedy, mended in MANIFESTS:
        assert re.search(remedy, said := _sentence(lambda manifest=refused: _planned(folder, manifest))), said
        assert _planned(folder, mended).jobs
    for act, remedy, then in _places(folder):
        assert re.search(remedy, said := _sentence(act)), said
        then()
    with monkeypatch.context() as patch:
        assert "check its permissions" in _sentence(_locked(folder, patch))
    assert _planned(folder, GOOD).jobs
    assert "move it away" in _beside(folder)


def test_every_sentence_that_advises_has_its_case(folder, monkeypatch):
    told = [_sentence(lambda manifest=refused: _planned(folder, manifest)) for refused, *_ in MANIFESTS]
    told += [_sentence(act) for act, *_ in _places(folder)]
    with monkeypatch.context() as patch:
        told.append(_sentence(_locked(folder, patch)))
    told += [_beside(folder), _note(folder)]
    sources = [inspect.getsource(module) for module in (planning, running)]
    patterns = {p for source in sources for p in advising(source)}
    assert len(patterns) > 20
    untold = [p for p in patterns if not any(re.search(p, s) for s in told) and not any(w in p for w in GOES_ON)]
    assert untold == [], untold
