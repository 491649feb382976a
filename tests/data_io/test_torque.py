"""Torques act at an arm and stresses on an area: the same record as that of the forces, to the last digit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_io import LogError, read_log
from identify import Scene
from identify.effects import MAIN
from identify.logs.scene_records import read_entry

TIME, LOAD = np.arange(200) / 100.0, 3.0
FRICTION = np.round(1.0 + 0.5 * np.sin(TIME), 6)  # [N]
ARM, AREA = 0.025, 2e-4  # [m], [m^2]


def _log(path: Path, friction: tuple[str, np.ndarray], normal: tuple[str, float]) -> Path:
    head = f"Time (s),{normal[0]},{friction[0]}"
    rows = (f"{t:.2f},{normal[1]:.9g},{f:.12g}" for t, f in zip(TIME, friction[1], strict=True))
    path.write_text("\n".join((head, *rows)) + "\n")
    return path


def _forces(path: Path) -> tuple[np.ndarray, np.ndarray]:
    record = read_log(path)
    return record.friction_force, record.normal_force


@pytest.mark.parametrize(
    "name, per_newton",
    [("Torque (N·m)", ARM), ("Torque [Nm]", ARM), ("TOB (N*m)", ARM), ("Torque (mN·m)", 1e3 * ARM),
     ("Torque (lbf·ft)", ARM / 1.3558179483314004)],
)  # fmt: skip
def test_a_torque_over_its_arm_is_the_force(tmp_path, name, per_newton):
    forces = _forces(_log(tmp_path / "force.csv", ("Fx (N)", FRICTION), ("Fz (N)", LOAD)))
    torque = _log(tmp_path / "torque.csv", (name, per_newton * FRICTION), ("Fz (N)", LOAD))
    record = read_log(torque, arm="25 mm")
    np.testing.assert_allclose(record.friction_force, forces[0], rtol=1e-11)
    np.testing.assert_array_equal(record.normal_force, forces[1])
    assert "force_from_torque" in [finding.code for finding in record.findings]
    if per_newton == ARM:
        np.testing.assert_array_equal(np.float64(record.friction_force).round(12), forces[0].round(12))


def test_stresses_on_an_area_are_the_forces(tmp_path):
    forces = _forces(_log(tmp_path / "force.csv", ("Fx (N)", FRICTION), ("Fz (N)", LOAD)))
    path = _log(tmp_path / "stress.csv", ("tau (kPa)", 1e-3 * FRICTION / AREA), ("sigma_n (kPa)", 1e-3 * LOAD / AREA))
    record = read_log(path, area="2 cm^2")
    np.testing.assert_allclose(record.friction_force, forces[0], rtol=1e-11)
    np.testing.assert_allclose(record.normal_force, forces[1], rtol=1e-11)


def test_a_weight_on_bit_in_kip_is_a_load(tmp_path):
    path = _log(tmp_path / "bit.csv", ("Torque (kNm)", 1e-3 * ARM * FRICTION), ("WOB (kip)", LOAD))
    assert read_log(path, arm=ARM).normal_force[0] == pytest.approx(LOAD * 4448.2216152605, rel=1e-12)


@pytest.mark.parametrize(
    "friction, normal, remedy",
    [(("Torque (N·m)", ARM), "Fz (N)", r'is a torque .* --arm "25 mm"'),
     (("tau (MPa)", 1e-6 / AREA), "Fz (N)", r'is a stress .* --area "2 cm\^2"'),
     (("Fx (N)", 1.0), "sigma_n (kPa)", r'is a stress .* --area "2 cm\^2"')],
)  # fmt: skip
def test_without_an_arm_or_an_area_the_remedy_is_named(tmp_path, friction, normal, remedy):
    path = _log(tmp_path / "log.csv", (friction[0], friction[1] * FRICTION), (normal, LOAD))
    with pytest.raises(LogError, match=remedy):
        read_log(path)


def test_a_coefficient_is_taken_before_a_torque(tmp_path):
    path = tmp_path / "pin.csv"
    rows = "\n".join(f"{t:.2f},3.0,0.4,0.03" for t in TIME)
    path.write_text(f"Time (s),Fz (N),COF,Torque (N·m)\n{rows}\n")
    assert read_log(path).friction_force[0] == pytest.approx(1.2)


@pytest.mark.parametrize("where", ["rig", "log"])
def test_a_scene_names_the_arm(tmp_path, where):
    _log(tmp_path / "torque.csv", ("Torque (N·m)", ARM * FRICTION), ("Fz (N)", LOAD))
    rig = {"mass": "0.2 kg", "stiffness": "1470 N/m", "zeta": 0.05, "drive_speed": "1 mm/s"}
    entry = {"path": "torque.csv"}
    (rig if where == "rig" else entry)["arm"] = "25 mm"
    scene = Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": [entry]}, tmp_path)
    record = read_entry(Scene.from_document(scene.as_document(), tmp_path), 0)
    np.testing.assert_allclose(record.friction_force, FRICTION, rtol=1e-11)
