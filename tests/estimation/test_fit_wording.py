"""What is said before, instead of and after a fit: each sentence where its cause is, and with its remedy not."""

from __future__ import annotations

import re
import time
from dataclasses import replace

import numpy as np
import pytest

from data_io import Record, read_log
from data_io.values import LogError
from experiments.study_problem import DEMO, RIG, SPEEDS, simulated_case
from identify import FitError, Scene, fit
from identify.base.errors import IdentifyError
from identify.base.progress import Notice
from identify.effects import MAIN
from identify.estimation.fit_wording import prefit_warnings, wrong_unit
from identify.estimation.preview import preview
from identify.examples import FOLDER, SCENE
from identify.logs.prepare import prepare
from identify.logs.scene_records import with_drives, with_records
from identify.logs.unknowns import from_scene

KILOGRAM = 9.80665
DRIVE = 'rig.drive_speed="1 mm/s"'


class _SearchBeganError(Exception):
    """The search has begun."""


def before_the_search(scene, records):
    """Sentences that stay, and the seconds of processor time until the last of them."""
    said, began = [], time.process_time()

    def listen(stage, _share):
        if isinstance(stage, Notice):
            said.append((str(stage), time.process_time() - began))
        if stage in ("finding a start", "fitting all that plainly matters"):
            raise _SearchBeganError

    with pytest.raises(_SearchBeganError):
        fit(scene, records, progress=listen)
    return said


def example(stiffness, *settings):
    scene = Scene.from_toml(FOLDER / "pair.toml", [f"rig.stiffness={stiffness}", *settings])
    return with_records(with_drives(scene)[0], None)


@pytest.mark.parametrize("settings", [(), ('effects="auto"',)])
def test_a_stiffness_that_all_sticks_contradict_is_said_before_the_search(settings):
    """And before effects are chosen, which takes minutes; a preview says it too, and the advised entry ends it."""
    ((sentence, seconds),) = before_the_search(*example('"1720 N/m"', *settings))
    assert sentence.startswith("in the sticks of all logs the force rises at 0.85") and seconds < 2.0
    assert before_the_search(*example('"1470 N/m"', *settings)) == []
    if not settings:
        assert preview(*example('"1720 N/m"')).notices == [sentence]
        (advised,) = re.findall(r"\[parameters\] (stiffness = \{.*?\})", sentence)
        scene, records = example('"1720 N/m"', f"parameters.{advised.replace(' = ', '=', 1)}")
        unknowns = from_scene(scene)
        logs = [prepare(scene, *of_log, unknowns) for of_log in zip(scene.logs, records, strict=True)]
        assert prefit_warnings(logs) == []


def test_a_wrong_unit_ends_a_fit_and_a_preview_at_once():
    scene, records = example('"1470 kN/m"')
    result = fit(scene, records).result
    assert result["status"] == "model_misfit" and "check the units" in result["message"] and result["search"] == []
    with pytest.raises(FitError, match="check the units"):
        preview(scene, records)


@pytest.mark.parametrize(
    ("times", "placed", "wrong"),
    [
        *((1e3, True, True), (1e-3, True, True), (1 / KILOGRAM, False, True)),
        *((1.0, False, False), (1 / KILOGRAM, True, False), (3.0, True, False)),
    ],
)
def test_a_wrong_unit_is_told_by_its_factor_and_what_a_soft_skin_can_be_is_none(times, placed, wrong):
    logs = [{"path": "log.csv", "drive_speed": SPEEDS[2][0]}]
    scene = Scene.from_document({"effects": list(MAIN), "rig": RIG, "logs": logs})
    record = simulated_case(DEMO, 3).records[2]
    record = replace(record, friction_force=times * record.friction_force)
    log = prepare(scene, scene.logs[0], record, from_scene(scene))
    assert ("check the units" in wrong_unit([log], placed=placed)) == wrong


