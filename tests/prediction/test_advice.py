"""What to change, how sure that is, and what a scene without a fit takes for uncertain."""

from __future__ import annotations

import json

import numpy as np
import pytest

from identify import Scene
from identify.base.document import to_dict
from identify.base.errors import SimulationError
from identify.base.result import Result
from identify.model.model import assemble
from identify.prediction import sources as tested
from identify.prediction.draws import Draws, OperatingPoint
from identify.prediction.predict import map_of, predict, prediction_certainty, solution_set
from identify.prediction.sources import stated
from identify.prediction.stabilising import stabilising_changes
from tests.support import oracle

EFFECTS = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
PAIR = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "a": 300.0, "D": 37.4e-6, "t_cr": 0.5}
RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
ALL = {**PAIR, **RIG}
MODEL = assemble(EFFECTS)
NAMES = tuple(ALL)
SPEED, LOAD = 15e-3, 1.0
TESTED = tested.Tested({"drive_speed": (1e-6, 1.4e-2), "normal_force": (0.4, 1.0), "stiffness": (1470.0, 1470.0)})


def covariance(share: float, names: tuple[str, ...] = NAMES) -> np.ndarray:
    return np.diag([(share * abs(ALL.get(name, SPEED))) ** 2 for name in names])


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
def told() -> dict[str, dict[str, object]]:
    found = to_dict(
        stabilising_changes(MODEL, OperatingPoint(ALL, SPEED, LOAD, covariance(0.01)), NAMES, TESTED, draws=60)
    )
    return {"all": found, **{row["quantity"]: row for row in found["changes"]}}


@pytest.mark.parametrize("quantity", ["damping", "normal_force"])
def test_a_limit_is_one_for_brute_force_too(told, quantity):
    limit, loud = told[quantity]["limit"]["value"], -1 if told[quantity]["at"] == "least" else 1
    answers = []
    for side in (loud, -loud):
        values, load = dict(ALL), LOAD
        if quantity == "normal_force":
            load = limit * (1 + 0.02 * side)
        else:
            values[quantity] = limit * (1 + 0.02 * side)
        answers.append(sticks(values, SPEED, load))
    assert answers == [True, False]


def test_the_interval_of_a_limit_is_how_far_it_moves():
    """Limits of points whose a is 2 sd off, searched again, are the ends of the interval where a alone is uncertain."""
    sd, names = 0.01 * ALL["a"], ("a",)
    found = stabilising_changes(MODEL, OperatingPoint(ALL, SPEED, LOAD, np.array([[sd**2]])), names, draws=100)
    rows = {row.quantity: row.limit for row in found.changes}
    outer = [
        {
            row.quantity: row.limit.value
            for row in stabilising_changes(MODEL, OperatingPoint(moved, SPEED, LOAD)).changes
        }
        for moved in (ALL | {"a": ALL["a"] * np.exp(side * 1.959964 * 0.01)} for side in (-1.0, 1.0))
    ]
    for name in ("drive_speed", "damping", "mass", "normal_force"):
        ends = sorted(each[name] for each in outer)
        assert rows[name].interval == pytest.approx(ends, rel=2e-3), name
        assert ends[1] / ends[0] > 1.005


def test_a_quantity_that_is_set_wrong_now_is_so_at_its_limit():
    """Stiffness known to 2 %, all else exact: the value to be set is off by as much as the one that is."""
    found = stabilising_changes(
        MODEL, OperatingPoint(ALL, SPEED, LOAD, np.array([[29.4**2]])), ("stiffness",), draws=100
    )
    (limit,) = (row.limit for row in found.changes if row.quantity == "stiffness")
    assert limit.interval == pytest.approx([limit.value / 1.04, limit.value * 1.04], rel=5e-3)


def test_advice_keeps_the_margin_and_says_what_is_extrapolated(told):
    for row in told["all"]["changes"]:
        factor = 1.2 if row["at"] == "least" else 1 / 1.2
        assert row["advised"]["value"] == pytest.approx(factor * row["limit"]["value"])
        low, high = row["limit"]["interval"] or (None, None)
        assert low is None or low < row["limit"]["value"] < high
    flags = {row["quantity"]: row["extrapolated"] for row in told["all"]["changes"]}
    assert flags["drive_speed"] and flags["stiffness"] and not flags["mass"] and not flags["normal_force"]
    text = told["all"]["text"]
    assert "damping h at least" in text and "ζ = " in text and "extrapolated: outside the tested range" in text
    assert not told["all"]["steady"]


