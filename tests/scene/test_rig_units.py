"""What a person writes of a rig: a dashpot in N s/m, bare numbers whose unit was forgotten, bounds alone."""

import numpy as np
import pytest

from identify import Scene, SceneError

EFFECTS = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
RIG = {"mass": "0.2 kg", "stiffness": "1470 N/m", "damping": "147 N/m", "drive_speed": "1 mm/s"}


def scene(rig=None, **more):
    return Scene.from_document({"effects": EFFECTS, "rig": {**RIG, **(rig or {})}, **more})


def test_a_dashpot_is_the_same_damper_as_h_over_the_natural_frequency():
    """The force of a dashpot is c v; the one of eq. 1 is h v / omega_n."""
    omega = np.sqrt(1470.0 / 0.2)
    assert scene({"damping": "2 N s/m"}).rig.damping == pytest.approx(2.0 * omega)
    assert scene({"damping": "2 kg/s"}).rig.damping == pytest.approx(2.0 * omega)
    assert scene({"damping": {"value": "2 N s/m", "tolerance": "10 %"}}).rig.tolerances == {"damping": 0.1}
    absolute = scene({"damping": {"value": "2 N s/m", "tolerance": "0.2 N s/m"}}).rig
    assert absolute.tolerances["damping"] == pytest.approx(0.1)
    assert scene().rig.damping == 147.0


def test_a_dashpot_follows_the_stiffness_and_the_mass_of_a_log():
    logs = [
        {"path": "a.csv", "drive_speed": "1 mm/s", "stiffness": "5880 N/m"},
        {"path": "b.csv", "drive_speed": "1 mm/s", "mass": "0.8 kg"},
        {"path": "c.csv", "drive_speed": "1 mm/s", "damping": "3 N s/m", "mass": "0.8 kg"},
        {"path": "d.csv", "drive_speed": "1 mm/s"},
    ]
    omega = np.sqrt(1470.0 / 0.2)
    told = [entry.damping for entry in scene({"damping": "2 N s/m"}, logs=logs).logs]
    assert told[:3] == pytest.approx([2.0 * omega * 2, 2.0 * omega / 2, 3.0 * omega / 2]) and told[3] is None
    assert [entry.damping for entry in scene(logs=logs).logs][:2] == [None, None], "h itself follows nothing"


def test_the_unit_settles_it_and_sound_bare_numbers_stand(tmp_path):
    path = tmp_path / "scene.toml"
    rig = "mass = 0.2\nstiffness = 1470\nzeta = 0.05\ndrive_speed = 0.001\n"
    text = f"effects = {EFFECTS!r}\n[rig]\n{rig}".replace("'", '"')
    path.write_text(text)
    assert Scene.from_toml(path).rig.mass == 0.2
    path.write_text(text.replace("mass = 0.2", 'mass = "180 kg"').replace("= 0.001", '= "0.1 m/s"'))
    assert Scene.from_toml(path).rig.mass == 180.0
    assert Scene.from_document(Scene.from_toml(path).as_document()).rig.drive_speed == 0.1, "a stored scene is bare"


def test_a_quantity_that_is_searched_needs_no_value_in_the_rig():
    bounds = {"mass": {"lower": "0.1 kg", "upper": "0.4 kg"}, "damping": {"lower": 0, "upper": "200 N/m"}}
    rig = {key: value for key, value in RIG.items() if key not in bounds}
    found = Scene.from_document({"effects": EFFECTS, "rig": rig, "parameters": bounds})
    assert (found.rig.mass, found.rig.damping) == pytest.approx((0.2, 100.0))
    started = {"mass": {"start": "0.3 kg"}, "damping": {"prior": {"mean": "150 N/m", "sd": "15 N/m"}}}
    found = Scene.from_document({"effects": EFFECTS, "rig": rig, "parameters": started})
    assert (found.rig.mass, found.rig.damping) == pytest.approx((0.3, 150.0))
    with pytest.raises(SceneError, match="no mass"):
        Scene.from_document({"effects": EFFECTS, "rig": rig, "parameters": {"damping": bounds["damping"]}})
    with pytest.raises(SceneError, match="no mass"):
        Scene.from_document({"effects": EFFECTS, "rig": rig, "parameters": {**bounds, "mass": {"lower": "0.1 kg"}}})


@pytest.mark.parametrize("speed", [0.1, "100 mm/s"])
def test_a_bare_speed_of_a_fast_rig_is_si(speed):
    assert scene({"drive_speed": speed}).rig.drive_speed == pytest.approx(0.1)
    with pytest.raises(SceneError, match="which no rig has"):
        scene({"drive_speed": "1e9 m/s"})