FIXED = {"mu_s": 0.6, "mu_k0": 0.45, "delta_mu_k": -0.1, "a": 500.0, "D": 40e-6, "t_cr": 0.5}


@pytest.mark.parametrize(
    ("effects", "parameters", "words"),
    [
        (["inertia", "force_sensor"], {"averaging_time": "1 ms"}, "averaging_time is 0.001 s.*leave it at 0"),
        (MAIN, {name: {"fixed": value} for name, value in FIXED.items()}, "fixes every parameter.*--preview"),
        (["contact_ageing"], {}, "inertia is off"),
        (["inertia", "friction_heterogeneity"], {}, None),  # which asks for the estimator of uneven records
        (MAIN, {name: {"fixed": value} for name, value in FIXED.items() if name != "t_cr"}, None),
    ],
)
def test_what_no_fit_can_have_is_refused_before_a_log_is_read(effects, parameters, words):
    logs = [{"path": "log.csv", "drive_speed": 1e-3}]
    scene = Scene.from_document({"effects": list(effects), "rig": RIG, "logs": logs, "parameters": parameters})
    with pytest.raises(LogError if words is None else FitError, match=words or r"log\.csv"):
        fit(scene)


def _refused(settings, *records):
    """Why no search begins; None where one does."""

    def listen(stage, _share):
        if stage == "finding a start" and not isinstance(stage, Notice):
            raise _SearchBeganError

    listed = ", ".join(f'{{path = "log_{n}.csv"}}' for n in range(len(records)))
    try:
        result = fit(Scene.from_toml(SCENE, [f"logs=[{listed}]", *settings]), list(records), progress=listen).result
    except _SearchBeganError:
        return None
    except (FitError, IdentifyError) as error:
        return str(error)
    return " ".join([result["message"], *(log["reason_left_out"] or "" for log in result["logs"])])


def _cases():
    """What is set and read, the remedy that the sentence names, and what is set and read with it."""
    log = read_log(SCENE.parent / "1_mm_per_s.txt.gz", step=2)  # 13 cycles in 4 s
    plain = Record(log.time, log.normal_force, log.friction_force)
    short = Record(*(column[:7] for column in (log.time, log.normal_force, log.friction_force)))
    falling = replace(plain, normal_force=np.where(log.time < 2.0, log.normal_force, 0.0))
    turning = replace(plain, friction_force=np.where(log.time < 2.0, 1.0, -1.0) * log.friction_force)
    yield [], (plain,), "give drive_speed = ", ['logs.1.drive_speed="1 mm/s"'], (plain,)
    yield [DRIVE], (plain, plain), "remove one of the two logs", [DRIVE], (plain,)
    yield [DRIVE, "logs.1.window=[1, 1.005]"], (plain,), "widen it", [DRIVE, "logs.1.window=[1, 4]"], (plain,)
    yield [DRIVE, "logs.1.exclude=[[0, 4]]"], (plain,), "exclude less", [DRIVE, "logs.1.exclude=[[0, 1]]"], (plain,)
    yield [DRIVE], (short,), "record longer", [DRIVE], (plain,)
    yield ['rig.drive_speed="0 mm/s"'], (plain,), "give the speed it moved at", [DRIVE], (plain,)
    yield [DRIVE], (turning,), "or a window of one stroke", [DRIVE, "logs.1.window=[0, 2]"], (turning,)
    yield [DRIVE], (falling,), "cut the window to the part under load", [DRIVE, "logs.1.window=[0, 1.9]"], (falling,)
    yield [DRIVE, "logs.1.skip_cycles=50"], (plain,), "lower it", [DRIVE, "logs.1.skip_cycles=2"], (plain,)


def test_a_refused_fit_begins_with_the_remedy_that_is_named():
    for settings, records, remedy, then, with_records_ in _cases():
        said = _refused(settings, *records)
        assert said is not None and remedy in said, (remedy, said)
        assert _refused(then, *with_records_) is None, remedy