def test_what_is_steady_stays_as_it_is_and_what_cannot_be_is_said():
    far = to_dict(stabilising_changes(MODEL, OperatingPoint(ALL, 4e-2, LOAD)))
    rows = {row["quantity"]: row for row in far["changes"]}
    assert far["steady"] and rows["drive_speed"]["advised"]["value"] == 4e-2 and "as it is" in far["text"]
    assert rows["drive_speed"]["limit"]["interval"] is None
    slow = to_dict(stabilising_changes(MODEL, OperatingPoint(ALL, 1e-4, LOAD)))
    mass = next(row for row in slow["changes"] if row["quantity"] == "mass")
    assert mass["limit"]["value"] is None and "cannot be reached" in slow["text"] and "2 g to 20 kg" in slow["text"]
    with pytest.raises(SimulationError, match="expected positive numbers"):
        to_dict(stabilising_changes(MODEL, OperatingPoint(ALL, 0.0, LOAD)))


def test_at_the_end_of_stick_slip_its_probability_is_a_half():
    sure = prediction_certainty(MODEL, OperatingPoint(ALL, 5e-3, LOAD, covariance(0.01)), NAMES, 150)
    assert sure.possible is not None and sure.possible.value == 1.0 and sure.possible.interval[1] == 1.0
    assert sure.certain is not None and sure.certain.value == 1.0 and sure.draws == 150
    end = solution_set(map_of(MODEL, OperatingPoint(ALL, 5e-3, LOAD)), 5e-3).end
    assert end is not None
    edge = prediction_certainty(MODEL, OperatingPoint(ALL, 0.9999 * end, LOAD, covariance(0.01)), NAMES, 150)
    assert edge.possible is not None and abs(edge.possible.value - 0.5) < 3 * np.sqrt(0.25 / 150)
    assert edge.possible.interval[0] < edge.possible.value < edge.possible.interval[1]
    assert edge.certain is not None and edge.certain.value == 0.0
    assert edge.text.startswith("Probability of stick-slip at 22 mm/s and 1 N: ")


def test_what_is_open_has_no_probability():
    wide = covariance(0.01)
    wide[NAMES.index("t_cr"), NAMES.index("t_cr")] = np.inf
    found = prediction_certainty(MODEL, OperatingPoint(ALL, 1e-3, LOAD, wide), NAMES)
    assert found.possible is None and found.open == ("t_cr",)
    values = ALL | {"drive_speed": 1e-3, "normal_force": 1.0}
    drawn = Draws.of(MODEL, values, NAMES, wide, 50)
    creep = drawn.column("t_cr")
    assert drawn.open == (("t_cr",),) and len(creep) == 52
    assert np.all(creep[:50] == ALL["t_cr"]) and creep[50] > ALL["t_cr"] > creep[51]


def test_draws_have_the_covariance_and_are_possible():
    names = (*NAMES, "drive_speed")
    matrix = covariance(0.02, names)
    matrix[0, 1] = matrix[1, 0] = 0.8 * np.sqrt(matrix[0, 0] * matrix[1, 1])
    values = ALL | {"drive_speed": SPEED, "normal_force": 1.0}
    drawn = Draws.of(MODEL, values, names, matrix, 20000, 1)
    assert drawn.refused == 0 and np.all(drawn.settings[:, -2] == 1.0)
    columns = [*(drawn.settings[:, MODEL.parameter_names.index(n)] for n in NAMES), drawn.settings[:, -1]]
    np.testing.assert_allclose(
        np.cov(np.array(columns)) / np.sqrt(np.outer(np.diag(matrix), np.diag(matrix))),
        matrix / np.sqrt(np.outer(np.diag(matrix), np.diag(matrix))),
        atol=0.04,
    )
    broad = Draws.of(MODEL, values, ("mu_s", "mu_k0"), np.diag([0.2**2, 0.2**2]), 2000)
    assert 100 < broad.refused < 1500
    static, kinetic = (broad.settings[:, MODEL.parameter_names.index(n)] for n in ("mu_s", "mu_k0"))
    assert np.all(static > kinetic) and np.all(kinetic > 0.13)


SCENE = """
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
[rig]
mass = { value = "0.2 kg", tolerance = "2 %" }
stiffness = "1470 N/m"
damping = "147 N/m"
drive_speed = { value = "1 mm/s", tolerance = "1 %" }
normal_force = "1 N"
[parameters]
mu_s = { prior = { mean = 0.6, sd = 0.02 } }
"""


