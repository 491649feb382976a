"""What to change so that sliding is steady: limits that an independent integrator confirms, with their intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify import Scene
from identify.base.errors import SimulationError
from identify.base.result import Result
from identify.cli.main import main
from identify.effects import MAIN
from identify.prediction import sources
from identify.prediction.axes import axis
from identify.prediction.maps import _change, stabilising_changes
from tests.support import oracle
from tests.support.maps_case import DEMO, SITE

SPEED, LOAD = 15e-3, SITE.normal_force
TESTED = sources.Tested({"drive_speed": (1e-6, 1.4e-2), "normal_force": (0.4, 1.0), "stiffness": (1470.0, 1470.0)})


def sticks(values: dict[str, float], speed: float, load: float) -> bool:
    """Brute force by an independent integrator: whether the mass comes to rest again, kicked off by a rested contact
    and by what it was left in."""
    state: oracle.State = (0.0, 0.0, 1.0)
    wait = 2 * values["mu_s"] * load / (values["stiffness"] * speed)
    slip = 2 * np.pi * np.sqrt(values["mass"] / values["stiffness"])
    for _ in range(25):
        run = oracle.simulate(values, speed, load, wait + 8 * slip, state, rtol=1e-9)
        if run.onsets.size == 0 or run.arrests.size == 0:
            return False
        x, v, gamma = run.arrest_states[0]
        state = (float(x), float(v), float(gamma))
    return True


@pytest.fixture(scope="module")
def advice():
    return stabilising_changes(replace(SITE, drive_speed=SPEED), TESTED)


def test_a_limit_is_that_of_brute_force(advice):
    (limit,) = (row.limit.value for row in advice.changes if row.quantity == "normal_force")
    assert [sticks(DEMO, SPEED, share * limit) for share in (1.02, 0.98)] == [True, False]


def test_advice_keeps_the_margin_and_names_what_is_extrapolated(advice):
    assert not advice.steady
    for row in advice.changes:
        factor = 1.2 if row.at == "least" else 1 / 1.2
        assert row.advised.value == pytest.approx(factor * row.limit.value)
    flags = {row.quantity: row.extrapolated for row in advice.changes}
    assert flags["drive_speed"] and flags["stiffness"] and not flags["mass"] and not flags["normal_force"]
    assert "damping h at least" in advice.text and "extrapolated: outside the tested range" in advice.text


def test_what_is_steady_is_seen_and_what_cannot_be_reached():
    far, slow = (replace(SITE, drive_speed=speed) for speed in (4e-2, 1e-4))
    speed = _change(far, axis(far, "drive_speed"), None, 0.2)
    assert speed.at == "least" and speed.limit.value < 4e-2 == speed.advised.value and "as it is" in speed.text
    mass = _change(slow, axis(slow, "mass"), None, 0.2)
    assert mass.limit.value is None and "cannot be reached" in mass.reason
    with pytest.raises(SimulationError, match="not zero and a positive"):
        stabilising_changes(replace(SITE, drive_speed=0.0))


def test_tested_range_of_a_result():
    logs = [
        {"drive_speed_m_per_s": 1e-3, "normal_force_N": 1.0, "reason_left_out": None},
        {"drive_speed_m_per_s": -5e-3, "normal_force_N": 2.0, "reason_left_out": None},
        {"drive_speed_m_per_s": 1.0, "normal_force_N": 9.0, "reason_left_out": "it slides"},
    ]
    entries = [{"path": f"{i}.csv"} for i in range(3)]
    entries[1]["stiffness"] = 2000.0
    stated = {"mass": 0.2, "damping": 147.0, "stiffness": {"value": 1000.0, "tolerance": 0.01}, "drive_speed": 1e-3}
    scene = Scene.from_document({"effects": list(MAIN), "rig": stated, "logs": entries}).as_document()
    found = sources.Tested.of_result(Result.from_dict({"logs": logs, "provenance": {"scene": scene}}))
    assert found.ranges == {"drive_speed": (1e-3, 5e-3), "normal_force": (1.0, 2.0), "stiffness": (1000.0, 2000.0)}
    assert found.extrapolated("drive_speed", 6e-3) and not found.extrapolated("drive_speed", -5.4e-3)
    assert not found.extrapolated("mass", 1e9) and sources.Tested({}).extrapolated("stiffness", 1.0)


def test_a_margin_of_zero_is_refused(capsys):
    assert main(["stability", "--scene", "scene.toml", "--advice", "0 %"]) == 2
    assert "above zero" in capsys.readouterr().err
