"""What a scene states counts as stated, whatever its value: also where it equals the documented default."""

import pytest

from identify.diagnosis.effect_choice import choose_from_numbers
from identify.effects import ALL
from identify.scene import Scene

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "drive_speed": 1e-3, "normal_force": 4.0}
PAIR = {"mu_s": 0.6, "mu_k0": 0.45, "delta_mu_k": -0.1, "a": 500.0, "D": 37.4e-6, "t_cr": 0.5}
EVERY = [(effect.name, p) for effect in ALL for p in effect.parameters if p.kind != "rig"]


def _scene(**parameters):
    fixed = {name: {"fixed": value} for name, value in PAIR.items()}
    return Scene.from_document({"effects": "auto", "rig": RIG, "parameters": fixed | parameters})


def _reason(scene, effect):
    return next(reason for reason in choose_from_numbers(scene).reasons if reason.effect == effect)


def test_what_the_scene_leaves_out_stays_out():
    assert "gives no number" in _reason(_scene(), "load_dependence").sentence


@pytest.mark.parametrize(("effect", "parameter"), EVERY, ids=[f"{effect} {p.name}" for effect, p in EVERY])
def test_every_parameter_stated_at_its_default_is_stated(effect, parameter):
    scene = _scene(**{parameter.name: {"fixed": parameter.default}})
    assert scene.parameters[parameter.name].states_value
    assert Scene.from_document(scene.as_document()).parameters[parameter.name].states_value
    silent = Scene.from_document({"effects": "auto", "rig": RIG})
    assert not Scene.from_document(silent.as_document()).parameters[parameter.name].states_value


@pytest.mark.parametrize(
    ("stated", "effect"),
    [
        ({"direct_speed": {"fixed": 1e-4}}, "direct_effect"),
        ({"lag_time": {"fixed": next(p.default for e, p in EVERY if p.name == "lag_time")}}, "sensor_lag"),
        ({"skin_retardation": {"fixed": 2e-3}, "skin_stiffness": {"fixed": "10 N/mm"}}, "skin_compliance"),
    ],
)
def test_an_effect_spoken_of_by_its_default_is_weighed(stated, effect):
    assert "gives no number" not in _reason(_scene(**stated), effect).sentence


def test_a_reference_force_stated_at_its_default_is_kept_from_the_logs():
    scene = Scene.from_document(
        {
            "effects": "auto",
            "rig": RIG,
            "parameters": {"reference_force": {"fixed": 1.0}},
            "logs": [{"path": "log.csv"}],
        }
    )
    made = scene.with_effects(("inertia", "contact_ageing", "load_dependence"), {"reference_force": 1.2})
    assert made.parameters["reference_force"].fixed == 1.0