def test_stated_tolerances_are_a_covariance(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    scene = Scene.from_toml(path)
    found = stated(scene, scene.values(None), 1e-3)
    assert found is not None
    sd = dict(zip(found[0], np.sqrt(np.diag(found[1])).tolist(), strict=True))
    assert sd == pytest.approx({"mass": 0.004, "drive_speed": 1e-5, "mu_s": 0.02})
    path.write_text(SCENE.replace(', tolerance = "2 %"', "").replace(', tolerance = "1 %"', "").split("[param")[0])
    scene = Scene.from_toml(path)
    assert stated(scene, scene.values(None), 1e-3) is None


def test_tested_range_of_a_result():
    logs = [
        {"drive_speed_m_per_s": 1e-3, "normal_force_N": 1.0, "reason_left_out": None},
        {"drive_speed_m_per_s": -5e-3, "normal_force_N": 2.0, "reason_left_out": None},
        {"drive_speed_m_per_s": 1.0, "normal_force_N": 9.0, "reason_left_out": "it slides"},
    ]
    scene = {"rig": {"stiffness": 1000.0}, "logs": [{}, {"stiffness": 2000.0}, {}]}
    found = tested.Tested.of_result(Result.from_dict({"logs": logs, "provenance": {"scene": scene}}))
    assert found.ranges == {"drive_speed": (1e-3, 5e-3), "normal_force": (1.0, 2.0), "stiffness": (1000.0, 2000.0)}
    scene["rig"] = {"stiffness": {"value": 1000.0, "tolerance": 0.01}}
    assert tested.Tested.of_result(Result.from_dict({"logs": logs, "provenance": {"scene": scene}})) == found
    assert found.extrapolated("drive_speed", 6e-3) and not found.extrapolated("drive_speed", -5.4e-3)
    assert not found.extrapolated("mass", 1e9) and tested.Tested({}).extrapolated("stiffness", 1.0)


FULL_SCENE = (
    SCENE
    + """
mu_k0 = { start = 0.43 }
delta_mu_k = { start = -0.13 }
a = { start = "300 s/m" }
D = { start = "37.4 um" }
t_cr = { start = "0.5 s" }
"""
)


def test_the_command_line_says_it(tmp_path, capsys):
    from identify.cli.main import main

    path = tmp_path / "scene.toml"
    path.write_text(FULL_SCENE.replace("1 mm/s", "22 mm/s"))
    code = main(["stability", "--scene", str(path), "--advice", "10 %", "--draws", "20", "--json"])
    point = json.loads(capsys.readouterr().out)["points"][0]
    assert code == 0 and point["advice"]["margin"] == pytest.approx(0.1)
    assert point["sureness"]["draws"] + point["sureness"]["refused"] == 20
    assert 0.0 < point["sureness"]["possible"]["value"] < 1.0
    speed = point["advice"]["changes"][0]
    assert speed["advised"]["value"] == pytest.approx(1.1 * speed["limit"]["value"])
    assert speed["limit"]["interval"][0] < speed["limit"]["value"]
    for wrong, said in ((["--advice", "0 %"], "above zero"), (["--draws", "0"], "expected 1 to")):
        assert main(["stability", "--scene", str(path), *wrong]) == 2
        assert said in capsys.readouterr().err


def test_every_number_of_an_answer_has_an_interval():
    names = tuple(name for name in NAMES if name != "stiffness")
    document = to_dict(predict(MODEL, ALL, 2e-5, LOAD, covariance(0.01, names), names))
    for part in ("amplitude", "groups", "closed_forms"):
        for name, entry in document[part].items():
            if isinstance(entry, dict) and entry["value"] is not None:
                assert entry["interval"] and entry["interval"][0] < entry["value"] < entry["interval"][1], name
    for entry in (document["stability"]["sliding"]["friction_force"], document["stability"]["critical_speed"]):
        assert entry["interval"][0] < entry["value"] < entry["interval"][1]


def test_intervals_are_those_of_differences():
    """Half widths against answers at moved parameters; of 400 independent draws their standard error is 5 %."""
    values, names, speed = ALL | {"a": 3.0}, ("mass", "mu_s", "damping", "t_cr"), 2e-5
    sd = {name: 0.003 * values[name] for name in names}

    def told(changes, covariance=None):
        document = to_dict(predict(MODEL, values | changes, speed, LOAD, covariance, names))
        return document["amplitude"] | document["stability"]["sliding"] | document["closed_forms"]

    here = told({}, np.diag([step**2 for step in sd.values()]))
    plain, moved = told({}), [told({name: values[name] + step}) for name, step in sd.items()]
    for quantity in ("share_in_slip", "friction_force", "period", "critical_speed", "Pi_fc", "Omega_c"):
        moves = [there[quantity]["value"] - plain[quantity]["value"] for there in moved]
        low, high = here[quantity]["interval"]
        assert (high - low) / 2 == pytest.approx(1.959964 * np.linalg.norm(moves), rel=0.1), quantity


def test_an_open_interval_of_a_limit_says_why():
    names = ("mu_s", "t_cr")
    told = to_dict(
        stabilising_changes(MODEL, OperatingPoint(ALL, SPEED, LOAD, np.diag([1e-6, np.inf])), names, draws=5)
    )
    limit = told["changes"][0]["limit"]
    assert limit["interval"] == [None, None] and "these data do not tell t_cr" in limit["reason"]
    (line,) = (line for line in told["text"].splitlines() if line.startswith("- drive speed"))
    assert f"mm/s ({limit['reason']})" in line and "(interval open)" not in told["text"]
