"""Every sentence in which a fit is refused before its search: met by logs, and with its remedy the search begins."""

import inspect
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import LogTooLargeError, Record, read_log
from data_io.record import WINDOW_START
from identify import Scene, fit, identification
from identify.base.errors import FitError, IdentifyError
from identify.base.progress import Notice
from identify.examples import SCENE
from identify.logs import loads, prepare, scene_records, segmented, unknowns
from identify.report.finished import Fit
from identify.report.stored_result import plain, read_result
from identify.shooting.accuracy import accuracy_of
from tests.support.fake_fit import fake_fit
from tests.support.sentences import advising

pytestmark = pytest.mark.usefixtures("no_further_logs")

CASES = Path(__file__).parents[1] / "cases"
DRIVE = 'rig.drive_speed="1 mm/s"'


class _SearchBeganError(Exception):
    """The search has begun."""


@pytest.fixture(scope="module")
def log():
    """The example at 1 mm/s: 13 cycles in 4 s."""
    return read_log(SCENE.parent / "1_mm_per_s.txt.gz", step=2)


def _changed(record, **changes):
    """The record without its drive column, and with other forces."""
    forces = {"normal_force": record.normal_force, "friction_force": record.friction_force} | changes
    return Record(record.time, **forces)


def _said(settings, *records):
    """Why no search begins; None where one does."""

    def listen(stage, _share):
        if stage == "finding a start" and not isinstance(stage, Notice):
            raise _SearchBeganError

    listed = [{"path": f"log_{n}.csv"} for n in range(len(records))]
    scene = Scene.from_toml(SCENE, [f"logs={_toml(listed)}", *settings])
    try:
        result = fit(scene, list(records) or None, progress=listen).result
    except _SearchBeganError:
        return None
    except (FitError, IdentifyError) as error:
        return str(error)
    return " ".join([result["message"], *(log["reason_left_out"] or "" for log in result["logs"])])


def _toml(tables):
    return "[" + ", ".join("{" + ", ".join(f'{k} = "{v}"' for k, v in t.items()) + "}" for t in tables) + "]"


def _cases(log):
    """What is set and read, the remedy that the sentence names, and what is set and read with it."""
    plain, half = _changed(log), log.time < 2.0
    short = Record(*(column[:7] for column in (log.time, log.normal_force, log.friction_force)))
    falling = _changed(log, normal_force=np.where(half, log.normal_force, 0.0))
    mostly_off = _changed(log, normal_force=np.where(log.time < 1.6, log.normal_force, 0.0))
    sliding = read_log(CASES / "level_of_the_last_tenth.csv.gz")
    turning = _changed(log, friction_force=np.where(half, 1.0, -1.0) * log.friction_force)
    no_inertia = 'effects=["driven_damping", "contact_ageing", "velocity_weakening", "varying_normal_force"]'
    fixed = [f"parameters.{name}={{fixed={value}}}" for name, value in
             {"mu_s": 0.6, "mu_k0": 0.4, "delta_mu_k": -0.1, "a": 300, "D": 4e-5, "t_cr": 0.5}.items()]  # fmt: skip
    free = [*fixed[:-1], "parameters.t_cr={start=0.5}"]
    yield ([DRIVE, no_inertia], [plain]), "add inertia to effects", ([DRIVE], [plain])
    yield ([DRIVE, *fixed], [plain]), "give one of them a start instead of fixed", ([DRIVE, *free], [plain])
    yield ([DRIVE, "rig.damping=0", "parameters.damping={}"], [plain]), "give a positive value to start from", (
        [DRIVE, "rig.damping=1", "parameters.damping={}"], [plain])  # fmt: skip
    yield ([], [plain]), 'give drive_speed = "… mm/s" in its', (['logs.1.drive_speed="1 mm/s"'], [plain])
    yield ([DRIVE], [plain, plain]), "remove one of the two logs", ([DRIVE], [plain])
    again = _changed(log, friction_force=np.round(log.friction_force, 4))
    yield ([DRIVE], [plain, again]), "are one measurement, exported twice", ([DRIVE], [plain])
    yield ([DRIVE], [plain, plain]), "give them windows that do not overlap", (
        [DRIVE, "logs.1.window=[0, 1.9]", "logs.2.window=[2, 4]"], [plain, plain])  # fmt: skip
    yield ([DRIVE, "logs.1.window=[1, 1.005]"], [plain]), "widen it", ([DRIVE, "logs.1.window=[1, 4]"], [plain])
    yield (
        ([DRIVE, "logs.1.window=[5, 6]"], [plain]),
        "move the window inside",
        ([DRIVE, "logs.1.window=[2, 4]"], [plain]),
    )
    yield ([DRIVE, "logs.1.exclude=[[0, 4]]"], [plain]), "exclude less", ([DRIVE, "logs.1.exclude=[[0, 1]]"], [plain])
    yield ([DRIVE], [short]), "record longer", ([DRIVE], [plain])
    yield (['rig.drive_speed="0 mm/s"'], [plain]), "give the speed it moved at", ([DRIVE], [plain])
    yield ([DRIVE, 'logs.2.drive_speed="0 mm/s"'], [plain, short]), r"take its \[\[logs\]\] out", ([DRIVE], [plain])
    yield ([DRIVE], [turning]), "or a window of one stroke", ([DRIVE, "logs.1.window=[0, 2]"], [turning])
    yield ([DRIVE], [falling]), "cut the window to the part under load", ([DRIVE, "logs.1.window=[0, 1.9]"], [falling])
    yield ([DRIVE], [mostly_off]), "or cut the window to the part under load", (
        [DRIVE, "logs.1.window=[0, 1.5]"], [mostly_off])  # fmt: skip
    faster = ['rig.drive_speed="1.1 mm/s"', 'rig.mass="30.7 g"', 'rig.stiffness="2254 N/m"', 'rig.damping="90 N/m"']
    yield (faster, [sliding]), "a window chooses a part", ([*faster, "logs.1.window=[1.26, 1.398]"], [sliding])
    both = 'logs=[{path="a.csv"}, {path="b.csv"}]'
    yield (
        ([DRIVE, both], [plain]),
        "give one each",
        ([DRIVE, both], [plain, _changed(log, friction_force=1.05 * log.friction_force)]),
    )
    yield ([DRIVE], []), "add ..logs.. to the scene", ([DRIVE], [plain])
    yield ([DRIVE, "logs.1.skip_cycles=50"], [plain]), "lower it", ([DRIVE, "logs.1.skip_cycles=2"], [plain])
    yield ([DRIVE, "quality.load_ripple_reject=0.001"], [plain]), "moved under .quality", ([DRIVE], [plain])


