"""What the looks at the logs say of an effect is where its fit starts; what the scene says stands."""

import pytest

from identify.scene import Scene

EFFECTS = ("inertia", "contact_ageing", "skin_compliance", "load_dependence")


def _auto(**parameters):
    document = {
        "effects": "auto",
        "rig": {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0},
        "logs": [{"path": "log.csv", "drive_speed": 1e-3}],
    }
    return Scene.from_document(document | ({"parameters": parameters} if parameters else {}))


def test_a_scene_that_says_nothing_starts_where_the_logs_say():
    made = _auto().with_effects(EFFECTS, {"skin_stiffness": 7600.0, "reference_force": 1.2, "mu_s": 1e9})
    assert made.parameters["skin_stiffness"].start == 7600.0
    assert made.parameters["reference_force"].fixed == 1.2
    assert made.parameters["mu_s"].start == made.parameters["mu_s"].upper
    assert made.parameters["D"].start is None


@pytest.mark.parametrize("said", [{"start": "3000 N/m"}, {"fixed": "3000 N/m"}])
def test_what_the_scene_says_stands(said):
    made = _auto(skin_stiffness=said).with_effects(EFFECTS, {"skin_stiffness": 7600.0})
    kept = made.parameters["skin_stiffness"]
    assert 3000.0 in (kept.start, kept.fixed)
    assert 7600.0 not in (kept.start, kept.fixed)
