"""Scenes with every effect: documents, parameters that are held, areas, effects and starts left to be chosen."""

import json
import math

import pytest
from jsonschema import Draft202012Validator

from identify.base.errors import SceneError
from identify.effects import ALL, MAIN, NAMES
from identify.model.model import assemble
from identify.scene import Scene

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "drive_speed": 0.01, "normal_force": 1.0}


def scene_of(effects, more=None, **tables):
    return Scene.from_document({"effects": effects, "rig": RIG | (more or {}), **tables})


def with_effect(name):
    """The paper's effects, what the effect needs, and itself in place of its rivals."""
    effect = next(e for e in ALL if e.name == name)
    rivals = [e.name for e in ALL if e.role and e.role == effect.role]
    return [n for n in dict.fromkeys((*MAIN, *effect.needs)) if n not in (*rivals, name)] + [name]


def _measured(effect):
    return [effect.name] if effect.name in ("power_law", "load_dependence", "pressure_dependence") else []


@pytest.mark.parametrize("effect", ALL, ids=NAMES)
def test_scenes_with_every_effect_are_rebuilt_from_their_document(effect):
    scene = scene_of(with_effect(effect.name), extrapolate=_measured(effect), contact={"area": "1 cm^2"})
    document = json.loads(json.dumps(scene.as_document(), allow_nan=False))
    assert Scene.from_document(document) == scene
    assert Draft202012Validator(Scene.json_schema()).is_valid(document)


def test_given_parameters_are_held_unless_asked_for():
    effects = [*MAIN, "skin_compliance"]
    plain = scene_of(effects)
    damping = plain.parameters["skin_retardation"]
    assert (damping.fixed, plain.values()["skin_retardation"]) == (2e-3, 2e-3)
    assert plain.parameters["skin_stiffness"].fixed is None, "a friction parameter is searched"
    held = scene_of(effects, parameters={"skin_retardation": "7 s"})
    assert held.parameters["skin_retardation"].fixed == 7.0
    assert scene_of(effects, parameters={"skin_retardation": 7}).parameters == held.parameters
    assert scene_of(effects, parameters={"skin_retardation": {"fixed": 7}}).parameters == held.parameters
    searched = scene_of(effects, parameters={"skin_retardation": {"prior": {"mean": "7 s", "sd": "10 %"}}})
    assert searched.parameters["skin_retardation"].fixed is None
    assert searched.parameters["skin_retardation"].prior_sd == pytest.approx(0.7)


def test_driven_damping_is_that_of_its_frequency():
    scene = scene_of(["inertia", "driven_damping"], parameters={"damping_frequency": "13 Hz"})
    assert scene.values()["damping_frequency"] == 13.0
    c = float(scene.model.load([0, 0], [scene.values()[n] for n in scene.model.parameter_names], [1, 1, 1, 0]))
    assert c == pytest.approx(147.0 / (2 * math.pi * 13.0), rel=1e-14), "c = h/omega, omega of the excitation"


def test_the_area_of_contact_feeds_the_pressure():
    effects = ["inertia", "pressure_dependence"]
    assert scene_of(effects).values()["contact_area"] == 2.262e-4
    plain = scene_of(effects, contact={"area": "1 cm^2"}).values()
    assert (plain["contact_area"], plain["area_exponent"]) == pytest.approx((1e-4, 0.0))
    law = scene_of(effects, contact={"area_law": {"coefficient": "2 cm^2", "exponent": 0.3}})
    assert (law.values()["contact_area"], law.values()["area_exponent"]) == pytest.approx((2e-4, 0.3))
    # the factor on friction is (p/p_ref)^-n with p = F_n/A_c, A_c = A_1 (F_n/1 N)^e
    p = [law.values()[name] for name in law.model.parameter_names]
    pressure = 3.0 / law.contact.area_at(3.0)
    expected = 3.0 * law.values()["mu_s"] * (pressure / 4421.7) ** -0.526
    assert float(law.model.grip([0, 0], p, [0.01, 3.0, 1, 0])) == pytest.approx(expected, rel=1e-12)
    with pytest.raises(SceneError, match=r"contact_area stands in \[contact\] area and in \[parameters\]"):
        scene_of(effects, contact={"area": "1 cm^2"}, parameters={"contact_area": "2 cm^2"})


