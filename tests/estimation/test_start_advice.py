"""What sentences advise of start values is what a scene takes."""

import re
import tomllib

import pytest

from identify import Scene
from identify.base.errors import SceneError
from identify.base.wording import START_VALUES
from identify.estimation.status_words import prefit_warnings
from identify.examples import SCENE
from identify.logs.prepare import prepare
from identify.logs.scene_records import with_drives, with_records
from identify.logs.unknowns import from_scene


def test_the_advised_entry_is_one_that_a_scene_takes():
    scene = Scene.from_toml(SCENE)
    (entry,) = re.findall(r"mu_s = \{.*?\}", START_VALUES)
    started = Scene.from_toml(SCENE, [f"parameters.{entry.replace(' = ', '=', 1)}"])
    assert started.parameters["mu_s"].start == tomllib.loads(entry)["mu_s"]["start"]
    assert scene.parameters["mu_s"].start is None


def test_a_stiffness_that_is_advised_as_a_start_is_not_doubted_again():
    def early(*settings):
        scene, records = with_records(with_drives(Scene.from_toml(SCENE, settings))[0], None)
        unknowns = from_scene(scene)
        return prefit_warnings([prepare(scene, *of_log, unknowns) for of_log in zip(scene.logs, records, strict=True)])

    (sentence,) = early('rig.stiffness="1720 N/m"')
    (advised,) = re.findall(r"\[parameters\] (stiffness = \{.*?\})", sentence)
    assert early('rig.stiffness="1720 N/m"', f"parameters.{advised.replace(' = ', '=', 1)}") == []


def test_a_start_of_kinetic_friction_below_static_friction_is_taken():
    with pytest.raises(SceneError, match=r"give \[parameters\] a start of mu_k0 below that of mu_s"):
        Scene.from_toml(SCENE, ["parameters.mu_k0={start=0.9}"])
    assert Scene.from_toml(SCENE, ["parameters.mu_k0={start=0.9}", "parameters.mu_s={start=1.0}"])
    assert Scene.from_toml(SCENE, ["parameters.mu_k0={start=0.3}"])