def _documents(folder):
    """The same of the files and questions of a finished fit."""
    fitted, written = fake_fit(samples=2000), folder / "result.json"
    provenance = {**fitted.result["provenance"], "scene": {"logs": fitted.result["logs"]}}
    written.write_text(json.dumps(plain({**fitted.result, "provenance": provenance})))
    (folder / "broken.json").write_text("{")
    (folder / "other.json").write_text("{}")
    alone = Fit(fitted.result)
    for name, remedy in (("none.json", "no such file"), (".", "give the result.json in it"),
                         ("broken.json", "this is not JSON"), ("other.json", "that stickslip fit wrote")):  # fmt: skip
        yield lambda name=name: read_result(folder / name), remedy, lambda: read_result(written)
    yield lambda: alone.cycles, "or fit again", lambda: fitted.cycles
    yield lambda: fitted.plot(99), "choose one of them", lambda: fitted.plot(1)
    yield lambda: accuracy_of("fine"), "choose one", lambda: accuracy_of("0.1")


def _of_single_logs(log, monkeypatch):
    """The same of one log as the page cuts it, of a scene that is made in Python, and of a log larger than memory."""
    scene = Scene.from_toml(SCENE, [DRIVE, 'logs=[{path="log.csv"}]'])
    entry, rig, plain = scene.logs[0], scene.rig, _changed(log)
    turns = replace(rig, drive_speed=((0.0, 1e-3), (2.0, -1e-3)))
    yield lambda: segmented.segmented(entry, plain, replace(rig, drive_speed=None)), "give drive_speed = ", (
        lambda: segmented.segmented(entry, plain, rig))  # fmt: skip
    yield lambda: segmented.segmented(entry, plain, turns), "cut it into one window per stroke", (
        lambda: segmented.segmented(replace(entry, window=(0.0, 1.9)), plain, turns))  # fmt: skip
    yield lambda: unknowns.from_scene(replace(scene, parameters={})), "add it to .parameters.", (
        lambda: unknowns.from_scene(scene))  # fmt: skip

    def read(_path, *, window=None, **_options):
        if window is None:
            raise LogTooLargeError("log.csv is larger than memory")
        return replace(plain, metadata={WINDOW_START: 1.0})

    monkeypatch.setattr(scene_records, "read_log", read)
    large = replace(scene, logs=(replace(entry, window=(1.0, 3.0)),), rig=replace(rig, drive_speed=None))
    yield lambda: scene_records.with_drives(large), "give drive_speed = ", (
        lambda: scene_records.with_drives(replace(large, rig=rig)))  # fmt: skip


NOT_MET = ("the time limit of", "times count from there on")  # notes, no refusals


def test_a_refused_fit_begins_with_the_remedy_that_is_named(log, monkeypatch):
    told = []
    for refused, remedy, mended in _of_single_logs(log, monkeypatch):
        with pytest.raises(IdentifyError, match=remedy) as said:
            refused()
        told.append(str(said.value))
        assert mended() is not None
    monkeypatch.undo()
    for (settings, records), remedy, (then, with_records) in _cases(log):
        said = _said(settings, *records)
        assert said is not None and re.search(remedy, said), (remedy, said)
        assert _said(then, *with_records) is None, (remedy, _said(then, *with_records))
        told.append(said)
    patterns = {p for m in (identification, loads, prepare, scene_records, segmented, unknowns)
                for p in advising(inspect.getsource(m))}  # fmt: skip
    met = [p for p in patterns if any(re.search(p, said) for said in told)]
    assert len(met) > 12
    left = [p for p in patterns if p not in met and not any(re.escape(words) in p for words in NOT_MET)]
    assert left == [], left


def test_a_refused_question_about_a_fit_is_answered_with_the_remedy_that_is_named(tmp_path):
    for refused, remedy, mended in _documents(tmp_path):
        with pytest.raises(FitError, match=remedy):
            refused()
        assert mended() is not None