HEAVY = {"normal_force": "100 N"}


def test_effects_may_be_left_to_be_chosen():
    parameters = {"lag_time": {"start": "2 ms"}, "damping_frequency": "13 Hz", "slope": {"lower": -3}}
    scene = scene_of("auto", parameters=parameters)
    assert scene.effects == "auto" and scene.as_document()["effects"] == "auto"
    assert Scene.from_document(scene.as_document()) == scene
    every = {p.name for e in ALL for p in e.parameters}
    assert every <= set(scene.values()) and scene.values()["damping_frequency"] == 13.0
    with pytest.raises(SceneError, match="list them by name"):
        assert scene.model
    with pytest.raises(SceneError, match="did you mean 'lag_time'"):
        scene_of("auto", parameters={"lagtime": 1})


def test_the_choice_of_effects_settles_a_scene():
    scene = scene_of(
        "auto",
        parameters={"lag_time": {"start": "2 ms"}, "slope": {"lower": -3}, "mass": {"lower": 0.1, "upper": 0.4}},
        contact={"area": "1 cm^2"},
        extrapolate=["power_law"],
    )
    settled = scene.with_effects(["sensor_lag", "inertia"])
    assert settled.effects == ("inertia", "sensor_lag") and settled.extrapolate == ()
    assert settled.values()["lag_time"] == 2e-3
    assert set(settled.parameters) == {"mu_s", "mu_k0", "lag_time", "mass"}
    assert settled.model is assemble(("inertia", "sensor_lag"))
    other = settled.with_effects(["inertia", "pressure_dependence", "linear_weakening"])
    assert other.values()["contact_area"] == pytest.approx(1e-4)
    assert other.parameters["slope"].fixed is None and "lag_time" not in other.parameters
    assert scene.with_effects(["inertia", "linear_weakening"]).parameters["slope"].lower == -3.0
    with pytest.raises(SceneError, match="did you mean 'inertia'"):
        scene.with_effects(["inertie"])
    with pytest.raises(SceneError, match="keep one of them"):
        scene.with_effects(["inertia", "power_law", "linear_weakening"])
    with pytest.raises(SceneError, match=r"extrapolate = \[\"load_dependence\"\]"):
        scene_of("auto", HEAVY).with_effects(["inertia", "load_dependence"])


def test_only_a_scene_without_inertia_does_without_a_mass():
    rig = {key: value for key, value in RIG.items() if key != "mass"}
    light = Scene.from_document({"effects": ["contact_ageing"], "rig": rig})
    assert light.rig.mass == 0.0 and "mass" not in light.values() and light.rig.half_period == 0.0
    assert Scene.from_document(light.as_document()) == light
    for effects in ("auto", ["inertia"]):
        with pytest.raises(SceneError, match="has no mass"):
            Scene.from_document({"effects": effects, "rig": rig})
    with pytest.raises(SceneError, match="mass is 0 kg"):
        light.with_effects(["inertia"])


@pytest.mark.parametrize("stated", [{}, {"skin_stiffness": {"start": "3000 N/m"}}, {"skin_stiffness": {"fixed": 3000}}])
def test_what_the_scene_says_stands_and_the_rest_starts_where_the_logs_say(stated):
    rig = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
    logs = [{"path": "log.csv", "drive_speed": 1e-3}]
    scene = Scene.from_document({"effects": "auto", "rig": rig, "logs": logs, "parameters": stated})
    starts = {"skin_stiffness": 7600.0, "reference_force": 1.2, "mu_s": 1e9}
    made = scene.with_effects(("inertia", "contact_ageing", "skin_compliance", "load_dependence"), starts).parameters
    skin = made["skin_stiffness"]
    assert [v for v in (skin.start, skin.fixed) if v is not None] == [3000.0 if stated else 7600.0]
    assert made["reference_force"].fixed == 1.2 and made["mu_s"].start == made["mu_s"].upper
    assert made["D"].start is None
