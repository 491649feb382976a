"""What to change so that sliding is steady: limits that an independent integrator confirms, with their intervals."""

from __future__ import annotations

import json

import numpy as np
import pytest

from identify.base.errors import SimulationError
from identify.base.result import Result
from identify.cli.main import main
from identify.prediction.axes import axis
from identify.prediction.draws import OperatingPoint
from identify.prediction.sources import Tested
from identify.prediction.stabilising import nearest_turn, stabilising_changes
from tests.prediction.test_draws import SCENE
from tests.support import oracle
from tests.support.maps_case import DEMO, SITE

MODEL, SPEED, LOAD = SITE.model, 15e-3, 1.0
TESTED = Tested({"drive_speed": (1e-6, 1.4e-2), "normal_force": (0.4, 1.0), "stiffness": (1470.0, 1470.0)})


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
    covariance = np.diag([(0.01 * abs(v)) ** 2 for v in DEMO.values()])
    return stabilising_changes(MODEL, OperatingPoint(DEMO, SPEED, LOAD, covariance), tuple(DEMO), TESTED, draws=60)


def test_limits_are_those_of_brute_force(advice):
    rows = {row.quantity: row for row in advice.changes}
    for quantity in ("damping", "normal_force"):
        limit, loud = rows[quantity].limit.value, -1 if rows[quantity].at == "least" else 1
        answers = []
        for side in (loud, -loud):
            moved = limit * (1 + 0.02 * side)
            load = moved if quantity == "normal_force" else LOAD
            values = DEMO if quantity == "normal_force" else {**DEMO, quantity: moved}
            answers.append(sticks(values, SPEED, load))
        assert answers == [True, False], quantity


def test_advice_keeps_the_margin_and_names_what_is_extrapolated(advice):
    assert not advice.steady
    for row in advice.changes:
        factor = 1.2 if row.at == "least" else 1 / 1.2
        assert row.advised.value == pytest.approx(factor * row.limit.value)
        low, high = row.limit.ends
        assert low is None or low < row.limit.value < high
    flags = {row.quantity: row.extrapolated for row in advice.changes}
    assert flags["drive_speed"] and flags["stiffness"] and not flags["mass"] and not flags["normal_force"]
    assert "damping h at least" in advice.text and "extrapolated: outside the tested range" in advice.text


def test_the_interval_of_a_limit_is_how_far_it_moves():
    """Limits of points whose a is 2 sd off, searched again, are the ends of the interval where a alone is uncertain."""
    point = OperatingPoint(DEMO, SPEED, LOAD, np.array([[(0.01 * DEMO["a"]) ** 2]]))
    rows = {row.quantity: row.limit for row in stabilising_changes(MODEL, point, ("a",), draws=100).changes}
    for name in ("damping", "mass"):
        ends = []
        for side in (-1.0, 1.0):
            site = type(SITE)(MODEL, DEMO | {"a": DEMO["a"] * np.exp(side * 1.959964 * 0.01)}, SPEED, LOAD)
            q = axis(site, name)
            ends.append(q.value_at(nearest_turn(site, q)[1].place))
        assert rows[name].interval == pytest.approx(sorted(ends), rel=2e-3), name
        assert max(ends) / min(ends) > 1.005


def test_a_quantity_that_is_set_wrong_now_is_so_at_its_limit():
    """Stiffness known to 2 %, all else exact: the value to be set is off by as much as the one that is."""
    point = OperatingPoint(DEMO, SPEED, LOAD, np.array([[29.4**2]]))
    found = stabilising_changes(MODEL, point, ("stiffness",), draws=100)
    (limit,) = (row.limit for row in found.changes if row.quantity == "stiffness")
    assert limit.interval == pytest.approx([limit.value / 1.04, limit.value * 1.04], rel=5e-3)


def test_what_is_steady_stays_as_it_is_and_what_cannot_be_is_said():
    far = stabilising_changes(MODEL, OperatingPoint(DEMO, 4e-2, LOAD))
    rows = {row.quantity: row for row in far.changes}
    assert far.steady and rows["drive_speed"].advised.value == 4e-2 and rows["drive_speed"].limit.interval is None
    slow = stabilising_changes(MODEL, OperatingPoint(DEMO, 1e-4, LOAD))
    mass = next(row for row in slow.changes if row.quantity == "mass")
    assert mass.limit.value is None and "cannot be reached" in slow.text and "2 g to 20 kg" in slow.text
    with pytest.raises(SimulationError, match="expected positive numbers"):
        stabilising_changes(MODEL, OperatingPoint(DEMO, 0.0, LOAD))


def test_an_open_interval_of_a_limit_gives_its_reason():
    point = OperatingPoint(DEMO, SPEED, LOAD, np.diag([1e-6, np.inf]))
    limit = stabilising_changes(MODEL, point, ("mu_s", "t_cr"), draws=5).changes[0].limit
    assert limit.interval == (None, None) and "t_cr, on which it depends" in limit.reason


def test_tested_range_of_a_result():
    logs = [
        {"drive_speed_m_per_s": 1e-3, "normal_force_N": 1.0, "reason_left_out": None},
        {"drive_speed_m_per_s": -5e-3, "normal_force_N": 2.0, "reason_left_out": None},
        {"drive_speed_m_per_s": 1.0, "normal_force_N": 9.0, "reason_left_out": "it slides"},
    ]
    scene = {"rig": {"stiffness": {"value": 1000.0, "tolerance": 0.01}}, "logs": [{}, {"stiffness": 2000.0}, {}]}
    found = Tested.of_result(Result.from_dict({"logs": logs, "provenance": {"scene": scene}}))
    assert found.ranges == {"drive_speed": (1e-3, 5e-3), "normal_force": (1.0, 2.0), "stiffness": (1000.0, 2000.0)}
    assert found.extrapolated("drive_speed", 6e-3) and not found.extrapolated("drive_speed", -5.4e-3)
    assert not found.extrapolated("mass", 1e9) and Tested({}).extrapolated("stiffness", 1.0)


def test_the_command_line_prints_it(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    more = 'mu_k0 = { start = 0.43 }\ndelta_mu_k = { start = -0.13 }\na = { start = "300 s/m" }\n'
    more += 'D = { start = "37.4 um" }\nt_cr = { start = "0.5 s" }\n'
    path.write_text((SCENE + more).replace("1 mm/s", "22 mm/s"))
    assert main(["stability", "--scene", str(path), "--advice", "10 %", "--json"]) == 0
    point = json.loads(capsys.readouterr().out)["points"][0]
    assert point["advice"]["margin"] == pytest.approx(0.1) and 0.0 < point["stability"]["probability"]["value"] < 1.0
    speed = point["advice"]["changes"][0]
    assert speed["advised"]["value"] == pytest.approx(1.1 * speed["limit"]["value"])
    assert main(["stability", "--scene", str(path), "--advice", "0 %"]) == 2
    assert "above zero" in capsys.readouterr().err
